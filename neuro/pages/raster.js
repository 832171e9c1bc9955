"use strict";
// All rasters and curves of a page show the same time, as a share of the run; each strip of a raster a share of its neurons.
const rasters = [], curves = [];
let from = 0, to = 1;

function unpacked(text) {  // differences of keys, 7 bits a byte, the lowest first
  const bytes = atob(text), keys = [];
  for (let k = 0, key = 0, gap = 0, place = 1; k < bytes.length; k++) {
    const byte = bytes.charCodeAt(k);
    gap += (byte & 127) * place;
    place *= 128;
    if (byte < 128) { key += gap; keys.push(key); gap = 0; place = 1; }
  }
  return keys;
}

function read(figure) {
  const data = JSON.parse(figure.querySelector("script").textContent);
  for (const strip of data.strips) {
    strip.low = 0; strip.high = strip.rows; strip.ids = unpacked(strip.neurons);
    strip.dots = Object.entries(strip.kinds).map(([kind, text]) => {
      const keys = unpacked(text), step = new Float64Array(keys.length), row = new Uint32Array(keys.length);
      keys.forEach((key, k) => { step[k] = Math.floor(key / strip.rows); row[k] = key % strip.rows; });
      return {kind, step, row};
    });
  }
  const canvas = figure.querySelector("canvas");
  const raster = {...data, canvas, pen: canvas.getContext("2d"), output: figure.querySelector("output"), drag: null};
  listen(figure, raster);
  rasters.push(raster);
}

const HEAD = 20, FOOT = 26, SIDE = 6;
const place = (raster, ms) => SIDE + (raster.width - 2 * SIDE) * (ms / raster.ms - from) / (to - from);
const time = (raster, x) => raster.ms * (from + (to - from) * (x - SIDE) / (raster.width - 2 * SIDE));

function draw(raster) {
  const {canvas, pen} = raster, style = getComputedStyle(canvas), sharp = devicePixelRatio || 1;
  const colour = name => style.getPropertyValue("--" + name);
  raster.width = canvas.parentElement.clientWidth;
  const height = raster.strips.reduce((sum, strip) => sum + HEAD + strip.height, FOOT);
  canvas.width = Math.round(raster.width * sharp); canvas.height = Math.round(height * sharp);
  canvas.style.height = height + "px";
  pen.setTransform(sharp, 0, 0, sharp, 0, 0);
  let top = 0;
  for (const strip of raster.strips) {
    strip.top = top + HEAD;
    pen.font = "600 12.5px " + style.fontFamily; pen.textAlign = "left"; pen.fillStyle = colour("ink");
    const name = fitting(pen, strip.name, raster.width - 2 * SIDE - 12 - 6.5 * strip.about.length);
    pen.fillText(name, SIDE, strip.top - 6);
    const after = SIDE + pen.measureText(name).width + 10;
    pen.font = "11.5px " + style.fontFamily; pen.fillStyle = colour("soft"); pen.fillText(strip.about, after, strip.top - 6);
    const ids = `neurons ${id(strip, strip.low)} to ${id(strip, strip.high - 1)}`, end = after + pen.measureText(strip.about).width;
    if (strip.rows > 1 && end + pen.measureText(ids).width + 14 < raster.width) {
      pen.textAlign = "right"; pen.fillText(ids, raster.width - SIDE, strip.top - 6);
    }
    pen.fillStyle = colour("field"); pen.fillRect(0, strip.top, raster.width, strip.height);
    spikes(raster, strip, colour);
    top = strip.top + strip.height;
  }
  axis(raster, top, colour, style.fontFamily);
  if (raster.drag) {
    const {x, y, strip, right, below} = raster.drag, tall = rows(raster.drag);
    pen.fillStyle = colour("accent"); pen.globalAlpha = 0.18;
    pen.fillRect(Math.min(x, right), tall ? Math.min(y, below) : strip.top, Math.abs(right - x), tall ? Math.abs(below - y) : strip.height);
    pen.globalAlpha = 1;
  }
}

const id = (strip, row) => strip.ids.length ? strip.ids[row] : row;

function fitting(pen, text, room) {
  if (pen.measureText(text).width <= room) return text;
  let n = text.length;
  while (n > 4 && pen.measureText(text.slice(0, n) + "…").width > room) n--;
  return text.slice(0, n) + "…";
}

