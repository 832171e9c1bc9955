"""Encoders of vectors: neurons with fields, which spike while the vector lies in their field.

Noise of the spikes becomes noise of what is learnt from them, so regular spikes often teach faster than drawn ones.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import ClassVar, TypeAlias

import numpy as np
import numpy.typing as npt

from neuro.coding.work import Work, on_numbers
from neuro.core.checks import argument
from neuro.core.errors import ModelError
from neuro.kernels.jit import kernel, subkernel

Floats: TypeAlias = npt.NDArray[np.float64]
Ints: TypeAlias = npt.NDArray[np.int64]

MOST = 1 << 20
"""Neurons of an encoder."""
PERIOD = 5
"""Ticks between two spikes of a neuron in the middle of its field."""
REACH = 2.5
"""Standard deviations from the middle of an unbounded dimension at which its fields begin to widen."""
WIDTH = 1.5
"""Distance of two tuning curves in standard deviations, the beta of Bohte, La Poutre & Kok 2002."""
SILENT = 0.01
"""A neuron whose activity is below this does not spike."""
NEAR = 5
"""Tuning curves of one dimension that are at least SILENT somewhere."""
LOW, HIGH, STATES, MIDDLE, SPREAD = range(5)
"""Rows of the array of a space, (5, dimensions) float64: lowest and highest value, number of states or 0, and mean and
standard deviation where a bound is missing."""
Parts: TypeAlias = tuple[Ints, Ints, Floats, Ints]
"""Of g grids of s dimensions: numbers of the dimensions, steps from one neuron to the next along each, and shares of a
field by which a grid is shifted, (g, s); the first neuron, (g,). A plain tuple, of which a kernel takes an array in a
quarter of the time of one in a named tuple: the kernel is called for each vector."""
GOLDEN = 0.6180339887498949
"""Multiples of it, modulo 1, are phases that are spread evenly, for any number of neurons."""


@dataclass(frozen=True, slots=True)
class Dimension:
    """One number of a vector.

    Attributes:
        name: name for messages.
        states: number of values, 0 for a continuous dimension.
        first: smallest value of a dimension with `states`.
        low, high: bounds of a continuous dimension, infinite if it has none.
        whole: True if a dimension without `states` takes whole numbers only, e.g. a pixel of 8 bits.
    """

    name: str = "dimension"
    states: int = 0
    first: int = 0
    low: float = -np.inf
    high: float = np.inf
    whole: bool = False

    @property
    def bounded(self) -> bool:
        """True if both bounds are known."""
        return self.states > 0 or bool(np.isfinite(self.low) and np.isfinite(self.high))


class Fields:
    """Base of the encoders of vectors.

    Dimensions without bounds get their middle and spread from `learn`. Beyond 2.5 deviations their fields widen, so
    that every value lies in a field.

    Attributes:
        dimensions: dimensions of the vectors.
        size: number of neurons.
        active: number of neurons that are active for a vector.
    """

    def __init__(self, dimensions: Sequence[Dimension], group: int) -> None:
        self.dimensions = list(dimensions)
        if not self.dimensions:
            raise ModelError("dimensions = []: expected at least one")
        self.size = self.active = 0
        self._some = min(argument("group", group, kind="integer", at_least=1), len(self.dimensions))
        if math.comb(len(self.dimensions), self._some) > MOST:
            raise self._too_many()
        self._groups = list(combinations(range(len(self.dimensions)), self._some))
        self._ends = np.ones((5, len(self.dimensions)))
        for d, one in enumerate(self.dimensions):
            middle = (one.low + one.high) / 2
            middle = 0.0 if one.states or not np.isfinite(middle) else middle
            self._ends[:SPREAD, d] = one.first if one.states else one.low, one.high, one.states, middle

    @property
    def middle(self) -> Floats:
        """Mean of each dimension, used where it has no bounds, (dimensions,)."""
        middle: Floats = self._ends[MIDDLE]
        return middle

    @property
    def spread(self) -> Floats:
        """Standard deviation of each dimension, used where it has no bounds, (dimensions,)."""
        spread: Floats = self._ends[SPREAD]
        return spread

    def learn(self, vectors: Floats) -> None:
        """Set middle and spread of unbounded dimensions from at least two vectors, (vectors, dimensions)."""
        for d, one in enumerate(self.dimensions):
            if not one.bounded and len(vectors) > 1:
                self.middle[d] = vectors[:, d].mean()
                self.spread[d] = max(float(vectors[:, d].std()), 1e-9)

    def spikes(self, vectors: Floats, ticks: int, rng: np.random.Generator | None = None) -> tuple[Ints, Ints, Ints]:
        """Spikes of some vectors, each shown for so many ticks to a copy of the neurons.

        Args:
            vectors: (vectors, dimensions), finite.
            ticks: how long each is shown.
            rng: with one, spikes are drawn: in each tick a neuron spikes with probability activity / 5, as a Poisson
                process does in a time that is short. Without one they are regular, every 5 / activity ticks.

        Returns:
            (offsets, ticks, ids) as `neuro.Stepper.step` takes them: spikes offsets[k] to offsets[k + 1] are of
            vector k, by tick, then id; the last spike is one tick before the end.
        """
        raise NotImplementedError

    def activity(self, vector: Floats) -> tuple[Ints, Floats]:
        """The neurons that spike for one vector, (n,), and how active each is, in (0, 1]."""
        raise NotImplementedError

    def cells(self, vector: Floats) -> Ints:
        """The neurons that stand for one vector: of each grid or group the one that is most active, (active,)."""
        raise NotImplementedError

    def work(self, ticks: int, poisson: bool = False) -> Work:
        """Return the operations of `spikes` for one vector.

        Args:
            ticks: how long the vector is shown.
            poisson: whether spikes are drawn at random.
        """
        raise NotImplementedError

    def _placing(self, continuous: int, states: int) -> float:
        """Return the operations that find the places of a vector along the dimensions of all groups.

        Args:
            continuous: operations behind the share of a continuous dimension.
            states: operations behind the limits of a dimension with states.

        The share takes a difference, a division, or a factor and a tanh, and two limits.
        """
        return sum(3 + states if self.dimensions[d].states else 5 + continuous for d in self._member.ravel().tolist())

    def _layout(self, members: Sequence[Sequence[int]], cells: Sequence[int]) -> None:
        """Number the neurons of each grid or group, of which each has so many along each dimension."""
        stride, first = [], []
        for chosen in members:
            steps = np.cumprod([1, *(cells[d] for d in chosen)], dtype=np.float64)
            stride.append(steps[:-1])
            first.append(self.size)
            if self.size + steps[-1] > MOST:
                raise self._too_many()
            self.size += int(steps[-1])
        self.active = len(first)
        self._member = np.array(members, dtype=np.int64)
        self._stride, self._first = np.array(stride, dtype=np.int64), np.array(first, dtype=np.int64)

    def _too_many(self) -> ModelError:
        return ModelError(
            f"places of {len(self.dimensions)} dimensions in groups of {self._some}: expected at most {MOST} places",
            hint="group=1, fewer fields or active ones need fewer; a wrapper may leave dimensions out or make features",
        )


class _Grids(Fields):
    """Encoders of which each grid has one active neuron."""

    _more: ClassVar[int] = 0
    """Shares of a field by which a grid is shifted more along each next dimension of its group."""

    def __init__(self, dimensions: Sequence[Dimension], group: int, fields: int, active: int) -> None:
        super().__init__(dimensions, group)
        self._fields = float(argument("fields", fields, kind="integer", at_least=2))
        grids = max(1, round(argument("active", active, kind="integer", at_least=1) / len(self._groups)))
        # A shifted grid has one field more along a dimension: a field at each end reaches beyond the bounds.
        cells = [one.states or fields + 1 for one in self.dimensions]
        members: list[tuple[int, ...]] = []
        shift = []
        for chosen in self._groups:
            # Grids of dimensions with few values would all be the same.
            count = 1 if all(self.dimensions[d].states for d in chosen) else grids
            if len(members) + count > MOST:
                raise self._too_many()
            for grid in range(count):
                members.append(chosen)
                shift.append([0.0 if self.dimensions[d].states else (grid * (1 + self._more * k) / grids) % 1.0
                              for k, d in enumerate(chosen)])  # fmt: skip
        self._layout(members, cells)
        self._shift = np.array(shift, dtype=np.float64)

    def spikes(self, vectors: Floats, ticks: int, rng: np.random.Generator | None = None) -> tuple[Ints, Ints, Ints]:
        """Spikes of some vectors, see `Fields.spikes`; a neuron's phase is its number."""
        n = len(vectors)
        most = n * self.active * len(range(0, ticks - 1, PERIOD if rng is None else 1))
        when, ids, count = np.empty(most, np.int64), np.empty(most, np.int64), np.zeros(n + 1, np.int64)
        room = np.empty(self.active, np.int64)
        draws = _NONE if rng is None else rng.random((n, ticks, self.active))
        parts = (self._member, self._stride, self._shift, self._first)
        _spikes(
            np.ascontiguousarray(vectors), parts, self._ends, self._fields, ticks - 1, draws, room, count, when, ids
        )
        total = count[-1]
        return count, when[:total], ids[:total]

    def work(self, ticks: int, poisson: bool = False) -> Work:
        """Return the operations for one vector, see `Fields.work`.

        Each dimension of a grid takes a shift, a rounding and a stride behind the share; each tick of a grid a
        comparison, and with `poisson` also a product with the draw.
        """
        macs = self._placing(3, 2) + self.active * (ticks - 1) * (2 if poisson else 1)
        return on_numbers(macs, len(self.dimensions) + self.active)

    def activity(self, vector: Floats) -> tuple[Ints, Floats]:
        """The active neurons, see `Fields.activity`; each is as active as all."""
        return self.cells(vector), np.ones(self.active)

    def cells(self, vector: Floats) -> Ints:
        """The active neuron of each grid, see `Fields.cells`."""
        _, _ticks, ids = self.spikes(vector[None], PERIOD + 1)
        return np.sort(ids)


