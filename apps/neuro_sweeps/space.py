"""The points of a sweep: a grid, a list, drawn at random or as a Latin hypercube, each with some seeds; their runs."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro import ModelError
from neuro.apps import is_number, shown, unknown

SAMPLINGS = ("grid", "random", "latin_hypercube")
SCALES = ("linear", "log")
MOST = 1_000_000
"""Runs of a sweep; each is a folder."""

Point = dict[str, Any]
_RANGE = ("from", "to", "number", "scale", "whole")


@dataclass(frozen=True, slots=True)
class RunItem:
    """One run to do.

    Attributes:
        key: hash of its inputs, its name in the folder.
        point, seed: its inputs.
        trial: of a tuning, where it may be pruned.
    """

    key: str
    point: Point
    seed: int | None
    trial: int | None = None


def key_of(before: str, point: Mapping[str, Any], seed: int | None) -> str:
    """The hash of the inputs of a run, 32 hexadecimal digits.

    Args:
        before: what decides the outcome beside point and seed.
        point: the values of the parameters.
        seed: of the run.

    Raises:
        ModelError: a value of the point cannot be written as JSON.
    """
    try:
        text = json.dumps([point, seed], sort_keys=True)
    except TypeError as error:
        raise ModelError(f"point {shown(dict(point))}: expected numbers, texts and lists: {error}") from None
    return hashlib.sha256(f"{before}\n{text}".encode()).hexdigest()[:32]


@dataclass(frozen=True, slots=True)
class Axis:
    """The values that one parameter may have.

    Attributes:
        name: of the parameter.
        values: those that are listed, or none of a range.
        low, high: of a range.
        number: how many values of a range a grid has; 0 where it is drawn from.
        log: whether equal steps are equal factors.
        whole: whether values are whole numbers.
    """

    name: str
    values: tuple[Any, ...] = ()
    low: float = 0.0
    high: float = 0.0
    number: int = 0
    log: bool = False
    whole: bool = False

    @property
    def listed(self) -> tuple[Any, ...]:
        """All values of a grid."""
        if self.values or not self.number:
            return self.values
        every = np.linspace(0.0, 1.0, self.number) if self.number > 1 else np.zeros(1)
        return tuple(dict.fromkeys(self.at(share) for share in every.tolist()))

    def count(self) -> int:
        """How many values a grid has."""
        return self.number if self.number > MOST else len(self.listed)

    def at(self, share: float) -> Any:
        """The value at a share from 0 to 1 of the axis."""
        if self.values:
            return self.values[min(int(share * len(self.values)), len(self.values) - 1)]
        if self.log:
            value = self.low * (self.high / self.low) ** share
        else:
            value = self.low + share * (self.high - self.low)
        value = min(max(value, self.low), self.high) if share < 1.0 else self.high
        return round(value) if self.whole else value


def axes(space: Mapping[str, Any]) -> tuple[Axis, ...]:
    """The axes that a mapping from names to lists or ranges says.

    Raises:
        ModelError: one is neither, or empty.
    """
    if not isinstance(space, Mapping):
        raise ModelError(f"parameters = {shown(space)}: expected values by name, such as {{g: [4, 5, 6]}}")
    return tuple(_axis(str(name), said) for name, said in space.items())


def _axis(name: str, said: Any) -> Axis:
    if isinstance(said, Mapping):
        return _range(name, said)
    if isinstance(said, np.ndarray):
        said = said.tolist()
    if isinstance(said, range):
        said = list(said)
    if not isinstance(said, (list, tuple)):
        hint = f"write [{shown(said)}] for one value, or put it under 'set'"
        raise ModelError(f"{name} = {shown(said)}: expected a list of values, or {{from: ..., to: ...}}", hint=hint)
    if not said:
        raise ModelError(f"{name}: found an empty list: expected one value or more")
    values = tuple(value.item() if isinstance(value, np.generic) else value for value in said)
    for k, value in enumerate(values):
        if value in values[:k]:
            raise ModelError(f"{name}[{k}] = {shown(value)}: is there twice")
    return Axis(name, values)


def _range(name: str, said: Mapping[str, Any]) -> Axis:
    for word in said:
        if word not in _RANGE:
            raise unknown(f"word of the range of {name}", word, _RANGE)
    for word in ("from", "to"):
        if word not in said:
            raise ModelError(f"{name}: a range needs '{word}'")
        if isinstance(said[word], bool) or not isinstance(said[word], (int, float)) or not math.isfinite(said[word]):
            raise ModelError(f"{name}.{word} = {shown(said[word])}: expected a finite number")
    number, scale, whole = said.get("number", 0), said.get("scale", "linear"), said.get("whole", False)
    low, high = float(said["from"]), float(said["to"])
    if not isinstance(number, int) or isinstance(number, bool) or ("number" in said and number < 1):
        raise ModelError(f"{name}.number = {shown(number)}: expected a whole number >= 1")
    if scale not in SCALES:
        raise ModelError(f"{name}.scale = {shown(scale)}: expected one of {', '.join(SCALES)}")
    if not isinstance(whole, bool):
        raise ModelError(f"{name}.whole = {shown(whole)}: expected true or false")
    if not low < high:
        raise ModelError(f"{name}: from {low:g} to {high:g}: expected from < to")
    if scale == "log" and low <= 0:
        raise ModelError(f"{name}.from = {low:g}: expected a number > 0 on a log scale")
    return Axis(name, (), low, high, number, scale == "log", whole)


@dataclass(frozen=True, slots=True)
class SearchSpace:
    """What a sweep goes through.

    Attributes:
        axes: the parameters.
        sampling: one of `SAMPLINGS`, or "list".
        runs: how many points are drawn.
        draw: the seed of what is drawn.
        seeds: with which each point is run; none where runs get no seed.
        given: the points of a list.
    """

    axes: tuple[Axis, ...] = ()
    sampling: str = "grid"
    runs: int = 0
    draw: int = 0
    seeds: tuple[int, ...] = ()
    given: tuple[Point, ...] = ()

    @property
    def names(self) -> tuple[str, ...]:
        """The parameters, in order."""
        if self.sampling == "list":
            return tuple(dict.fromkeys(name for point in self.given for name in point))
        return tuple(axis.name for axis in self.axes)

    def size(self) -> int:
        """How many runs there are."""
        points = self.runs if self.runs else len(self.given)
        if self.sampling == "grid":
            points = math.prod(axis.count() for axis in self.axes)
        return points * max(1, len(self.seeds))

    def points(self) -> list[tuple[Point, int | None]]:
        """All points in order, each with its seed."""
        return [(point, seed) for point in self._points() for seed in self.seeds or (None,)]

    def _points(self) -> Iterator[Point]:
        if self.sampling == "list":
            yield from (dict(point) for point in self.given)
        elif self.sampling == "grid":
            for values in product(*(axis.listed for axis in self.axes)):
                yield dict(zip(self.names, values, strict=True))
        else:
            for row in self._shares():
                yield {axis.name: axis.at(float(share)) for axis, share in zip(self.axes, row, strict=True)}

    def _shares(self) -> NDArray[np.float64]:
        """Places in the unit cube.

        Latin hypercube: McKay, Beckman & Conover, Technometrics 21:239, 1979.
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
    """A checked space.

    Args:
        parameters: by name lists of values or ranges, `{"from": 0, "to": 1, "number": 5}`, for a grid, of which the
            drawn samplings need no number; or a list of points.
        sampling: "grid", "random" or "latin_hypercube".
        runs: how many points are drawn, of the drawn samplings.
        seeds: a number, for 0, 1, ..., or a list.
        draw: the seed of what is drawn.

    Raises:
        ModelError: it is empty, too large, or not said like that.
    """
    all_seeds = seeds_of(seeds)
    if isinstance(parameters, (list, tuple)):
        found = SearchSpace(sampling="list", seeds=all_seeds, given=tuple(_given(parameters)))
    else:
        found = SearchSpace(axes(parameters), sampling, _runs(sampling, runs), draw, all_seeds)
        if not found.axes and not found.seeds:
            raise ModelError("the space is empty: expected parameters with values, or seeds")
        if not found.axes and found.sampling != "grid":
            raise ModelError(f"the space is empty: sampling {found.sampling} needs parameters")
        for axis in found.axes:
            if found.sampling == "grid" and not axis.values and not axis.number:
                raise ModelError(f"{axis.name}: a range of a grid needs 'number', how many values")
            if found.sampling != "grid" and axis.number:
                raise ModelError(f"{axis.name}.number = {axis.number}: has no meaning with sampling {found.sampling}")
    if found.size() > MOST:
        sizes = [f"{axis.name} has {axis.count():,}" for axis in found.axes if found.sampling == "grid"]
        message = ", ".join(sizes[:6]) + "; " if sizes else ""
        raise ModelError(
            f"the space has {found.size():,} runs: expected at most {MOST:,}",
            hint=message + "'sampling: latin_hypercube' with 'runs: 1000' covers a large space",
        )
    return found


