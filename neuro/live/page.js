"use strict";
// Everything that is shown comes by one WebSocket: texts that hold until another of their key, frames, answers, files.
const get = id => document.getElementById(id);
const MOST_BANDS = 12, KEPT_MS = 10000, SIDE = 8, LEFT = 46;
let about = null, state = {}, kept = {}, history = [], rates = [], colours = {}, now = 0, span = 1000, asked = false, socket = null, tries = 0;
let part = "", number = 0, waiting = new Map(), raster = null, bands = [], drawn = 0, counted = performance.now(), pictures = new Map();

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
const item = k => "item" + k % 8;
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
  if (message.error) say(message.error, true);
  if (row) row(message.error || "");
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
  get("spikes-here").hidden = !about.populations.some(p => p.records && p.size);
  get("pictures").replaceChildren();
  get("curve-here").hidden = true;
  drawGraph();
  const first = about.populations.find(p => p.kind === "neuron") || about.populations[0];
  choose([part, stored("part")].find(name => name && found(name)) || first.name);
  resize();
}
const found = name => [...about.populations, ...about.projections, ...about.signals].find(each => each.name === name);

function layers() {  // by the fewest projections from a population that none but itself reaches
  const depth = new Map(), reached = new Set(about.projections.filter(p => p.from !== p.to).map(p => p.to));
  let front = about.populations.filter(p => !reached.has(p.name)).map(p => p.name);
  if (!front.length) front = [about.populations[0].name];
  for (let level = 0; front.length; level++) {
    for (const name of front) depth.set(name, level);
    front = [...new Set(about.projections.filter(p => front.includes(p.from) && !depth.has(p.to)).map(p => p.to))];
  }
  const rows = [];
  for (const p of about.populations) (rows[depth.get(p.name) ?? 0] ||= []).push(p);
  return rows.flatMap(row => Array.from({length: Math.ceil(row.length / 3)}, (_, k) => row.slice(3 * k, 3 * k + 3)));
}
const nodes = new Map(), edges = [];
function drawGraph() {
  const W = 106, H = 44, GAP = 22, DOWN = 40, rows = layers(), most = Math.max(2, ...rows.map(row => row.length)), width = most * (W + GAP) + 24, svg = get("graph");
  nodes.clear(); edges.length = 0;
  const height = rows.length * (H + DOWN) - DOWN + 44;
  svg.setAttribute("viewBox", `0 0 ${width} ${height}`);
  svg.style.maxWidth = 1.2 * width + "px";
  const lines = shape("g"), boxes = shape("g");
  rows.forEach((row, level) => row.forEach((p, k) => {
    const x = width / 2 + (k - (row.length - 1) / 2) * (W + GAP) - W / 2, y = 22 + level * (H + DOWN), index = about.populations.indexOf(p);
    const bar = shape("rect", {class: "bar", x: x + 9, y: y + H - 9, width: 0, height: 3, rx: 1.5}), rate = shape("text", {class: "rate", x: x + 9, y: y + 30});
    const name = p.name.length > 14 ? p.name.slice(0, 13) + "…" : p.name;
    const node = shape("g", {class: "node", tabindex: 0, role: "button", "aria-label": `${p.name}, ${named(p.size, "neuron")} of ${p.model}`},
      shape("title"), shape("rect", {class: "box", x, y, width: W, height: H, rx: 8}), shape("circle", {cx: x + 13, cy: y + 13, r: 4}),
      shape("text", {x: x + 22, y: y + 17}, name), rate, shape("rect", {class: "room", x: x + 9, y: y + H - 9, width: W - 18, height: 3, rx: 1.5}), bar);
    node.firstChild.textContent = `${p.name}: ${named(p.size, "neuron")} of ${p.model}`;
    node.style.color = `var(--${item(index)})`;
    node.onclick = () => choose(p.name);
    node.onkeydown = event => { if (event.key === "Enter" || event.key === " ") { event.preventDefault(); event.stopPropagation(); choose(p.name); } };
    nodes.set(p.name, {node, bar, rate, x, y, level, room: W - 18});
    boxes.append(node);
  }));
  about.projections.forEach((p, index) => {
    const a = nodes.get(p.from), b = nodes.get(p.to), twin = about.projections.slice(0, index).filter(q => q.from === p.from && q.to === p.to).length;
    const shift = 9 * twin, ax = a.x + W / 2, bx = b.x + W / 2;
    let path, tip;
    if (a === b) { const r = a.x + W - 26 - shift; path = `M${r} ${a.y} c-3 -17 23 -17 19 0`; tip = [r + 19, a.y, 100]; }
    else if (b.level > a.level) { const x = ax + (bx > ax ? 16 : bx < ax ? -16 : -14) + shift, to = bx - (bx > ax ? 16 : bx < ax ? -16 : 14) + shift, mid = (a.y + H + b.y) / 2;
      path = `M${x} ${a.y + H} C${x} ${mid} ${to} ${mid} ${to} ${b.y - 5}`; tip = [to, b.y - 1, 90]; }
    else if (b.level < a.level) { const x = ax + 22 + shift, to = bx + 22 + shift, mid = (a.y + b.y + H) / 2;
      path = `M${x} ${a.y} C${x} ${mid} ${to} ${mid} ${to} ${b.y + H + 5}`; tip = [to, b.y + H + 1, -90]; }
    else { const right = bx > ax, y = a.y + H / 2 + (right ? -7 : 7) + shift, x = right ? a.x + W : a.x, to = right ? b.x : b.x + W, sign = right ? -1 : 1;
      const far = Math.abs(to - x) > 2 * GAP ? (right ? -34 : 34) : 0;
      path = `M${x} ${y} C${x - sign * 8} ${y + far} ${to + sign * 12} ${y + far} ${to + sign * 5} ${y}`; tip = [to + sign, y, right ? 0 : 180]; }
    const kind = p.negative ? " negative" : "";
    const edge = shape("path", {class: "edge" + kind, d: path}, shape("title"));
    edge.firstChild.textContent = `${p.name}: ${named(p.size, "synapse")}, ${p.synapse}`;
    if (p.learns) edge.setAttribute("stroke-dasharray", "5 4");
    edge.onclick = () => choose(p.name);
    const head = shape("path", {class: "tip" + kind, d: "M0 0 L-7 -3.5 L-7 3.5 Z", transform: `translate(${tip[0]} ${tip[1]}) rotate(${tip[2]})`});
    lines.append(edge, head);
    edges.push({edge, head, name: p.name, from: about.populations.findIndex(q => q.name === p.from)});
  });
  svg.replaceChildren(lines, boxes);
}
function colourGraph() {
  const last = rates[rates.length - 1];
  if (!last) return;
  const most = Math.max(20, ...last.values);
  about.populations.forEach((p, k) => {
    const seen = nodes.get(p.name);
    seen.bar.setAttribute("width", (Math.sqrt(last.values[k] / most) * seen.room).toFixed(1));
    const text = p.kind === "current" ? "current" : (last.values[k] < 100 ? Number(last.values[k].toFixed(last.values[k] < 10 ? 2 : 1)) : Math.round(last.values[k])) + " Hz";
    if (seen.rate.textContent !== text) seen.rate.textContent = text;
  });
  for (const {edge, head, from} of edges) {
    const strength = Math.sqrt(last.values[from] / most) || 0;
    edge.setAttribute("stroke-width", (1 + 1.8 * strength).toFixed(2));
    edge.style.opacity = head.style.opacity = (0.35 + 0.65 * strength).toFixed(2);
  }
}

