"""The HTML page of a sweep or a search: one file without external parts, with the state at the time of writing."""

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
from neuro_sweeps.pictures import (
    PlotData,
    Units,
    draw,
    name_with_unit,
    plot_data,
    search_pictures,
    short_text,
    with_units,
)
from neuro_sweeps.table import RunRows, SweepTable, columns, failures_by_reason, text, with_unit
from neuro_sweeps.trials import TrialRow, TuneTable

PAGES = {
    name: sealed(f"a page of 'neuro {name}'", f'<meta name="generator" content="neuro {name}">', "<!-- digest {} -->")
    for name in ("sweep", "tune")
}

MOST_ROWS = 500
MOST_REASONS = 20
MOST_BEST = 50
_MOST_LINES = 8
_WIDE = 4.6
"""Width of a figure in inches."""
_CAPTIONS = {
    "parallel": "a line per point, in the colour of the metric",
    "history": "all trials, and the best value so far",
    "front": "all trials; the line joins the front, which no trial beats",
}
"""Captions by kind of figure."""


def write_page(table: SweepTable | TuneTable, path: Path | None = None) -> Path:
    """Write the page, and return its path; default: sweep.html or tune.html in the folder.

    Raises:
        Unwritable: the file cannot be written, or is not such a page.
    """
    command = "sweep" if isinstance(table, SweepTable) else "tune"
    path = table.path / f"{command}.html" if path is None else path
    with output(path, PAGES[command]) as part:
        part.write_text(PAGES[command].seal(page(table)), "utf-8")
    return path


def page(table: SweepTable | TuneTable) -> str:
    """Return the page as HTML."""
    folder = Folder(table.path)
    content, kind = folder.read(), folder.kind
    if isinstance(table, SweepTable):
        outcomes = table.outcomes()
        parts = [*_sweep_parts(table, content, outcomes)]
    else:
        trials = table.trials()
        outcomes = folder.outcomes({item.key: None for each in trials for item in each.items})
        parts = [*_search_parts(table, content, trials, outcomes)]
    footer = html.tag("footer", f"Written by neuro {neuro.__version__} (neuro {kind.command}).")
    return html.page(f"neuro {kind.command}", f"{table.name}: a {kind.what}", [*parts, footer])


def _sweep_parts(
    table: SweepTable, content: Mapping[str, Any], outcomes: Mapping[str, RunOutcome]
) -> Iterator[html.Html]:
    what, over = content["what"], ", ".join(table.parameters) or "seeds"
    on = f" on {what['backend']}" if what["kind"] == "network" else ""
    yield _head(table, what, f"{on} over {over}: {some(len(table), 'run')}.")
    yield html.tag("div", *_sweep_cards(table.counts(), outcomes), class_="cards")
    yield from _metrics(table, content.get("units", {}))
    yield from _failures(table, outcomes, ())
    yield from _rows(table, content.get("units", {}))
    yield from _origin(content, outcomes)
    yield from _next(table, ("table", "plot", "status"))
    if first := next(iter(table.keys), None):
        yield html.tag("p", "Repeat any run with the same bits:")
        yield html.tag("pre", f"neuro rerun {shlex.quote(str(table.path))}/runs/{first}")


def _search_parts(
    table: TuneTable, content: Mapping[str, Any], trials: Sequence[TrialRow], outcomes: Mapping[str, RunOutcome]
) -> Iterator[html.Html]:
    plan = table.plan
    objectives = ", ".join(f"{name} {direction}d" for name, direction in plan.objectives.items())
    runs = "" if plan.runs == 1 else f", each the mean of {plan.runs} runs"
    trials_by = f"{some(plan.most, 'trial')} by {plan.sampler}{runs}"
    yield _head(table, content["what"], f": {objectives}, over {', '.join(plan.names)}; {trials_by}.")
    yield html.tag("div", *_search_cards(table, trials), class_="cards")
    units = content.get("units", {})
    yield from _best(table, units)
    yield from _objectives(table, trials)
    yield from _failures(table, outcomes, [trial for trial in trials if trial.has_no_value and trial.error])
    yield from _rows(table, units)
    yield from _origin(content, outcomes)
    yield from _next(table, ("table", "plot", "status", *(("test",) if plan.folds else ())))
    if best := table.best():
        yield html.tag("p", "Repeat a run of the best trial with the same bits:")
        yield html.tag("pre", f"neuro rerun {shlex.quote(str(table.path))}/runs/{best[0].items[0].key}")


