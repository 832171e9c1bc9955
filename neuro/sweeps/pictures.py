"""Sweeps and searches as figures of matplotlib.

Of a sweep metrics over its parameters; of a search history, front, how much parameters matter, parallel coordinates.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator

from neuro.core.checks import is_number
from neuro.core.errors import ModelError, unknown
from neuro.core.values import literal
from neuro.pages.scales import few, prefixed, ticks
from neuro.plots._canvas import COLOURS, Picture, tidy
from neuro.sweeps.folder import TUNING, Folder
from neuro.sweeps.journal import OPTUNAS, optuna, quietly, trials_of
from neuro.sweeps.plan import MAXIMISE, Floats, so_far
from neuro.sweeps.plot_data import PlotData, Units, is_log, named, ordered, plot_data, scaled, told, with_units
from neuro.sweeps.table import SweepTable
from neuro.sweeps.trials import FoundTrial, TuneTable

KINDS = ("history", "front", "importance", "parallel")
MOST_MARKS = 6
ENOUGH = 8
"""Trials from which on something can be said of how much a parameter matters."""


WIDE = 7.0
"""Inches of a figure that stands alone."""


def pictures(
    table: SweepTable, metrics: Sequence[str] = (), of: Sequence[str] = (), kind: str = "auto"
) -> dict[str, Figure]:
    """A figure for each metric, by the name of a file; arguments and errors as of `plot_data.plot_data`."""
    data, units = plot_data(table, metrics, of, kind), units_of(table)
    return {f"{_in_a_name(each.metric)}-{each.kind}": draw(with_units(each, units), table.name) for each in data}


def draw(data: PlotData, title: str = "", wide: float = WIDE) -> Figure:
    """Draw one metric.

    Args:
        data: with units.
        title: above the figure, with what means are over; a page says so beside the figure, which then has none.
        wide: width of the figure, inches; parallel coordinates of many parameters are wider.
    """
    figure = _DRAW[data.kind](data, title, wide)
    if title:
        figure.axes[0].set_title(literal(data.caption), fontsize=9)
    return figure


def units_of(table: SweepTable | TuneTable) -> Units:
    """The units of the parameters and metrics, as far as they were known when the runs began."""
    found: Units = Folder(table.path).read().get("units", {})
    return found


def _in_a_name(metric: str) -> str:
    """A metric in the name of a file of one folder, such as val-loss of val/loss."""
    return metric.replace("/", "-").lstrip(".")


def _figure(title: str, wide: float, rows: int = 1, tall: float = 0.0) -> tuple[Picture, list[Any]]:
    """A figure with panels below each other."""
    size = (wide, tall or (0.63 if rows == 1 else 0.37 * rows) * wide)
    figure = Picture(figsize=size, layout="constrained", dpi=150)
    if title:
        figure.suptitle(literal(title), fontsize=12)
    axes = list(figure.subplots(rows, sharex=rows > 1, squeeze=False)[:, 0])
    for axis in axes:
        tidy(axis)
    return figure, axes


def _lines(data: PlotData, title: str, wide: float) -> Figure:
    """Draw a line for each combination of the other parameters, with a band from the lowest to the highest run."""
    figure, (axis,) = _figure(title, wide)
    lines = data.lines()
    for k, (name, x, mean, low, high) in enumerate(lines):
        colour = COLOURS[k % len(COLOURS)]
        style = ("-", "--", ":", "-.")[k // len(COLOURS) % 4]
        line = {"color": colour, "label": literal(name), "markersize": 4, "linewidth": 1.3, "gid": f"line {k}"}
        axis.plot(x, mean, f"o{style}", **line)
        values = zip(x.tolist(), mean.tolist(), strict=True)
        figure.titles[f"line {k}"] = [f"{data.names[0]} = {told(at)}: {few(value)}" for at, value in values]
        if (high > low).any():
            axis.fill_between(x, low, high, color=colour, alpha=0.18, linewidth=0)
    _named(axis.xaxis, data.axis(0))
    axis.set_xlabel(literal(data.names[0]))
    axis.set_ylabel(literal(data.metric))
    if len(data.names) > 1:
        axis.legend(frameon=False, fontsize="small", loc="best")
    if is_log(data.axis(0)):
        axis.set_xscale("log")
        digits = (1, 2, 5) if max(data.axis(0)) <= 1e2 * min(data.axis(0)) else (1,)
        axis.xaxis.set(major_locator=LogLocator(subs=digits), major_formatter=lambda value, place: few(value))
        axis.xaxis.set_minor_locator(NullLocator())
    return figure


def _map(data: PlotData, title: str, wide: float) -> Figure:
    """Draw a field for each pair of values; its colour is the mean of the runs there."""
    figure, (axis,) = _figure(title, wide)
    grid, columns, rows = data.grid(), data.axis(0), data.axis(1)
    image = axis.pcolormesh(grid, cmap="cividis", edgecolors="face", linewidth=0.3, gid="cells")
    figure.titles["cells"] = [
        f"{data.names[0]} = {told(columns[x])}, {data.names[1]} = {told(rows[y])}: {few(float(value))}"
        for (y, x), value in np.ndenumerate(grid)
    ]
    for side, values, name in ((axis.xaxis, columns, data.names[0]), (axis.yaxis, rows, data.names[1])):
        every = max(1, -(-len(values) // 12))
        side.set_ticks(np.arange(0.5, len(values), every), [literal(told(value)) for value in values[::every]])
        side.set_label_text(literal(name))
    if grid.size <= 64:
        middle = (np.nanmin(grid) + np.nanmax(grid)) / 2
        for (row, column), value in np.ndenumerate(grid):
            if np.isfinite(value):
                ink = "white" if value < middle else "0.05"
                axis.text(column + 0.5, row + 0.5, f"{value:.3g}", ha="center", va="center", color=ink, fontsize=8)
    figure.colorbar(image, ax=axis, label=literal(data.metric))
    return figure


def _parallel(data: PlotData, title: str, wide: float) -> Figure:
    """An axis for each parameter and one for the metric; a line for each point, in the colour of its metric.

    Source: Inselberg, The Visual Computer 1:69, 1985
    """
    from matplotlib import colormaps
    from matplotlib.collections import LineCollection

    names = (*data.names, data.metric)
    figure, (axis,) = _figure(title, max(wide, 0.23 * wide * len(names)), tall=0.63 * wide)
    axis.spines[["left", "bottom"]].set_visible(False)
    metric = np.array([np.mean(each) for _, each in data.points])
    columns = [[values[k] for values, _ in data.points] for k in range(len(data.names))] + [metric.tolist()]
    heights = []
    for k, values in enumerate(columns):
        every = ordered(values)
        at = dict(zip(map(repr, every), scaled(every), strict=True))
        y = np.array([at[repr(value)] for value in values])
        low, high = float(min(at.values())), float(max(at.values()))
        heights.append((y - low) / (high - low) if high > low else np.full_like(y, 0.5))
        axis.axvline(k, color="0.6", linewidth=0.8, zorder=0)
        for place, text in _marks(every):
            height = (place - low) / (high - low) if high > low else 0.5
            axis.text(k, height, f" {literal(text)}", fontsize=8, va="center")
    order = np.argsort(metric)
    lines = np.stack([np.broadcast_to(np.arange(len(names)), (metric.size, len(names))), np.array(heights).T], axis=2)
    share = heights[-1]
    colours = colormaps["cividis"](share[order])
    axis.add_collection(LineCollection(list(lines[order]), colors=colours, linewidths=1.0, gid="points"))
    figure.titles["points"] = [
        ", ".join(f"{name} = {told(column[n])}" for name, column in zip(names, columns, strict=True)) for n in order
    ]
    axis.set_xlim(-0.15, len(names) - 0.6)
    axis.set_ylim(-0.05, 1.05)
    axis.set_xticks(range(len(names)), [literal(name) for name in names])
    axis.set_yticks([])
    return figure


def _marks(values: Sequence[Any]) -> list[tuple[float, str]]:
    """Marks on an axis, at places as of `scaled`: the values where these are few or no numbers, else round numbers."""
    each = list(zip(scaled(values).tolist(), map(told, values), strict=True))
    if len(values) <= MOST_MARKS or not all(map(is_number, values)):
        return each[:: -(-len(each) // MOST_MARKS)]
    marks = ticks(each[0][0], each[-1][0], 5)
    if not is_log(values):
        return [(mark, few(mark)) for mark in marks]
    decades = [mark for mark in marks if mark == int(mark)]
    return [(mark, few(10.0**mark)) for mark in decades] if len(decades) > 1 else [each[0], each[-1]]


def _named(side: Any, values: list[Any]) -> None:
    if not all(map(is_number, values)):
        side.set_ticks(range(len(values)), [literal(told(value)) for value in values])


_DRAW = {"lines": _lines, "map": _map, "parallel": _parallel}


def search_pictures(
    table: TuneTable, kinds: Sequence[str] = (), title: str | None = None, wide: float = WIDE
) -> dict[str, Figure]:
    """Figures by the name of a file.

    Args:
        table: of the search.
        kinds: some of `KINDS`; those that have something to show if none is given.
        title: above each figure; the name of the search if None.
        wide: width of each figure, inches.

    Raises:
        ModelError: no trial is done yet, or a kind has nothing to show.
    """
    for kind in kinds:
        if kind not in KINDS:
            raise unknown("kind of picture", kind, KINDS)
    done = [trial for trial in table.trials() if trial.values is not None]
    if not done:
        raise ModelError(f"{table.path}: no trial is done yet: nothing to draw")
    several = len(table.plan.objectives) > 1
    if "front" in kinds and not several:
        raise ModelError(f"a front needs two objectives: found {next(iter(table.plan.objectives))} alone")
    shows = {"front": several, "importance": len(done) >= ENOUGH and len(table.plan.names) > 1}
    title = table.name if title is None else title
    drawn: dict[str, Figure] = {}
    for kind in kinds or [kind for kind in KINDS if shows.get(kind, True)]:
        if kind == "parallel":
            for data in plot_data(table.runs(), tuple(table.plan.objectives), table.plan.names, "parallel"):
                drawn[f"{_in_a_name(data.metric)}-parallel"] = draw(with_units(data, units_of(table)), title, wide)
        elif kind == "importance":
            drawn[kind] = _importance(table, title, wide)
        else:
            drawn[kind] = {"history": _history, "front": _front}[kind](table, done, title, wide)
    return drawn


def _history(table: TuneTable, done: Sequence[FoundTrial], title: str, wide: float) -> Figure:
    """Each trial's value, and the best so far."""
    figure, axes = _figure(title, wide, rows=len(table.plan.objectives))
    numbers = [trial.number for trial in done]
    for axis, (objective, direction) in zip(axes, table.plan.objectives.items(), strict=True):
        factor, name = _unit(table, objective, done)
        values = factor * _column(table, done, objective)
        axis.plot(numbers, values, "o", color="0.65", markersize=4, label="trials", gid=objective)
        figure.titles[objective] = [
            f"trial {n}: {name} {few(v)}" for n, v in zip(numbers, values.tolist(), strict=True)
        ]
        best = so_far(values, direction)
        axis.step(numbers, best, where="post", color=COLOURS[0], linewidth=1.4, label="best so far")
        axis.set_ylabel(literal(name))
    axes[0].legend(frameon=False, fontsize="small")
    axes[-1].set_xlabel("trial")
    return figure


