"use strict";
// One WebSocket carries everything: texts that are valid until a text with the same key, frames, answers and files.
const get = id => document.getElementById(id);
const MOST_SHOWN = 24, FIRST_SHOWN = 12, DASHES = [[], [7, 3], [2, 2]], KEPT_MS = 10000, SIDE = 8, LEFT = 46, FOOT = 20;
let about = null, state = {}, kept = {}, history = [], rates = [], colours = {}, now = 0, span = 1000, asked = false, socket = null, tries = 0;
let part = "", number = 0, waiting = new Map(), shown = [], raster = null, bands = [], drawn = 0, counted = performance.now(), pictures = new Map();

function make(name, words = {}, ...inside) {
  const element = document.createElement(name);
  for (const [word, value] of Object.entries(words)) if (word in element) element[word] = value; else element.setAttribute(word, value);
  element.append(...inside.filter(each => each !== null));
  return element;
}
function shape(name, words = {}, ...inside) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", name);
  for (const [word, value] of Object.entries(words)) element.setAttribute(word, value);
  element.append(...inside);
  return element;
}
function short(value) {
  if (!Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  return size === 0 ? "0" : size >= 1e6 || size < 1e-3 ? value.toExponential(2) : String(Number(value.toPrecision(4)));
}
const named = (count, noun) => count.toLocaleString("en") + " " + noun + (count === 1 ? "" : "s");
const hertz = value => (value < 100 ? Number(value.toFixed(value < 10 ? 2 : 1)) : Math.round(value)) + " Hz";
const stored = (word, value) => { try { if (value === undefined) return sessionStorage.getItem(word); sessionStorage.setItem(word, value); } catch { return null; } };

// --- the connection

function connect() {
  const address = new URL("socket", location.href);
  address.protocol = "ws:";
  socket = new WebSocket(address);
  socket.binaryType = "arraybuffer";
  socket.onopen = () => { tries = 0; get("lost").hidden = true; };
  socket.onmessage = event => typeof event.data === "string" ? heard(JSON.parse(event.data)) : received(event.data);
  socket.onclose = () => {
    get("lost").hidden = false;
    get("lost").textContent = tries ? "The simulation has ended, or too many browsers look at it." : "The connection is lost; trying again.";
    setTimeout(connect, Math.min(5000, 500 * 2 ** tries++));
  };
}
function ask(what, row = null) {
  if (!socket || socket.readyState !== WebSocket.OPEN) return;
  waiting.set(++number, row);
  socket.send(JSON.stringify({...what, id: number}));
}
function heard(message) {
  if (message.keep === undefined) return answered(message);
  if (message.fresh) kept = {};
  kept[message.keep] = message;
  const [kind] = message.keep.split("/");
  const shows = {about: begin, state: showState, begun: forget, value: showValue, weights: showWeights, joules: showJoules, figures: showFigures, curve: showCurve,
    trouble: ({error}) => { if (error || get("message").className) say(error, Boolean(error)); }};
  if (shows[kind]) shows[kind](message);
}
function answered(message) {
  const row = waiting.get(message.id);
  waiting.delete(message.id);
  if (row) row(message.error || "", message);
  else if (message.error) say(message.error, true);
}
let clearing = 0;
function say(text, bad = false) {
  get("message").textContent = text; get("message").className = bad ? "bad" : "";
  clearTimeout(clearing);
  if (text) clearing = setTimeout(() => say(""), bad ? 12000 : 4000);
}
function received(data) {
  const [headSize] = new Uint32Array(data, 0, 2), head = JSON.parse(new TextDecoder().decode(new Uint8Array(data, 8, headSize)));
  const body = data.slice(8 + headSize);
  if (head.file) { waiting.delete(head.id); return download(new Blob([body]), head.file); }
  let at = 0;
  const take = (kind, count) => { const found = new kind(body, at, count); at += found.byteLength; return found; };
  const frame = {from: head.began, to: head.time, spikes: [], traces: new Map()};
  for (const [population, count] of head.spikes) frame.spikes.push({population, steps: take(Uint32Array, count), ids: take(Uint32Array, count)});
  const line = (count, columns) => {
    const times = take(Float32Array, count), values = Array.from({length: columns}, () => take(Float32Array, count));
    return {times, values};
  };
  for (const [index, count, columns] of head.traces) frame.traces.set("probe" + index, line(count, columns));
  if (head.watched) frame.traces.set("watched", line(head.watched.samples, 1));
  for (const [index, layers, rows, columns] of head.cameras) {
    const size = layers * rows * columns;
    see(index, layers, rows, columns, take(Uint8Array, size));
    at += (4 - size % 4) % 4;
  }
  if (frame.to < now) forget({time: frame.from});
  history.push(frame);
  remember(frame, head.rates);
  while (history.length && history[0].to < frame.to - KEPT_MS) history.shift();
  now = frame.to;
  if (raster) paint(frame);
  get("pace").textContent = head.speed ? short(Number(head.speed.toPrecision(2))) + " × real time" : "";
  redraw();
}
function remember(frame, values) {  // rates, smoothed over 50 ms
  const last = rates[rates.length - 1], share = last ? 1 - Math.exp(-(frame.to - frame.from) / 50) : 1;
  rates.push({time: frame.to, values: values.map((value, k) => last ? last.values[k] + share * (value - last.values[k]) : value)});
  while (rates.length && rates[0].time < frame.to - KEPT_MS) rates.shift();
}
function forget(message) {
  history = []; rates = []; now = message.time;
  if (raster) raster.pen.clearRect(0, 0, raster.ring.width, raster.ring.height);
  redraw();
}
function download(blob, name) {
  const link = make("a", {href: URL.createObjectURL(blob), download: name});
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10000);
  say(name + " is saved");
}

