"""The page of a sweep or of a search: it needs nothing else, and shows what is there when it is written."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

import neuro
from neuro import ModelError
from neuro.apps import differences, html, output, quantity, sealed, some
from neuro_sweeps.folder import Folder, RunOutcome
from neuro_sweeps.pictures import PlotData, Units, draw, named, plot_data, search_pictures, told, with_units
from neuro_sweeps.table import RunRows, SweepTable, columns, measured, reasons, text
from neuro_sweeps.trials import FoundTrial, TuneTable

PAGES = {
    name: sealed(f"a page of 'neuro {name}'", f'<meta name="generator" content="neuro {name}">', "<!-- digest {} -->")
    for name in ("sweep", "tune")
}

MOST_ROWS = 500
MOST_REASONS = 20
MOST_BEST = 50
_MOST_LINES = 8
_WIDE = 4.6
"""Inches of a figure of the page."""
_CAPTIONS = {
    "parallel": "a line for each point, in the colour of its metric",
    "history": "each trial, and the best so far",
    "front": "each trial; the line joins those that no other beats",
}
"""By kind of picture."""


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
    footer = html.tag("footer", f"Written by neuro {neuro.__version__} (neuro {holding.command}).")
    return html.page(f"neuro {holding.command}", f"{found.name}: a {holding.what}", [*parts, footer])


def _of_sweep(found: SweepTable, said: Mapping[str, Any], outcomes: Mapping[str, RunOutcome]) -> Iterator[html.Html]:
    what, over = said["what"], ", ".join(found.parameters) or "seeds"
    on = f" on {what['backend']}" if what["kind"] == "network" else ""
    yield _head(found, what, f"{on} over {over}: {some(len(found), 'run')}.")
    yield html.tag("div", *_sweep_cards(found.counts(), outcomes), class_="cards")
    yield from _metrics(found, said.get("units", {}))
    yield from _failures(found, outcomes, ())
    yield from _rows(found, said.get("units", {}))
    yield from _origin(said, outcomes)
    yield from _next(found, ("table", "plot", "status"))
    if first := next(iter(found.keys), None):
        yield html.tag("p", "Any run again, to the bit:")
        yield html.tag("pre", f"neuro rerun {shlex.quote(str(found.path))}/runs/{first}")


def _of_search(
    found: TuneTable, said: Mapping[str, Any], trials: Sequence[FoundTrial], outcomes: Mapping[str, RunOutcome]
) -> Iterator[html.Html]:
    plan = found.plan
    aims = ", ".join(f"{name} {direction}d" for name, direction in plan.objectives.items())
    runs = "" if plan.runs == 1 else f", each the mean of {plan.runs} runs"
    trials_by = f"{some(plan.most, 'trial')} by {plan.sampler}{runs}"
    yield _head(found, said["what"], f": {aims}, over {', '.join(plan.names)}; {trials_by}.")
    yield html.tag("div", *_search_cards(found, trials), class_="cards")
    units = said.get("units", {})
    yield from _best(found, units)
    yield from _objectives(found, trials)
    yield from _failures(found, outcomes, [trial for trial in trials if trial.has_no_value and trial.error])
    yield from _rows(found, units)
    yield from _origin(said, outcomes)
    yield from _next(found, ("table", "plot", "status", *(("test",) if plan.folds else ())))
    if best := found.best():
        yield html.tag("p", "A run of the best again, to the bit:")
        yield html.tag("pre", f"neuro rerun {shlex.quote(str(found.path))}/runs/{best[0].items[0].key}")


def _head(found: SweepTable | TuneTable, what: Mapping[str, Any], rest: str) -> html.Html:
    of = Path(what["file"]).name if what["kind"] == "network" else what["name"]
    return html.tag("header", html.tag("h1", found.name), html.tag("p", f"{of}{rest}", class_="lead"))


def _sweep_cards(counts: Mapping[str, int], outcomes: Mapping[str, RunOutcome]) -> Iterator[html.Html]:
    seconds = [each.seconds for each in outcomes.values()]
    total = counts["done"] + counts["failed"] + counts["left"]
    yield from _cards(counts, some(total, "run"), counts["under way"])
    if seconds:
        took = quantity(float(np.median(seconds)), "s", 3)
        yield html.card("a run took", took, f"the median; {sum(seconds):,.3g} s all together")


def _search_cards(found: TuneTable, trials: Sequence[FoundTrial]) -> Iterator[html.Html]:
    under_way = sum(each.outcome == "under way" for each in trials)
    pruned = f"by {found.plan.prune['by']}" if found.plan.prune else ""
    yield from _cards(found.counts(), some(found.plan.most, "trial"), under_way, pruned)


def _cards(counts: Mapping[str, int], total: str, under_way: int, pruned: str = "") -> Iterator[html.Html]:
    yield html.card("done", f"{counts['done']:,}", f"of {total}")
    yield html.card("failed", f"{counts['failed']:,}", "kept with their errors" if counts["failed"] else "none")
    if pruned:
        yield html.card("pruned", f"{counts['pruned']:,}", pruned)
    yield html.card("left", f"{counts['left']:,}", f"{under_way:,} of them under way")


def _metrics(found: SweepTable, units: Units) -> Iterator[html.Html]:
    try:
        data = [with_units(each, units) for each in plot_data(found, (), (), "auto")]
    except ModelError as error:
        yield html.tag("p", error.message)
        return
    yield html.tag("h2", "Metrics")
    yield from _beside(*((each.kind, _metric(each)) for each in data))


def _metric(data: PlotData) -> html.Html:
    """A picture of one metric; of many lines the first are drawn."""
    over = data.names[0] if data.kind == "lines" else " and ".join(data.names)
    shown, more = data.first_lines(_MOST_LINES)
    caption = _CAPTIONS.get(data.kind, f"over {over}" + f": {data.caption}" * bool(data.caption))
    rest = f", {more} more lines are not drawn" if more else ""
    return html.figure(html.drawn(draw(shown, wide=_WIDE), f"{data.metric} over {over}"), caption + rest, data.metric)


def _beside(*pictures: tuple[str, html.Html]) -> Iterator[html.Html]:
    """Pictures beside each other, by kind; parallel coordinates below them."""
    small = [picture for kind, picture in pictures if kind != "parallel"]
    if small:
        yield html.tag("div", *small, class_="grid")
    yield from (picture for kind, picture in pictures if kind == "parallel")


def _failures(
    found: SweepTable | TuneTable, outcomes: Mapping[str, RunOutcome], judged: Sequence[FoundTrial]
) -> Iterator[html.Html]:
    """Why runs failed, and trials whose runs were done: `judged`."""
    failed = reasons(outcomes)
    if not failed and not judged:
        return
    yield html.tag("h2", "What failed")
    rows = []
    for those in failed[:MOST_REASONS]:
        seed = {} if those[0].seed is None else {"seed": those[0].seed}
        rows.append((f"{len(those):,}", those[0].error, _point(those[0].point | seed), those[0].key[:10]))
    rows += [("1", trial.error, _point(trial.point), f"trial {trial.number}") for trial in judged]
    yield html.table((">runs", "why, of the first", "its point", "run"), rows[:MOST_REASONS])
    if len(failed) > MOST_REASONS:
        yield html.tag("p", f"{len(failed) - MOST_REASONS} more reasons are in the table.")
    if failed:
        command, file = ("sweep", "SWEEP") if isinstance(found, SweepTable) else ("tune", "SEARCH")
        yield html.tag("p", "What failed is not tried again, unless that is asked for:")
        yield html.tag("pre", f"neuro {command} run {file}.yaml --out {shlex.quote(str(found.path))} --retry-failed")


def _point(point: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} = {told(value)}" for name, value in point.items())


def _rows(found: RunRows, units: Units) -> Iterator[html.Html]:
    """The rows of a table, those first that are there."""
    rows = found.rows(times=True)
    there = [row for row in rows if row["outcome"] != "left"][:MOST_ROWS]
    if not there:
        return
    yield html.tag("h2", found.many.capitalize())
    left_out = {"attempts"} if any(row["error"] for row in there) else {"attempts", "error"}
    names = [name for name in there[0] if name not in left_out]
    body = [[_cell(row[name], name, units) for name in names] for row in there]
    yield html.table(
        _headed(columns(names), units), body, f"the first {MOST_ROWS} of {len(rows):,}" if len(rows) > MOST_ROWS else ""
    )


def _origin(content: Mapping[str, Any], outcomes: Mapping[str, RunOutcome]) -> Iterator[html.Html]:
    """Where runs come from, and whether all are of the same versions and machine."""
    record = content["provenance"]
    yield html.tag("h2", "Where it comes from")
    versions = ", ".join(f"{name} {number}" for name, number in record["versions"].items())
    commit = f", commit {record['commit']}" if record["commit"] else ""
    rows = [("command", record["command"]), ("neuro", f"{record['neuro']}{commit}"), ("versions", versions)]
    rows += [("machine", record["machine"])]
    rows += [(f"input {Path(name).name}", f"{name}, sha256 {digest[:16]}") for name, digest in record["inputs"].items()]
    yield html.table(("what", "is"), rows)
    others = {line for each in outcomes.values() for line in differences(record, each.provenance | {"seed": None})}
    others = {line for line in others if not line.startswith(("seed", "backend", "threads", "network"))}
    if others:
        yield html.tag("p", "Not all runs are of the same versions and machine:")
        yield html.tag("ul", *(html.tag("li", line) for line in sorted(others)[:MOST_REASONS]), class_="remarks")


def _next(found: SweepTable | TuneTable, commands: Iterable[str]) -> Iterator[html.Html]:
    name, words = shlex.quote(str(found.path)), {"table": " --out table.csv"}
    command = "sweep" if isinstance(found, SweepTable) else "tune"
    yield html.tag("h2", "What next")
    yield html.tag("pre", "\n".join(f"neuro {command} {each} {name}{words.get(each, '')}" for each in commands))


def _headed(names: Iterable[str], units: Units) -> list[str]:
    """Heads of columns with their units, the first at the left; joules have theirs in the cells."""
    of = {name: unit for name, unit in units.items() if unit != "J"}
    first, *rest = [named(name, of.get(name.lstrip(">"), "")) for name in names]
    return [first.lstrip(">"), *rest]


def _cell(value: Any, name: str, units: Units) -> str:
    """A value in three digits, joules with their prefix."""
    return text(value, name) if name == "run" else measured(value, "J" if units.get(name) == "J" else "")


def _best(found: TuneTable, units: Units) -> Iterator[html.Html]:
    best = {each.number for each in found.best()}
    rows = [row for row in found.rows() if row["trial"] in best]
    if not rows:
        return
    names = [name for name in rows[0] if name not in ("outcome", "best", "error")]
    first = next(iter(found.plan.objectives))
    body = [
        [_cell(row[name], name, units) for name in names] for row in sorted(rows, key=lambda row: float(row[first]))
    ]
    yield html.tag("h2", "Best" if len(found.plan.objectives) == 1 else "No other trial beats these")
    more = f"the first {MOST_BEST} of {len(body)}" if len(body) > MOST_BEST else ""
    yield html.table(_headed([f">{name}" for name in names], units), body[:MOST_BEST], more)


def _objectives(found: TuneTable, trials: Sequence[FoundTrial]) -> Iterator[html.Html]:
    done = [trial for trial in trials if trial.values is not None]
    if not done:
        yield html.tag("p", "No trial is done yet.")
        return
    yield html.tag("h2", "Objectives")
    kinds = ("front", "history", "parallel") if len(found.plan.objectives) > 1 else ("history", "parallel")
    pictures = []
    for name, figure in search_pictures(found, kinds, title="", wide=_WIDE).items():
        kind = name.rpartition("-")[2]
        drawn = html.drawn(figure, f"{name} of {found.name}")
        pictures.append((kind, html.figure(drawn, _CAPTIONS[kind], name)))
    yield from _beside(*pictures)
