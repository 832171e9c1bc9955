"""The page of a sweep: it needs nothing else, and shows what is there when it is written."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from neuro.core import html
from neuro.core.errors import ModelError
from neuro.core.html import Html, table, tag
from neuro.core.outputs import output, sealed
from neuro.core.provenance import differences
from neuro.core.version import VERSION
from neuro.sweeps.folder import Folder, RunOutcome
from neuro.sweeps.plot_data import PlotData, is_log, ordered, places, plot_data, scaled, told
from neuro.sweeps.rows import RunRows, text
from neuro.sweeps.table import SweepTable, reasons

PAGE = sealed("a page of 'neuro sweep'", '<meta name="generator" content="neuro sweep">', "<!-- digest {} -->")

MOST_ROWS = 500
MOST_REASONS = 20
WIDE, TALL, LEFT, TOP, BELOW = 400.0, 200.0, 58.0, 20.0, 40.0
_AXIS = 105.0
"""Room for an axis of parallel coordinates."""
_COLOURS = 8


def write_page(found: SweepTable, path: Path | None = None) -> Path:
    """Write the page; into the folder of the sweep if no file is given.

    Raises:
        Unwritable: it cannot be written, or something else stands there.
    """
    path = found.path / "sweep.html" if path is None else path
    with output(path, PAGE) as part:
        part.write_text(PAGE.seal(page(found)), "utf-8")
    return path


def page(found: SweepTable) -> str:
    """The page as HTML text."""
    told = Folder(found.path).read()
    outcomes, counts = found.outcomes(), found.counts()
    parts = (
        _head(found, told),
        tag("div", *_cards(counts, outcomes), class_="cards"),
        *_pictures(found),
        *_failures(found, outcomes),
        *rows_of(found),
        *origin(told, outcomes),
        *_next(found, counts),
        tag("footer", f"Written by neuro {VERSION} (neuro sweep)."),
    )
    return html.page("neuro sweep", f"{found.name}: a sweep", parts)


def _head(found: SweepTable, told: Mapping[str, Any]) -> Html:
    what = told["what"]
    of = Path(what["file"]).name if what["kind"] == "network" else what["name"]
    over = ", ".join(found.parameters) or "seeds"
    on = f" on {what['backend']}" if what["kind"] == "network" else ""
    lead = f"{of}{on} over {over}: {many(len(found), 'run')}."
    return tag("header", tag("h1", found.name), tag("p", lead, class_="lead"))


def _cards(counts: Mapping[str, int], outcomes: Mapping[str, RunOutcome]) -> Iterator[Html]:
    total = counts["done"] + counts["failed"] + counts["left"]
    seconds = [each.seconds for each in outcomes.values()]
    yield card("done", f"{counts['done']:,}", f"of {many(total, 'run')}")
    yield card("failed", f"{counts['failed']:,}", "kept with their errors" if counts["failed"] else "none")
    yield card("left", f"{counts['left']:,}", f"{counts['under way']:,} of them under way")
    if seconds:
        yield card("a run took", f"{np.median(seconds):.3g} s", f"in the middle; {sum(seconds):,.3g} s all together")


def card(what: str, big: str, below: str) -> Html:
    """A figure, large, with what it is."""
    return tag("section", tag("h3", what), tag("p", big, class_="big"), tag("p", below), class_="card")


def many(n: int, what: str) -> str:
    """So many of something."""
    return f"{n:,} {what}{'s' * (n != 1)}"


def _pictures(found: SweepTable) -> Iterator[Html]:
    try:
        drawn = plot_data(found, (), (), "auto")
    except ModelError as error:
        yield tag("p", error.message)
        return
    yield tag("h2", "Metrics")
    small = [_DRAW[each.kind](each) for each in drawn if each.kind != "parallel"]
    if small:
        yield tag("div", *small, class_="grid")
    for each in drawn:
        if each.kind == "parallel":
            yield parallel(each)


def _lines(data: PlotData) -> Html:
    lines = data.lines()
    drawn = lines[:_COLOURS]
    x = np.concatenate([line[1] for line in drawn])
    y = np.concatenate([np.concatenate([mean - sd, mean + sd]) for _, _, mean, sd in drawn])
    is_wide = is_log(data.axis(0))
    along = scale(np.log10(x) if is_wide else x, LEFT + 6, WIDE - 18)
    to_y = scale(y, TOP + TALL, TOP)

    def to_x(value: float) -> float:
        return float(along(np.log10(value) if is_wide else value))

    parts: list[Html] = list(_frame(data, to_x, y))
    for k, (_, xs, mean, sd) in enumerate(drawn):
        band = [*zip(xs, mean + sd, strict=True), *zip(xs[::-1], (mean - sd)[::-1], strict=True)]
        if sd.any():
            parts.append(tag("path", d=f"{_path(band, to_x, to_y)}Z", class_=f"item{k}", fill_opacity=0.18))
        style = f"fill:none;stroke:var(--item{k});stroke-width:1.6;stroke-linejoin:round"
        parts.append(tag("path", d=_path(list(zip(xs, mean, strict=True)), to_x, to_y), style=style))
        for a, b in zip(xs, mean, strict=True):
            what = tag("title", f"{data.names[0]} = {told(a.item())}: {b:.6g}")
            parts.append(tag("circle", what, cx=to_x(a), cy=to_y(b), r=2.6, class_=f"item{k}"))
    words = html.legend(*((f"item{k}", line[0]) for k, line in enumerate(drawn) if line[0]))
    more = f", {len(lines) - len(drawn)} more lines are not drawn" if len(lines) > len(drawn) else ""
    spread = "; the band is one standard deviation" if any(line[3].any() for line in drawn) else ""
    caption = f"over {data.names[0]}: the mean of all runs there{spread}{more}"
    picture = html.svg(WIDE, TOP + TALL + BELOW, *parts, label=f"{data.metric} over {data.names[0]}")
    return html.figure(html.join([words, picture]), caption, data.metric)


def _map(data: PlotData) -> Html:
    grid, x, y = data.grid(), data.axis(0), data.axis(1)
    wide, tall = (WIDE - LEFT - 12) / len(x), min(34.0, TALL / len(y))
    low, high = float(np.nanmin(grid)), float(np.nanmax(grid))
    parts = []
    for (row, column), value in np.ndenumerate(grid):
        if np.isfinite(value):
            share = (value - low) / (high - low) if high > low else 0.5
            title = f"{data.names[0]} = {told(x[column])}, {data.names[1]} = {told(y[row])}: {value:.6g}"
            at = (LEFT + column * wide, TOP + (len(y) - 1 - row) * tall)
            parts.append(html.box(*at, max(wide - 1, 0.5), max(tall - 1, 0.5), "core", title, 0.08 + 0.92 * share))
    floor = TOP + tall * len(y)
    for k in range(0, len(x), max(1, -(-len(x) // 8))):
        parts.append(html.text(LEFT + (k + 0.5) * wide, floor + 14, told(x[k]), "tick", "middle"))
    for k in range(0, len(y), max(1, -(-len(y) // 12))):
        parts.append(html.text(LEFT - 6, TOP + (len(y) - 0.5 - k) * tall + 4, told(y[k]), "tick", "end"))
    parts.append(html.text((LEFT + WIDE) / 2, floor + 32, data.names[0], "quiet", "middle"))
    parts.append(html.text(0.0, TOP - 8, data.names[1], "quiet"))
    caption = f"from {low:.6g}, pale, to {high:.6g}: the mean of all runs there"
    label = f"{data.metric} over {data.names[0]} and {data.names[1]}"
    return html.figure(html.svg(WIDE, floor + BELOW, *parts, label=label), caption, data.metric)


def parallel(data: PlotData) -> Html:
    """All parameters and a metric, as parallel coordinates."""
    names = (*data.names, data.metric)
    metric = [float(np.mean(each)) for _, each in data.points]
    columns = [[values[k] for values, _ in data.points] for k in range(len(data.names))] + [metric]
    wide = max(WIDE, _AXIS * len(names))
    gap = (wide - 2 * LEFT) / (len(names) - 1)
    parts: list[Html] = []
    heights: list[list[float]] = []
    for k, values in enumerate(columns):
        every = ordered(values)
        to_y = scale(scaled(every), TOP + TALL, TOP + 12)
        at = {repr(value): to_y(place) for value, place in zip(every, scaled(every), strict=True)}
        heights.append([at[repr(value)] for value in values])
        x = LEFT + k * gap
        parts.append(html.line(x, TOP + 12, x, TOP + TALL, "axis"))
        parts.append(html.text(x, TOP + TALL + 32, names[k], "quiet", "middle"))
        parts.append(html.text(x, TOP + 4, told(every[-1]), "tick", "middle"))
        parts.append(html.text(x, TOP + TALL + 16, told(every[0]), "tick", "middle"))
    low, high = min(metric), max(metric)
    lines = []
    for n in np.argsort(metric).tolist():
        share = (metric[n] - low) / (high - low) if high > low else 0.5
        d = "M" + "L".join(f"{LEFT + k * gap:.1f} {heights[k][n]:.1f}" for k in range(len(names)))
        style = f"fill:none;stroke:var(--accent);stroke-width:1.2;stroke-opacity:{0.08 + 0.8 * share:.2f}"
        title = ", ".join(f"{name} = {told(column[n])}" for name, column in zip(names, columns, strict=True))
        lines.append(tag("path", tag("title", title), d=d, style=style))
    caption = f"a line for each point; the darker, the larger {data.metric}, from {low:.6g} to {high:.6g}"
    label = f"{data.metric} over {', '.join(data.names)}"
    return html.figure(html.svg(wide, TOP + TALL + BELOW, *lines, *parts, label=label), caption, data.metric)


_DRAW = {"lines": _lines, "map": _map, "parallel": parallel}


def _frame(data: PlotData, to_x: Any, y: Any) -> Iterator[Html]:
    floor = TOP + TALL
    yield html.line(LEFT, floor, WIDE - 12, floor, "axis")
    low, high = float(np.min(y)), float(np.max(y))
    for share in (0.0, 0.5, 1.0):
        at = floor - share * TALL
        yield html.line(LEFT, at, WIDE - 12, at, "rule")
        yield html.text(LEFT - 6, at + 4, f"{low + share * (high - low):.3g}", "tick", "end")
    values = data.axis(0)

    at_x = places(values)
    last = -1e9
    for value, place in zip(values, at_x, strict=True):
        x = to_x(place)
        if x - last >= 52:
            yield html.text(x, floor + 16, told(value), "tick", "middle")
            last = x
    yield html.text((LEFT + WIDE) / 2, floor + 34, data.names[0], "quiet", "middle")


def scale(values: Any, begin: float, end: float) -> Any:
    """From values to places of the drawing."""
    low, high = float(np.min(values)), float(np.max(values))
    factor = (end - begin) / (high - low) if high > low else 0.0
    middle = begin if high > low else (begin + end) / 2
    return lambda value: float(middle + (value - low) * factor)


def _path(points: Any, to_x: Any, to_y: Any) -> str:
    return "M" + "L".join(f"{to_x(a):.1f} {to_y(b):.1f}" for a, b in points)


def _failures(found: SweepTable, outcomes: Mapping[str, RunOutcome]) -> Iterator[Html]:
    failed = reasons(outcomes)
    if not failed:
        return
    yield tag("h2", "What failed")
    rows = []
    for those in failed[:MOST_REASONS]:
        point = ", ".join(f"{name} = {told(value)}" for name, value in those[0].point.items())
        seed = "" if those[0].seed is None else f", seed {those[0].seed}"
        rows.append((f"{len(those):,}", those[0].error, f"{point}{seed}".strip(", "), those[0].key[:10]))
    yield table((">runs", "why, of the first", "its point", "run"), rows)
    if len(failed) > MOST_REASONS:
        yield tag("p", f"{len(failed) - MOST_REASONS} more reasons are in the table.")
    yield tag("p", "They are not tried again, unless they are asked for:")
    yield tag("pre", f"neuro sweep run SWEEP.yaml --out {shlex.quote(str(found.path))} --retry-failed")


def rows_of(found: RunRows) -> Iterator[Html]:
    """The rows of a table, those first that are there."""
    rows = found.rows(times=True)
    there = [row for row in rows if row["outcome"] != "left"][:MOST_ROWS]
    if not there:
        return
    yield tag("h2", found.many.capitalize())
    left_out = {"attempts"} if any(row["error"] for row in there) else {"attempts", "error"}
    names = [name for name in there[0] if name not in left_out]
    head = [name if name in ("run", "outcome", "error") else f">{name}" for name in names]
    body = [[text(row[name], name) for name in names] for row in there]
    yield table(head, body, f"the first {MOST_ROWS} of {len(rows):,}" if len(rows) > MOST_ROWS else "")


def origin(told: Mapping[str, Any], outcomes: Mapping[str, RunOutcome]) -> Iterator[Html]:
    """Where runs come from, and whether all are of the same versions and machine."""
    record = told["provenance"]
    yield tag("h2", "Where it comes from")
    versions = ", ".join(f"{name} {number}" for name, number in record["versions"].items())
    commit = f", commit {record['commit']}" if record["commit"] else ""
    rows = [("command", record["command"]), ("neuro", f"{record['neuro']}{commit}"), ("versions", versions)]
    rows += [("machine", record["machine"])]
    rows += [(f"input {Path(name).name}", f"{name}, sha256 {digest[:16]}") for name, digest in record["inputs"].items()]
    yield table(("what", "is"), rows)
    others = {line for each in outcomes.values() for line in differences(record, each.provenance | {"seed": None})}
    others = {line for line in others if not line.startswith(("seed", "backend", "threads", "network"))}
    if others:
        yield tag("p", "Not all runs are of the same versions and machine:")
        yield tag("ul", *(tag("li", line) for line in sorted(others)[:MOST_REASONS]), class_="remarks")


def _next(found: SweepTable, counts: Mapping[str, int]) -> Iterator[Html]:
    name = shlex.quote(str(found.path))
    yield tag("h2", "What next")
    yield tag("pre", f"neuro sweep table {name} --out table.csv\nneuro sweep plot {name}\nneuro sweep status {name}")
    if done := next(iter(found.keys), None):
        yield tag("p", "Any run again, to the bit:")
        yield tag("pre", f"neuro rerun {name}/runs/{done}")