// --- the network

function begin(message) {
  about = message;
  history = []; rates = []; now = 0; pictures = new Map();
  document.title = about.name + " · neuro live";
  get("name").textContent = about.name;
  const neurons = about.populations.reduce((sum, p) => sum + p.size, 0), synapses = about.projections.reduce((sum, p) => sum + p.size, 0);
  get("told").textContent = `${named(neurons, "neuron")}, ${named(synapses, "synapse")} · ${about.backend} · steps of ${about.resolution} ms · seed ${about.seed}`;
  document.querySelectorAll(".paced").forEach(each => { each.hidden = !about.paced; });
  document.querySelectorAll(".seeds").forEach(each => { each.hidden = !about.seeds; });
  get("seed").value = about.seed;
  const groups = [["populations", about.populations], ["projections", about.projections], ["signals", about.signals]].filter(([, parts]) => parts.length);
  get("part").replaceChildren(...groups.map(([label, parts]) => make("optgroup", {label}, ...parts.map(p => new Option(p.name, p.name)))));
  get("projection").replaceChildren(...about.projections.map(p => new Option(p.name, p.name)));
  get("projection").value = stored("projection") || (about.projections.find(p => p.learns) || about.projections[0] || {}).name;
  if (get("projection").selectedIndex < 0) get("projection").selectedIndex = 0;
  get("weights-here").hidden = !about.projections.length;
  const cameras = about.populations.filter(p => p.camera);
  const computes = about.populations.some(p => p.kind === "neuron");
  get("cameras").hidden = !cameras.length;
  get(computes ? "right" : "middle").prepend(get("cameras"));
  get("power").hidden = !computes;
  layShown();
  get("spikes-here").hidden = !about.populations.some(p => p.records && p.size);
  get("pictures").replaceChildren();
  get("curve-here").hidden = true;
  nodes.clear(); centre = "";
  const first = about.populations.find(p => p.kind === "neuron") || about.populations[0];
  choose([part, stored("part")].find(name => name && found(name)) || first.name);
  resize();
}
const found = name => [...about.populations, ...about.projections, ...about.signals].find(each => each.name === name);

// --- which populations the raster and the rates show

function layShown() {
  const all = about.populations.map((_, k) => k).filter(k => about.populations[k].kind !== "current" && about.populations[k].size);
  const first = all.filter(k => about.populations[k].kind === "neuron" || about.populations[k].records), names = JSON.parse(stored("shown/" + about.name));
  shown = names ? all.filter(k => names.includes(about.populations[k].name)).slice(0, MOST_SHOWN) : (first.length ? first : all).slice(0, FIRST_SHOWN);
  get("chooser").hidden = all.length < 2;
  get("choices").replaceChildren(...all.map(k => {
    const box = make("input", {type: "checkbox", value: k});
    box.onchange = () => show(all.filter(each => each === k ? box.checked : shown.includes(each)));
    return make("label", {}, box, make("span", {}, about.populations[k].name));
  }));
  filter();
  showLegend();
}
function filter() {
  const text = get("filter").value.toLowerCase();
  for (const label of get("choices").children) label.hidden = !label.textContent.toLowerCase().includes(text);
}
function show(indices) {
  shown = indices;
  stored("shown/" + about.name, JSON.stringify(shown.map(k => about.populations[k].name)));
  showLegend();
  resize();
}
function showLegend() {
  for (const box of get("choices").querySelectorAll("input")) {
    box.checked = shown.includes(Number(box.value));
    box.disabled = !box.checked && shown.length >= MOST_SHOWN;
  }
  const all = get("choices").children.length, told = `${shown.length} of ${all} populations`;
  get("shown-told").textContent = told + (shown.length >= MOST_SHOWN ? `, at most ${MOST_SHOWN}` : "");
  get("spikes-told").textContent = shown.length < all ? told : "";
  get("legend").replaceChildren(...shown.map((k, place) => {
    const line = shape("line", {x1: 0, x2: 22, y1: 4, y2: 4, "stroke-dasharray": DASHES[Math.floor(place / 8)].join(" ")}), swatch = shape("svg", {width: 22, height: 8}, line);
    swatch.style.color = `var(--${hue(k)})`;
    return make("li", {}, swatch, about.populations[k].name, make("small"));
  }));
  tint();
}
const place = index => shown.indexOf(index);
const hue = index => place(index) < 0 ? "soft" : "item" + place(index) % 8;

// --- one part: its properties and settings

