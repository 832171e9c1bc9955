const get = id => document.getElementById(id);
const TYPES = {u1: Uint8Array, i1: Int8Array, u2: Uint16Array, u4: Uint32Array, f4: Float32Array};
const data = JSON.parse(get("data").textContent, (_, value) => {  // {"f4": "..."} is an array as base64
  const [type, ...others] = value && typeof value === "object" ? Object.keys(value) : [];
  return type in TYPES && !others.length ? new TYPES[type](Uint8Array.from(atob(value[type]), c => c.charCodeAt(0)).buffer) : value;
});
const {clock, tracks} = data, GAP = 8, COLOURS = {}, FONT = getComputedStyle(document.body).fontFamily;
const moments = clock.moments || Float32Array.from({length: clock.end + 1}, (_, k) => k);
let now = clock.begin, playing = false, last = 0, asked = false;
const C = new Proxy(COLOURS, {get: (known, name) => known[name] ??= getComputedStyle(document.documentElement).getPropertyValue("--" + name).trim()});

const clamp = (low, value, high) => Math.max(low, Math.min(high, value));
const rgb = hex => [1, 3, 5].map(k => parseInt(hex.slice(k, k + 2), 16));
const mix = (from, to, part) => { const a = rgb(from), b = rgb(to); return a.map((v, k) => Math.round(v + (b[k] - v) * part)); };
const css = c => "rgb(" + c.join() + ")";
const word = c => (255 << 24 | c[2] << 16 | c[1] << 8 | c[0]) >>> 0;
const short = v => Math.abs(v) >= 1e5 || (v && Math.abs(v) < 1e-3) ? v.toExponential(1) : String(Number(v.toPrecision(3)));
const before = (times, value) => {  // how many times are at or before a value
  let low = 0, high = times.length;
  while (low < high) { const k = (low + high) >> 1; if (times[k] <= value) low = k + 1; else high = k; }
  return low;
};
const momentOf = (track, k) => track.at ? before(track.at, now + 1e-4) - 1 : k;

function sheet(name, tall) {  // a canvas with as many pixels as the screen has; sizes are in CSS pixels
  const canvas = get(name), many = devicePixelRatio || 1;
  if (tall) canvas.style.height = tall + "px";
  const w = canvas.clientWidth, h = canvas.clientHeight;
  if (canvas.width !== Math.round(w * many)) canvas.width = Math.round(w * many);
  if (canvas.height !== Math.round(h * many)) canvas.height = Math.round(h * many);
  const pen = canvas.getContext("2d");
  pen.setTransform(many, 0, 0, many, 0, 0);
  pen.clearRect(0, 0, w, h);
  pen.lineJoin = pen.lineCap = "round"; pen.font = "11px " + FONT; pen.lineWidth = 1;
  return [pen, w, h];
}
const stroke = (pen, ...points) => { pen.beginPath(); for (const [x, y] of points) pen.lineTo(x, y); pen.stroke(); };
const words = (pen, text, x, y, colour = "soft", align = "right") => { pen.fillStyle = C[colour]; pen.textAlign = align; pen.fillText(text, x, y); };
const small = document.createElement("canvas");
function pixels(pen, columns, rows, box, fill) {  // a small picture, as large as its box
  small.width = columns; small.height = rows;
  const thin = small.getContext("2d"), image = thin.createImageData(columns, rows);
  fill(new Uint32Array(image.data.buffer));
  thin.putImageData(image, 0, 0);
  pen.imageSmoothingEnabled = false;
  pen.drawImage(small, ...box);
}
const fitting = (columns, rows, w, h) => {
  const scale = Math.min(w / columns, h / rows);
  return [(w - columns * scale) / 2, (h - rows * scale) / 2, columns * scale, rows * scale];
};
const framed = (pen, box) => { pen.strokeStyle = C.rule; pen.lineWidth = 1; pen.strokeRect(...box); };
function rowNames(pen, {labels = [], colours = ["soft"], size, name}, x, top, tall) {
  const high = tall / labels.length;
  labels.forEach((label, k) => { if (high >= 9) words(pen, label, x, top + (k + 0.5) * high + 4, colours[k % colours.length]); });
  if (!labels.length || high < 9) words(pen, `${size} ${name}`, x, top + tall / 2 + 4);
}