class Places(_Grids):
    """Place cells: for each group of dimensions some grids, each shifted, of each the field that holds the vector.

    Dimensions are shifted by different odd shares of a field, so that the cells of no two grids lie along a diagonal.

    Args:
        dimensions: of the vectors.
        group: how many of them one group of grids sees together: all where there are no more.
        fields: of a grid along a continuous dimension, at least 2; one that has states has a field for each.
        active: about how many neurons are to be active at a time: so many grids a group has, at least one.

    Raises:
        ModelError: there is no dimension, a number is out of bounds, or there would be more than 2^20 neurons.

    Source: Albus, J. Dyn. Syst. Meas. Control 97:220, 1975 (CMAC); displacement: Miller & Glanz 1996, after Parks &
        Militzer 1991; place cells as input to an actor and a critic: Foster, Morris & Dayan, Hippocampus 10:1, 2000.
    """

    _more: ClassVar[int] = 2

    def __init__(self, dimensions: Sequence[Dimension], group: int = 2, fields: int = 6, active: int = 24) -> None:
        super().__init__(dimensions, group, fields, active)


class Tiles(_Grids):
    """Tile coding: as `Places`, but each grid is shifted alike along all dimensions, and by default it sees all.

    Args:
        dimensions: of the vectors.
        group: how many of them a grid sees together; None: all.
        fields: of a grid along a continuous dimension, at least 2; one that has states has a field for each.
        active: about how many neurons are to be active at a time.

    Raises:
        ModelError: as of `Places`.

    Source: Albus, J. Dyn. Syst. Meas. Control 97:220, 1975; Sutton & Barto, Reinforcement Learning, 2nd ed., section
        9.5.4.
    """

    def __init__(
        self, dimensions: Sequence[Dimension], group: int | None = None, fields: int = 6, active: int = 8
    ) -> None:
        super().__init__(dimensions, max(1, len(dimensions)) if group is None else group, fields, active)