function spikes(raster, strip, colour) {
  const {pen} = raster, each = strip.height / (strip.high - strip.low), tall = Math.max(1.2, Math.min(each * 0.8, 12));
  const first = from * raster.ms / raster.step, last = to * raster.ms / raster.step;
  pen.save(); pen.beginPath(); pen.rect(0, strip.top, raster.width, strip.height); pen.clip();
  const wide = (raster.width - 2 * SIDE) * raster.step / (raster.ms * (to - from));
  const thick = Math.max(1.2, Math.min(wide * 0.8, 3));
  for (const {kind, step, row} of strip.dots) {
    pen.fillStyle = colour(kind);
    let k = 0, high = step.length;
    while (k < high) { const mid = (k + high) >> 1; if (step[mid] < first) k = mid + 1; else high = mid; }
    for (; k < step.length && step[k] <= last; k++) {
      if (row[k] < strip.low || row[k] >= strip.high) continue;
      const y = strip.top + strip.height - (row[k] - strip.low + 0.5) * each;
      pen.fillRect(place(raster, step[k] * raster.step) - thick / 2, y - tall / 2, thick, tall);
    }
  }
  if (strip.mark !== null) {
    const x = place(raster, strip.mark);
    pen.setLineDash([4, 3]); pen.strokeStyle = colour("ink"); pen.beginPath();
    pen.moveTo(x, strip.top); pen.lineTo(x, strip.top + strip.height); pen.stroke(); pen.setLineDash([]);
  }
  pen.restore();
}

function ticks(whole, most) {  // round times of the part that is shown, the last with its unit
  const rough = whole * (to - from) / most, ten = 10 ** Math.floor(Math.log10(rough));
  const step = [1, 2, 5, 10].map(n => n * ten).find(n => n >= rough * 0.999), found = [];
  const digits = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  for (let k = Math.ceil(from * whole / step - 1e-9); k * step <= to * whole * (1 + 1e-12); k++)
    found.push({ms: k * step, text: (k * step).toFixed(digits) + (k * step + step > to * whole ? " ms" : "")});
  return found;
}

function follow(curve) {
  const {lines, times, ms, left, wide, y} = curve;
  for (const part of lines) {
    const height = part.viewBox.baseVal.height;
    part.setAttribute("viewBox", `${from * wide} 0 ${(to - from) * wide} ${height}`);
  }
  const made = (name, words, text = "") => {
    const part = document.createElementNS(times.namespaceURI, name);
    for (const [word, value] of Object.entries(words)) part.setAttribute(word, value);
    part.textContent = text;
    return part;
  };
  times.replaceChildren(...ticks(ms, 3).flatMap(tick => {
    const x = left + wide * (tick.ms / ms - from) / (to - from), end = x > left + wide - 26;
    return [made("line", {x1: x, y1: y, x2: x, y2: y + 4, class: "axis"}),
      made("text", {x, y: y + 17, class: "tick", "text-anchor": end ? "end" : "middle"}, tick.text)];
  }));
}

function readCurve(svg) {
  const times = svg.querySelector(".times"), number = name => Number(times.dataset[name]);
  const curve = {lines: [...svg.querySelectorAll(".lines")], times, ms: number("ms"), left: number("left"), wide: number("wide"), y: number("y")};
  const share = event => {
    const box = svg.getBoundingClientRect(), x = (event.clientX - box.left) / box.width * svg.viewBox.baseVal.width;
    return from + (to - from) * Math.max(0, Math.min(1, (x - curve.left) / curve.wide));
  };
  let begin = null;
  svg.onpointerdown = event => { begin = share(event); svg.setPointerCapture(event.pointerId); };
  svg.onpointercancel = () => { begin = null; };
  svg.onpointerup = event => {
    const end = share(event);
    if (begin !== null && Math.abs(end - begin) > 0.02 * (to - from)) show(Math.min(begin, end), Math.max(begin, end));
    begin = null;
  };
  svg.ondblclick = whole;
  curves.push(curve);
}

function axis(raster, top, colour, family) {
  const {pen} = raster;
  pen.font = "11.5px " + family; pen.fillStyle = colour("soft"); pen.strokeStyle = colour("soft");
  for (const {ms, text} of ticks(raster.ms, Math.max(2, Math.floor(raster.width / 90)))) {
    const x = place(raster, ms);
    const half = pen.measureText(text).width / 2;
    pen.beginPath(); pen.moveTo(x, top); pen.lineTo(x, top + 4); pen.stroke();
    pen.textAlign = "center";
    pen.fillText(text, Math.max(half, Math.min(raster.width - half, x)), top + 17);
  }
}