// Each kind of track draws itself: its data, the last moment (-1 before the first), the time.
const draws = {
  frames(track, k) {
    const image = get(track.name);
    image.onload = () => { image.style.imageRendering = image.naturalWidth < 150 ? "pixelated" : "auto"; };
    image.src = track.frames[Math.max(0, before(track.at, k) - 1)];
  },

  events(track, k, time) {
    const {width, height, place, t, unit, span, fade} = track, [pen, w, h] = sheet(track.name), box = fitting(width, height, w, h);
    pixels(pen, width, height, box, image => {
      image.fill(word(rgb(C.paper)));
      const shades = [C.off, C.on].map(c => fade.map(part => word(mix(C.paper, c, part))));
      for (let i = before(t, (time - span) / unit), end = before(t, time / unit); i < end; i++)
        image[place[i] >> 1] = shades[place[i] & 1][clamp(0, Math.floor((time - t[i] * unit) / span * fade.length), fade.length - 1)];
    });
    framed(pen, box);
    return [pen, ...box];
  },

  image(track, k) {
    const {rows, columns, values, shade: [from, to, power, below], marks, edge = 0} = track, size = rows * columns, own = momentOf(track, k);
    const row = clamp(5, 180 / rows, 26), [pen, w, h] = sheet(track.name, edge && 10 + row * rows), top = edge && 10;
    const shades = Array.from({length: 256}, (_, v) => below && v > 127 ? mix(C[from], C[below], ((256 - v) / 127) ** power)
      : mix(C[from], C[to], (v / (below ? 127 : 255)) ** power));
    const shown = i => shades[own < 0 ? 0 : values[own * size + i] & 255];
    if (track.tiles) for (let i = 0; i < size; i++) {
      const wide = w / columns, high = h / rows;
      pen.fillStyle = css(shown(i));
      pen.beginPath(); pen.roundRect((i % columns) * wide + 1, Math.floor(i / columns) * high + 1, wide - 2, high - 2, 2.5); pen.fill();
    } else {
      const box = edge ? [edge, top, w - edge, row * rows] : fitting(columns, rows, w, h);
      pixels(pen, columns, rows, box, image => { for (let i = 0; i < size; i++) image[i] = word(shown(i)); });
      if (!edge) framed(pen, box);
    }
    if (!edge) return;
    rowNames(pen, {...track, name: track.rowsOf}, edge - GAP, top, row * rows);
    pen.fillStyle = C.card;
    for (let n = 1; n < rows && row > 8; n++) pen.fillRect(edge, top + n * row - 0.5, w - edge, 1);
    pen.fillStyle = C.ink;
    for (let n = marks.first[k]; n < marks.first[k + 1]; n++) {
      const x = edge + (marks.places[n] + 0.5) / marks.of * (w - edge);
      pen.beginPath(); pen.moveTo(x - 3, 2); pen.lineTo(x + 3, 2); pen.lineTo(x, 9); pen.fill();
    }
  },

  raster(track, k, time) {  // of the last window, or of one around now, or of the trial of a moment
    const {strips, window, ends, lead = 0} = track, low = ends ? 18 : 0, own = momentOf(track, k);
    const [pen, w, h] = sheet(track.name, strips[0].height && strips.reduce((sum, s) => sum + s.height + GAP, -GAP));
    const named = s => (s.labels?.length ? s.labels : [`${s.size} ${s.name}`]).map(text => pen.measureText(text).width);
    const edge = track.edge || 10 + Math.max(...strips.flatMap(named));
    const from = ends ? 0 : lead ? clamp(0, time - Math.round((1 - lead) * window), Math.max(0, clock.end + 1 - window)) : time - window;
    const scale = (w - edge) / window, X = t => edge + (t - from) * scale;
    let top = 0;
    for (const s of strips) {
      const tall = s.height || h - low, row = tall / s.size, wide = Math.max(ends ? 2 : 1, (s.each || 0) * scale + (s.level ? 0.3 : -0.5));
      const dot = s.level ? row + 0.3 : Math.max(ends ? 2 : 1.2, row - (row > 3)), shades = Array.from({length: 256}, (_, v) => css(mix(C.paper, C.accent, v / 255)));
      pen.fillStyle = C.paper; pen.fillRect(edge, top, w - edge, tall);
      rowNames(pen, s, edge - GAP, top, tall);
      pen.strokeStyle = C.rule;
      for (let n = 1; s.labels && s.labels.length < s.size && n < s.labels.length; n++) stroke(pen, [edge, top + n * tall / s.labels.length], [w, top + n * tall / s.labels.length]);
      const first = ends ? ends[Math.max(0, own)] : before(s.times, from - (lead ? 1e-4 : 0)), until = ends ? ends[own + 1] : before(s.times, lead ? from + window - 1e-4 : time);
      pen.save(); pen.beginPath(); pen.rect(edge, top, w - edge, tall); pen.clip();
      pen.fillStyle = C.ink;
      for (let i = first; i < until; i++) {
        if (s.level) pen.fillStyle = shades[s.level[i]];
        else if (s.colours) pen.fillStyle = C[s.colours[s.ids[i] % s.colours.length]];
        pen.fillRect(X(s.times[i]) - (lead || ends ? 0 : wide), top + Math.min(tall - dot, s.ids[i] * row), wide, dot);
      }
      pen.restore();
      top += tall + GAP;
    }
    if (ends) { words(pen, "0", edge, h - 4, "soft", "left"); words(pen, window + " ms", w, h - 4); }
    if (lead) { pen.fillStyle = C.off; pen.globalAlpha = 0.75; pen.fillRect(X(time) + scale / 2 - 0.75, 0, 1.5, h); pen.globalAlpha = 1; }
  },

  curve(track, k, time) {  // lines in lanes along the whole time, or the last window, or an axis of its own
    const {lanes, window, edge = 86, axis, stop, fades} = track, [pen, w, h] = sheet(track.name), right = w - (track.right || 4), floor = h - (axis ? 18 : 0);
    const from = window ? time - window : 0, span = window || track.end || clock.end || 1, X = t => edge + (t - from) / span * (right - edge);
    const tall = floor / lanes.length, gap = lanes.length > 1 ? 6 : 0;
    track.timeAt = x => (x - edge) / (right - edge) * span;
    const line = ({x = moments, y, style, colour, width = 1.6}, Y) => {
      const part = {begin: Math.max(0, before(x, from) - 1), end: window ? before(x, time) : x.length};
      const points = Array.from({length: part.end - part.begin}, (_, i) => [X(x[part.begin + i]), Y(y[part.begin + i])]).filter(p => Number.isFinite(p[1]));
      pen.fillStyle = pen.strokeStyle = C[colour]; pen.lineWidth = width;
      if (style === "dots") { pen.globalAlpha = 0.45; for (const [x, y] of points) pen.fillRect(x - 1.5, y - 1.5, 3, 3); pen.globalAlpha = 1; }
      else if (style === "crosses") for (const [x, y] of points) for (const way of [4, -4]) stroke(pen, [x - 4, y - way], [x + 4, y + way]);
      else if (style === "area") {
        pen.beginPath(); for (const [x, y] of [[X(0), Y(0)], ...points, [X(span), Y(0)]]) pen.lineTo(x, y);
        pen.fill(); }
      else if (style === "steps") stroke(pen, ...points.slice(1).flatMap(([x, y], i) => [[points[i][0], y], [x, y]]));
      else stroke(pen, ...points);
      if (style === "rings") for (const [x, y] of points) { pen.beginPath(); pen.arc(x, y, 2.6, 0, 7); pen.fill(); }
    };
    const clipped = (left, end, alpha, paint) => {
      pen.save(); pen.beginPath(); pen.rect(left, 0, end - left, h); pen.clip(); pen.globalAlpha = alpha; paint(); pen.restore();
    };
    const marks = axis ? rounds(0, span, Math.min(10, Math.floor((right - edge) / 70))) : [];
    lanes.forEach((lane, n) => {
      const top = n * tall, high = tall - gap, Y = v => top + 3 + (high - 6) * (lane.high - v) / (lane.high - lane.low || 1);
      pen.fillStyle = C.paper; pen.fillRect(edge, top, right - edge, high);
      pen.strokeStyle = C.faint;
      for (const t of marks) stroke(pen, [X(t), top], [X(t), top + high]);
      pen.strokeStyle = C.rule;
      for (const v of rounds(lane.low, lane.high, lane.marks || 0)) {
        words(pen, short(v) + (lane.unit || ""), edge - GAP, clamp(top + 9, Y(v) + 4, top + high - 1));
        stroke(pen, [edge, Y(v)], [right, Y(v)]);
      }
      if (lane.zero) stroke(pen, [edge, Y(0)], [right, Y(0)]);
      if (lane.name) words(pen, lane.name, 0, top + high / 2 + 4, lane.lines[0].colour, "left");
      const paint = () => lane.lines.forEach(each => line(each, Y));
      if (fades) { clipped(0, X(time), 1, paint); clipped(X(time), w, 0.28, paint); } else clipped(window ? edge : 0, w, 1, paint);
      const ends = lane.lines.filter(each => each.name).map(each => [Y(each.y[each.y.length - 1]), each]).filter(p => Number.isFinite(p[0]));
      const places = [];
      ends.sort((a, b) => (b[1].width || 0) - (a[1].width || 0) || a[0] - b[0]).forEach(([y, each], i) => {
        if (!track.right) words(pen, each.name, edge - GAP, top + high / 2 + 4 + 20 * (lane.lines.indexOf(each) - (lane.lines.length - 1) / 2), each.colour);
        else if (!places.some(p => Math.abs(p - y) < 11)) { places.push(y); words(pen, each.name.slice(0, 10), right + 4, Math.min(floor, y + 4), each.width > 2 ? each.colour : "soft", "left"); }
      });
      if (track.cursor && lane.lines.length === 1 && k >= 0) { pen.fillStyle = C[lane.lines[0].colour]; pen.beginPath(); pen.arc(Math.min(w - 4, X(time)), Y(lane.lines[0].y[k]), 3.2, 0, 7); pen.fill(); }
    });
    marks.forEach((t, n) => words(pen, t.toLocaleString("en") + (n === marks.length - 1 ? " " + axis : ""), clamp(14, X(t), w - 34), h - 3, "soft", "center"));
    if (stop) {
      const x = X(stop.at), side = x > w / 2 ? -6 : 6;
      pen.strokeStyle = C.off; pen.lineWidth = 1.6; pen.setLineDash([5, 4]); stroke(pen, [x, 0], [x, floor]); pen.setLineDash([]);
      words(pen, stop.text, x + side, 13, "off", side < 0 ? "right" : "left");
    }
    if (track.cursor) { pen.fillStyle = C[track.cursor]; pen.globalAlpha = 0.7; pen.fillRect(Math.min(w - 2, X(time)), 0, 1.5, floor); pen.globalAlpha = 1; }
  },

  bars(track, k) {  // a row for each value, from 0 to it, or a mark where it lies
    const {labels, values, low, high, lit, mark, unit, factor = 1, colours = ["accent"]} = track, many = labels.length;
    const [pen, w, h] = sheet(track.name, track.row && track.row * many), row = track.row || Math.min(34, h / many);
    const size = clamp(8, row - 4, track.row ? 11 : 13), room = 8 + Math.max(...labels.map(text => pen.measureText(text).width)) * size / 10, end = w - (unit === undefined ? 8 : 52);
    labels.forEach((label, c) => {
      const value = k < 0 ? NaN : values[many * k + c], on = k >= 0 && lit && lit[many * k + c], y = c * row, least = low[c % low.length], most = high[c % high.length];
      const X = v => room + (most > least ? clamp(0, (v - least) / (most - least), 1) : 0.5) * (end - room), zero = X(clamp(least, 0, most));
      pen.font = (on ? "bold " : "") + size + "px " + FONT;
      if (row >= 11 || c % 2 === 0) words(pen, label, room - GAP, y + row / 2 + 4, on ? colours[c % colours.length] : "soft");
      pen.fillStyle = C.faint; pen.fillRect(room, y + 2, end - room, row - 4);
      if (!Number.isFinite(value)) return;
      pen.fillStyle = C[on || mark ? colours[c % colours.length] : "grey"];
      if (mark) pen.fillRect(X(value) - 2, y + 1, 4, row - 2);
      else pen.fillRect(Math.min(X(value), zero), y + 2, Math.max(1.5, Math.abs(X(value) - zero)), row - 4);
      if (unit !== undefined && row >= 11) words(pen, (unit ? (factor * value).toFixed(0) : short(value)) + unit, w, y + row / 2 + 4, on ? "ink" : "soft");
    });
  },
};

