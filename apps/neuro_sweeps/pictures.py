"""Figures of sweeps and searches, drawn with matplotlib.

Sweeps have metrics over parameters. Searches have history, front, importance of parameters and parallel coordinates.
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
from neuro_sweeps.journal import OPTUNAS, optuna, trials_of, without_warnings
from neuro_sweeps.plan import MAXIMISE, Floats, so_far
from neuro_sweeps.table import SweepTable
from neuro_sweeps.trials import TrialRow, TuneTable

Values = tuple[Any, ...]
Column = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class PlotData:
    """The data of a figure of a metric.

    Attributes:
        kind: "lines", "map" or "parallel".
        metric: name of the metric.
        names: names of the parameters: first the one on the horizontal axis, then those of lines or rows.
        points: values of the parameters, and the metric of each run at these values.
        averaged: names over which the means are taken: parameters that vary but are not drawn, and "seeds" if there are
            several.
    """

    kind: str
    metric: str
    names: tuple[str, ...]
    points: tuple[tuple[Values, tuple[float, ...]], ...]
    averaged: tuple[str, ...] = ()

    @property
    def mean_of(self) -> str:
        """A text such as "mean over tau_m and seeds"; "" if each point is a single run."""
        return f"mean over {' and '.join(self.averaged)}" if self.averaged else ""

    @property
    def caption(self) -> str:
        """A text about means and bands; "" if each point is a single run."""
        if self.kind == "parallel":
            return ""
        return self.mean_of and self.mean_of + "; band: lowest to highest run" * (self.kind == "lines")

    def axis(self, index: int) -> list[Any]:
        """Return the values of a parameter. Numbers are ascending."""
        return ordered(values[index] for values, _ in self.points)

    def lines(self) -> list[tuple[str, Column, Column, Column, Column]]:
        """Return a line per combination of the other parameters: name, x, and mean, lowest and highest run at x."""
        lines = []
        for other_values in product(*(self.axis(k) for k in range(1, len(self.names)))):
            runs: dict[Any, list[float]] = {}
            for values, metrics in self.points:
                if values[1:] == other_values:
                    runs.setdefault(values[0], []).extend(metrics)
            x = ordered(runs)
            mean, low, high = (np.array([f(runs[value]) for value in x]) for f in (np.mean, np.min, np.max))
            name = ", ".join(
                f"{name} = {short_text(value)}" for name, value in zip(self.names[1:], other_values, strict=True)
            )
            if x:
                lines.append((name, axis_values(x), mean, low, high))
        return lines

    def first_lines(self, most: int) -> tuple[PlotData, int]:
        """Return the data of the first `most` lines, and the number of other lines. Other kinds do not change."""
        line_keys = [values[1:] for values, _ in self.points] if self.kind == "lines" else []
        names = list(dict.fromkeys(line_keys))
        points = tuple(point for point in self.points if not names or point[0][1:] in names[:most])
        return replace(self, points=points), max(0, len(names) - most)

    def grid(self) -> NDArray[np.float64]:
        """Return the means by value of the second parameter (rows) and the first (columns); NaN without a run."""
        x, y = self.axis(0), self.axis(1)
        sums, count = np.zeros((len(y), len(x))), np.zeros((len(y), len(x)))
        for values, metrics in self.points:
            cell = y.index(values[1]), x.index(values[0])
            sums[cell] += sum(metrics)
            count[cell] += len(metrics)
        with np.errstate(invalid="ignore"):
            return np.where(count > 0, sums / np.maximum(count, 1), np.nan)


Units = Mapping[str, str]
"""Units of parameters and metrics by name, without names that have no unit."""


def with_units(data: PlotData, units: Units) -> PlotData:
    """Add units to the names, and scale the metric to a unit with a readable prefix, e.g. mJ."""
    largest = max((abs(value) for _, runs in data.points for value in runs), default=0.0)
    factor, unit = curves.prefixed(largest, units.get(data.metric, ""))
    points = tuple((values, tuple(factor * value for value in runs)) for values, runs in data.points)
    names = tuple(name_with_unit(name, units.get(name, "")) for name in data.names)
    return replace(data, metric=name_with_unit(data.metric, unit), names=names, points=points)


def name_with_unit(name: str, unit: str) -> str:
    """Return a name with its unit, if any, e.g. "rate (Hz)"."""
    return f"{name} ({unit})" if unit else name


def plot_data(table: SweepTable, metrics: Sequence[str], of: Sequence[str], kind: str) -> list[PlotData]:
    """Return the data of the figures.

    Args:
        table: table of the sweep.
        metrics: names of metrics; default: all that are numbers.
        of: names of parameters; default: those with several values.
        kind: "auto", or a kind of `PlotData`.

    Raises:
        ModelError: a name is unknown, no run is done, or there are too few parameters.
    """
    finished = {key: run for key, run in table.outcomes().items() if not run.failed}
    if not finished:
        raise ModelError(f"{table.path}: no run is done yet: nothing to draw")
    numeric = [name for name in table.metrics() if any(_finite(run.metrics.get(name)) for run in finished.values())]
    for name in metrics:
        if name not in numeric:
            raise unknown("metric", name, numeric)
    for name in of:
        if name not in table.parameters:
            raise unknown("parameter", name, table.parameters)
    names = tuple(of) or varied(table)
    if not names:
        names = table.parameters[:1]
    if not names:
        raise ModelError(f"{table.path}: has no parameters, only seeds: nothing to draw over")
    return [_data_of_metric(table, finished, metric, names, kind) for metric in metrics or numeric]


def varied(table: SweepTable) -> tuple[str, ...]:
    """Return the parameters with several values."""
    first_values: dict[str, list[Any]] = {name: [] for name in table.parameters}
    for item in table.items:
        for name, values in first_values.items():
            if len(values) < 2 and item.point.get(name) not in values:
                values.append(item.point.get(name))
    return tuple(name for name, values in first_values.items() if len(values) > 1)


def _data_of_metric(
    table: SweepTable, finished: Mapping[str, RunOutcome], metric: str, names: tuple[str, ...], kind: str
) -> PlotData:
    runs: dict[str, tuple[Values, list[float]]] = {}
    for item in table.items:
        value: Any = finished[item.key].metrics.get(metric) if item.key in finished else None
        if _finite(value):
            values = tuple(item.point.get(name) for name in names)
            runs.setdefault(repr(values), (values, []))[1].append(float(value))
    points = tuple((values, tuple(metrics)) for values, metrics in runs.values())
    kind = _best_kind(PlotData("lines", metric, names, points)) if kind == "auto" else kind
    if kind == "map" and len(names) < 2:
        raise ModelError(f"a map needs two parameters: found only {names[0]}")
    max_names = 2 if kind == "map" else len(names)
    cut = tuple((values[:max_names], metrics) for values, metrics in points)
    seeds = ("seeds",) if len({repr(item.point) for item in table.items}) < len(table) else ()
    averaged = tuple(name for name in varied(table) if name not in names[:max_names]) + seeds
    return PlotData(kind, metric, names[:max_names], cut, averaged)


def _best_kind(data: PlotData) -> str:
    """Choose the kind: lines for one parameter or a few lines, a map for a grid of two parameters, else parallel."""
    if len(data.names) == 1:
        return "lines"
    if len(data.names) == 2:
        rows, columns = len(data.axis(1)), len(data.axis(0))
        if rows * columns <= 2 * len(data.points):
            return "lines" if rows <= 4 and all(map(is_number, data.axis(0))) else "map"
    return "parallel"


def _finite(value: Any) -> bool:
    return is_number(value) and math.isfinite(value)


def ordered(values: Any) -> list[Any]:
    """Return unique values: numbers ascending, all other values in their order."""
    values_by_text: dict[str, Any] = {repr(value): value for value in values}
    unique = list(values_by_text.values())
    return sorted(unique) if all(map(is_number, unique)) else unique


def axis_values(values: Sequence[Any]) -> NDArray[np.float64]:
    """Return positions on a linear axis: numbers themselves, or 0, 1, ... for other values."""
    return np.array(values if all(map(is_number, values)) else range(len(values)), float)


def is_log(values: Sequence[Any]) -> bool:
    """Return whether a logarithmic axis suits: if values grow by about equal factors, or if many span a wide range."""
    if len(values) < 3 or not all(map(is_number, values)) or min(values) <= 0 or max(values) / min(values) < 20:
        return False
    steps = np.diff(np.log(np.sort(np.array(values, float))))
    return bool(np.ptp(steps) < 0.5 * steps.mean()) or (len(values) > 8 and max(values) / min(values) >= 50)


def axis_positions(values: Sequence[Any]) -> NDArray[np.float64]:
    """Return positions on an axis that is logarithmic if that suits the values."""
    return np.log10(axis_values(values)) if is_log(values) else axis_values(values)


def short_text(value: Any) -> str:
    """Return a value as a short text."""
    return f"{value:.4g}" if isinstance(value, float) else str(value)


KINDS = ("history", "front", "importance", "parallel")
MOST_MARKS = 6
"""Largest number of labelled values on an axis of parallel coordinates."""
LABEL_GAP = 0.05
"""Smallest distance of two labels on an axis of parallel coordinates, as a share of its length."""
ENOUGH = 8
"""Smallest number of trials for the importance of parameters."""


WIDE = 7.0
"""Width of a single figure in inches."""


def pictures(
    table: SweepTable, metrics: Sequence[str] = (), of: Sequence[str] = (), kind: str = "auto"
) -> dict[str, Figure]:
    """Return a figure for each metric, by file name. Arguments and errors are those of `plot_data`."""
    data, units = plot_data(table, metrics, of, kind), units_of(table)
    return {f"{_file_name(part.metric)}-{part.kind}": draw(with_units(part, units), table.name) for part in data}


def draw(data: PlotData, title: str = "", wide: float = WIDE) -> Figure:
    """Draw a metric.

    Args:
        data: data with units.
        title: title of the figure. A line about means is added below it. "" draws neither, for the figures of a page.
        wide: width of the figure in inches; parallel coordinates of many parameters are wider.
    """
    figure = _DRAW[data.kind](data, title, wide)
    if title:
        figure.axes[0].set_title(literal(data.caption), fontsize=9)
    return figure


def units_of(table: SweepTable | TuneTable) -> Units:
    """Return the units of parameters and metrics that were known when the runs began."""
    units: Units = Folder(table.path).read().get("units", {})
    return units


def _file_name(metric: str) -> str:
    """Return a metric's name as a part of a file name, e.g. "val-loss" for "val/loss"."""
    return metric.replace("/", "-").lstrip(".")


