"""Sweeps and searches as figures of matplotlib.

Of a sweep metrics over its parameters; of a search history, front, how much parameters matter, parallel coordinates.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator
from numpy.typing import NDArray

from neuro import ModelError
from neuro.apps import COLOURS, Picture, curves, is_number, literal, tidy, unknown
from neuro_sweeps.folder import TUNING, Folder, RunOutcome
from neuro_sweeps.journal import OPTUNAS, optuna, quietly, trials_of
from neuro_sweeps.plan import MAXIMISE, Floats, so_far
from neuro_sweeps.table import SweepTable
from neuro_sweeps.trials import FoundTrial, TuneTable

Values = tuple[Any, ...]
Column = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class PlotData:
    """What is drawn of one metric.

    Attributes:
        kind: "lines", "map" or "parallel".
        metric: its name.
        names: parameters: to the right, then those of lines or rows.
        points: values of the parameters, and the metric of each run there.
        averaged: what a mean is over: parameters that vary and are not drawn, and "seeds" where there are several.
    """

    kind: str
    metric: str
    names: tuple[str, ...]
    points: tuple[tuple[Values, tuple[float, ...]], ...]
    averaged: tuple[str, ...] = ()

    @property
    def mean_of(self) -> str:
        """Text such as "mean over tau_m and seeds"; "" if each point is one run."""
        return f"mean over {' and '.join(self.averaged)}" if self.averaged else ""

    @property
    def caption(self) -> str:
        """What a point or field is the mean of, and what the band beside a line is; "" if each is one run."""
        if self.kind == "parallel":
            return ""
        return self.mean_of and self.mean_of + "; band: lowest to highest run" * (self.kind == "lines")

    def axis(self, index: int) -> list[Any]:
        """The values of one parameter, ascending where these are numbers."""
        return ordered(values[index] for values, _ in self.points)

    def lines(self) -> list[tuple[str, Column, Column, Column, Column]]:
        """Return a line for each combination of the other parameters: name, x, mean, lowest and highest run there."""
        lines = []
        for others in product(*(self.axis(k) for k in range(1, len(self.names)))):
            runs: dict[Any, list[float]] = {}
            for values, metrics in self.points:
                if values[1:] == others:
                    runs.setdefault(values[0], []).extend(metrics)
            x = ordered(runs)
            mean, low, high = (np.array([of(runs[value]) for value in x]) for of in (np.mean, np.min, np.max))
            name = ", ".join(f"{name} = {told(value)}" for name, value in zip(self.names[1:], others, strict=True))
            if x:
                lines.append((name, places(x), mean, low, high))
        return lines

    def first_lines(self, most: int) -> tuple[PlotData, int]:
        """The data of the first lines alone, and how many more there are; other kinds as they are."""
        others = [values[1:] for values, _ in self.points] if self.kind == "lines" else []
        names = list(dict.fromkeys(others))
        points = tuple(point for point in self.points if not names or point[0][1:] in names[:most])
        return replace(self, points=points), max(0, len(names) - most)

    def grid(self) -> NDArray[np.float64]:
        """The mean at each value of the second parameter (rows) and the first (columns); NaN where there is none."""
        x, y = self.axis(0), self.axis(1)
        sums, count = np.zeros((len(y), len(x))), np.zeros((len(y), len(x)))
        for values, metrics in self.points:
            at = y.index(values[1]), x.index(values[0])
            sums[at] += sum(metrics)
            count[at] += len(metrics)
        with np.errstate(invalid="ignore"):
            return np.where(count > 0, sums / np.maximum(count, 1), np.nan)


Units = Mapping[str, str]
"""Of parameters and metrics, by name; of what has none there is none."""


def with_units(data: PlotData, units: Units) -> PlotData:
    """The same with units in the names, and metrics in that with a prefix by which they are readable."""
    largest = max((abs(value) for _, each in data.points for value in each), default=0.0)
    factor, unit = curves.prefixed(largest, units.get(data.metric, ""))
    points = tuple((values, tuple(factor * value for value in each)) for values, each in data.points)
    names = tuple(named(name, units.get(name, "")) for name in data.names)
    return replace(data, metric=named(data.metric, unit), names=names, points=points)


def named(name: str, unit: str) -> str:
    """A name with its unit, if it has one."""
    return f"{name} ({unit})" if unit else name


def plot_data(table: SweepTable, metrics: Sequence[str], of: Sequence[str], kind: str) -> list[PlotData]:
    """What is drawn of each metric.

    Args:
        table: the sweep.
        metrics: names; all that are numbers if none is given.
        of: names of parameters; those that have several values if none is given.
        kind: "auto", or one of the kinds.

    Raises:
        ModelError: a name is unknown, nothing is done yet, or there are too few parameters.
    """
    done = {key: each for key, each in table.outcomes().items() if not each.failed}
    if not done:
        raise ModelError(f"{table.path}: no run is done yet: nothing to draw")
    known = [name for name in table.metrics() if any(_finite(each.metrics.get(name)) for each in done.values())]
    for name in metrics:
        if name not in known:
            raise unknown("metric", name, known)
    for name in of:
        if name not in table.parameters:
            raise unknown("parameter", name, table.parameters)
    names = tuple(of) or varied(table)
    if not names:
        names = table.parameters[:1]
    if not names:
        raise ModelError(f"{table.path}: has no parameters, only seeds: nothing to draw over")
    return [_one(table, done, metric, names, kind) for metric in metrics or known]


def varied(table: SweepTable) -> tuple[str, ...]:
    """The parameters that have several values."""
    seen: dict[str, list[Any]] = {name: [] for name in table.parameters}
    for point, _ in table.points:
        for name, values in seen.items():
            if len(values) < 2 and point.get(name) not in values:
                values.append(point.get(name))
    return tuple(name for name, values in seen.items() if len(values) > 1)


def _one(table: SweepTable, done: Mapping[str, RunOutcome], metric: str, names: tuple[str, ...], kind: str) -> PlotData:
    found: dict[str, tuple[Values, list[float]]] = {}
    for key, (point, _) in zip(table.keys, table.points, strict=True):
        value: Any = done[key].metrics.get(metric) if key in done else None
        if _finite(value):
            values = tuple(point.get(name) for name in names)
            found.setdefault(repr(values), (values, []))[1].append(float(value))
    points = tuple((values, tuple(each)) for values, each in found.values())
    whole = PlotData("lines", metric, names, points)
    kind = _fitting(whole) if kind == "auto" else kind
    if kind == "map" and len(names) < 2:
        raise ModelError(f"a map needs two parameters: found {names[0]} alone")
    most = 2 if kind == "map" else len(names)
    cut = tuple((values[:most], each) for values, each in points)
    seeds = ("seeds",) if len({repr(point) for point, _ in table.points}) < len(table.points) else ()
    averaged = tuple(name for name in varied(table) if name not in names[:most]) + seeds
    return PlotData(kind, metric, names[:most], cut, averaged)


def _fitting(whole: PlotData) -> str:
    """Lines of one parameter, or of two of which one has few values; a map of a full grid of two; else parallel."""
    if len(whole.names) == 1:
        return "lines"
    if len(whole.names) == 2:
        rows, columns = len(whole.axis(1)), len(whole.axis(0))
        if rows * columns <= 2 * len(whole.points):
            return "lines" if rows <= 4 and all(map(is_number, whole.axis(0))) else "map"
    return "parallel"


def _finite(value: Any) -> bool:
    return is_number(value) and math.isfinite(value)


def ordered(values: Any) -> list[Any]:
    """Values, each once: numbers ascending, others as they come."""
    each: dict[str, Any] = {repr(value): value for value in values}
    every = list(each.values())
    return sorted(every) if all(map(is_number, every)) else every


def places(values: Sequence[Any]) -> NDArray[np.float64]:
    """Where values lie on an axis: numbers at themselves, others at 0, 1, ..."""
    return np.array(values if all(map(is_number, values)) else range(len(values)), float)


def is_log(values: Sequence[Any]) -> bool:
    """Whether numbers are steps of about equal factors, or many over a wide range."""
    if len(values) < 3 or not all(map(is_number, values)) or min(values) <= 0 or max(values) / min(values) < 20:
        return False
    steps = np.diff(np.log(np.sort(np.array(values, float))))
    return bool(np.ptp(steps) < 0.5 * steps.mean()) or (len(values) > 8 and max(values) / min(values) >= 50)


def scaled(values: Sequence[Any]) -> NDArray[np.float64]:
    """Where values lie on an axis that is logarithmic where that suits them."""
    return np.log10(places(values)) if is_log(values) else places(values)


def told(value: Any) -> str:
    """A value in few letters."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)


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
        figure.titles[f"line {k}"] = [f"{data.names[0]} = {told(at)}: {curves.few(value)}" for at, value in values]
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
        axis.xaxis.set(major_locator=LogLocator(subs=digits), major_formatter=lambda value, place: curves.few(value))
        axis.xaxis.set_minor_locator(NullLocator())
    return figure