function draw() {
  asked = false;
  const k = before(moments, now + 1e-4) - 1, time = clock.moments ? now : k, {scale, digits, unit} = clock;
  for (const track of tracks) {
    draws[track.kind](track, k, time);
    if (track.notes) get(track.name + "Note").textContent = track.notes[momentOf(track, k) + 1];
  }
  const shown = t => (t * scale).toFixed(digits);
  get("now").textContent = clock.label + shown(time) + " of " + shown(clock.end) + unit;
  for (const {name, values, digits, unit} of clock.readouts)
    get(name).textContent = Number.isFinite(values[k]) ? (digits === null ? short(values[k]) : values[k].toFixed(digits)) + unit : "–";
  get("time").value = now;
}
function ask() { if (!asked) { asked = true; requestAnimationFrame(draw); } }
function go(time) { now = clamp(0, time, clock.end); ask(); }
function tick(stamp) {
  if (!playing) return;
  if (last) { now += (stamp - last) * clock.rate * get("speed").value; if (now >= clock.end) { now = clock.end; play(false); } draw(); }
  last = stamp;
  if (playing) requestAnimationFrame(tick);
}
function play(on) {
  playing = on; last = 0; get("play").textContent = on ? "Pause" : "Play";
  if (on) { if (now >= clock.end) now = 0; requestAnimationFrame(tick); }
}
function move(by) {  // to another moment
  const k = before(moments, now + 1e-4) - 1 + by;
  if (moments.length) go(k < 0 ? 0 : moments[Math.min(moments.length - 1, k)]);
}
clock.speeds.forEach(([text, factor], k) => get("speed").add(new Option(text, factor, k === clock.speed, k === clock.speed)));
for (const track of tracks) {
  if (track.click) get(track.name).style.cursor = "pointer", get(track.name).onclick = event => go(clock.moments ? track.timeAt(event.offsetX) : Math.round(track.timeAt(event.offsetX)));
  if (track.place && track.first) {  // events by the step in which they came
    track.t = new Uint32Array(track.place.length);
    for (let k = 0; k + 1 < track.first.length; k++) track.t.fill(k, track.first[k], track.first[k + 1]);
  }
}
get("time").max = clock.end; get("time").step = clock.moments ? "any" : 1;
get("time").oninput = () => go(Number(get("time").value));
get("play").onclick = () => play(!playing);
addEventListener("resize", ask);
addEventListener("keydown", event => {
  if (event.target.tagName === "SELECT" || event.target.tagName === "BUTTON" && event.key === " ") return;
  if (event.key === " ") { event.preventDefault(); play(!playing); }
  if (event.key === "ArrowRight" || event.key === "ArrowLeft") { event.preventDefault(); move((event.key === "ArrowRight" ? 1 : -1) * (event.shiftKey ? clock.shift : 1)); }
});
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { for (const name in COLOURS) delete COLOURS[name]; ask(); });