class OneHot(_Grids):
    """A neuron for each value of each dimension; of each dimension one is active.

    Args:
        dimensions: of the vectors, each with `states`, or with bounds and `whole`.

    Raises:
        ModelError: a dimension is continuous, there is none, or there would be more than 2^20 neurons.

    Source: the tabular case, Sutton & Barto, Reinforcement Learning, 2nd ed., section 9.4.
    """

    def __init__(self, dimensions: Sequence[Dimension]) -> None:
        super().__init__([_with_states(one) for one in dimensions], 1, 2, 1)


def _with_states(one: Dimension) -> Dimension:
    """Return a dimension with a state for each of its values."""
    if one.states:
        return one
    if not (one.whole and one.bounded):
        raise ModelError(
            f"one_hot: {one.name} is continuous: expected a number of values, as of Discrete or a Box of integers",
            hint="places, tiles and population take continuous dimensions",
        )
    return replace(one, states=int(one.high - one.low) + 1, first=int(one.low))


class Population(Fields):
    """Tuning curves: along each dimension n bells, and neurons that are as active as the product of a group's bells.

    With the share s of a value between its bounds, bell i, from 0, is exp(-(1.5 (s (n - 2) - i + 1/2))^2 / 2), which
    is what `population` gives. A dimension that has states has a neuron for each, of which one is active.

    Args:
        dimensions: of the vectors.
        group: how many of them a neuron is tuned to: 1 for a population for each dimension.
        fields: bells along a continuous dimension, at least 3.

    Raises:
        ModelError: there is no dimension, a number is out of bounds, or there would be more than 2^20 neurons.

    Source: Bohte, La Poutre & Kok, IEEE Trans. Neural Networks 13, 2002; products of bells: Poggio & Girosi, Proc.
        IEEE 78:1481, 1990.
    """

    def __init__(self, dimensions: Sequence[Dimension], group: int = 1, fields: int = 8) -> None:
        super().__init__(dimensions, group)
        self._fields = float(argument("fields", fields, kind="integer", at_least=3))
        self._layout(self._groups, [one.states or fields for one in self.dimensions])
        self._room = min(self.size, self.active * NEAR**self._some)

    def spikes(self, vectors: Floats, ticks: int, rng: np.random.Generator | None = None) -> tuple[Ints, Ints, Ints]:
        """Spikes of some vectors, see `Fields.spikes`; phases of neurons are spread evenly."""
        n = len(vectors)
        most = n * self._room * (ticks - 1)
        when, ids, count = np.empty(most, np.int64), np.empty(most, np.int64), np.zeros(n + 1, np.int64)
        draws = _NONE if rng is None else rng.random((n, ticks, self._room))
        at = 0
        for k in range(n):
            cells, amounts = self.activity(vectors[k])
            at = _bell_spikes(cells, amounts, ticks - 1, draws[k : k + 1], at, when, ids)
            count[k + 1] = at
        return count, when[:at], ids[:at]

    def work(self, ticks: int, poisson: bool = False) -> Work:
        """Return the operations for one vector, see `Fields.work`.

        Each dimension of a group takes the place, two roundings and a limit behind the share. Each of up to five bells
        takes a difference, a factor, a square, a factor and an exp. A combination of bells takes a product and a stride
        a dimension, and a comparison with the least activity. The phase, two sums and two roundings give the regular
        spikes of a tick; a comparison gives drawn ones.
        """
        bells = [1 if one.states else min(NEAR, int(self._fields)) for one in self.dimensions]
        groups = [[bells[d] for d in group] for group in self._groups]
        macs = self._placing(4, 1) + sum(5 * n for group in groups for n in group if n > 1)
        combinations = sum(math.prod(group) for group in groups)
        macs += combinations * (2 * self._some + 1)
        macs += combinations * (1 + (ticks - 1)) if poisson else combinations * (2 + 5 * (ticks - 1))
        return on_numbers(macs, len(self.dimensions) + combinations)

    def activity(self, vector: Floats) -> tuple[Ints, Floats]:
        """The neurons that spike and how active each is, see `Fields.activity`."""
        cells, amounts = np.empty(self._room, np.int64), np.empty(self._room)
        bells, lowest = np.empty((self._some, NEAR)), np.empty((2, self._some), np.int64)
        parts = (self._member, self._stride, self._first)
        n = _bells(np.ascontiguousarray(vector), *parts, self._ends, self._fields, bells, lowest, cells, amounts)
        return cells[:n], amounts[:n]

    def cells(self, vector: Floats) -> Ints:
        """The most active neuron of each group, see `Fields.cells`."""
        cells, amounts = self.activity(vector)
        group = np.searchsorted(self._first, cells, side="right")
        order = np.lexsort((-amounts, group))
        most_active: Ints = cells[order[np.unique(group[order], return_index=True)[1]]]
        return most_active


