"""The rows of a sweep as pictures need them: which parameters are drawn, and means over seeds."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.checks import is_number
from neuro.core.errors import ModelError, unknown
from neuro.pages.scales import prefixed
from neuro.sweeps.folder import RunOutcome
from neuro.sweeps.table import SweepTable

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
    factor, unit = prefixed(largest, units.get(data.metric, ""))
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
