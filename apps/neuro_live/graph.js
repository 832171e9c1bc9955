"use strict";
// The graph: rows of populations, ordered by their distance from the inputs. A graph that does not fit can be scrolled.
// With very many populations, the graph shows only the chosen population and its neighbours.
const MOST_BOXES = 60, MOST_NEAR = 24, FEW_EDGES = 40, TALL = 44, ACROSS = 14, DOWN = 40;
const nodes = new Map(), edges = [];
let rowsShown = [], centre = "";

function layers() {  // by the fewest projections from a population that none but itself reaches
  const reached = new Set(about.projections.filter(p => p.from !== p.to).map(p => p.to)), rows = [];
  const left = new Set(about.populations.map(p => p.name));
  let front = [...left].filter(name => !reached.has(name));
  while (left.size) {
    if (!front.length) front = [[...left][0]];
    front.forEach(name => left.delete(name));
    rows.push(front);
    const next = new Set(about.projections.filter(p => front.includes(p.from) && left.has(p.to)).map(p => p.to));
    front = [...left].filter(name => next.has(name));
  }
  return rows;
}
function neighbours(name) {  // those that reach a population, it, those that it reaches
  const others = (end, other) => [...new Set(about.projections.filter(p => p[end] === name && p[other] !== name).map(p => p[other]))];
  const before = others("to", "from"), after = others("from", "to").filter(each => !before.includes(each));
  const left = Math.max(0, before.length - MOST_NEAR) + Math.max(0, after.length - MOST_NEAR);
  get("graph-told").textContent = `${name} with its neighbours` + (left ? `, without ${left} of them` : "") + `, of ${about.populations.length} populations`;
  return [before.slice(0, MOST_NEAR), [name], after.slice(0, MOST_NEAR)].filter(row => row.length);
}
const long = text => { const pen = get("rates").getContext("2d"); pen.font = colours.font; return pen.measureText(text).width; };
function fitted(name, room) {  // a name that is too long without its middle
  let text = name;
  for (let kept = name.length - 1; long(text) > room && kept > 2; kept--) text = name.slice(0, Math.ceil(kept / 2)) + "…" + name.slice(name.length - Math.floor(kept / 2));
  return text;
}
function drawGraph() {
  const svg = get("graph"), width = get("net").clientWidth;
  if (!about || !width) return;
  const large = about.populations.length > MOST_BOXES, rows = large ? neighbours(centre) : layers();
  if (!large) get("graph-told").textContent = "choose a part to see and set it";
  const wide = Math.max(92, ...rows.flat().map(name => Math.min(180, long(name) + 34))), columns = Math.max(2, Math.floor((width - ACROSS) / (wide + ACROSS)));
  const longest = Math.max(2, ...rows.map(row => row.length)), W = Math.min(Math.max(wide, 128), (width - ACROSS) / Math.min(columns, longest) - ACROSS);
  rowsShown = rows.flatMap(row => Array.from({length: Math.ceil(row.length / columns)}, (_, k) => row.slice(columns * k, columns * (k + 1))));
  const height = rowsShown.length * (TALL + DOWN) - DOWN + 44, lines = shape("g"), boxes = shape("g"), focused = svg.contains(document.activeElement);
  nodes.clear(); edges.length = 0;
  for (const [word, size] of [["viewBox", `0 0 ${width} ${height}`], ["width", width], ["height", height]]) svg.setAttribute(word, size);
  rowsShown.forEach((row, level) => row.forEach((name, place) => {
    const before = longest > columns ? Math.floor((columns - row.length) / 2) - (columns - 1) / 2 : (1 - row.length) / 2;  // in columns where rows are cut
    const x = width / 2 + (place + before) * (W + ACROSS) - W / 2, y = 22 + level * (TALL + DOWN), p = found(name), index = about.populations.indexOf(p);
    const bar = shape("rect", {class: "bar", x: x + 9, y: y + TALL - 9, width: 0, height: 3, rx: 1.5}), rate = shape("text", {class: "rate", x: x + 9, y: y + 30});
    const node = shape("g", {class: "node", tabindex: -1, role: "button", "aria-label": `${name}, ${named(p.size, "neuron")} of ${p.model}`},
      shape("title"), shape("rect", {class: "box", x, y, width: W, height: TALL, rx: 8}), shape("circle", {cx: x + 13, cy: y + 13, r: 4}),
      shape("text", {x: x + 22, y: y + 17}, fitted(name, W - 28)), rate, shape("rect", {class: "room", x: x + 9, y: y + TALL - 9, width: W - 18, height: 3, rx: 1.5}), bar);
    node.firstChild.textContent = `${name}: ${named(p.size, "neuron")} of ${p.model}`;
    node.onclick = () => choose(name);
    node.onkeydown = event => press(event, name, level, place);
    nodes.set(name, {node, bar, rate, x, y, level, index, room: W - 18});
    boxes.append(node);
  }));
  const drawn = new Map();
  for (const p of about.projections) {
    const a = nodes.get(p.from), b = nodes.get(p.to), pair = p.from + " " + p.to, twin = drawn.get(pair) || 0;
    if (!a || !b) continue;
    drawn.set(pair, twin + 1);
    const {path, tip} = way(a, b, W, 9 * twin), kind = p.negative ? " negative" : "";
    const edge = shape("path", {class: "edge" + kind, d: path}, shape("title"));
    edge.firstChild.textContent = `${p.name}: ${named(p.size, "synapse")}, ${p.synapse}`;
    if (p.learns) edge.setAttribute("stroke-dasharray", "5 4");
    edge.onclick = () => choose(p.name);
    const head = shape("path", {class: "tip" + kind, d: "M0 0 L-7 -3.5 L-7 3.5 Z", transform: `translate(${tip[0]} ${tip[1]}) rotate(${tip[2]})`});
    lines.append(edge, head);
    edges.push({edge, head, name: p.name, from: a.index, ends: [p.from, p.to]});
  }
  svg.replaceChildren(lines, boxes);
  for (const p of about.projections.filter(each => nodes.has(each.dopamine))) {
    const taught = edges.find(each => each.name === p.name);
    if (taught) teach(lines, nodes.get(p.dopamine), taught.edge, p, W);
  }
  tint();
  mark(focused);
}
function teach(lines, from, taught, p, W) {  // an arrow from a population that releases dopamine to the middle of a projection
  const to = taught.getPointAtLength(taught.getTotalLength() / 2), x = from.x + W * (to.x < from.x + W / 2 ? 0.25 : 0.75);
  const y = to.y < from.y + TALL / 2 ? from.y : from.y + TALL;  // it leaves the box towards the arrow, between the rows
  const edge = shape("path", {class: "edge dopamine", d: `M${x} ${y} Q${x} ${to.y} ${to.x} ${to.y}`, "stroke-dasharray": "1 4"}, shape("title"));
  edge.firstChild.textContent = `dopamine of ${p.dopamine} teaches ${p.name}`;
  edge.onclick = () => choose(p.name);
  const head = shape("circle", {class: "tip dopamine", cx: to.x, cy: to.y, r: 3.5});
  lines.append(edge, head);
  edges.push({edge, head, name: p.name, from: from.index, ends: [p.dopamine, p.to]});
}
function way(a, b, W, shift) {  // of an arrow from one box to another: its path; the place and direction of its tip
  const ax = a.x + W / 2, bx = b.x + W / 2;
  if (a === b) { const right = a.x + W - 26 - shift; return {path: `M${right} ${a.y} c-3 -17 23 -17 19 0`, tip: [right + 19, a.y, 100]}; }
  if (a.level !== b.level) {
    const down = b.level > a.level, aside = down ? Math.sign(bx - ax) * 16 || -14 : 22, x = ax + aside + shift, to = bx + (down ? -aside * Math.abs(Math.sign(bx - ax)) || -14 : 22) + shift;
    const from = down ? a.y + TALL : a.y, end = down ? b.y - 1 : b.y + TALL + 1, back = down ? -4 : 4, mid = (from + end) / 2;
    if (Math.abs(b.level - a.level) > 1) {  // between the columns
      const gap = ax + (to >= x ? 1 : -1) * (W + ACROSS) / 2 + b.index * 5 % 9 - 4, most = down ? DOWN - 6 : 6 - DOWN;
      return {path: `M${x} ${from} C${x} ${from + most} ${gap} ${from} ${gap} ${from + most} V${end - most} C${gap} ${end} ${to} ${end - most} ${to} ${end + back}`, tip: [to, end, down ? 90 : -90]};
    }
    return {path: `M${x} ${from} C${x} ${mid} ${to} ${mid} ${to} ${end + back}`, tip: [to, end, down ? 90 : -90]};
  }
  const sign = bx > ax ? 1 : -1, y = a.y + TALL / 2 - 7 * sign + shift, x = ax + sign * W / 2, to = bx - sign * W / 2;
  const far = Math.abs(to - x) > 2 * ACROSS ? -34 * sign : 0;
  return {path: `M${x} ${y} C${x + sign * 8} ${y + far} ${to - sign * 12} ${y + far} ${to - sign * 5} ${y}`, tip: [to - sign, y, sign > 0 ? 0 : 180]};
}
function press(event, name, level, place) {  // the arrow keys go to the next box, enter or space choose one
  const near = (row, k) => row && row[Math.min(Math.max(0, k), row.length - 1)];
  const to = {ArrowLeft: near(rowsShown[level], place - 1), ArrowRight: near(rowsShown[level], place + 1),
    ArrowUp: near(rowsShown[level - 1], place), ArrowDown: near(rowsShown[level + 1], place)}[event.key];
  if (event.key === "Enter" || event.key === " ") choose(name);
  else if (!event.key.startsWith("Arrow")) return;
  else if (to) reach(to, true);
  event.preventDefault();
  event.stopPropagation();
}
function reach(name, focus) {  // the tab key comes to one box of the graph
  for (const [each, {node}] of nodes) node.setAttribute("tabindex", each === name ? 0 : -1);
  if (focus) nodes.get(name).node.focus();
}
function mark(focus = false) {  // what is chosen, with what it is connected to
  const p = found(part), many = edges.length > FEW_EDGES, box = get("net"), at = nodes.get(p && p.model ? part : p && p.to);
  for (const [name, {node}] of nodes) {
    node.classList.toggle("chosen", name === part);
    node.classList.toggle("silenced", (state.silenced || []).includes(name));
  }
  for (const each of edges) {
    each.near = each.name === part || each.ends.includes(part);
    each.faint = many && !each.near;
    each.edge.classList.toggle("chosen", each.name === part);
  }
  reach(at ? about.populations[at.index].name : rowsShown[0][0], focus);
  if (at && (at.y < box.scrollTop || at.y + TALL > box.scrollTop + box.clientHeight)) box.scrollTop = at.y - box.clientHeight / 2 + TALL / 2;
  colourGraph();
}
function chooseInGraph() {
  const p = found(part), name = p.model ? part : p.to;
  if (name === centre || about.populations.length <= MOST_BOXES && nodes.size) { centre = name; mark(); }
  else { centre = name; drawGraph(); }
}
function tint() { for (const {node, index} of nodes.values()) node.style.color = `var(--${hue(index)})`; }
function colourGraph() {
  const last = rates[rates.length - 1];
  if (!last) return;
  const most = Math.max(20, ...last.values);
  for (const {bar, rate, room, index} of nodes.values()) {
    const value = last.values[index], text = about.populations[index].kind === "current" ? "current" : hertz(value);
    bar.setAttribute("width", (Math.sqrt(value / most) * room).toFixed(1));
    if (rate.textContent !== text) rate.textContent = text;
  }
  for (const {edge, head, from, faint} of edges) {
    const strength = Math.sqrt(last.values[from] / most) || 0;
    edge.setAttribute("stroke-width", (1 + 1.8 * strength).toFixed(2));
    edge.style.opacity = head.style.opacity = faint ? 0.12 : (0.35 + 0.65 * strength).toFixed(2);
  }
}