FIELDS: Mapping[str, type[Fields]] = {"places": Places, "tiles": Tiles, "one_hot": OneHot, "population": Population}
"""The encoders of vectors by name."""

_NONE = np.empty((0, 0, 0))


@subkernel
def _share(x: float, ends: Floats, d: int) -> float:
    """Return the place of a number of dimension d between its bounds, from 0 to 1."""
    low, high = ends[LOW, d], ends[HIGH, d]
    if np.isfinite(low) and np.isfinite(high):
        share = (x - low) / (high - low) if high > low else 0.5
        return min(max(share, 0.0), 1.0)
    # Beyond a few deviations fields widen, so that values not reached so far have a place, too.
    return float(0.5 + 0.5 * np.tanh((x - ends[MIDDLE, d]) / (REACH * ends[SPREAD, d])))


@kernel
def _spikes(
    vectors: Floats,
    parts: Parts,
    ends: Floats,
    fields: float,
    last: int,
    draws: Floats,
    cell: Ints,
    count: Ints,
    when: Ints,
    ids: Ints,
) -> None:
    """Fill when and ids with the spikes of each vector, by tick, then id; draws are empty for regular ones."""
    member, stride, shift, first = parts
    at = 0
    for k in range(vectors.shape[0]):
        for g in range(member.shape[0]):
            place = first[g]
            for j in range(member.shape[1]):
                d = member[g, j]
                x = vectors[k, d]
                if ends[STATES, d] > 0.0:
                    inside = min(max(x - ends[LOW, d], 0.0), ends[STATES, d] - 1.0)
                else:
                    inside = _share(x, ends, d) * fields * (1.0 - 1e-12) + shift[g, j]
                place += stride[g, j] * np.int64(inside)
            cell[g] = place
        # Places of later grids have larger numbers, so they are in order already.
        for tick in range(1, last + 1):
            for g in range(member.shape[0]):
                if draws[k, tick, g] * PERIOD < 1.0 if draws.size else (tick - 1) % PERIOD == cell[g] % PERIOD:
                    when[at], ids[at] = tick, cell[g]
                    at += 1
        count[k + 1] = at


