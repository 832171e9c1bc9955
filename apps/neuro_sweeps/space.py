"""The points of a sweep: a grid, a list, random points or a Latin hypercube, each combined with seeds; their runs."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro import ModelError
from neuro.apps import argument, is_number, shown, unknown

SAMPLINGS = ("grid", "random", "latin_hypercube")
SCALES = ("linear", "log")
MOST = 1_000_000
"""Largest number of runs of a sweep, each of which is a folder."""

Point = dict[str, Any]
_RANGE = ("from", "to", "number", "scale", "whole")


@dataclass(frozen=True, slots=True)
class RunItem:
    """The inputs of a run.

    Attributes:
        key: hash of the inputs, and name of the run in the folder.
        point: values of the parameters.
        seed: seed; None for runs without a seed.
        trial: number of the trial of a tuning that may prune the run; else None.
    """

    key: str
    point: Point
    seed: int | None
    trial: int | None = None


def key_of(key_prefix: str, point: Mapping[str, Any], seed: int | None) -> str:
    """Return the hash of the inputs of a run, 32 hexadecimal digits.

    Args:
        key_prefix: all inputs of the run but point and seed, as text.
        point: values of the parameters.
        seed: seed of the run.

    Raises:
        ModelError: a value of the point cannot be written as JSON.
    """
    try:
        text = json.dumps([point, seed], sort_keys=True)
    except TypeError as error:
        raise ModelError(f"point {shown(dict(point))}: expected numbers, texts and lists: {error}") from None
    return hashlib.sha256(f"{key_prefix}\n{text}".encode()).hexdigest()[:32]


@dataclass(frozen=True, slots=True)
class Axis:
    """The values of a parameter: a list or a range.

    Attributes:
        name: name of the parameter.
        values: the list; empty for a range.
        low, high: bounds of a range.
        number: number of values of a range in a grid; 0 for a range from which values are drawn.
        log: the range has a logarithmic scale.
        whole: values are whole numbers.
    """

    name: str
    values: tuple[Any, ...] = ()
    low: float = 0.0
    high: float = 0.0
    number: int = 0
    log: bool = False
    whole: bool = False

    @property
    def grid_values(self) -> tuple[Any, ...]:
        """The values of the parameter in a grid."""
        if self.values or not self.number:
            return self.values
        shares = np.linspace(0.0, 1.0, self.number) if self.number > 1 else np.zeros(1)
        return tuple(dict.fromkeys(self.at(share) for share in shares.tolist()))

    def count(self) -> int:
        """Return the number of values in a grid."""
        return self.number if self.number > MOST else len(self.grid_values)

    def at(self, share: float) -> Any:
        """Return the value at a share of the axis from 0 to 1, e.g. 10 at 0.5 on a log scale from 1 to 100."""
        if self.values:
            return self.values[min(int(share * len(self.values)), len(self.values) - 1)]
        if self.log:
            value = self.low * (self.high / self.low) ** share
        else:
            value = self.low + share * (self.high - self.low)
        value = min(max(value, self.low), self.high) if share < 1.0 else self.high
        return round(value) if self.whole else value


def axes(space: Mapping[str, Any]) -> tuple[Axis, ...]:
    """Return the axes for a mapping of names to lists or ranges.

    Raises:
        ModelError: a value is neither a list nor a range, or is empty.
    """
    if not isinstance(space, Mapping):
        raise ModelError(f"parameters = {shown(space)}: expected values by name, such as {{g: [4, 5, 6]}}")
    return tuple(_axis(str(name), values) for name, values in space.items())


def check_numbers(axes: Iterable[Axis], way: str, way_text: str) -> None:
    """Check that ranges have a number of values in a grid, and nowhere else.

    Args:
        axes: the parameters with their values.
        way: "grid", or another way to choose points.
        way_text: the way in messages.

    Raises:
        ModelError: a range of a grid has no number, or another range has one.
    """
    for axis in axes:
        if way == "grid" and not axis.values and not axis.number:
            raise ModelError(f"{axis.name}: a range of a grid needs 'number', the number of values")
        if way != "grid" and axis.number:
            raise ModelError(f"{axis.name}.number = {axis.number}: not used with {way_text}")


def _axis(name: str, values: Any) -> Axis:
    if isinstance(values, Mapping):
        return _range(name, values)
    if isinstance(values, np.ndarray):
        values = values.tolist()
    if isinstance(values, range):
        values = list(values)
    if not isinstance(values, (list, tuple)):
        hint = f"write [{shown(values)}] for a single value, or move it to 'set'"
        raise ModelError(f"{name} = {shown(values)}: expected a list of values, or {{from: ..., to: ...}}", hint=hint)
    if not values:
        raise ModelError(f"{name}: found an empty list: expected one value or more")
    plain = tuple(value.item() if isinstance(value, np.generic) else value for value in values)
    for k, value in enumerate(plain):
        if value in plain[:k]:
            raise ModelError(f"{name}[{k}] = {shown(value)}: found twice: expected different values")
    return Axis(name, plain)


def _range(name: str, spec: Mapping[str, Any]) -> Axis:
    for word in spec:
        if word not in _RANGE:
            raise unknown(f"word of the range of {name}", word, _RANGE)
    for word in ("from", "to"):
        if word not in spec:
            raise ModelError(f"{name}: a range needs '{word}'")
    low, high = (argument(f"{name}.{word}", spec[word]) for word in ("from", "to"))
    number = argument(f"{name}.number", spec.get("number"), kind="integer", at_least=1, optional="number" not in spec)
    scale = argument(f"{name}.scale", spec.get("scale", "linear"), words=SCALES)
    is_whole = argument(f"{name}.whole", spec.get("whole", False), kind="boolean")
    if not low < high:
        raise ModelError(f"{name}: from {low:g} to {high:g}: expected from < to")
    if scale == "log" and low <= 0:
        raise ModelError(f"{name}.from = {low:g}: expected a number > 0 on a log scale")
    return Axis(name, (), low, high, number or 0, scale == "log", is_whole)


@dataclass(frozen=True, slots=True)
class SearchSpace:
    """The space of a sweep.

    Attributes:
        axes: the parameters with their values.
        sampling: one of `SAMPLINGS`, or "list".
        runs: number of points to draw; 0 for grids and lists.
        draw: seed of the drawn points.
        seeds: seeds of the runs at each point; empty for runs without a seed.
        listed_points: the points of a list.
    """

    axes: tuple[Axis, ...] = ()
    sampling: str = "grid"
    runs: int = 0
    draw: int = 0
    seeds: tuple[int, ...] = ()
    listed_points: tuple[Point, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the parameters, in order."""
        if self.sampling == "list":
            return tuple(dict.fromkeys(name for point in self.listed_points for name in point))
        return tuple(axis.name for axis in self.axes)

    def size(self) -> int:
        """Return the number of runs."""
        points = self.runs if self.runs else len(self.listed_points)
        if self.sampling == "grid":
            points = math.prod(axis.count() for axis in self.axes)
        return points * max(1, len(self.seeds))

    def points(self) -> list[tuple[Point, int | None]]:
        """Return all points in order, each with a seed."""
        return [(point, seed) for point in self._points() for seed in self.seeds or (None,)]

    def _points(self) -> Iterator[Point]:
        if self.sampling == "list":
            yield from (dict(point) for point in self.listed_points)
        elif self.sampling == "grid":
            for values in product(*(axis.grid_values for axis in self.axes)):
                yield dict(zip(self.names, values, strict=True))
        else:
            for row in self._shares():
                yield {axis.name: axis.at(float(share)) for axis, share in zip(self.axes, row, strict=True)}

    def _shares(self) -> NDArray[np.float64]:
        """Draw points in the unit cube, shape (runs, axes).

        Source of the Latin hypercube: McKay, Beckman & Conover, Technometrics 21:239, 1979.
        """
        rng = np.random.default_rng(self.draw)
        if self.sampling == "random":
            return rng.random((self.runs, len(self.axes)))
        from scipy.stats import qmc

        return np.asarray(qmc.LatinHypercube(len(self.axes), rng=rng).random(self.runs))