function choose(name) {
  part = name;
  stored("part", name);
  get("part").value = name;
  chooseInGraph();
  const p = found(name), inside = [], rows = make("div");
  if (p.model) {
    inside.push(facts([["model", p.model], ["neurons", p.size.toLocaleString("en") + (p.shape.length > 1 ? ` (${p.shape.join(" × ")})` : "")],
      ["from", links(about.projections.filter(q => q.to === name), q => q.from)], ["to", links(about.projections.filter(q => q.from === name), q => q.to)]]));
    inside.push(...actions(p));
  } else if (p.synapse) {
    inside.push(facts([["from", links([found(p.from)])], ["to", links([found(p.to)])], ["synapse", p.synapse + (p.learns ? ", learns" : "")], ...(p.dopamine ? [["dopamine from", links([found(p.dopamine)])]] : []), ["synapses", p.size.toLocaleString("en")]]));
    get("projection").value = name;
    if (kept["weights/" + name]) showWeights(kept["weights/" + name]);
  } else inside.push(facts([["signal to", links([found(p.to)])]]));
  get("inside").replaceChildren(...inside, rows);
  ask({do: "sliders", part: name}, (error, {sliders}) => rows.replaceChildren(...error ? [make("p", {}, error)] : sliders.map(each => slider(p, each))));
}
function links(parts, text = p => p.name) {  // to parts of the network, each a button
  if (!parts.length) return "–";
  const most = 12, list = make("span", {className: "links"}, ...parts.slice(0, most).map(p => {
    const link = make("button", {className: "link", title: p.name}, text(p));
    link.onclick = () => choose(p.name);
    return link;
  }));
  if (parts.length > most) list.append(`and ${parts.length - most} more`);
  return list;
}
const facts = rows => make("dl", {}, ...rows.flatMap(([word, value]) => [make("dt", {}, word), make("dd", {}, value)]));
function actions(p) {
  const rows = [];
  if (about.projections.some(q => q.from === p.name)) {
    const silent = (state.silenced || []).includes(p.name);
    const button = make("button", {className: "plain", id: "silence", title: "the weights of all synapses from it become 0"}, silent ? "Restore" : "Silence");
    button.setAttribute("aria-pressed", silent);
    button.onclick = () => ask({do: silent ? "restore" : "silence", population: p.name});
    rows.push(make("div", {className: "row"}, button, make("span", {}, silent ? "its synapses are cut" : "cuts its synapses")));
  }
  if (p.driven) {
    const rate = make("input", {type: "number", min: 0, step: "any", value: 50, "aria-label": "rate in Hz"});
    const drive = make("button", {className: "plain"}, "Drive");
    drive.onclick = () => ask({do: "activate", population: p.name, rate: Number(rate.value)});
    rows.push(make("div", {className: "row"}, drive, make("label", {}, rate, "Hz, by Poisson spikes")));
  }
  if (Object.keys(p.states).length) {
    const mine = state.watched && state.watched.population === p.name ? state.watched : {neuron: 0, state: Object.keys(p.states)[0]};
    const neuron = make("input", {type: "number", min: 0, max: p.size - 1, step: 1, value: mine.neuron, id: "neuron"});
    const which = make("select", {"aria-label": "state"}, ...Object.keys(p.states).map(word => new Option(word, word)));
    which.value = mine.state;
    const watch = make("button", {className: "plain"}, "Watch");
    watch.onclick = which.onchange = () => ask({do: "watch", population: p.name, neuron: Number(neuron.value), state: which.value});
    const row = make("div", {className: "row"}, make("label", {}, "neuron", neuron), which, watch);
    if (p.curve) {
      const curve = make("button", {className: "plain", id: "ask-curve", title: "rates of this neuron alone, at constant currents"}, "F-I curve");
      curve.onclick = () => {
        get("curve-here").hidden = false;
        get("curve-told").textContent = "is computed";
        ask({do: "curve", population: p.name, neuron: Number(neuron.value)}, error => { if (error) get("curve-told").textContent = error; });
      };
      row.append(curve);
    }
    rows.push(row);
  }
  return rows;
}
function slider(p, q) {
  const known = p.to && q.word === "value" && kept[`value/${p.name}/value`] || q, row = make("div", {className: "slider"}), error = make("p", {hidden: true, role: "alert"});
  const id = "slider-" + q.word, told = make("span"), label = make("label", {htmlFor: id, title: q.doc || ""}, q.word, told);
  let last = known.value, sent = 0, later = 0;
  const send = value => {
    sent = performance.now();
    ask({do: "set", part: p.name, word: q.word, value}, text => { error.hidden = !text; error.textContent = text; if (text) row.show({value: last}); });
  };
  row.ends = () => {};
  if (q.kind === "boolean") {
    const box = make("input", {type: "checkbox", id, checked: Boolean(known.value)});
    box.onchange = () => send(box.checked);
    row.show = value => { box.checked = Boolean(value.value); };
    label.prepend(box);
    row.append(label, error);
  } else {
    const range = make("input", {type: "range", min: q.low, max: q.high, step: q.step, id});
    const exact = make("input", {type: "number", step: q.kind === "integer" ? 1 : "any", "aria-label": `${q.word}${q.unit ? " in " + q.unit : ""}`});
    range.oninput = () => {
      exact.value = range.value;
      clearTimeout(later);
      later = setTimeout(() => send(Number(range.value)), Math.max(0, 60 - (performance.now() - sent)));
    };
    exact.onchange = () => { if (exact.value !== "") send(Number(exact.value)); };
    row.ends = ({low, high}) => { range.min = low; range.max = high; };
    row.show = value => {
      last = value.value;
      if (last < Number(range.min)) range.min = last;
      if (last > Number(range.max)) range.max = last;
      if (document.activeElement !== range || performance.now() - sent > 300) range.value = last ?? range.min;
      if (document.activeElement !== exact) exact.value = last === null ? "" : Number(last.toPrecision(6));
      told.textContent = [q.unit, last === null ? "infinite" : value.same === false ? "differs, mean" : q.bounds].filter(Boolean).join(" · ");
    };
    row.append(label, range, exact, error);
  }
  row.show(known);
  row.dataset.word = q.word;
  return row;
}
let measuring = 0;
function showValue(message) {
  if (message.part !== part) return;
  const rows = [...document.querySelectorAll(".slider")];
  for (const row of rows) if (row.dataset.word === message.word) row.show(message);
  if (message.word === "weight") return;
  clearTimeout(measuring);  // what the others may be depends on it
  measuring = setTimeout(() => ask({do: "sliders", part: message.part}, (error, {sliders}) => {
    for (const each of sliders || []) for (const row of rows) if (row.dataset.word === each.word && each.word !== message.word) row.ends(each);
  }), 400);
}
function showState(message) {
  const before = JSON.stringify([state.silenced, state.watched]);
  state = message;
  get("play").textContent = state.paused ? "Go on" : "Pause";
  const speed = [...get("speed").options].find(each => Number(each.value) === state.speed);
  if (speed) get("speed").value = speed.value;
  else if (state.speed) { get("speed").add(new Option(short(state.speed) + " ×", state.speed)); get("speed").value = state.speed; }
  if (about && before !== JSON.stringify([state.silenced, state.watched])) {
    const focused = document.activeElement && document.activeElement.id;
    choose(part);
    if (focused && get(focused)) get(focused).focus();
    for (const frame of history) frame.traces.delete("watched");
    layTraces();
  }
}