def _map(data: PlotData, title: str, wide: float) -> Figure:
    """Draw a field for each pair of values; its colour is the mean of the runs there."""
    figure, (axis,) = _figure(title, wide)
    grid, columns, rows = data.grid(), data.axis(0), data.axis(1)
    image = axis.pcolormesh(grid, cmap="cividis", edgecolors="face", linewidth=0.3, gid="cells")
    figure.titles["cells"] = [
        f"{data.names[0]} = {told(columns[x])}, {data.names[1]} = {told(rows[y])}: {curves.few(float(value))}"
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
    marks = curves.ticks(each[0][0], each[-1][0], 5)
    if not is_log(values):
        return [(mark, curves.few(mark)) for mark in marks]
    decades = [mark for mark in marks if mark == int(mark)]
    return [(mark, curves.few(10.0**mark)) for mark in decades] if len(decades) > 1 else [each[0], each[-1]]


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
            f"trial {n}: {name} {curves.few(v)}" for n, v in zip(numbers, values.tolist(), strict=True)
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
    # The first two objectives; what is minimised, a cost, to the right.
    first, second = list(table.plan.objectives.items())[:2]
    (x_name, x_way), (y_name, y_way) = [second, first] if first[1] == MAXIMISE else [first, second]
    (x_factor, x_label), (y_factor, y_label) = (_unit(table, name, done) for name in (x_name, y_name))
    x, y = x_factor * _column(table, done, x_name), y_factor * _column(table, done, y_name)
    best = table.best()
    front_x, front_y = x_factor * _column(table, best, x_name), y_factor * _column(table, best, y_name)
    order = np.lexsort((front_y if y_way == MAXIMISE else -front_y, front_x))
    axis.plot(x, y, "o", color="0.7", markersize=4, label="trials", gid="trials")
    figure.titles["trials"] = [
        f"trial {trial.number}: {y_label} {curves.few(up)}, {x_label} {curves.few(across)}"
        for trial, across, up in zip(done, x.tolist(), y.tolist(), strict=True)
    ]
    if len(table.plan.objectives) == 2:
        where = "post" if x_way != MAXIMISE else "pre"
        axis.step(front_x[order], front_y[order], where=where, color=COLOURS[0], linewidth=1.2)
    axis.plot(front_x, front_y, "o", color=COLOURS[0], markersize=6, label="no other beats these")
    found = [(row.get(f"test.{x_name}"), row.get(f"test.{y_name}")) for row in table.rows()]
    tests = [(x, y) for x, y in found if x is not None and y is not None]
    if tests:
        test_x, test_y = np.array(tests).T
        axis.plot(x_factor * test_x, y_factor * test_y, "x", color=COLOURS[1], markersize=7, label="the same, held out")
    axis.set_xlabel(literal(f"{x_label}, {x_way}d"))
    axis.set_ylabel(literal(f"{y_label}, {y_way}d"))
    axis.legend(frameon=False, fontsize="small", loc="best")
    return figure


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
    factor, unit = curves.prefixed(largest, units_of(table).get(objective, ""))
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