def _front(table: TuneTable, done: Sequence[FoundTrial], title: str, wide: float) -> Figure:
    """Two objectives against each other, and the trials that no other beats, joined in steps."""
    figure, (axis,) = _figure(title, wide)
    (x_name, x_way), (y_name, y_way) = _pair(table)
    (x_factor, x_label), (y_factor, y_label) = (_unit(table, name, done) for name in (x_name, y_name))
    x, y = x_factor * _column(table, done, x_name), y_factor * _column(table, done, y_name)
    best = table.best()
    front_x, front_y = x_factor * _column(table, best, x_name), y_factor * _column(table, best, y_name)
    order = np.lexsort((front_y if y_way == MAXIMISE else -front_y, front_x))
    axis.plot(x, y, "o", color="0.7", markersize=4, label="trials", gid="trials")
    figure.titles["trials"] = [
        f"trial {trial.number}: {y_label} {few(up)}, {x_label} {few(across)}"
        for trial, across, up in zip(done, x.tolist(), y.tolist(), strict=True)
    ]
    if len(table.plan.objectives) == 2:
        where = "post" if x_way != MAXIMISE else "pre"
        axis.step(front_x[order], front_y[order], where=where, color=COLOURS[0], linewidth=1.2)
    axis.plot(front_x, front_y, "o", color=COLOURS[0], markersize=6, label="no other beats these")
    tests = _tests(table, x_name, y_name)
    if tests:
        test_x, test_y = np.array(tests).T
        axis.plot(x_factor * test_x, y_factor * test_y, "x", color=COLOURS[1], markersize=7, label="the same, held out")
    axis.set_xlabel(literal(f"{x_label}, {x_way}d"))
    axis.set_ylabel(literal(f"{y_label}, {y_way}d"))
    axis.legend(frameon=False, fontsize="small", loc="best")
    return figure