// --- along time

function read() {
  const style = getComputedStyle(document.documentElement), words = ["ink", "soft", "rule", "faint", "field", "card", "accent", "on", "off"];
  colours = Object.fromEntries([...words, ...Array.from({length: 8}, (_, k) => "item" + k)].map(word => [word, style.getPropertyValue("--" + word).trim()]));
  colours.font = "11.5px " + getComputedStyle(document.body).fontFamily;
}
function canvas(id, height) {  // sharp on any screen; drawing is in CSS pixels
  const element = get(id), sharp = devicePixelRatio || 1, width = element.clientWidth;
  if (height) element.style.height = height + "px";
  const tall = height || element.clientHeight;
  if (element.width !== Math.round(width * sharp) || element.height !== Math.round(tall * sharp)) {
    element.width = Math.round(width * sharp); element.height = Math.round(tall * sharp);
  }
  const pen = element.getContext("2d");
  pen.setTransform(sharp, 0, 0, sharp, 0, 0);
  pen.clearRect(0, 0, width, tall);
  pen.font = colours.font; pen.textAlign = "left"; pen.textBaseline = "alphabetic";
  return {pen, width, height: tall, sharp};
}
function resize() {
  if (!about) return;
  read();
  const recorded = shown.filter(k => about.populations[k].records), sharp = devicePixelRatio || 1;
  let top = 18;
  bands = recorded.map(k => {
    const {name, size} = about.populations[k], height = Math.round((24 + 36 * Math.log10(size)) * (recorded.length > 12 ? 0.35 : recorded.length > 6 ? 0.5 : recorded.length > 3 ? 0.7 : 1));
    const band = {population: k, name, size, top, height};
    top += height + 20;
    return band;
  });
  const tall = Math.max(60, top), element = get("raster");
  element.style.height = tall + "px";
  const ring = document.createElement("canvas");
  ring.width = Math.max(1, Math.round((element.clientWidth - LEFT - SIDE) * sharp)); ring.height = Math.round(tall * sharp);
  element.width = Math.round(element.clientWidth * sharp); element.height = ring.height;
  raster = {ring, pen: ring.getContext("2d"), screen: element.getContext("2d"), sharp, scale: ring.width / span, tall};
  for (const frame of history) paint(frame);
  layTraces();
  drawGraph();
  redraw();
}
function paint(frame) {  // the spikes of a frame into a ring of columns: column x has the times x / scale, modulo its width
  const {ring, pen, scale, sharp} = raster, width = ring.width, first = Math.floor(frame.from * scale), last = Math.floor(frame.to * scale);
  if (last - first >= width) pen.clearRect(0, 0, width, ring.height);
  else {
    const a = (first + 1) % width, n = last - first;
    pen.clearRect(a, 0, Math.min(n, width - a), ring.height);
    if (a + n > width) pen.clearRect(0, 0, a + n - width, ring.height);
  }
  const wide = Math.max(1, Math.round(1.3 * sharp));
  for (const {population, steps, ids} of frame.spikes) {
    const band = bands.find(each => each.population === population);
    if (!band) continue;
    const each = band.height / band.size, tall = Math.max(1.3 * sharp, Math.min(each * 0.8, 10) * sharp);
    pen.fillStyle = colours[hue(population)];
    for (let k = 0; k < ids.length; k++) {
      const x = Math.floor((frame.from + steps[k] * about.resolution) * scale) % width;
      pen.fillRect(x - wide + 1, (band.top + band.height - (ids[k] + 0.5) * each) * sharp - tall / 2, wide, tall);
    }
  }
}
function showRaster() {
  const {ring, screen, sharp, scale, tall} = raster, width = ring.width, split = (Math.floor(now * scale) + 1) % width, left = Math.round(LEFT * sharp);
  screen.setTransform(1, 0, 0, 1, 0, 0);
  screen.clearRect(0, 0, get("raster").width, ring.height);
  screen.fillStyle = colours.field;
  for (const band of bands) screen.fillRect(left, band.top * sharp, width, band.height * sharp);
  if (split < width) screen.drawImage(ring, split, 0, width - split, ring.height, left, 0, width - split, ring.height);
  if (split > 0) screen.drawImage(ring, 0, 0, split, ring.height, left + width - split, 0, split, ring.height);
  screen.setTransform(sharp, 0, 0, sharp, 0, 0);
  screen.font = colours.font;
  for (const {population, name, size, top, height} of bands) {
    screen.fillStyle = colours[hue(population)];
    screen.fillRect(LEFT, top - 13, 9, 9);
    screen.fillStyle = colours.ink; screen.textAlign = "left";
    screen.fillText(name, LEFT + 14, top - 4.5);
    const after = LEFT + 22 + screen.measureText(name).width;
    screen.fillStyle = colours.soft;
    screen.fillText(named(size, "neuron"), after, top - 4.5);
    screen.textAlign = "right";
    screen.fillText("0", LEFT - 6, top + height);
    if (height > 24) screen.fillText(short(size - 1), LEFT - 6, top + 9);
  }
  timeAxis(screen, LEFT, width / sharp, tall - FOOT);
}
function timeAxis(pen, left, room, y) {  // before now
  pen.fillStyle = colours.soft; pen.strokeStyle = colours.rule; pen.lineWidth = 1;
  for (let k = 0; k <= 5; k++) {
    const x = Math.round(left + room * k / 5) - (k === 5) + 0.5, ms = span * (5 - k) / 5;
    pen.beginPath(); pen.moveTo(x, y); pen.lineTo(x, y + 4); pen.stroke();
    pen.textAlign = k === 5 ? "right" : "center";
    pen.fillText(k === 5 ? (span >= 1000 ? "0 s" : "0 ms") : "−" + short(span >= 1000 ? ms / 1000 : ms), k === 5 ? x + SIDE : x, y + 16);
  }
}
let written = 0;
function showRates() {
  const {pen, width, height} = canvas("rates"), foot = height - FOOT, left = LEFT, room = width - left - SIDE;
  const since = now - span, seen = rates.filter(each => each.time >= since - 100), last = rates[rates.length - 1];
  const most = nice(Math.max(1, ...seen.flatMap(each => shown.map(k => each.values[k]))));
  grid(pen, left, 8, room, foot - 8, 0, most);
  timeAxis(pen, left, room, foot);
  pen.save(); pen.beginPath(); pen.rect(left, 0, room + SIDE, height); pen.clip();
  pen.lineWidth = 1.6; pen.lineJoin = "round";
  for (const k of shown) {
    pen.strokeStyle = colours[hue(k)]; pen.setLineDash(DASHES[Math.floor(place(k) / 8)]);
    pen.beginPath();
    for (const each of seen) pen.lineTo(left + (each.time - since) / span * room, foot - each.values[k] / most * (foot - 8));
    pen.stroke();
  }
  pen.restore();
  if (!last || performance.now() - written < 250) return;
  written = performance.now();
  [...get("legend").children].forEach((entry, n) => { entry.lastChild.textContent = hertz(last.values[shown[n]]); });
}
function nice(most) { const ten = 10 ** Math.floor(Math.log10(most)); return [1, 2, 2.5, 5, 10].map(n => n * ten).find(n => n >= most * 0.999); }
function grid(pen, left, top, room, tall, low, high) {
  pen.strokeStyle = colours.faint; pen.fillStyle = colours.soft; pen.lineWidth = 1; pen.textAlign = "right";
  for (const mark of rounds(low, high, 3)) {
    const part = (mark - low) / (high - low), y = Math.round(top + tall * (1 - part)) + 0.5;
    pen.beginPath(); pen.moveTo(left, y); pen.lineTo(left + room, y); pen.stroke();
    pen.fillText(short(mark), left - 6, y + (part > 0.9 ? 8 : part > 0.1 ? 4 : 0));
  }
}
function rounds(low, high, most) {  // at most so many round numbers from low to high, evenly apart
  const ten = 10 ** Math.floor(Math.log10((high - low) / most)), slack = 1e-9;
  const first = step => Math.ceil(low / step - slack), last = step => Math.floor(high / step + slack);
  const step = [1, 2, 5, 10, 20].map(n => n * ten).find(step => last(step) - first(step) < most);
  return Array.from({length: last(step) - first(step) + 1}, (_, k) => (first(step) + k) * step);
}
function along(pen, left, room, y, low, high, unit) {  // the axis below a picture, with its unit at the last number
  pen.fillStyle = colours.soft; pen.strokeStyle = colours.rule; pen.lineWidth = 1;
  rounds(low, high, 5).forEach((mark, k, marks) => {
    const x = left + room * (mark - low) / (high - low), text = short(mark) + (k === marks.length - 1 ? " " + unit : "");
    pen.beginPath(); pen.moveTo(x, y); pen.lineTo(x, y + 4); pen.stroke();
    const beyond = x + pen.measureText(text).width / 2 > left + room + SIDE;
    pen.textAlign = beyond ? "right" : "center"; pen.fillText(text, beyond ? left + room + SIDE : x, y + 14);
  });
}
let lines = [];
function layTraces() {
  lines = [];
  if (state.watched) {
    const p = about.populations.find(each => each.name === state.watched.population);
    if (p) lines.push({key: "watched", text: `${state.watched.state} of ${p.name}[${state.watched.neuron}]`, unit: p.states[state.watched.state] || "", colour: hue(about.populations.indexOf(p))});
  }
  about.traces.slice(0, 3).forEach((trace, k) => lines.push({key: "probe" + k, text: `${trace.name}: ${trace.state} of ${trace.of}`, unit: trace.unit, colour: ""}));
  get("traces-here").hidden = !lines.length;
  get("traces").style.height = 96 * lines.length + FOOT - 8 + "px";
}
function showTraces() {
  if (!lines.length) return;
  const {pen, width, height} = canvas("traces"), each = (height - FOOT + 8) / lines.length, room = width - LEFT - SIDE, since = now - span;
  lines.forEach((line, k) => {
    const seen = history.filter(frame => frame.to >= since && frame.traces.has(line.key)), top = k * each + 18, tall = each - 26;
    let low = Infinity, high = -Infinity, columns = 0;
    for (const frame of seen) for (const values of frame.traces.get(line.key).values) { columns = Math.max(columns, frame.traces.get(line.key).values.length); for (const v of values) { if (v < low) low = v; if (v > high) high = v; } }
    pen.fillStyle = colours.ink; pen.textAlign = "left"; pen.fillText(line.text, LEFT, k * each + 11);
    if (!(low <= high)) return;
    if (high - low < 1e-9) { low -= 1; high += 1; }
    grid(pen, LEFT, top, room, tall, low, high);
    pen.fillStyle = colours.soft; pen.textAlign = "right"; pen.fillText(line.unit, LEFT - 6, k * each + 11);
    pen.save(); pen.beginPath(); pen.rect(LEFT, top - 2, room, tall + 4); pen.clip(); pen.lineWidth = 1.2;
    for (let c = 0; c < columns; c++) {
      pen.strokeStyle = colours[line.colour || "item" + c % 8];
      pen.beginPath();
      let column = -1, least = 0, most = 0, last = 0;
      const y = v => top + tall * (1 - (v - low) / (high - low)), put = () => { if (column >= 0) { pen.lineTo(LEFT + column, y(least)); if (most > least) pen.lineTo(LEFT + column, y(most)); pen.lineTo(LEFT + column, y(last)); } };
      for (const frame of seen) {
        const {times, values} = frame.traces.get(line.key);
        if (!values[c]) continue;
        for (let n = 0; n < times.length; n++) {
          const x = Math.floor((frame.from + times[n] - since) / span * room), v = values[c][n];
          if (x !== column) { put(); column = x; least = most = v; } else if (v < least) least = v; else if (v > most) most = v;
          last = v;
        }
      }
      put();
      pen.stroke();
    }
    pen.restore();
  });
  timeAxis(pen, LEFT, room, height - FOOT);
}
function redraw() { if (!asked) { asked = true; requestAnimationFrame(draw); } }
function draw() {
  asked = false;
  if (!about || !raster) return;
  get("time").textContent = now >= 1000 ? (now / 1000).toFixed(3) + " s" : now.toFixed(1) + " ms";
  showRaster(); showRates(); showTraces(); colourGraph(); showPictures();
  drawn++;
  const time = performance.now();
  if (time - counted > 1000) {
    get("fps").textContent = Math.round(drawn * 1000 / (time - counted)) + " frames/s";
    drawn = 0; counted = time;
  }
}