def _head(table: SweepTable | TuneTable, what: Mapping[str, Any], rest: str) -> html.Html:
    name = Path(what["file"]).name if what["kind"] == "network" else what["name"]
    return html.tag("header", html.tag("h1", table.name), html.tag("p", f"{name}{rest}", class_="lead"))


def _sweep_cards(counts: Mapping[str, int], outcomes: Mapping[str, RunOutcome]) -> Iterator[html.Html]:
    seconds = [each.seconds for each in outcomes.values()]
    total = counts["done"] + counts["failed"] + counts["left"]
    yield from _cards(counts, some(total, "run"), counts["under way"])
    if seconds:
        median = quantity(float(np.median(seconds)), "s", 3)
        yield html.card("time per run", median, f"median; total {sum(seconds):,.3g} s")


def _search_cards(table: TuneTable, trials: Sequence[TrialRow]) -> Iterator[html.Html]:
    under_way = sum(each.outcome == "under way" for each in trials)
    pruned = f"by {table.plan.prune['by']}" if table.plan.prune else ""
    yield from _cards(table.counts(), some(table.plan.most, "trial"), under_way, pruned)


def _cards(counts: Mapping[str, int], total: str, under_way: int, pruned: str = "") -> Iterator[html.Html]:
    yield html.card("done", f"{counts['done']:,}", f"of {total}")
    yield html.card("failed", f"{counts['failed']:,}", "kept with their errors" if counts["failed"] else "none")
    if pruned:
        yield html.card("pruned", f"{counts['pruned']:,}", pruned)
    yield html.card("left", f"{counts['left']:,}", f"{under_way:,} of them under way")


def _metrics(table: SweepTable, units: Units) -> Iterator[html.Html]:
    try:
        data = [with_units(each, units) for each in plot_data(table, (), (), "auto")]
    except ModelError as error:
        yield html.tag("p", error.message)
        return
    yield html.tag("h2", "Metrics")
    yield from _side_by_side(*((each.kind, _metric(each)) for each in data))


def _metric(data: PlotData) -> html.Html:
    """Return the figure of a metric, with the first lines if there are many."""
    over = data.names[0] if data.kind == "lines" else " and ".join(data.names)
    first_lines, more = data.first_lines(_MOST_LINES)
    caption = _CAPTIONS.get(data.kind, f"over {over}" + f": {data.caption}" * bool(data.caption))
    rest = f", without {more} more lines" if more else ""
    return html.figure(
        html.figure_svg(draw(first_lines, wide=_WIDE), f"{data.metric} over {over}"), caption + rest, data.metric
    )


def _side_by_side(*pictures: tuple[str, html.Html]) -> Iterator[html.Html]:
    """Place figures (kind, HTML) side by side, and parallel coordinates below."""
    small = [picture for kind, picture in pictures if kind != "parallel"]
    if small:
        yield html.tag("div", *small, class_="grid")
    yield from (picture for kind, picture in pictures if kind == "parallel")


def _failures(
    table: SweepTable | TuneTable, outcomes: Mapping[str, RunOutcome], without_value: Sequence[TrialRow]
) -> Iterator[html.Html]:
    """Show the errors of failed runs, and of trials without a value, whose runs are done."""
    groups = failures_by_reason(outcomes)
    if not groups and not without_value:
        return
    yield html.tag("h2", "Failures")
    rows = []
    for runs in groups[:MOST_REASONS]:
        seed = {} if runs[0].seed is None else {"seed": runs[0].seed}
        rows.append((f"{len(runs):,}", runs[0].error, _point(runs[0].point | seed), runs[0].key[:10]))
    rows += [("1", trial.error, _point(trial.point), f"trial {trial.number}") for trial in without_value]
    yield html.table((">runs", "error of the first run", "point", "run"), rows[:MOST_REASONS])
    if len(groups) > MOST_REASONS:
        yield html.tag("p", f"{len(groups) - MOST_REASONS} more errors are in the table.")
    if groups:
        command, file = ("sweep", "SWEEP") if isinstance(table, SweepTable) else ("tune", "SEARCH")
        yield html.tag("p", "Repeat failed runs:")
        yield html.tag("pre", f"neuro {command} run {file}.yaml --out {shlex.quote(str(table.path))} --retry-failed")


def _point(point: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} = {short_text(value)}" for name, value in point.items())