def space_of(
    parameters: Any,
    sampling: str = "grid",
    runs: int | None = None,
    seeds: int | Sequence[int] | None = None,
    draw: int = 0,
) -> SearchSpace:
    """Return a checked space.

    Args:
        parameters: lists of values or ranges by name, or a list of points. A range is
            `{"from": 0, "to": 1, "number": 5}`; only grids have a `number`.
        sampling: "grid", "random" or "latin_hypercube".
        runs: number of points to draw, for "random" and "latin_hypercube".
        seeds: a number of seeds, which are 0, 1, ..., or a list of seeds.
        draw: seed of the drawn points.

    Raises:
        ModelError: the space is empty or too large, or an argument has another form.
    """
    all_seeds = seeds_of(seeds)
    if isinstance(parameters, (list, tuple)):
        space = SearchSpace(sampling="list", seeds=all_seeds, listed_points=tuple(_listed_points(parameters)))
    else:
        space = SearchSpace(axes(parameters), sampling, _runs(sampling, runs), draw, all_seeds)
        if not space.axes and not space.seeds:
            raise ModelError("the space is empty: expected parameters with values, or seeds")
        if not space.axes and space.sampling != "grid":
            raise ModelError(f"the space is empty: sampling {space.sampling} needs parameters")
        check_numbers(space.axes, space.sampling, f"sampling {space.sampling}")
    if space.size() > MOST:
        sizes = [f"{axis.name} has {axis.count():,}" for axis in space.axes if space.sampling == "grid"]
        message = ", ".join(sizes[:6]) + "; " if sizes else ""
        raise ModelError(
            f"the space has {space.size():,} runs: expected at most {MOST:,}",
            hint=message + "'sampling: latin_hypercube' with 'runs: 1000' covers a large space",
        )
    return space