// --- cameras

function see(index, layers, rows, columns, events) {
  const size = rows * columns;
  let seen = pictures.get(index);
  if (!seen || seen.rows !== rows || seen.columns !== columns) {
    const element = make("canvas", {width: columns, height: rows, role: "img", "aria-label": "events of " + about.populations[index].name});
    get("pictures").append(element, make("p", {}, `${about.populations[index].name}, ${columns} × ${rows}`));
    seen = {rows, columns, element, on: new Float32Array(size), off: new Float32Array(size), last: now};
    pictures.set(index, seen);
  }
  const fade = Math.exp(-Math.max(0, now - seen.last) / 50);
  seen.last = now;
  for (let k = 0; k < size; k++) {
    seen.off[k] = seen.off[k] * fade + (layers > 1 ? events[k] : 0);
    seen.on[k] = seen.on[k] * fade + events[layers > 1 ? k + size : k];
  }
  seen.fresh = true;
}
const rgb = text => [1, 3, 5].map(k => parseInt(text.slice(k, k + 2), 16));
function showPictures() {
  for (const seen of pictures.values()) {
    if (!seen.fresh) continue;
    seen.fresh = false;
    const pen = seen.element.getContext("2d"), image = pen.createImageData(seen.columns, seen.rows), field = rgb(colours.field), on = rgb(colours.on), off = rgb(colours.off);
    for (let k = 0; k < seen.on.length; k++) {
      const plus = Math.min(1, seen.on[k]), minus = Math.min(1, seen.off[k]), colour = plus >= minus ? on : off, share = Math.max(plus, minus);
      for (let c = 0; c < 3; c++) image.data[4 * k + c] = field[c] + (colour[c] - field[c]) * share;
      image.data[4 * k + 3] = 255;
    }
    pen.putImageData(image, 0, 0);
  }
}

