// Events with the boxes of now, and a row for each; given boxes are dashed.
draws.objects = (track, k, time) => {
  const [pen, x, y, w] = draws.events(track, k, time), scale = w / track.width, rows = get("rows");
  rows.replaceChildren();
  pen.font = "bold 14px " + FONT; pen.lineWidth = 2;
  for (const {id, kind, name, score, box} of track.boxes.filter(b => b.start <= time && time < b.until)) {
    const [left, top, right, bottom] = box.map(side => side * scale), high = y + top > 20;
    pen.strokeStyle = track.colours[id % track.colours.length];
    pen.setLineDash(kind ? [4, 4] : []);
    pen.strokeRect(x + left, y + top, right - left, bottom - top);
    pen.fillStyle = pen.strokeStyle; pen.textAlign = "left";
    if (!kind) pen.fillText(name + " #" + id, x + left, high ? y + top - 5 : y + bottom + 15);
    const row = rows.insertRow();
    for (const text of [kind + " #" + id, name, kind ? "" : score, box.map(side => side.toFixed(1)).join(", ")])
      row.insertCell().textContent = text;
    row.cells[0].style.color = pen.strokeStyle;
  }
  pen.setLineDash([]);
};