def _pair(table: TuneTable) -> list[tuple[str, str]]:
    """The first two objectives; what is minimised, a cost, to the right."""
    first, second = list(table.plan.objectives.items())[:2]
    return [second, first] if first[1] == MAXIMISE else [first, second]


def _tests(table: TuneTable, x_name: str, y_name: str) -> list[tuple[float, float]]:
    found = [(row.get(f"test.{x_name}"), row.get(f"test.{y_name}")) for row in table.rows()]
    return [(x, y) for x, y in found if x is not None and y is not None]


def _importance(table: TuneTable, title: str, wide: float) -> Figure:
    """A bar for each parameter and objective."""
    figure, (axis,) = _figure(title, wide)
    found = {name: importance(table, name) for name in table.plan.objectives}
    names = list(table.plan.names)[::-1]
    tall = 0.8 / len(found)
    for k, (objective, shares) in enumerate(found.items()):
        places = np.arange(len(names)) + 0.4 - (k + 0.5) * tall
        axis.barh(
            places,
            [shares[name] for name in names],
            tall * 0.9,
            color=COLOURS[k % len(COLOURS)],
            label=literal(objective),
        )
    axis.set_yticks(range(len(names)), [literal(name) for name in names])
    axis.set_xlim(0.0, 1.0)
    axis.set_xlabel("share in what makes a trial one of the best tenth")
    if len(found) > 1:
        axis.legend(frameon=False, fontsize="small", loc="best")
    return figure


