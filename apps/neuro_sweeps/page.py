"""The HTML page of a sweep or a search: one file without external parts, with the state at the time of writing."""

from __future__ import annotations

import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from itertools import chain
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

# Largest numbers of rows of a page: of runs or trials, of errors, and of best trials; and of lines of a figure.
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
    content, kind, counts, path = folder.read(), folder.kind, table.counts(), shlex.quote(str(table.path))
    run, units, commands = content["what"], content.get("units", {}), ["table", "plot", "status"]
    pruned, without_value = "", list[TrialRow]()
    if isinstance(table, SweepTable):
        outcomes, under_way, size = table.outcomes(), counts["under way"], some(len(table), "run")
        place = f" on {run['backend']}" if run["kind"] == "network" else ""
        lead = f"{place} over {', '.join(table.parameters) or 'seeds'}: {size}."
        times = [outcome.seconds for outcome in outcomes.values()]
        results, keys, repeated = _metrics(table, units), list(table.keys[:1]), "any run"
    else:
        plan, trials, times = table.plan, table.trials(), []
        outcomes = folder.outcomes({item.key: None for trial in trials for item in trial.items})
        without_value = [trial for trial in trials if trial.has_no_value and trial.error]
        under_way, size = sum(trial.outcome == "under way" for trial in trials), some(plan.most, "trial")
        objectives = ", ".join(f"{name} {direction}d" for name, direction in plan.objectives.items())
        runs = "" if plan.runs == 1 else f", each the mean of {plan.runs} runs"
        lead = f": {objectives}, over {', '.join(plan.names)}; {size} by {plan.sampler}{runs}."
        pruned = f"by {plan.prune['by']}" if plan.prune else ""
        commands += ["test"] if plan.folds else []
        results = chain(_best(table, units), _objectives(table, trials))
        keys, repeated = [trial.items[0].key for trial in table.best()[:1]], "a run of the best trial"
    name = Path(run["file"]).name if run["kind"] == "network" else run["name"]
    cards = [
        html.card("done", f"{counts['done']:,}", f"of {size}"),
        html.card("failed", f"{counts['failed']:,}", "kept with their errors" if counts["failed"] else "none"),
        *([html.card("pruned", f"{counts['pruned']:,}", pruned)] if pruned else ()),
        html.card("left", f"{counts['left']:,}", f"{under_way:,} of them under way"),
    ]
    if times:
        median = quantity(float(np.median(times)), "s", 3)
        cards.append(html.card("time per run", median, f"median; total {sum(times):,.3g} s"))
    arguments = {"table": " --out table.csv"}
    parts = [
        html.tag("header", html.tag("h1", table.name), html.tag("p", f"{name}{lead}", class_="lead")),
        html.tag("div", *cards, class_="cards"),
        *results,
        *_failures(table, outcomes, without_value),
        *_rows(table, units),
        *_origin(content, outcomes),
        html.tag("h2", "Next steps"),
        html.tag("pre", "\n".join(f"neuro {kind.command} {word} {path}{arguments.get(word, '')}" for word in commands)),
    ]
    for key in keys:
        parts += [
            html.tag("p", f"Repeat {repeated} with the same bits:"),
            html.tag("pre", f"neuro rerun {path}/runs/{key}"),
        ]
    parts.append(html.tag("footer", f"Written by neuro {neuro.__version__} (neuro {kind.command})."))
    return html.page(f"neuro {kind.command}", f"{table.name}: a {kind.what}", parts)


def _metrics(table: SweepTable, units: Units) -> Iterator[html.Html]:
    try:
        data = [with_units(metric_data, units) for metric_data in plot_data(table, (), (), "auto")]
    except ModelError as error:
        yield html.tag("p", error.message)
        return
    yield html.tag("h2", "Metrics")
    yield from _side_by_side(*((metric_data.kind, _metric(metric_data)) for metric_data in data))


def _metric(data: PlotData) -> html.Html:
    """Return the figure of a metric, with the first lines if there are many."""
    axes = data.names[0] if data.kind == "lines" else " and ".join(data.names)
    first_lines, n_more = data.first_lines(_MOST_LINES)
    caption = _CAPTIONS.get(data.kind, f"over {axes}" + f": {data.caption}" * bool(data.caption))
    note = f", without {n_more} more lines" if n_more else ""
    return html.figure(
        html.figure_svg(draw(first_lines, wide=_WIDE), f"{data.metric} over {axes}"), caption + note, data.metric
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
    hidden_columns = {"attempts"} if any(row["error"] for row in finished_rows) else {"attempts", "error"}
    names = [name for name in finished_rows[0] if name not in hidden_columns]
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
    lines = {line for outcome in outcomes.values() for line in differences(record, outcome.provenance | {"seed": None})}
    lines = {line for line in lines if not line.startswith(("seed", "backend", "threads", "network"))}
    if lines:
        yield html.tag("p", "Some runs have other versions or another machine:")
        yield html.tag("ul", *(html.tag("li", line) for line in sorted(lines)[:MOST_REASONS]), class_="remarks")


def _headings(names: Iterable[str], units: Units) -> list[str]:
    """Return the headings of columns with units; joules have the unit in the cells. The first is left-aligned."""
    heading_units = {name: unit for name, unit in units.items() if unit != "J"}
    first, *other_heads = [name_with_unit(name, heading_units.get(name.lstrip(">"), "")) for name in names]
    return [first.lstrip(">"), *other_heads]


def _cell(value: Any, name: str, units: Units) -> str:
    """Return a value with three digits, and joules with a prefix."""
    return text(value, name) if name == "run" else with_unit(value, "J" if units.get(name) == "J" else "")


def _best(table: TuneTable, units: Units) -> Iterator[html.Html]:
    best_numbers = {trial.number for trial in table.best()}
    rows = [row for row in table.rows() if row["trial"] in best_numbers]
    if not rows:
        return
    names = [name for name in rows[0] if name not in ("outcome", "best", "error")]
    first = next(iter(table.plan.objectives))
    body = [
        [_cell(row[name], name, units) for name in names] for row in sorted(rows, key=lambda row: float(row[first]))
    ]
    yield html.tag("h2", "Best trial" if len(table.plan.objectives) == 1 else "Front: trials that no other trial beats")
    note = f"the first {MOST_BEST} of {len(body)}" if len(body) > MOST_BEST else ""
    yield html.table(_headings([f">{name}" for name in names], units), body[:MOST_BEST], note)


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
