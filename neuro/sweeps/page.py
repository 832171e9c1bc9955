"""The page of a sweep or of a search: it needs nothing else, and shows what is there when it is written."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from neuro.chips.pricing.energy import quantity
from neuro.core import html
from neuro.core.checks import is_number
from neuro.core.english import some
from neuro.core.errors import ModelError
from neuro.core.html import Html, table, tag
from neuro.core.outputs import output, sealed
from neuro.core.provenance import differences
from neuro.core.version import VERSION
from neuro.pages.scales import few, prefixed, tick, ticks
from neuro.sweeps.folder import Folder, RunOutcome
from neuro.sweeps.plan import Floats, so_far
from neuro.sweeps.plot_data import PlotData, Units, is_log, named, ordered, plot_data, scaled, told, with_units
from neuro.sweeps.table import RunRows, SweepTable, columns, measured, reasons, text
from neuro.sweeps.trials import FoundTrial, TuneTable

PAGES = {
    name: sealed(f"a page of 'neuro {name}'", f'<meta name="generator" content="neuro {name}">', "<!-- digest {} -->")
    for name in ("sweep", "tune")
}

MOST_ROWS = 500
MOST_REASONS = 20
MOST_BEST = 50
WIDE, TALL, LEFT, TOP, BELOW = 400.0, 200.0, 58.0, 20.0, 40.0
_AXIS = 105.0
"""Room for an axis of parallel coordinates."""
_COLOURS = 8
MOST_MARKS = 6
_LINE = "fill:none;stroke:var(--item{});stroke-width:1.6;stroke-linejoin:round"


def write_page(found: SweepTable | TuneTable, path: Path | None = None) -> Path:
    """Write the page; into the folder of the sweep or the search if no file is given.

    Raises:
        Unwritable: it cannot be written, or something else stands there.
    """
    command = "sweep" if isinstance(found, SweepTable) else "tune"
    path = found.path / f"{command}.html" if path is None else path
    with output(path, PAGES[command]) as part:
        part.write_text(PAGES[command].seal(page(found)), "utf-8")
    return path


def page(found: SweepTable | TuneTable) -> str:
    """The page as HTML text."""
    folder = Folder(found.path)
    said, holding = folder.read(), folder.holding
    if isinstance(found, SweepTable):
        outcomes = found.outcomes()
        parts = [*_of_sweep(found, said, outcomes)]
    else:
        trials = found.trials()
        outcomes = folder.outcomes({item.key: None for each in trials for item in each.items})
        parts = [*_of_search(found, said, trials, outcomes)]
    footer = tag("footer", f"Written by neuro {VERSION} (neuro {holding.command}).")
    return html.page(f"neuro {holding.command}", f"{found.name}: a {holding.what}", [*parts, footer])


def _of_sweep(found: SweepTable, said: Mapping[str, Any], outcomes: Mapping[str, RunOutcome]) -> Iterator[Html]:
    what, over = said["what"], ", ".join(found.parameters) or "seeds"
    on = f" on {what['backend']}" if what["kind"] == "network" else ""
    yield _head(found, what, f"{on} over {over}: {some(len(found), 'run')}.")
    yield tag("div", *_sweep_cards(found.counts(), outcomes), class_="cards")
    yield from _metrics(found, said.get("units", {}))
    yield from _failures(found, outcomes, ())
    yield from _rows(found, said.get("units", {}))
    yield from _origin(said, outcomes)
    yield from _next(found, ("table", "plot", "status"))
    if first := next(iter(found.keys), None):
        yield tag("p", "Any run again, to the bit:")
        yield tag("pre", f"neuro rerun {shlex.quote(str(found.path))}/runs/{first}")


def _of_search(
    found: TuneTable, said: Mapping[str, Any], trials: Sequence[FoundTrial], outcomes: Mapping[str, RunOutcome]
) -> Iterator[Html]:
    plan = found.plan
    aims = ", ".join(f"{name} {direction}d" for name, direction in plan.objectives.items())
    runs = "" if plan.runs == 1 else f", each the mean of {plan.runs} runs"
    trials_by = f"{some(plan.most, 'trial')} by {plan.sampler}{runs}"
    yield _head(found, said["what"], f": {aims}, over {', '.join(plan.names)}; {trials_by}.")
    yield tag("div", *_search_cards(found, trials), class_="cards")
    units = said.get("units", {})
    yield from _best(found, units)
    yield from _objectives(found, trials, units)
    yield from _failures(found, outcomes, [trial for trial in trials if trial.has_no_value and trial.error])
    yield from _rows(found, units)
    yield from _origin(said, outcomes)
    yield from _next(found, ("table", "plot", "status", *(("test",) if plan.folds else ())))
    if best := found.best():
        yield tag("p", "A run of the best again, to the bit:")
        yield tag("pre", f"neuro rerun {shlex.quote(str(found.path))}/runs/{best[0].items[0].key}")


def _head(found: SweepTable | TuneTable, what: Mapping[str, Any], rest: str) -> Html:
    of = Path(what["file"]).name if what["kind"] == "network" else what["name"]
    return tag("header", tag("h1", found.name), tag("p", f"{of}{rest}", class_="lead"))


def _sweep_cards(counts: Mapping[str, int], outcomes: Mapping[str, RunOutcome]) -> Iterator[Html]:
    seconds = [each.seconds for each in outcomes.values()]
    total = counts["done"] + counts["failed"] + counts["left"]
    yield from _cards(counts, some(total, "run"), counts["under way"])
    if seconds:
        took = quantity(float(np.median(seconds)), "s", 3)
        yield html.card("a run took", took, f"the median; {sum(seconds):,.3g} s all together")


def _search_cards(found: TuneTable, trials: Sequence[FoundTrial]) -> Iterator[Html]:
    under_way = sum(each.outcome == "under way" for each in trials)
    pruned = f"by {found.plan.prune['by']}" if found.plan.prune else ""
    yield from _cards(found.counts(), some(found.plan.most, "trial"), under_way, pruned)


def _cards(counts: Mapping[str, int], total: str, under_way: int, pruned: str = "") -> Iterator[Html]:
    yield html.card("done", f"{counts['done']:,}", f"of {total}")
    yield html.card("failed", f"{counts['failed']:,}", "kept with their errors" if counts["failed"] else "none")
    if pruned:
        yield html.card("pruned", f"{counts['pruned']:,}", pruned)
    yield html.card("left", f"{counts['left']:,}", f"{under_way:,} of them under way")


def _metrics(found: SweepTable, units: Units) -> Iterator[Html]:
    try:
        drawn = [with_units(each, units) for each in plot_data(found, (), (), "auto")]
    except ModelError as error:
        yield tag("p", error.message)
        return
    yield tag("h2", "Metrics")
    small = [_DRAW[each.kind](each) for each in drawn if each.kind != "parallel"]
    if small:
        yield tag("div", *small, class_="grid")
    for each in drawn:
        if each.kind == "parallel":
            yield _parallel(each)


def _lines(data: PlotData) -> Html:
    lines = data.lines()
    drawn = lines[:_COLOURS]
    x = np.concatenate([line[1] for line in drawn])
    y = np.concatenate([np.concatenate([low, high]) for *_, low, high in drawn])
    is_wide = is_log(data.axis(0))
    along = _scale(np.log10(x) if is_wide else x, LEFT + 6, WIDE - 18)
    to_y = _scale(y, TOP + TALL, TOP)

    def to_x(value: float) -> float:
        return float(along(np.log10(value) if is_wide else value))

    parts: list[Html] = list(_frame(data, to_x, y))
    for k, (_, xs, mean, low, high) in enumerate(drawn):
        band = [*zip(xs, high, strict=True), *zip(xs[::-1], low[::-1], strict=True)]
        if (high > low).any():
            parts.append(tag("path", d=f"{_path(band, to_x, to_y)}Z", class_=f"item{k}", fill_opacity=0.18))
        line = list(zip(xs, mean, strict=True))
        parts.append(tag("path", d=_path(line, to_x, to_y), style=_LINE.format(k)))
        for a, b in line:
            what = tag("title", f"{data.names[0]} = {told(a.item())}: {few(b)}")
            parts.append(tag("circle", what, cx=to_x(a), cy=to_y(b), r=2.6, class_=f"item{k}"))
    words = html.legend(*((f"item{k}", line[0]) for k, line in enumerate(drawn) if line[0]))
    more = f", {len(lines) - len(drawn)} more lines are not drawn" if len(lines) > len(drawn) else ""
    mean_of = f": {data.mean_of}; band: lowest to highest run" if data.mean_of else ""
    caption = f"over {data.names[0]}{mean_of}{more}"
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
            title = f"{data.names[0]} = {told(x[column])}, {data.names[1]} = {told(y[row])}: {few(float(value))}"
            at = (LEFT + column * wide, TOP + (len(y) - 1 - row) * tall)
            parts.append(html.box(*at, max(wide - 1, 0.5), max(tall - 1, 0.5), "core", title, 0.08 + 0.92 * share))
    floor = TOP + tall * len(y)
    for k in range(0, len(x), max(1, -(-len(x) // 8))):
        parts.append(html.text(LEFT + (k + 0.5) * wide, floor + 14, told(x[k]), "tick", "middle"))
    for k in range(0, len(y), max(1, -(-len(y) // 12))):
        parts.append(html.text(LEFT - 6, TOP + (len(y) - 0.5 - k) * tall + 4, told(y[k]), "tick", "end"))
    parts.append(html.text((LEFT + WIDE) / 2, floor + 32, data.names[0], "quiet", "middle"))
    parts.append(html.text(0.0, TOP - 8, data.names[1], "quiet"))
    mean_of = f": {data.mean_of}" if data.mean_of else ""
    caption = f"from {few(low)}, pale, to {few(high)}{mean_of}"
    label = f"{data.metric} over {data.names[0]} and {data.names[1]}"
    return html.figure(html.svg(WIDE, floor + BELOW, *parts, label=label), caption, data.metric)


def _parallel(data: PlotData) -> Html:
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
        to_y = _scale(scaled(every), TOP + TALL, TOP + 12)
        at = {repr(value): to_y(place) for value, place in zip(every, scaled(every), strict=True)}
        heights.append([at[repr(value)] for value in values])
        x = LEFT + k * gap
        parts.append(html.line(x, TOP + 12, x, TOP + TALL, "axis"))
        parts.append(html.text(x, TOP + TALL + 32, names[k], "quiet", "middle"))
        for value, label in _marks(every, most_listed=MOST_MARKS if k < len(data.names) else 0):
            parts.append(html.line(x - 3, to_y(value), x + 3, to_y(value), "axis"))
            parts.append(html.text(x + 7, to_y(value) + 4, label, "tick"))
    low, high = min(metric), max(metric)
    lines = []
    for n in np.argsort(metric).tolist():
        share = (metric[n] - low) / (high - low) if high > low else 0.5
        d = "M" + "L".join(f"{LEFT + k * gap:.1f} {heights[k][n]:.1f}" for k in range(len(names)))
        style = f"fill:none;stroke:var(--accent);stroke-width:1.2;stroke-opacity:{0.2 + 0.7 * share:.2f}"
        title = ", ".join(f"{name} = {told(column[n])}" for name, column in zip(names, columns, strict=True))
        lines.append(tag("path", tag("title", title), d=d, style=style))
    caption = f"a line for each point; the stronger, the larger {data.metric}, from {few(low)} to {few(high)}"
    label = f"{data.metric} over {', '.join(data.names)}"
    return html.figure(html.svg(wide, TOP + TALL + BELOW, *lines, *parts, label=label), caption, data.metric)


_DRAW = {"lines": _lines, "map": _map, "parallel": _parallel}


def _frame(data: PlotData, to_x: Any, y: Any) -> Iterator[Html]:
    floor = TOP + TALL
    yield html.line(LEFT, floor, WIDE - 12, floor, "axis")
    yield from _up(y, _scale(y, floor, TOP))
    values, last = data.axis(0), -1e9
    for value, label in _marks(values):
        x = to_x(10.0**value if is_log(values) else value)
        if x - last >= 52:
            yield html.line(x, floor, x, floor + 4, "axis")
            yield html.text(x, floor + 16, label, "tick", "middle")
            last = x
    yield html.text((LEFT + WIDE) / 2, floor + 34, data.names[0], "quiet", "middle")


def _up(y: Any, to_y: Any) -> Iterator[Html]:
    """Round values on the axis that goes up, with lines across."""
    low, high = float(np.min(y)), float(np.max(y))
    marks = ticks(low, high, 5) if high > low else [low]
    for mark in marks:
        yield html.line(LEFT, to_y(mark), WIDE - 12, to_y(mark), "rule")
        yield html.text(LEFT - 6, to_y(mark) + 4, tick(mark, marks) if len(marks) > 1 else few(mark), "tick", "end")


def _marks(values: Sequence[Any], most_listed: int = MOST_MARKS) -> list[tuple[float, str]]:
    """Marks on the axis of some values, at their places as of `scaled`: all of a few, else round numbers."""
    at = scaled(values)
    if len(values) <= max(1, most_listed) or not all(map(is_number, values)):
        every = max(1, -(-len(values) // MOST_MARKS))
        return [(float(place), told(value)) for value, place in zip(values[::every], at[::every], strict=True)]
    low, high = float(at.min()), float(at.max())
    if is_log(values):
        return [(math.log10(value), few(value)) for value in _rounds(10.0**low, 10.0**high)]
    marks = ticks(low, high, 5)
    return [(mark, tick(mark, marks)) for mark in marks]


def _rounds(low: float, high: float) -> list[float]:
    """Powers of ten, with 2 and 5 of each where these are few."""
    decades = range(math.floor(math.log10(low)), math.ceil(math.log10(high)) + 1)
    digits = (1, 2, 5) if len(decades) <= 3 else (1,)
    return [n * 10.0**k for k in decades for n in digits if low <= n * 10.0**k <= high]


def _scale(values: Any, begin: float, end: float) -> Any:
    """From values to places of the drawing."""
    low, high = float(np.min(values)), float(np.max(values))
    factor = (end - begin) / (high - low) if high > low else 0.0
    middle = begin if high > low else (begin + end) / 2
    return lambda value: float(middle + (value - low) * factor)


def _path(points: Any, to_x: Any, to_y: Any) -> str:
    return "M" + "L".join(f"{to_x(a):.1f} {to_y(b):.1f}" for a, b in points)


def _failures(
    found: SweepTable | TuneTable, outcomes: Mapping[str, RunOutcome], judged: Sequence[FoundTrial]
) -> Iterator[Html]:
    """Why runs failed, and trials whose runs were done: `judged`."""
    failed = reasons(outcomes)
    if not failed and not judged:
        return
    yield tag("h2", "What failed")
    rows = []
    for those in failed[:MOST_REASONS]:
        seed = {} if those[0].seed is None else {"seed": those[0].seed}
        rows.append((f"{len(those):,}", those[0].error, _point(those[0].point | seed), those[0].key[:10]))
    rows += [("1", trial.error, _point(trial.point), f"trial {trial.number}") for trial in judged]
    yield table((">runs", "why, of the first", "its point", "run"), rows[:MOST_REASONS])
    if len(failed) > MOST_REASONS:
        yield tag("p", f"{len(failed) - MOST_REASONS} more reasons are in the table.")
    if failed:
        command, file = ("sweep", "SWEEP") if isinstance(found, SweepTable) else ("tune", "SEARCH")
        yield tag("p", "What failed is not tried again, unless that is asked for:")
        yield tag("pre", f"neuro {command} run {file}.yaml --out {shlex.quote(str(found.path))} --retry-failed")


def _point(point: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} = {told(value)}" for name, value in point.items())


def _rows(found: RunRows, units: Units) -> Iterator[Html]:
    """The rows of a table, those first that are there."""
    rows = found.rows(times=True)
    there = [row for row in rows if row["outcome"] != "left"][:MOST_ROWS]
    if not there:
        return
    yield tag("h2", found.many.capitalize())
    left_out = {"attempts"} if any(row["error"] for row in there) else {"attempts", "error"}
    names = [name for name in there[0] if name not in left_out]
    body = [[_cell(row[name], name, units) for name in names] for row in there]
    yield table(
        _headed(columns(names), units), body, f"the first {MOST_ROWS} of {len(rows):,}" if len(rows) > MOST_ROWS else ""
    )


def _origin(content: Mapping[str, Any], outcomes: Mapping[str, RunOutcome]) -> Iterator[Html]:
    """Where runs come from, and whether all are of the same versions and machine."""
    record = content["provenance"]
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


def _next(found: SweepTable | TuneTable, commands: Iterable[str]) -> Iterator[Html]:
    name, words = shlex.quote(str(found.path)), {"table": " --out table.csv"}
    command = "sweep" if isinstance(found, SweepTable) else "tune"
    yield tag("h2", "What next")
    yield tag("pre", "\n".join(f"neuro {command} {each} {name}{words.get(each, '')}" for each in commands))


def _headed(names: Iterable[str], units: Units) -> list[str]:
    """Heads of columns with their units, the first at the left; joules have theirs in the cells."""
    of = {name: unit for name, unit in units.items() if unit != "J"}
    first, *rest = [named(name, of.get(name.lstrip(">"), "")) for name in names]
    return [first.lstrip(">"), *rest]


def _cell(value: Any, name: str, units: Units) -> str:
    """A value in three digits, joules with their prefix."""
    return text(value, name) if name == "run" else measured(value, "J" if units.get(name) == "J" else "")


def _best(found: TuneTable, units: Units) -> Iterator[Html]:
    best = {each.number for each in found.best()}
    rows = [row for row in found.rows() if row["trial"] in best]
    if not rows:
        return
    names = [name for name in rows[0] if name not in ("outcome", "best", "error")]
    first = next(iter(found.plan.objectives))
    body = [
        [_cell(row[name], name, units) for name in names] for row in sorted(rows, key=lambda row: float(row[first]))
    ]
    yield tag("h2", "Best" if len(found.plan.objectives) == 1 else "No other trial beats these")
    more = f"the first {MOST_BEST} of {len(body)}" if len(body) > MOST_BEST else ""
    yield table(_headed([f">{name}" for name in names], units), body[:MOST_BEST], more)


def _objectives(found: TuneTable, trials: Sequence[FoundTrial], units: Units) -> Iterator[Html]:
    done = [trial for trial in trials if trial.values is not None]
    if not done:
        yield tag("p", "No trial is done yet.")
        return
    yield tag("h2", "Objectives")
    values = np.array([trial.values for trial in done], float)
    numbers = np.array([trial.number for trial in done], float)
    largest = np.abs(values).max(axis=0).tolist()
    scales = [prefixed(most, units.get(name, "")) for name, most in zip(found.plan.objectives, largest, strict=True)]
    factors = [factor for factor, _ in scales]
    values = values * factors
    names = [named(name, unit) for name, (_, unit) in zip(found.plan.objectives, scales, strict=True)]
    small = []
    if len(found.plan.objectives) > 1:
        small.append(_front(found, names, values, numbers, factors))
    for k, (name, direction) in enumerate(zip(names, found.plan.objectives.values(), strict=True)):
        best = so_far(values[:, k], direction)
        steps = list(zip(np.repeat(numbers, 2)[1:], np.repeat(best, 2)[:-1], strict=True))
        caption = f"each trial, and the best so far ({direction}d)"
        small.append(_points("trial", name, numbers, values[:, k], numbers, steps, caption))
    yield tag("div", *small, class_="grid")
    for each in plot_data(found.runs(), tuple(found.plan.objectives), found.plan.names, "parallel"):
        yield _parallel(with_units(each, units))


def _front(found: TuneTable, names: Sequence[str], values: Floats, numbers: Floats, factors: Sequence[float]) -> Html:
    """The first two objectives; what is minimised, a cost, to the right."""
    across, up = (1, 0) if next(iter(found.plan.objectives.values())) == "maximise" else (0, 1)
    best = np.array([trial.values for trial in found.best()], float) * factors
    order = np.argsort(best[:, across], kind="stable")
    line = [(x, y) for x, y in best[order][:, [across, up]]] if len(names) == 2 else []
    caption = "each trial; the line joins those that no other beats"
    return _points(names[across], names[up], values[:, across], values[:, up], numbers, line, caption)


def _points(
    x_name: str, y_name: str, x: Floats, y: Floats, numbers: Floats, line: Sequence[tuple[float, float]], caption: str
) -> Html:
    floor = TOP + TALL
    to_x, to_y = _scale(x, LEFT + 6, WIDE - 18), _scale(y, floor, TOP)
    parts: list[Html] = [html.line(LEFT, floor, WIDE - 12, floor, "axis"), *_up(y, to_y)]
    marks = ticks(float(x.min()), float(x.max()), 5) if np.ptp(x) else [float(x.min())]
    for mark in marks:
        parts.append(html.line(to_x(mark), floor, to_x(mark), floor + 4, "axis"))
        parts.append(html.text(to_x(mark), floor + 16, tick(mark, marks), "tick", "middle"))
    if line:
        parts.append(tag("path", d=_path(line, to_x, to_y), style=_LINE.format(0)))
    for a, b, number in zip(x, y, numbers, strict=True):
        where = "" if x_name == "trial" else f", {x_name} {few(float(a))}"
        title = tag("title", f"trial {int(number)}: {y_name} {few(float(b))}{where}")
        parts.append(tag("circle", title, cx=to_x(a), cy=to_y(b), r=3.0, class_="item2", fill_opacity=0.75))
    parts.append(html.text((LEFT + WIDE) / 2, floor + 34, x_name, "quiet", "middle"))
    picture = html.svg(WIDE, TOP + TALL + BELOW, *parts, label=f"{y_name} over {x_name}")
    return html.figure(picture, caption, y_name)
