"""Observations as active places: for each group of dimensions a few shifted grids, of each the cell that holds it.

Places fire regularly, since noise of the input becomes noise of the policy. The shifted grids are the tiles of Albus
(CMAC, 1975) and Sutton & Barto, Reinforcement Learning, 2nd ed., section 9.5.4, with a spiking neuron for each.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from neuro import ModelError
from neuro.apps import kernel

__all__ = ["Dimension", "Places", "dimensions_of", "flat"]

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
BOUNDLESS = 1e6
"""A bound beyond this is none: spaces name the largest float where they know none."""
MOST_PLACES = 1 << 20
PERIOD = 5
"""Ticks between two spikes of an active place."""
REACH = 2.5
"""Standard deviations from the middle of an unbounded dimension at which its fields begin to widen."""
EXPECTED = "Box, Discrete, MultiDiscrete, MultiBinary, or a Dict or Tuple of these"


@dataclass(frozen=True, slots=True)
class Dimension:
    """One number of an observation.

    Attributes:
        name: for messages.
        states: how many values it has, 0 if it is continuous.
        first: the smallest value of one that has `states`.
        low, high: the bounds of one that is continuous, infinite where it has none.
    """

    name: str
    states: int = 0
    first: int = 0
    low: float = -np.inf
    high: float = np.inf

    @property
    def bounded(self) -> bool:
        """Whether its bounds are known."""
        return self.states > 0 or bool(np.isfinite(self.low) and np.isfinite(self.high))


def dimensions_of(space: gymnasium.Space[Any], name: str = "observation") -> list[Dimension]:
    """The dimensions of a space of observations, in the order of `flat`.

    Raises:
        ModelError: a part of it is of another kind.
    """
    match space:
        case spaces.Discrete():
            return [Dimension(name, int(space.n), int(space.start))]
        case spaces.MultiDiscrete():
            starts = np.ravel(space.start)
            return [Dimension(f"{name}[{k}]", int(n), int(starts[k])) for k, n in enumerate(np.ravel(space.nvec))]
        case spaces.MultiBinary():
            return [Dimension(f"{name}[{k}]", 2) for k in range(int(np.prod(space.shape)))]
        case spaces.Box():
            ends = zip(np.ravel(space.low).astype(float), np.ravel(space.high).astype(float), strict=True)
            return [Dimension(f"{name}[{k}]", low=_bound(low), high=_bound(high)) for k, (low, high) in enumerate(ends)]
        case spaces.Dict():
            return [one for key, part in space.spaces.items() for one in dimensions_of(part, f"{name}[{key!r}]")]
        case spaces.Tuple():
            return [one for k, part in enumerate(space.spaces) for one in dimensions_of(part, f"{name}[{k}]")]
    raise ModelError(f"{name} space: found {type(space).__name__}: expected {EXPECTED}")


def _bound(value: float) -> float:
    return value if abs(value) < BOUNDLESS else float(np.copysign(np.inf, value))


def flat(space: gymnasium.Space[Any], found: Any, n: int = 0) -> Floats:
    """Observations as vectors, (observations, dimensions).

    Args:
        space: of one observation.
        found: one observation, or with `n` as many as a vector of environments gives them.
        n: how many there are.

    Raises:
        ModelError: one has another form than the space says, or holds NaN.
    """
    ahead = (n,) if n else ()
    try:
        if isinstance(space, (spaces.Dict, spaces.Tuple)):
            vectors = np.concatenate([part.reshape(n or 1, -1) for part in _parts(space, found, ahead)], axis=1)
        else:
            vectors = _array(space, found, ahead).reshape(n or 1, -1)
        vectors = vectors.astype(np.float64, copy=False)
    except (TypeError, ValueError, KeyError, IndexError):
        listed = f"{n} of {space}, one for each environment" if n else f"one of {space}"
        raise ModelError(f"observation: found {_form(found)}: expected {listed}") from None
    good = np.isfinite(vectors)
    if np.count_nonzero(good) < good.size:
        bad = int(np.argmin(good))
        raise ModelError(
            f"observation: number {bad % vectors.shape[1]} is {vectors.flat[bad]:g}: expected finite numbers"
        )
    return vectors


def _form(observation: Any) -> str:
    shape = getattr(observation, "shape", None)
    return type(observation).__name__ if shape is None else f"an array of shape {list(shape)}"


def _parts(space: gymnasium.Space[Any], found: Any, ahead: tuple[int, ...]) -> Any:
    if isinstance(space, spaces.Dict):
        for key, part in space.spaces.items():
            yield from _parts(part, found[key], ahead)
    elif isinstance(space, spaces.Tuple):
        for part, one in zip(space.spaces, found, strict=True):
            yield from _parts(part, one, ahead)
    else:
        yield _array(space, found, ahead)


def _array(space: gymnasium.Space[Any], found: Any, ahead: tuple[int, ...]) -> npt.NDArray[Any]:
    array = np.asarray(found)
    if array.shape != (*ahead, *(space.shape or ())):
        raise ValueError
    return array


def _too_many(dimensions: int, group: int) -> ModelError:
    return ModelError(
        f"places of {dimensions} dimensions in groups of {group}: expected at most {MOST_PLACES} places",
        hint="group=1, or fewer fields, need fewer; a wrapper may leave dimensions out, or make features of an image",
    )


class Places:
    """Which neurons stand for an observation, and when they spike in a control step.

    Args:
        dimensions: of the observation.
        group: how many of them one group of grids sees together.
        fields: places of a grid along a continuous dimension.
        active: about how many are to be active at a time.

    Attributes:
        size: how many neurons there are.
        active: how many of them stand for an observation, one for each grid of each group.

    Raises:
        ModelError: there would be too many.
    """

    def __init__(self, dimensions: Sequence[Dimension], group: int, fields: int, active: int) -> None:
        self.dimensions = list(dimensions)
        if not self.dimensions:
            raise ModelError("observation space: it is empty: expected at least one dimension")
        some = min(group, len(self.dimensions))
        if math.comb(len(self.dimensions), some) > MOST_PLACES:
            raise _too_many(len(self.dimensions), some)
        groups = list(combinations(range(len(self.dimensions)), some))
        grids = max(1, round(active / len(groups)))
        # A shifted grid has one field more along a dimension: a field at each end reaches beyond the bounds.
        cells = [one.states or fields + 1 for one in self.dimensions]
        member: list[tuple[int, ...]] = []
        shift, stride, first, at = [], [], [], 0
        for chosen in groups:
            # Grids of dimensions with few values would all be the same.
            for grid in range(1 if all(self.dimensions[d].states for d in chosen) else grids):
                member.append(chosen)
                # Dimensions are shifted by different odd shares of a field, so that the cells of no two grids lie
                # along a diagonal (Miller & Glanz 1996, after Parks & Militzer 1991).
                shift.append([0.0 if self.dimensions[d].states else (grid * (2 * k + 1) / grids) % 1.0
                              for k, d in enumerate(chosen)])  # fmt: skip
                steps = np.cumprod([1, *(cells[d] for d in chosen)])
                stride.append(steps[:-1])
                first.append(at)
                at += int(steps[-1])
                if at > MOST_PLACES:
                    raise _too_many(len(self.dimensions), some)
        self.size, self.active = at, len(first)
        self._member, self._stride = np.array(member, dtype=np.int64), np.array(stride, dtype=np.int64)
        self._shift, self._first = np.array(shift, dtype=np.float64), np.array(first, dtype=np.int64)
        self._fields = float(fields)
        self.middle = np.array([0.0 if one.states else (one.low + one.high) / 2 for one in self.dimensions])
        self.middle[~np.isfinite(self.middle)] = 0.0
        self.spread = np.ones(len(self.dimensions))
        self._states = np.array([float(one.states) for one in self.dimensions])
        self._low = np.array([float(one.first) if one.states else one.low for one in self.dimensions])
        self._high = np.array([one.high for one in self.dimensions])

    def learn(self, seen: Floats) -> None:
        """Take middle and spread of unbounded dimensions from what was seen, (observations, dimensions)."""
        for d, one in enumerate(self.dimensions):
            if not one.bounded and len(seen):
                self.middle[d] = seen[:, d].mean()
                self.spread[d] = max(float(seen[:, d].std()), 1e-9)

    def spikes(self, vectors: Floats, ticks: int) -> tuple[Ints, Ints, Ints]:
        """Spikes of a control step for some observations, (observations, dimensions).

        Returns:
            (offsets, ticks, ids) as `neuro.Stepper.step` takes them; the last spike is one tick before the end.
        """
        n = len(vectors)
        per = self.active * len(range(0, ticks - 1, PERIOD))
        when, ids, count = np.empty(n * per, np.int64), np.empty(n * per, np.int64), np.zeros(n + 1, np.int64)
        room = np.empty(self.active, np.int64)
        parts = (self._member, self._stride, self._shift, self._first)
        ends = (self._low, self._high, self._states, self.middle, self.spread)
        _spikes(np.ascontiguousarray(vectors), *parts, *ends, self._fields, ticks - 1, room, count, when, ids)
        total = count[-1]
        return count, when[:total], ids[:total]

    def cells(self, vector: Floats) -> Ints:
        """The active neurons of one observation, (active,)."""
        _, _ticks, ids = self.spikes(vector[None], PERIOD + 1)
        return np.sort(ids)


@kernel
def _spikes(
    vectors: Floats,
    member: Ints,
    stride: Ints,
    shift: Floats,
    first: Ints,
    low: Floats,
    high: Floats,
    states: Floats,
    middle: Floats,
    spread: Floats,
    fields: float,
    last: int,
    cell: Ints,
    count: Ints,
    when: Ints,
    ids: Ints,
) -> None:
    """Fill when and ids with the spikes of each observation, by tick, then id; a place's phase is its number."""
    at = 0
    for k in range(vectors.shape[0]):
        for g in range(member.shape[0]):
            place = first[g]
            for j in range(member.shape[1]):
                d = member[g, j]
                x = vectors[k, d]
                if states[d] > 0.0:
                    inside = min(max(x - low[d], 0.0), states[d] - 1.0)
                elif np.isfinite(low[d]) and np.isfinite(high[d]):
                    share = (x - low[d]) / (high[d] - low[d]) if high[d] > low[d] else 0.5
                    inside = min(max(share, 0.0), 1.0) * fields * (1.0 - 1e-12) + shift[g, j]
                else:
                    # Beyond a few deviations fields widen: what random moves have not reached has a place, too.
                    share = 0.5 + 0.5 * np.tanh((x - middle[d]) / (REACH * spread[d]))
                    inside = share * fields * (1.0 - 1e-12) + shift[g, j]
                place += stride[g, j] * np.int64(inside)
            cell[g] = place
        # Places of later grids have larger numbers, so they are in order already.
        for tick in range(1, last + 1):
            for g in range(member.shape[0]):
                if (tick - 1) % PERIOD == cell[g] % PERIOD:
                    when[at], ids[at] = tick, cell[g]
                    at += 1
        count[k + 1] = at