def _column(table: TuneTable, trials: Sequence[FoundTrial], objective: str) -> Floats:
    """The values of an objective in some trials."""
    k = list(table.plan.objectives).index(objective)
    return np.array([trial.values[k] for trial in trials if trial.values], float)


def _unit(table: TuneTable, objective: str, done: Sequence[FoundTrial]) -> tuple[float, str]:
    """The factor by which the values of an objective are readable, and its name with the unit that they then have."""
    largest = float(np.abs(_column(table, done, objective)).max())
    factor, unit = prefixed(largest, units_of(table).get(objective, ""))
    return factor, named(objective, unit)


def importance(table: TuneTable, objective: str) -> dict[str, float]:
    """Shares of the parameters in what makes a trial good; together 1.

    Args:
        table: of the search.
        objective: by name.

    Raises:
        ModelError: the journal is damaged, or Optuna is not installed.

    Source: Watanabe et al., IJCAI 2023 (PED-ANOVA), as Optuna has it.
    """
    package = optuna()
    k = list(table.plan.objectives).index(objective)
    with quietly():
        study = package.create_study(direction=OPTUNAS[table.plan.objectives[objective]])
        for trial in trials_of(Folder(table.path, TUNING)):
            if trial.state.name == "COMPLETE":
                words = {"params": trial.params, "distributions": trial.distributions, "value": trial.values[k]}
                study.add_trial(package.trial.create_trial(**words))
        evaluator = package.importance.PedAnovaImportanceEvaluator()
        found = package.importance.get_param_importances(study, evaluator=evaluator)
    return {name: float(found.get(name, 0.0)) for name in table.plan.names}