// --- weights, the curve, power, figures

function showWeights(message) {
  if (message.projection !== get("projection").value) return;
  const p = about.projections.find(each => each.name === message.projection), told = get("weights-told");
  get("histogram").hidden = !message.bins; get("matrix").hidden = !message.matrix;
  if (message.refused) { told.textContent = message.refused; return; }
  read();
  const {pen, width, height} = canvas("histogram"), most = Math.max(...message.bins), foot = height - 18, room = width - LEFT - SIDE, same = message.low === message.high;
  const each = same ? 12 : room / message.bins.length, left = same ? LEFT + room / 2 - 6 : LEFT;
  grid(pen, LEFT, 8, room, foot - 8, 0, most);
  pen.fillStyle = colours[p.negative ? "off" : "on"];
  message.bins.forEach((count, k) => { const tall = Math.max(1, count / most * (foot - 8)); if (count) pen.fillRect(left + k * each, foot - tall, Math.max(1, each - 1), tall); });
  if (!same) along(pen, LEFT, room, foot, message.low, message.high, p.unit);
  else { pen.fillStyle = colours.soft; pen.textAlign = "center"; pen.fillText(`${short(message.low)} ${p.unit}`, LEFT + room / 2, height - 4); }
  const rows = message.matrix.length, columns = message.matrix[0].length, element = get("matrix"), field = rgb(colours.field), plus = rgb(colours.on), minus = rgb(colours.off);
  element.width = columns; element.height = rows;
  const screen = element.getContext("2d"), image = screen.createImageData(columns, rows), reach = Math.max(Math.abs(message.low), Math.abs(message.high)) || 1;
  const floor = same ? 0 : message.low * message.high > 0 ? Math.min(Math.abs(message.low), Math.abs(message.high)) : 0;
  message.matrix.forEach((row, r) => row.forEach((value, c) => {
    const at = 4 * (r * columns + c), colour = value < 0 ? minus : plus, share = value === null ? 0 : 0.15 + 0.85 * (Math.abs(value) - floor) / (reach - floor || 1);
    for (let k = 0; k < 3; k++) image.data[at + k] = field[k] + (colour[k] - field[k]) * share;
    image.data[at + 3] = value === null && message.kernels ? 0 : 255;
  }));
  screen.putImageData(image, 0, 0);
  element.style.aspectRatio = `${columns} / ${rows}`;
  told.textContent = `${named(message.size, message.kernels ? "weight" : "synapse")}, mean ${short(message.mean)} ${p.unit}. ` + (message.kernels ? "Kernels of maps side by side." : `Rows: ${p.from}, columns: ${p.to}; the stronger the colour, the larger.`);
}
function showCurve(message) {
  get("curve-here").hidden = false;
  const p = about.populations.find(each => each.name === message.population);
  get("curve-told").textContent = message.refused || `${message.population}[${message.neuron}]` + (message.currents.length ? ", Hz by constant current" : ": silent up to 100,000 pA");
  read();
  const {pen, width, height} = canvas("curve");
  if (!message.currents || !message.currents.length) return;
  const foot = height - 18, room = width - LEFT - SIDE, top = Math.max(...message.currents), most = nice(Math.max(1, ...message.rates));
  grid(pen, LEFT, 8, room, foot - 8, 0, most);
  along(pen, LEFT, room, foot, 0, top, "pA");
  const place = k => [LEFT + message.currents[k] / top * room, foot - message.rates[k] / most * (foot - 8)];
  pen.strokeStyle = pen.fillStyle = colours[hue(about.populations.indexOf(p))]; pen.lineWidth = 1.8;
  pen.beginPath(); message.currents.forEach((_, k) => pen.lineTo(...place(k))); pen.stroke();
  message.currents.forEach((_, k) => { pen.beginPath(); pen.arc(...place(k), 2.2, 0, 7); pen.fill(); });
}
function watts(value) {
  const [unit, size] = [["J/s", 1], ["mJ/s", 1e-3], ["µJ/s", 1e-6], ["nJ/s", 1e-9]].find(([, each]) => value >= each * 0.9995) || ["pJ/s", 1e-12];
  return Number((value / size).toPrecision(3)) + " " + unit;
}
function showJoules(message) {
  get("joules-told").textContent = message.refused || "Joules of a second of the network, by what was done in the last one and chips that are on.";
  const rows = (message.chips || []).map(each => each.refused
    ? make("tr", {}, make("td", {title: each.refused}, each.chip, make("small", {}, each.refused)), make("td", {}, "–"))
    : make("tr", {}, make("td", {title: each.title}, each.chip, make("small", {}, named(each.chips, "chip") + (each.late ? `, takes ${short(Number(each.late.toPrecision(2)))} s for a second` : ""))),
      make("td", {title: each.missing.length ? `not priced, as no figure is published: ${each.missing.join(", ")}` : ""}, (each.missing.length ? "> " : "") + watts(each.dynamic + each.host + (each.static || 0)), make("small", {}, `dynamic ${watts(each.dynamic)}, host ${watts(each.host)}, ${each.static === null ? "static: no figure" : `static ${watts(each.static)}`}`))));
  get("joules").tBodies[0].replaceChildren(...rows);
}
function showFigures(message) {
  get("figures-here").hidden = false;
  get("figures").tBodies[0].replaceChildren(...Object.entries(message.figures).map(([name, value]) => make("tr", {}, make("td", {}, name), make("td", {}, String(value)))));
}