// --- one part: what it is, and what can be set

function choose(name) {
  part = name;
  stored("part", name);
  get("part").value = name;
  for (const [each, {node}] of nodes) node.classList.toggle("chosen", each === name);
  for (const {edge, name: each} of edges) edge.classList.toggle("chosen", each === name);
  const p = found(name), inside = [];
  if (p.model) {
    inside.push(facts([["model", p.model], ["neurons", p.size.toLocaleString("en") + (p.shape.length > 1 ? ` (${p.shape.join(" × ")})` : "")]]));
    inside.push(...actions(p));
  } else if (p.synapse) {
    inside.push(facts([["from", p.from], ["to", p.to], ["synapse", p.synapse + (p.learns ? ", learns" : "")], ["synapses", p.size.toLocaleString("en")]]));
    get("projection").value = name;
    if (kept["weights/" + name]) showWeights(kept["weights/" + name]);
  } else inside.push(facts([["signal to", p.to]]));
  inside.push(...p.sliders.map(each => slider(p, each)));
  get("inside").replaceChildren(...inside);
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
  const known = kept[`value/${p.name}/${q.word}`] || q, row = make("div", {className: "slider"}), error = make("p", {hidden: true});
  const id = "slider-" + q.word, unit = q.unit || (q.word === "weight" ? p.unit : "");
  const told = make("span"), label = make("label", {htmlFor: id, title: q.doc || ""}, q.word, told);
  let last = known.value, sent = 0, later = 0;
  const send = value => {
    sent = performance.now();
    ask({do: "set", part: p.name, word: q.word, value}, text => { error.hidden = !text; error.textContent = text; if (text) row.show({value: last}); });
  };
  if (q.kind === "boolean") {
    const box = make("input", {type: "checkbox", id, checked: Boolean(known.value)});
    box.onchange = () => send(box.checked);
    row.show = value => { box.checked = Boolean(value.value); };
    label.prepend(box);
    row.append(label, error);
  } else {
    const step = q.kind === "integer" ? 1 : "any", range = make("input", {type: "range", min: q.low, max: q.high, step: q.kind === "integer" ? 1 : (q.high - q.low) / 500, id});
    const exact = make("input", {type: "number", step, "aria-label": `${q.word}${unit ? " in " + unit : ""}`});
    range.oninput = () => {
      exact.value = range.value;
      clearTimeout(later);
      later = setTimeout(() => send(Number(range.value)), Math.max(0, 60 - (performance.now() - sent)));
    };
    exact.onchange = () => { if (exact.value !== "") send(Number(exact.value)); };
    row.show = value => {
      last = value.value;
      if (last < Number(range.min)) range.min = last;
      if (last > Number(range.max)) range.max = last;
      if (document.activeElement !== range || performance.now() - sent > 300) range.value = last ?? range.min;
      if (document.activeElement !== exact) exact.value = last === null ? "" : Number(last.toPrecision(6));
      told.textContent = [unit, last === null ? "infinite" : value.same === false ? "differs, mean" : q.bounds].filter(Boolean).join(" · ");
    };
    range.value = known.value ?? q.low;
    row.append(label, range, exact, error);
  }
  row.show(known);
  row.dataset.of = `${p.name}/${q.word}`;
  return row;
}
function showValue(message) {
  for (const row of document.querySelectorAll(".slider")) if (row.dataset.of === `${message.part}/${message.word}`) row.show(message);
}
function showState(message) {
  const before = JSON.stringify([state.silenced, state.watched]);
  state = message;
  get("play").textContent = state.paused ? "Go on" : "Pause";
  const speed = [...get("speed").options].find(each => Number(each.value) === state.speed);
  if (speed) get("speed").value = speed.value;
  else if (state.speed) { get("speed").add(new Option(short(state.speed) + " ×", state.speed)); get("speed").value = state.speed; }
  for (const [name, {node}] of nodes) node.classList.toggle("silenced", (state.silenced || []).includes(name));
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
  const recorded = about.populations.map((p, index) => ({...p, index})).filter(p => p.records && p.size);
  const shown = recorded.slice(0, MOST_BANDS), sharp = devicePixelRatio || 1;
  get("spikes-told").textContent = recorded.length > shown.length ? `of the first ${MOST_BANDS} of ${recorded.length} populations` : "";
  let top = 18;
  bands = shown.map(p => {
    const height = Math.round((24 + 36 * Math.log10(p.size)) * (shown.length > 6 ? 0.5 : shown.length > 3 ? 0.7 : 1));
    const band = {population: p.index, name: p.name, size: p.size, top, height};
    top += height + 20;
    return band;
  });
  const tall = Math.max(60, top), element = get("raster");
  element.style.height = tall + "px";
  const ring = document.createElement("canvas");
  ring.width = Math.max(1, Math.round(element.clientWidth * sharp)); ring.height = Math.round(tall * sharp);
  element.width = ring.width; element.height = ring.height;
  raster = {ring, pen: ring.getContext("2d"), screen: element.getContext("2d"), sharp, scale: ring.width / span, tall};
  for (const frame of history) paint(frame);
  layTraces();
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
    pen.fillStyle = colours[item(population)];
    for (let k = 0; k < ids.length; k++) {
      const x = Math.floor((frame.from + steps[k] * about.resolution) * scale) % width;
      pen.fillRect(x - wide + 1, (band.top + band.height - (ids[k] + 0.5) * each) * sharp - tall / 2, wide, tall);
    }
  }
}
function showRaster() {
  const {ring, screen, sharp, scale, tall} = raster, width = ring.width, split = (Math.floor(now * scale) + 1) % width;
  screen.setTransform(1, 0, 0, 1, 0, 0);
  screen.clearRect(0, 0, width, ring.height);
  screen.fillStyle = colours.field;
  for (const band of bands) screen.fillRect(0, band.top * sharp, width, band.height * sharp);
  if (split < width) screen.drawImage(ring, split, 0, width - split, ring.height, 0, 0, width - split, ring.height);
  if (split > 0) screen.drawImage(ring, 0, 0, split, ring.height, width - split, 0, split, ring.height);
  screen.setTransform(sharp, 0, 0, sharp, 0, 0);
  screen.font = colours.font;
  for (const band of bands) {
    screen.fillStyle = colours[item(band.population)];
    screen.fillRect(0, band.top - 13, 9, 9);
    screen.fillStyle = colours.ink; screen.textAlign = "left";
    screen.fillText(band.name, 14, band.top - 4.5);
    const after = 22 + screen.measureText(band.name).width;
    screen.fillStyle = colours.soft;
    screen.fillText(named(band.size, "neuron"), after, band.top - 4.5);
  }
  screen.fillStyle = colours.soft; screen.textAlign = "right";
  screen.fillText(`the last ${span >= 1000 ? span / 1000 + " s" : span + " ms"}`, width / sharp, tall - 6);
}
function showRates() {
  const {pen, width, height} = canvas("rates"), foot = height - 8, left = LEFT, room = width - left - SIDE;
  const since = now - span, seen = rates.filter(each => each.time >= since - 100);
  const all = about.populations.map((p, k) => k), cells = all.filter(k => about.populations[k].kind === "neuron");
  const indices = cells.length ? cells : all;
  const most = nice(Math.max(1, ...seen.flatMap(each => indices.map(k => each.values[k]))));
  grid(pen, left, 8, room, foot - 8, 0, most);
  pen.save(); pen.beginPath(); pen.rect(left, 0, room + SIDE, height); pen.clip();
  pen.lineWidth = 1.6; pen.lineJoin = "round";
  for (const k of indices) {
    pen.strokeStyle = colours[item(k)];
    pen.beginPath();
    for (const each of seen) pen.lineTo(left + (each.time - since) / span * room, foot - each.values[k] / most * (foot - 8));
    pen.stroke();
  }
  pen.restore();
}
function nice(most) { const ten = 10 ** Math.floor(Math.log10(most)); return [1, 2, 2.5, 5, 10].map(n => n * ten).find(n => n >= most * 0.999); }
function grid(pen, left, top, room, tall, low, high) {
  pen.strokeStyle = colours.faint; pen.fillStyle = colours.soft; pen.lineWidth = 1; pen.textAlign = "right";
  for (const part of [0, 0.5, 1]) {
    const y = Math.round(top + tall * (1 - part)) + 0.5;
    pen.beginPath(); pen.moveTo(left, y); pen.lineTo(left + room, y); pen.stroke();
    pen.fillText(short(low + (high - low) * part), left - 6, y + (part === 1 ? 8 : part ? 4 : 0));
  }
}
let lines = [];
function layTraces() {
  lines = [];
  if (state.watched) {
    const p = about.populations.find(each => each.name === state.watched.population);
    if (p) lines.push({key: "watched", text: `${state.watched.state} of ${p.name}[${state.watched.neuron}]`, unit: p.states[state.watched.state] || "", colour: item(about.populations.indexOf(p))});
  }
  about.traces.slice(0, 3).forEach((trace, k) => lines.push({key: "probe" + k, text: `${trace.name}: ${trace.state} of ${trace.of}`, unit: trace.unit, colour: ""}));
  get("traces-here").hidden = !lines.length;
  get("traces").style.height = 96 * lines.length + "px";
}
function showTraces() {
  if (!lines.length) return;
  const {pen, width, height} = canvas("traces"), each = height / lines.length, room = width - LEFT - SIDE, since = now - span;
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
      pen.strokeStyle = colours[line.colour || item(c)];
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
  const {pen, width, height} = canvas("histogram", 92), most = Math.max(...message.bins), foot = height - 18, each = (width - 2) / message.bins.length;
  pen.fillStyle = colours.field; pen.fillRect(0, 0, width, foot);
  pen.fillStyle = colours[p.negative ? "off" : "on"];
  message.bins.forEach((count, k) => { const tall = count / most * (foot - 6); if (count) pen.fillRect(1 + k * each, foot - Math.max(1, tall), Math.max(1, each - 1), Math.max(1, tall)); });
  pen.fillStyle = colours.soft;
  const same = message.low === message.high;
  pen.textAlign = same ? "center" : "left"; pen.fillText(short(message.low) + (same ? " " + p.unit : ""), same ? width / 2 : 1, height - 4);
  if (!same) { pen.textAlign = "right"; pen.fillText(`${short(message.high)} ${p.unit}`, width - 1, height - 4); }
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
  told.textContent = `${named(message.size, message.kernels ? "weight" : "synapse")}, mean ${short(message.mean)} ${p.unit}. ` + (message.kernels ? "Kernels of maps side by side." : `Rows: ${p.from}, columns: ${p.to}.`);
}
function showCurve(message) {
  get("curve-here").hidden = false;
  const p = about.populations.find(each => each.name === message.population);
  get("curve-told").textContent = message.refused || `${message.population}[${message.neuron}]` + (message.currents.length ? "" : ": silent up to 100,000 pA");
  read();
  const {pen, width, height} = canvas("curve");
  if (!message.currents || !message.currents.length) return;
  const foot = height - 18, room = width - LEFT - SIDE, top = Math.max(...message.currents), most = nice(Math.max(1, ...message.rates));
  grid(pen, LEFT, 8, room, foot - 8, 0, most);
  pen.fillStyle = colours.soft; pen.textAlign = "left"; pen.fillText("0", LEFT, height - 4);
  pen.textAlign = "right"; pen.fillText(`${short(top)} pA`, width - SIDE, height - 4); pen.fillText("Hz", LEFT - 6, foot - 10);
  const place = k => [LEFT + message.currents[k] / top * room, foot - message.rates[k] / most * (foot - 8)];
  pen.strokeStyle = pen.fillStyle = colours[item(about.populations.indexOf(p))]; pen.lineWidth = 1.8;
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
      make("td", {}, watts(each.dynamic + (each.static || 0)), make("small", {}, each.static === null ? "dynamic; static: no figure" : `dynamic ${watts(each.dynamic)}, static ${watts(each.static)}`))));
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

// --- what is pressed

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
get("seed").onchange = () => { if (get("seed").value !== "") ask({do: "seed", value: Number(get("seed").value)}, error => { if (error) get("seed").value = about.seed; }); };
get("window").onchange = () => { span = Number(get("window").value); stored("window", span); resize(); };
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