def _figure(title: str, wide: float, rows: int = 1, tall: float = 0.0) -> tuple[Picture, list[Any]]:
    """Return a figure with panels in a column."""
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
        figure.titles[f"line {k}"] = [
            f"{data.names[0]} = {short_text(x_value)}: {curves.few(value)}" for x_value, value in values
        ]
        if (high > low).any():
            axis.fill_between(x, low, high, color=colour, alpha=0.18, linewidth=0)
    _set_labels(axis.xaxis, data.axis(0))
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
    """Draw a cell for each pair of values, in the colour of the runs' mean."""
    figure, (axis,) = _figure(title, wide)
    grid, columns, rows = data.grid(), data.axis(0), data.axis(1)
    image = axis.pcolormesh(grid, cmap="cividis", edgecolors="face", linewidth=0.3, gid="cells")
    figure.titles["cells"] = [
        ", ".join(f"{name} = {short_text(item)}" for name, item in zip(data.names, (columns[x], rows[y]), strict=True))
        + f": {curves.few(float(value))}"
        for (y, x), value in np.ndenumerate(grid)
    ]
    for side, values, name in ((axis.xaxis, columns, data.names[0]), (axis.yaxis, rows, data.names[1])):
        stride = max(1, -(-len(values) // 12))
        side.set_ticks(np.arange(0.5, len(values), stride), [literal(short_text(value)) for value in values[::stride]])
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
    """Draw an axis for each parameter and the metric, and a line for each point, in the colour of the metric.

    Source: Inselberg, The Visual Computer 1:69, 1985
    """
    from matplotlib import colormaps
    from matplotlib.collections import LineCollection

    names = (*data.names, data.metric)
    figure, (axis,) = _figure(title, max(wide, 0.23 * wide * len(names)), tall=0.63 * wide)
    axis.spines[["left", "bottom"]].set_visible(False)
    metric = np.array([np.mean(runs) for _, runs in data.points])
    columns = [[values[k] for values, _ in data.points] for k in range(len(data.names))] + [metric.tolist()]
    heights = []
    for k, values in enumerate(columns):
        unique = ordered(values)
        positions = dict(zip(map(repr, unique), axis_positions(unique), strict=True))
        y = np.array([positions[repr(value)] for value in values])
        low, high = float(min(positions.values())), float(max(positions.values()))
        heights.append((y - low) / (high - low) if high > low else np.full_like(y, 0.5))
        axis.axvline(k, color="0.6", linewidth=0.8, zorder=0)
        previous = -1.0
        for position, text in _marks(unique):
            height = (position - low) / (high - low) if high > low else 0.5
            if height - previous >= LABEL_GAP:
                axis.text(k, height, f" {literal(text)}", fontsize=8, va="center")
                previous = height
    order = np.argsort(metric)
    lines = np.stack([np.broadcast_to(np.arange(len(names)), (metric.size, len(names))), np.array(heights).T], axis=2)
    colours = colormaps["cividis"](0.3 + 0.55 * heights[-1][order])  # visible on white and on black
    axis.add_collection(LineCollection(list(lines[order]), colors=colours, linewidths=1.0, gid="points"))
    figure.titles["points"] = [
        ", ".join(f"{name} = {short_text(column[n])}" for name, column in zip(names, columns, strict=True))
        for n in order
    ]
    axis.set_xlim(-0.15, len(names) - 0.6)
    axis.set_ylim(-0.05, 1.05)
    axis.set_xticks(range(len(names)), [literal(name) for name in names])
    axis.set_yticks([])
    return figure


def _marks(values: Sequence[Any]) -> list[tuple[float, str]]:
    """Return positions (see `axis_positions`) and texts of marks: ticks for many numbers, else all or some values."""
    pairs = list(zip(axis_positions(values).tolist(), map(short_text, values), strict=True))
    if len(values) <= MOST_MARKS or not all(map(is_number, values)):
        return pairs[:: -(-len(pairs) // MOST_MARKS)]
    marks = curves.ticks(pairs[0][0], pairs[-1][0], 5)
    if not is_log(values):
        return [(mark, curves.few(mark)) for mark in marks]
    decades = [mark for mark in marks if mark == int(mark)]
    return [(mark, curves.few(10.0**mark)) for mark in decades] if len(decades) > 1 else [pairs[0], pairs[-1]]


def _set_labels(side: Any, values: list[Any]) -> None:
    if not all(map(is_number, values)):
        side.set_ticks(range(len(values)), [literal(short_text(value)) for value in values])


_DRAW = {"lines": _lines, "map": _map, "parallel": _parallel}


def search_pictures(
    table: TuneTable, kinds: Sequence[str] = (), title: str | None = None, wide: float = WIDE
) -> dict[str, Figure]:
    """Return the figures of a search by file name.

    Args:
        table: table of the search.
        kinds: some of `KINDS`; default: all for which there are enough data.
        title: title of each figure; default: the name of the search.
        wide: width of each figure in inches.

    Raises:
        ModelError: no trial is done, or there are no data for a kind.
    """
    for kind in kinds:
        if kind not in KINDS:
            raise unknown("kind of picture", kind, KINDS)
    finished = [trial for trial in table.trials() if trial.values is not None]
    if not finished:
        raise ModelError(f"{table.path}: no trial is done yet: nothing to draw")
    has_front = len(table.plan.objectives) > 1
    if "front" in kinds and not has_front:
        raise ModelError(f"a front needs two objectives: found only {next(iter(table.plan.objectives))}")
    has_data = {"front": has_front, "importance": len(finished) >= ENOUGH and len(table.plan.names) > 1}
    title = table.name if title is None else title
    figures: dict[str, Figure] = {}
    for kind in kinds or [kind for kind in KINDS if has_data.get(kind, True)]:
        if kind == "parallel":
            for data in plot_data(table.runs(), tuple(table.plan.objectives), table.plan.names, "parallel"):
                figures[f"{_file_name(data.metric)}-parallel"] = draw(with_units(data, units_of(table)), title, wide)
        elif kind == "importance":
            figures[kind] = _importance(table, title, wide)
        else:
            figures[kind] = {"history": _history, "front": _front}[kind](table, finished, title, wide)
    return figures


def _history(table: TuneTable, finished: Sequence[TrialRow], title: str, wide: float) -> Figure:
    """Draw the value of each trial, and the best value so far."""
    figure, axes = _figure(title, wide, rows=len(table.plan.objectives))
    numbers = [trial.number for trial in finished]
    for axis, (objective, direction) in zip(axes, table.plan.objectives.items(), strict=True):
        factor, name = _unit(table, objective, finished)
        values = factor * _column(table, finished, objective)
        axis.plot(numbers, values, "o", color="0.65", markersize=4, label="trials", gid=objective)
        figure.titles[objective] = [
            f"trial {n}: {name} {curves.few(v)}" for n, v in zip(numbers, values.tolist(), strict=True)
        ]
        best_values = so_far(values, direction)
        axis.step(numbers, best_values, where="post", color=COLOURS[0], linewidth=1.4, label="best so far")
        axis.set_ylabel(literal(name))
    axes[0].legend(frameon=False, fontsize="small")
    axes[-1].set_xlabel("trial")
    return figure


def _front(table: TuneTable, finished: Sequence[TrialRow], title: str, wide: float) -> Figure:
    """Draw two objectives and the Pareto front as steps. The horizontal axis has the minimised one, if any."""
    figure, (axis,) = _figure(title, wide)
    first, second = list(table.plan.objectives.items())[:2]
    (x_name, x_direction), (y_name, y_direction) = [second, first] if first[1] == MAXIMISE else [first, second]
    (x_factor, x_label), (y_factor, y_label) = (_unit(table, name, finished) for name in (x_name, y_name))
    x, y = x_factor * _column(table, finished, x_name), y_factor * _column(table, finished, y_name)
    front_trials = table.best()
    front_x, front_y = x_factor * _column(table, front_trials, x_name), y_factor * _column(table, front_trials, y_name)
    order = np.lexsort((front_y if y_direction == MAXIMISE else -front_y, front_x))
    axis.plot(x, y, "o", color="0.7", markersize=4, label="trials", gid="trials")
    figure.titles["trials"] = [
        f"trial {trial.number}: {y_label} {curves.few(y_value)}, {x_label} {curves.few(x_value)}"
        for trial, x_value, y_value in zip(finished, x.tolist(), y.tolist(), strict=True)
    ]
    if len(table.plan.objectives) == 2:
        step_side = "post" if x_direction != MAXIMISE else "pre"
        axis.step(front_x[order], front_y[order], where=step_side, color=COLOURS[0], linewidth=1.2)
    axis.plot(front_x, front_y, "o", color=COLOURS[0], markersize=6, label="front (no trial beats these)")
    pairs = [(row.get(f"test.{x_name}"), row.get(f"test.{y_name}")) for row in table.rows()]
    tests = [(x, y) for x, y in pairs if x is not None and y is not None]
    if tests:
        test_x, test_y = np.array(tests).T
        axis.plot(
            x_factor * test_x, y_factor * test_y, "x", color=COLOURS[1], markersize=7, label="front on held-out data"
        )
    axis.set_xlabel(literal(f"{x_label}, {x_direction}d"))
    axis.set_ylabel(literal(f"{y_label}, {y_direction}d"))
    axis.legend(frameon=False, fontsize="small", loc="best")
    return figure


def _importance(table: TuneTable, title: str, wide: float) -> Figure:
    """Draw a bar for each parameter and objective."""
    figure, (axis,) = _figure(title, wide)
    shares_by_objective = {name: importance(table, name) for name in table.plan.objectives}
    names = list(table.plan.names)[::-1]
    tall = 0.8 / len(shares_by_objective)
    for k, (objective, shares) in enumerate(shares_by_objective.items()):
        positions = np.arange(len(names)) + 0.4 - (k + 0.5) * tall
        axis.barh(
            positions,
            [shares[name] for name in names],
            tall * 0.9,
            color=COLOURS[k % len(COLOURS)],
            label=literal(objective),
        )
    axis.set_yticks(range(len(names)), [literal(name) for name in names])
    axis.set_xlim(0.0, 1.0)
    axis.set_xlabel("importance for being among the best tenth of trials")
    if len(shares_by_objective) > 1:
        axis.legend(frameon=False, fontsize="small", loc="best")
    return figure


def _column(table: TuneTable, trials: Sequence[TrialRow], objective: str) -> Floats:
    """Return the values of an objective in some trials."""
    k = list(table.plan.objectives).index(objective)
    return np.array([trial.values[k] for trial in trials if trial.values], float)


def _unit(table: TuneTable, objective: str, finished: Sequence[TrialRow]) -> tuple[float, str]:
    """Return the factor to a unit with a readable prefix, and the objective's name with that unit."""
    largest = float(np.abs(_column(table, finished, objective)).max())
    factor, unit = curves.prefixed(largest, units_of(table).get(objective, ""))
    return factor, name_with_unit(objective, unit)


def importance(table: TuneTable, objective: str) -> dict[str, float]:
    """Return the importance of each parameter for an objective; the sum is 1.

    Args:
        table: table of the search.
        objective: name of the objective.

    Raises:
        ModelError: the journal is damaged, or Optuna is not installed.

    Source: Watanabe et al., IJCAI 2023 (PED-ANOVA), implemented by Optuna.
    """
    package = optuna()
    k = list(table.plan.objectives).index(objective)
    with without_warnings():
        study = package.create_study(direction=OPTUNAS[table.plan.objectives[objective]])
        for trial in trials_of(Folder(table.path, TUNING)):
            if trial.state.name == "COMPLETE":
                fields = {"params": trial.params, "distributions": trial.distributions, "value": trial.values[k]}
                study.add_trial(package.trial.create_trial(**fields))
        evaluator = package.importance.PedAnovaImportanceEvaluator()
        importances = package.importance.get_param_importances(study, evaluator=evaluator)
    return {name: float(importances.get(name, 0.0)) for name in table.plan.names}