def _rows(table: RunRows, units: Units) -> Iterator[html.Html]:
    """Show the first rows of a table, without runs that are left."""
    rows = table.rows(times=True)
    finished_rows = [row for row in rows if row["outcome"] != "left"][:MOST_ROWS]
    if not finished_rows:
        return
    yield html.tag("h2", table.many.capitalize())
    hidden = {"attempts"} if any(row["error"] for row in finished_rows) else {"attempts", "error"}
    names = [name for name in finished_rows[0] if name not in hidden]
    body = [[_cell(row[name], name, units) for name in names] for row in finished_rows]
    yield html.table(
        _headings(columns(names), units),
        body,
        f"the first {MOST_ROWS} of {len(rows):,}" if len(rows) > MOST_ROWS else "",
    )


def _origin(content: Mapping[str, Any], outcomes: Mapping[str, RunOutcome]) -> Iterator[html.Html]:
    """Show the provenance of the runs, and differences in versions and machines between runs."""
    record = content["provenance"]
    yield html.tag("h2", "Provenance")
    versions = ", ".join(f"{name} {number}" for name, number in record["versions"].items())
    commit = f", commit {record['commit']}" if record["commit"] else ""
    rows = [("command", record["command"]), ("neuro", f"{record['neuro']}{commit}"), ("versions", versions)]
    rows += [("machine", record["machine"])]
    rows += [(f"input {Path(name).name}", f"{name}, sha256 {digest[:16]}") for name, digest in record["inputs"].items()]
    yield html.table(("source", "value"), rows)
    others = {line for each in outcomes.values() for line in differences(record, each.provenance | {"seed": None})}
    others = {line for line in others if not line.startswith(("seed", "backend", "threads", "network"))}
    if others:
        yield html.tag("p", "Some runs have other versions or another machine:")
        yield html.tag("ul", *(html.tag("li", line) for line in sorted(others)[:MOST_REASONS]), class_="remarks")


def _next(table: SweepTable | TuneTable, commands: Iterable[str]) -> Iterator[html.Html]:
    name, words = shlex.quote(str(table.path)), {"table": " --out table.csv"}
    command = "sweep" if isinstance(table, SweepTable) else "tune"
    yield html.tag("h2", "Next steps")
    yield html.tag("pre", "\n".join(f"neuro {command} {each} {name}{words.get(each, '')}" for each in commands))


def _headings(names: Iterable[str], units: Units) -> list[str]:
    """Return the headings of columns with units; joules have the unit in the cells. The first is left-aligned."""
    heading_units = {name: unit for name, unit in units.items() if unit != "J"}
    first, *rest = [name_with_unit(name, heading_units.get(name.lstrip(">"), "")) for name in names]
    return [first.lstrip(">"), *rest]


def _cell(value: Any, name: str, units: Units) -> str:
    """Return a value with three digits, and joules with a prefix."""
    return text(value, name) if name == "run" else with_unit(value, "J" if units.get(name) == "J" else "")


def _best(table: TuneTable, units: Units) -> Iterator[html.Html]:
    best = {each.number for each in table.best()}
    rows = [row for row in table.rows() if row["trial"] in best]
    if not rows:
        return
    names = [name for name in rows[0] if name not in ("outcome", "best", "error")]
    first = next(iter(table.plan.objectives))
    body = [
        [_cell(row[name], name, units) for name in names] for row in sorted(rows, key=lambda row: float(row[first]))
    ]
    yield html.tag("h2", "Best trial" if len(table.plan.objectives) == 1 else "Front: trials that no other trial beats")
    more = f"the first {MOST_BEST} of {len(body)}" if len(body) > MOST_BEST else ""
    yield html.table(_headings([f">{name}" for name in names], units), body[:MOST_BEST], more)


def _objectives(table: TuneTable, trials: Sequence[TrialRow]) -> Iterator[html.Html]:
    if not any(trial.values is not None for trial in trials):
        yield html.tag("p", "No trial is done yet.")
        return
    yield html.tag("h2", "Objectives")
    kinds = ("front", "history", "parallel") if len(table.plan.objectives) > 1 else ("history", "parallel")
    pictures = []
    for name, figure in search_pictures(table, kinds, title="", wide=_WIDE).items():
        kind = name.rpartition("-")[2]
        image = html.figure_svg(figure, f"{name} of {table.name}")
        pictures.append((kind, html.figure(image, _CAPTIONS[kind], name)))
    yield from _side_by_side(*pictures)