def _given(points: Sequence[Any]) -> Iterator[Point]:
    if not points:
        raise ModelError("the space is empty: expected one point or more")
    for k, point in enumerate(points):
        if not isinstance(point, Mapping):
            raise ModelError(f"list[{k}] = {shown(point)}: expected values by name, such as {{g: 5}}")
        if sorted(point) != sorted(points[0]):
            names = ", ".join(map(str, points[0]))
            raise ModelError(f"list[{k}]: has {', '.join(map(str, point)) or 'nothing'}: expected {names} as the first")
        yield {name: value.item() if isinstance(value, np.generic) else value for name, value in point.items()}


def _runs(sampling: str, runs: int | None) -> int:
    if sampling not in SAMPLINGS:
        raise unknown("sampling", sampling, SAMPLINGS)
    if sampling == "grid":
        if runs is not None:
            raise ModelError(f"runs = {shown(runs)}: a grid has as many as it has points", path=("runs",))
        return 0
    if not isinstance(runs, int) or isinstance(runs, bool) or runs < 1:
        found = "nothing" if runs is None else shown(runs)
        raise ModelError(f"runs: found {found}: expected how many points are drawn, a whole number >= 1")
    return runs


def seeds_of(seeds: int | Sequence[int] | None) -> tuple[int, ...]:
    """Seeds from a number of them, for 0, 1, ..., or a list; none from None.

    Raises:
        ModelError: it is neither.
    """
    if seeds is None:
        return ()
    if isinstance(seeds, int) and not isinstance(seeds, bool):
        if not 1 <= seeds <= MOST:
            raise ModelError(f"seeds = {seeds}: expected a whole number from 1 to {MOST:,}, or a list", path=("seeds",))
        return tuple(range(seeds))
    every: list[Any] = list(seeds) if isinstance(seeds, (list, tuple, range)) else [seeds]
    for seed in every or [None]:
        if not isinstance(seed, int) or isinstance(seed, bool) or not 0 <= seed < 2**63:
            most = " and < 2^63" if is_number(seed) and seed >= 2**63 else ""
            message = f"seeds = {shown(seeds)}: expected how many, or a list of whole numbers >= 0{most}"
            raise ModelError(message, path=("seeds",))
    if len(set(every)) < len(every):
        raise ModelError(f"seeds = {shown(seeds)}: one is there twice", path=("seeds",))
    return tuple(every)