let asked = false;
function ask() {
  if (asked) return;
  asked = true;
  requestAnimationFrame(() => { asked = false; rasters.forEach(draw); curves.forEach(follow); });
}

function show(a, b) {
  const least = rasters.length ? Math.min(1, 4 * rasters[0].step / rasters[0].ms) : 1e-4, span = Math.max(least, Math.min(1, b - a));
  from = Math.max(0, Math.min(1 - span, a)); to = from + span;
  ask();
}

const rows = drag => Math.abs(drag.below - drag.y) > 10 && Math.abs(drag.right - drag.x) > 3;
const zoom = (factor, at = (from + to) / 2) => show(at - (at - from) * factor, at + (to - at) * factor);
function whole() {
  for (const {strips} of rasters) for (const strip of strips) { strip.low = 0; strip.high = strip.rows; }
  show(0, 1);
}

function listen(figure, raster) {
  const {canvas} = raster;
  const inside = event => { const box = canvas.getBoundingClientRect(); return [event.clientX - box.left, event.clientY - box.top]; };
  const strip = y => raster.strips.find(s => y >= s.top && y < s.top + s.height);
  const neuron = (s, y) => s.low + (s.top + s.height - y) / s.height * (s.high - s.low);
  const actions = {in: () => zoom(0.5), out: () => zoom(2), whole, left: () => show(from - (to - from) / 2, to - (to - from) / 2),
    right: () => show(from + (to - from) / 2, to + (to - from) / 2)};
  for (const button of figure.querySelectorAll("button")) button.onclick = actions[button.name];
  const keys = {"+": "in", "=": "in", "-": "out", "0": "whole", ArrowLeft: "left", ArrowRight: "right"};
  canvas.onkeydown = event => { if (keys[event.key]) { event.preventDefault(); actions[keys[event.key]](); } };
  canvas.ondblclick = whole;
  canvas.addEventListener("wheel", event => {
    if (!event.ctrlKey && !event.metaKey) return;  // the wheel alone moves the page
    event.preventDefault();
    zoom(event.deltaY < 0 ? 0.8 : 1.25, time(raster, inside(event)[0]) / raster.ms);
  }, {passive: false});
  canvas.onpointerdown = event => {
    const [x, y] = inside(event), found = strip(y);
    if (found) { canvas.setPointerCapture(event.pointerId); raster.drag = {x, y, right: x, below: y, strip: found}; }
  };
  canvas.onpointermove = event => {
    const [x, y] = inside(event), found = strip(y);
    const at = Math.max(0, Math.min(raster.ms, time(raster, x)));
    const row = found ? Math.max(0, Math.min(found.rows - 1, Math.floor(neuron(found, y)))) : 0;
    raster.output.textContent = found ? `${found.name}: neuron ${id(found, row)}, ${at.toFixed(1)} ms` : "";
    if (raster.drag) { raster.drag.right = x; raster.drag.below = y; ask(); }
  };
  canvas.onpointercancel = () => { raster.drag = null; ask(); };
  canvas.onpointerup = () => {
    const drag = raster.drag;
    raster.drag = null;
    if (drag && rows(drag)) {
      const s = drag.strip, ends = [drag.y, drag.below].map(y => neuron(s, Math.max(s.top, Math.min(s.top + s.height, y)))).sort((a, b) => a - b);
      const low = Math.floor(ends[0]), high = Math.max(low + 1, Math.ceil(ends[1]));
      for (const each of raster.together ? raster.strips : [s]) { each.low = low; each.high = high; }
    }
    if (drag && Math.abs(drag.right - drag.x) > 3) {
      const ends = [drag.x, drag.right].map(x => time(raster, x) / raster.ms).sort((a, b) => a - b);
      show(...ends);
    } else ask();
  };
}

document.querySelectorAll("figure.raster").forEach(read);
document.querySelectorAll("svg.curves").forEach(readCurve);
addEventListener("resize", ask);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", ask);
function linked() {  // page.html#200-400 shows these ms
  const span = /^#([\d.]+)-([\d.]+)$/.exec(location.hash);
  const whole = (rasters[0] || curves[0] || {}).ms;
  if (span && whole) show(span[1] / whole, span[2] / whole);
}
addEventListener("hashchange", linked);
linked();
rasters.forEach(draw);