def _listed_points(points: Sequence[Any]) -> Iterator[Point]:
    if not points:
        raise ModelError("the space is empty: expected one point or more")
    for k, point in enumerate(points):
        if not isinstance(point, Mapping):
            raise ModelError(f"list[{k}] = {shown(point)}: expected values by name, such as {{g: 5}}")
        if sorted(point) != sorted(points[0]):
            names = ", ".join(map(str, points[0]))
            raise ModelError(f"list[{k}]: has {', '.join(map(str, point)) or 'nothing'}: expected {names}, as list[0]")
        yield {name: value.item() if isinstance(value, np.generic) else value for name, value in point.items()}


def _runs(sampling: str, runs: int | None) -> int:
    if sampling not in SAMPLINGS:
        raise unknown("sampling", sampling, SAMPLINGS)
    if sampling == "grid":
        if runs is not None:
            raise ModelError(f"runs = {shown(runs)}: not used with a grid, which runs all its points", path=("runs",))
        return 0
    if runs is None:
        raise ModelError("runs: found nothing: expected the number of points to draw, a whole number >= 1")
    number: int = argument("runs", runs, kind="integer", at_least=1)
    return number


def seeds_of(seeds: int | Sequence[int] | None) -> tuple[int, ...]:
    """Return the seeds for a number of seeds (3 gives 0, 1, 2), for a list, or for None (no seeds).

    Raises:
        ModelError: the argument has another form.
    """
    if seeds is None:
        return ()
    if isinstance(seeds, int) and not isinstance(seeds, bool):
        if not 1 <= seeds <= MOST:
            raise ModelError(f"seeds = {seeds}: expected a whole number from 1 to {MOST:,}, or a list", path=("seeds",))
        return tuple(range(seeds))
    numbers: list[Any] = list(seeds) if isinstance(seeds, (list, tuple, range)) else [seeds]
    for seed in numbers or [None]:
        if not isinstance(seed, int) or isinstance(seed, bool) or not 0 <= seed < 2**63:
            bound = " and < 2^63" if is_number(seed) and seed >= 2**63 else ""
            message = f"seeds = {shown(seeds)}: expected a number of seeds, or a list of whole numbers >= 0{bound}"
            raise ModelError(message, path=("seeds",))
    if len(set(numbers)) < len(numbers):
        raise ModelError(f"seeds = {shown(seeds)}: found a seed twice: expected different seeds", path=("seeds",))
    return tuple(numbers)
