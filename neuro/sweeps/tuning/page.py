"""The page of a search: it needs nothing else, and shows what is there when it is written."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from neuro.core import html
from neuro.core.html import Html, table, tag
from neuro.core.outputs import output, sealed
from neuro.core.version import VERSION
from neuro.sweeps.folder import TUNING, Folder
from neuro.sweeps.page import BELOW, LEFT, MOST_REASONS, TALL, TOP, WIDE, card, many, origin, parallel, rows_of, scale
from neuro.sweeps.plot_data import plot_data, told
from neuro.sweeps.rows import text
from neuro.sweeps.table import reasons
from neuro.sweeps.tuning.objectives import Floats, so_far
from neuro.sweeps.tuning.table import FoundTrial, TuneTable

PAGE = sealed("a page of 'neuro tune'", '<meta name="generator" content="neuro tune">', "<!-- digest {} -->")
MOST_BEST = 50


def write_page(found: TuneTable, path: Path | None = None) -> Path:
    """Write the page; into the folder of the search if no file is given.

    Raises:
        Unwritable: it cannot be written, or something else stands there.
    """
    path = found.path / "tune.html" if path is None else path
    with output(path, PAGE) as part:
        part.write_text(PAGE.seal(page(found)), "utf-8")
    return path


def page(found: TuneTable) -> str:
    """The page as HTML text."""
    said = Folder(found.path, TUNING).read()
    trials = found.trials()
    outcomes = Folder(found.path, TUNING).outcomes({item.key: None for each in trials for item in each.items})
    parts = (
        _head(found, said),
        tag("div", *_cards(found, trials), class_="cards"),
        *_best(found),
        *_pictures(found, trials),
        *_failures(found, trials, outcomes),
        *rows_of(found),
        *origin(said, outcomes),
        *_next(found),
        tag("footer", f"Written by neuro {VERSION} (neuro tune)."),
    )
    return html.page("neuro tune", f"{found.name}: a tuning", parts)


def _head(found: TuneTable, said: Mapping[str, Any]) -> Html:
    what, plan = said["what"], found.plan
    of = Path(what["file"]).name if what["kind"] == "network" else what["name"]
    aims = ", ".join(f"{name} {direction}d" for name, direction in plan.objectives.items())
    runs = "" if plan.runs == 1 else f", each the mean of {plan.runs} runs"
    lead = f"{of}: {aims}, over {', '.join(plan.names)}; {many(plan.most, 'trial')} by {plan.sampler}{runs}."
    return tag("header", tag("h1", found.name), tag("p", lead, class_="lead"))


def _cards(found: TuneTable, trials: Sequence[FoundTrial]) -> Iterator[Html]:
    counts = found.counts()
    under_way = sum(each.outcome == "under way" for each in trials)
    yield card("done", f"{counts['done']:,}", f"of {many(found.plan.most, 'trial')}")
    yield card("failed", f"{counts['failed']:,}", "kept with their errors" if counts["failed"] else "none")
    if found.plan.prune:
        yield card("pruned", f"{counts['pruned']:,}", f"by {found.plan.prune['by']}")
    yield card("left", f"{counts['left']:,}", f"{under_way:,} of them under way")


def _best(found: TuneTable) -> Iterator[Html]:
    best = {each.number for each in found.best()}
    rows = [row for row in found.rows() if row["trial"] in best]
    if not rows:
        return
    names = [name for name in rows[0] if name not in ("outcome", "best", "error")]
    first = next(iter(found.plan.objectives))
    body = [[text(row[name], name) for name in names] for row in sorted(rows, key=lambda row: float(row[first]))]
    yield tag("h2", "Best" if len(found.plan.objectives) == 1 else "No other trial beats these")
    more = f"the first {MOST_BEST} of {len(body)}" if len(body) > MOST_BEST else ""
    yield table([f">{name}" for name in names], body[:MOST_BEST], more)


def _pictures(found: TuneTable, trials: Sequence[FoundTrial]) -> Iterator[Html]:
    done = [trial for trial in trials if trial.values is not None]
    if not done:
        yield tag("p", "No trial is done yet.")
        return
    yield tag("h2", "Objectives")
    values = np.array([trial.values for trial in done], float)
    numbers = np.array([trial.number for trial in done], float)
    small = []
    if len(found.plan.objectives) > 1:
        small.append(_front(found, values, numbers))
    for k, (name, direction) in enumerate(found.plan.objectives.items()):
        best = so_far(values[:, k], direction)
        steps = list(zip(np.repeat(numbers, 2)[1:], np.repeat(best, 2)[:-1], strict=True))
        caption = f"each trial, and the best so far ({direction}d)"
        small.append(_points("trial", name, numbers, values[:, k], numbers, steps, caption))
    yield tag("div", *small, class_="grid")
    for each in plot_data(found.runs(), tuple(found.plan.objectives), found.plan.names, "parallel"):
        yield parallel(each)


def _front(found: TuneTable, values: Floats, numbers: Floats) -> Html:
    """The first two objectives; what is minimised, a cost, to the right."""
    names = list(found.plan.objectives)
    across, up = (1, 0) if found.plan.objectives[names[0]] == "maximise" else (0, 1)
    best = np.array([trial.values for trial in found.best()], float)
    order = np.argsort(best[:, across], kind="stable")
    line = [(x, y) for x, y in best[order][:, [across, up]]] if len(names) == 2 else []
    caption = "each trial; the line joins those that no other beats"
    return _points(names[across], names[up], values[:, across], values[:, up], numbers, line, caption)


def _points(
    x_name: str, y_name: str, x: Floats, y: Floats, numbers: Floats, line: Sequence[tuple[float, float]], caption: str
) -> Html:
    floor = TOP + TALL
    to_x, to_y = scale(x, LEFT + 6, WIDE - 18), scale(y, floor, TOP)
    parts: list[Html] = [html.line(LEFT, floor, WIDE - 12, floor, "axis")]
    for share in (0.0, 0.5, 1.0):
        up, across = y.min() + share * (y.max() - y.min()), x.min() + share * (x.max() - x.min())
        parts.append(html.line(LEFT, to_y(up), WIDE - 12, to_y(up), "rule"))
        parts.append(html.text(LEFT - 6, to_y(up) + 4, f"{up:.3g}", "tick", "end"))
        parts.append(html.text(to_x(across), floor + 16, _tick(across, x_name), "tick", "middle"))
    if line:
        d = "M" + "L".join(f"{to_x(a):.1f} {to_y(b):.1f}" for a, b in line)
        parts.append(tag("path", d=d, style="fill:none;stroke:var(--item0);stroke-width:1.6;stroke-linejoin:round"))
    for a, b, number in zip(x, y, numbers, strict=True):
        where = "" if x_name == "trial" else f", {x_name} {told(float(a))}"
        title = tag("title", f"trial {int(number)}: {y_name} {told(float(b))}{where}")
        parts.append(tag("circle", title, cx=to_x(a), cy=to_y(b), r=3.0, class_="item2", fill_opacity=0.75))
    parts.append(html.text((LEFT + WIDE) / 2, floor + 34, x_name, "quiet", "middle"))
    picture = html.svg(WIDE, TOP + TALL + BELOW, *parts, label=f"{y_name} over {x_name}")
    return html.figure(picture, caption, y_name)


def _tick(value: float, name: str) -> str:
    return f"{value:.0f}" if name == "trial" else f"{value:.3g}"


def _failures(found: TuneTable, trials: Sequence[FoundTrial], outcomes: Mapping[str, Any]) -> Iterator[Html]:
    failed = reasons(outcomes)
    judged = [trial for trial in trials if trial.has_no_value and trial.error]
    if not failed and not judged:
        return
    yield tag("h2", "What failed")
    rows = [(f"{len(those):,}", those[0].error, _point(those[0].point), those[0].key[:10]) for those in failed]
    rows += [("1", trial.error, _point(trial.point), f"trial {trial.number}") for trial in judged]
    yield table((">runs", "why, of the first", "its point", "run"), rows[:MOST_REASONS])
    if failed:
        yield tag("p", "Trials of which a run failed are not tried again, unless they are asked for:")
        yield tag("pre", f"neuro tune run SEARCH.yaml --out {shlex.quote(str(found.path))} --retry-failed")


def _point(point: Mapping[str, Any]) -> str:
    return ", ".join(f"{name} = {told(value)}" for name, value in point.items())


def _next(found: TuneTable) -> Iterator[Html]:
    name = shlex.quote(str(found.path))
    commands = [f"neuro tune table {name} --out table.csv", f"neuro tune plot {name}", f"neuro tune status {name}"]
    if found.plan.folds:
        commands.append(f"neuro tune test {name}")
    yield tag("h2", "What next")
    yield tag("pre", "\n".join(commands))
    if best := found.best():
        yield tag("p", "A run of the best again, to the bit:")
        yield tag("pre", f"neuro rerun {name}/runs/{best[0].items[0].key}")