// --- files

function picture() {
  const shown = ["raster", "rates", "traces"].map(get).filter(each => !each.closest("[hidden]") && each.clientWidth), sharp = devicePixelRatio || 1, pad = 24 * sharp;
  const width = Math.max(...shown.map(each => each.width)) + 2 * pad, head = 64 * sharp;
  const sheet = make("canvas", {width, height: head + shown.reduce((sum, each) => sum + each.height + pad, 0)}), pen = sheet.getContext("2d");
  pen.fillStyle = colours.card; pen.fillRect(0, 0, sheet.width, sheet.height);
  pen.fillStyle = colours.ink; pen.font = `600 ${18 * sharp}px ${getComputedStyle(document.body).fontFamily}`;
  pen.fillText(`${about.name}, ${get("time").textContent}`, pad, 30 * sharp);
  pen.fillStyle = colours.soft; pen.font = `${12 * sharp}px ${getComputedStyle(document.body).fontFamily}`;
  pen.fillText(get("told").textContent, pad, 50 * sharp);
  let top = head;
  for (const each of shown) { pen.drawImage(each, pad, top); top += each.height + pad; }
  sheet.toBlob(blob => download(blob, `${about.name}-${now}ms.png`));
}

// --- buttons and keys

for (const value of [0.001, 0.01, 0.05, 0.1, 0.25, 0.5, 1, 2, 5, 10, 100]) get("speed").add(new Option((value < 0.01 ? "1/1000" : value) + " ×", value));
get("speed").add(new Option("no limit", 1e9));
get("speed").value = 1;
for (const ms of [100, 200, 500, 1000, 2000, 5000, 10000]) get("window").add(new Option(ms >= 1000 ? ms / 1000 + " s" : ms + " ms", ms));
span = Number(stored("window")) || 1000;
get("window").value = span;
get("play").onclick = () => ask({do: state.paused ? "resume" : "pause"});
get("step").onclick = () => ask({do: "step"});
get("reset").onclick = () => ask({do: "reset", weights: get("weights-too").checked});
get("speed").onchange = () => ask({do: "speed", value: Number(get("speed").value)});
get("seed").onchange = () => { if (get("seed").value !== "") ask({do: "seed", value: Number(get("seed").value)}, error => { if (error) { say(error, true); get("seed").value = about.seed; } }); };
get("window").onchange = () => { span = Number(get("window").value); stored("window", span); resize(); };
get("filter").oninput = filter;
get("none").onclick = () => show([]);
get("spikes-told").onclick = () => { get("chooser").open = true; get("filter").focus(); };
get("part").onchange = () => choose(get("part").value);
get("projection").onchange = () => { stored("projection", get("projection").value); const message = kept["weights/" + get("projection").value]; if (message) showWeights(message); };
get("save").onclick = () => ask({do: "save"});
get("network").onclick = () => ask({do: "network"});
get("picture").onclick = picture;
addEventListener("keydown", event => {
  const name = event.target.tagName;
  if (["INPUT", "SELECT", "BUTTON"].includes(name) || event.ctrlKey || event.metaKey || event.altKey || !about || !about.paced) return;
  if (event.key === " ") { event.preventDefault(); get("play").click(); }
  if (event.key === ".") get("step").click();
});
let soon = 0;
addEventListener("resize", () => { clearTimeout(soon); soon = setTimeout(() => { resize(); again(); }, 100); });
function again() {
  if (kept["weights/" + get("projection").value]) showWeights(kept["weights/" + get("projection").value]);
  if (kept.curve) showCurve(kept.curve);
}
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => { resize(); again(); });
read();
connect();
