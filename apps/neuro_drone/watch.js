// The world from above, the camera with its aim and target, and the stick of the pilot.
const box = track => {  // the part of the world that is drawn: path and flight with a margin, square
  const xs = [], ys = [];
  for (let k = 0; k < track.path.length; k += 2) { xs.push(track.path[k]); ys.push(track.path[k + 1]); }
  for (let k = 0; k < track.poses.length; k += 3) { xs.push(track.poses[k]); ys.push(track.poses[k + 1]); }
  const ends = list => [list.reduce((a, b) => Math.min(a, b)), list.reduce((a, b) => Math.max(a, b))], [x, y] = [ends(xs), ends(ys)];
  const side = 1.16 * Math.max(x[1] - x[0], y[1] - y[0]) + 0.4;
  return {x: (x[0] + x[1] - side) / 2, y: (y[0] + y[1] - side) / 2, side};
};

draws.world = (track, k) => {
  const {path, poses, foot, balls, heights, winds, loads, ball, width, step} = track, part = track.box ??= box(track);
  const [pen, w, h] = sheet("world"), scale = w / part.side, X = x => (x - part.x) * scale, Y = y => h - (y - part.y) * scale;
  const trace = (list, from, to, size = 2) => {
    pen.beginPath();
    for (let i = from; i < to; i++) pen.lineTo(X(list[size * i]), Y(list[size * i + 1]));
  };
  pen.strokeStyle = C.faint;
  const gap = part.side > 12 ? 2 : 1;
  for (let m = Math.ceil(part.x / gap) * gap; m < part.x + part.side; m += gap) stroke(pen, [X(m), 0], [X(m), h]);
  for (let m = Math.ceil(part.y / gap) * gap; m < part.y + part.side; m += gap) stroke(pen, [0, Y(m)], [w, Y(m)]);
  trace(foot, 4 * k, 4 * k + 4); pen.closePath();
  pen.globalAlpha = 0.11; pen.fillStyle = C.accent; pen.fill();
  pen.globalAlpha = 0.6; pen.strokeStyle = C.accent; pen.lineWidth = 1.2; pen.stroke();
  pen.globalAlpha = ball ? 0.55 : 1; pen.strokeStyle = ball ? C.soft : C.ink;
  pen.lineWidth = ball ? 1.2 : Math.max(2, width * scale); pen.setLineDash(ball ? [2, 5] : []);
  trace(path, 0, path.length / 2); pen.closePath(); pen.stroke(); pen.setLineDash([]);
  const from = Math.max(0, k - Math.round(10000 / step));
  for (let n = 0; n < 8; n++) {  // the way of the last ten seconds, fainter the older
    const a = Math.round(from + (k - from) * n / 8), b = Math.round(from + (k - from) * (n + 1) / 8);
    pen.globalAlpha = 0.12 + 0.75 * n / 7; pen.strokeStyle = C.accent; pen.lineWidth = 2;
    trace(poses, a, b + 1, 3); pen.stroke();
    if (ball) { pen.strokeStyle = C.target; trace(balls, a, b + 1); pen.stroke(); }
  }
  pen.globalAlpha = 1;
  if (ball) {
    pen.beginPath(); pen.arc(X(balls[2 * k]), Y(balls[2 * k + 1]), Math.max(4, ball * scale), 0, 7);
    pen.fillStyle = C.target; pen.fill();
  }
  const r = Math.max(11, 0.16 * scale);
  pen.save(); pen.translate(X(poses[3 * k]), Y(poses[3 * k + 1])); pen.rotate(-poses[3 * k + 2]);
  pen.strokeStyle = C.ink; pen.lineWidth = 2.4;
  for (const b of [1, -1]) stroke(pen, [-r, -b * r], [r, b * r]);
  for (const [a, b] of [[1, 1], [1, -1], [-1, 1], [-1, -1]]) {
    pen.beginPath(); pen.arc(a * r, b * r, 0.62 * r, 0, 7); pen.fillStyle = C.card; pen.globalAlpha = 0.85; pen.fill();
    pen.globalAlpha = 1; pen.lineWidth = 1.6; pen.strokeStyle = a > 0 ? C.accent : C.ink; pen.stroke();
  }
  pen.beginPath(); pen.moveTo(1.1 * r, 0); pen.lineTo(-0.45 * r, 0.55 * r); pen.lineTo(-0.45 * r, -0.55 * r); pen.closePath();
  pen.fillStyle = C.accent; pen.fill();
  pen.restore();
  pen.strokeStyle = C.soft; pen.lineWidth = 2;
  stroke(pen, [10, h - 10], [10 + scale, h - 10]);
  words(pen, "1 m", 10, h - 16, "soft", "left");
  const lines = track.climbs ? ["height " + heights[k].toFixed(2) + " m"] : [];
  if (loads.some(v => v)) lines.push("load " + loads[k].toFixed(2) + " kg");
  lines.forEach((text, n) => words(pen, text, 10, 16 + 15 * n, "soft", "left"));
  if (!winds.some(v => v)) return;
  const [x, y] = [winds[2 * k], winds[2 * k + 1]], speed = Math.hypot(x, y), long = Math.min(22, 4 * speed);
  words(pen, "wind " + speed.toFixed(1) + " m/s", w - 58, 34);
  if (speed < 0.05) return;
  pen.save(); pen.translate(w - 30, 30); pen.rotate(-Math.atan2(y, x)); pen.strokeStyle = C.ink;  // an arrow to where it blows
  stroke(pen, [-long, 0], [long, 0]); stroke(pen, [long - 7, -5], [long, 0], [long - 7, 5]);
  pen.restore();
};