@kernel
def _bells(
    vector: Floats,
    member: Ints,
    stride: Ints,
    first: Ints,
    ends: Floats,
    fields: float,
    bells: Floats,
    lowest: Ints,
    cells: Ints,
    amounts: Floats,
) -> int:
    """Fill cells and amounts with the neurons that are active, and return how many these are."""
    n = 0
    for g in range(member.shape[0]):
        combinations = 1
        for j in range(member.shape[1]):  # the bells near the value, from `lowest[0]`, `lowest[1]` of them
            d = member[g, j]
            if ends[STATES, d] > 0.0:
                inside = min(max(vector[d] - ends[LOW, d], 0.0), ends[STATES, d] - 1.0)
                lowest[0, j], lowest[1, j] = np.int64(inside), 1
                bells[j, 0] = 1.0
            else:
                at = _share(vector[d], ends, d) * (fields - 2.0) + 0.5
                lowest[0, j] = np.int64(max(0.0, np.floor(at + 0.5) - NEAR // 2))
                lowest[1, j] = np.int64(min(float(NEAR), fields - lowest[0, j]))
                for i in range(lowest[1, j]):
                    bells[j, i] = np.exp(-0.5 * (WIDTH * (at - (lowest[0, j] + i))) ** 2)
            combinations *= lowest[1, j]
        for k in range(combinations):
            cell, amount, rest = first[g], 1.0, k
            for j in range(member.shape[1]):
                i = rest % lowest[1, j]
                rest //= lowest[1, j]
                cell += stride[g, j] * (lowest[0, j] + i)
                amount *= bells[j, i]
            if amount >= SILENT:
                cells[n], amounts[n] = cell, amount
                n += 1
    return n


@kernel
def _bell_spikes(cells: Ints, amounts: Floats, last: int, draws: Floats, at: int, when: Ints, ids: Ints) -> int:
    """Write the spikes of one vector into `when` and `ids` from entry `at`, by tick; return the end of the entries."""
    for tick in range(1, last + 1):
        for i in range(cells.size):
            amount = amounts[i] / PERIOD
            phase = (cells[i] * GOLDEN) % 1.0
            regular = np.floor(amount * tick + phase) > np.floor(amount * (tick - 1) + phase)
            if draws[0, tick, i] < amount if draws.size else regular:
                when[at], ids[at] = tick, cells[i]
                at += 1
    return at