draws.camera = (track, k, time) => {
  const [pen, left, top, w] = draws.events(track, k, time), f = w / 128, mid = 63.5 * f;
  pen.strokeStyle = C.soft; pen.globalAlpha = 0.22;
  for (let m = 0; m <= 8; m++) { stroke(pen, [16 * m * f, 0], [16 * m * f, w]); stroke(pen, [0, 16 * m * f], [w, 16 * m * f]); }
  pen.globalAlpha = 0.9; pen.strokeStyle = C.ink; pen.lineWidth = 1.2;
  stroke(pen, [mid - 9, mid], [mid + 9, mid]); stroke(pen, [mid, mid - 9], [mid, mid + 9]);
  pen.strokeStyle = C.target; pen.lineWidth = 1.8; pen.globalAlpha = 1;
  const {targets, talls} = track;
  pen.beginPath(); pen.arc((targets[2 * k] + 0.5) * f, (targets[2 * k + 1] + 0.5) * f, (talls[k] ? 0.5 * talls[k] + 3 : 4) * f, 0, 7); pen.stroke();
};

draws.stick = ({actions, axes, motors}, k) => {
  const [pen, w] = sheet("stick"), m = w / 2, r = m - 18, at = k => [m + actions[axes * k] * r, m + actions[axes * k + 1] * r];
  pen.strokeStyle = C.rule;
  pen.beginPath(); pen.roundRect(m - r, m - r, 2 * r, 2 * r, 8); pen.fillStyle = C.paper; pen.fill(); pen.stroke();
  stroke(pen, [m - r, m], [m + r, m]); stroke(pen, [m, m - r], [m, m + r]);
  const [right, left, down, up, ...climbing] = motors;
  words(pen, up, m, m - r - 5, "soft", "center"); words(pen, down, m, m + r + 13, "soft", "center");
  for (const [text, x, way] of [[left, m - r - 5, -1], [right, m + r + 5, 1]]) {
    pen.save(); pen.translate(x, m); pen.rotate(way * Math.PI / 2); words(pen, text, 0, 0, "soft", "center"); pen.restore();
  }
  for (let ago = Math.min(12, k); ago >= 0; ago--) {
    pen.globalAlpha = ago ? 0.28 * (1 - ago / 13) : 1; pen.fillStyle = C.accent;
    pen.beginPath(); pen.arc(...at(k - ago), ago ? 4 : 6.5, 0, 7); pen.fill();
  }
  pen.globalAlpha = 1; pen.strokeStyle = C.accent; pen.lineWidth = 2;
  stroke(pen, [m, m], at(k));
  if (!climbing.length) return;
  const c = actions[axes * k + 2], x = m + r - 9;  // up is up, as a bar at the right edge
  pen.strokeStyle = C.e; pen.lineWidth = 6;
  stroke(pen, [x, m], [x, m - c * (r - 6)]);
  words(pen, climbing[c < 0 ? 1 : 0], x - 8, m - r + 14, "item5");
};
