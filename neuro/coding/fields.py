"""Encoders of vectors: a neuron has a field, and spikes while the vector lies in the field.

Regular spikes are often learnt faster than random ones, because a readout also learns the noise of random spikes.
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
"""Largest number of neurons of an encoder."""
PERIOD = 5
"""Ticks between two spikes of a neuron in the middle of its field."""
REACH = 2.5
"""Distance from the middle of an unbounded dimension, in standard deviations, at which fields begin to widen."""
WIDTH = 1.5
"""Distance of two tuning curves in standard deviations, the beta of Bohte, La Poutre & Kok 2002."""
SILENT = 0.01
"""Smallest activity of a neuron that spikes."""
NEAR = 5
"""Largest number of tuning curves of a dimension that have at least the activity `SILENT` at the same value."""
LOW, HIGH, STATES, MIDDLE, SPREAD = range(5)
"""Rows of the array `ends` of a space, (5, dimensions) float64: lowest and highest value, number of states or 0, and
mean and standard deviation of dimensions without a bound."""
Parts: TypeAlias = tuple[Ints, Ints, Floats, Ints]
"""Arrays of g grids with s dimensions each: indices of the dimensions, strides of the neurons along each dimension, and
shifts of the grid as shares of a field, all (g, s); index of the first neuron, (g,). A plain tuple, because a kernel
is called for each vector, and reads a named tuple four times slower."""
GOLDEN = 0.6180339887498949
"""Neuron k has the phase k GOLDEN modulo 1, so the phases of any number of neurons are spread evenly."""


@dataclass(frozen=True, slots=True)
class Dimension:
    """A number of a vector.

    Attributes:
        name: name for messages.
        states: number of values, 0 for a continuous dimension.
        first: smallest value of a dimension with `states`.
        low, high: bounds of a continuous dimension; infinite without bounds.
        whole: True if a dimension without `states` has whole numbers only, e.g. a pixel of 8 bits.
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
        active: number of active neurons for a vector.
    """

    def __init__(self, dimensions: Sequence[Dimension], group: int) -> None:
        self.dimensions = list(dimensions)
        if not self.dimensions:
            raise ModelError("dimensions = []: expected at least one")
        self.size = self.active = 0
        self._group_size = min(argument("group", group, kind="integer", at_least=1), len(self.dimensions))
        if math.comb(len(self.dimensions), self._group_size) > MOST:
            raise self._too_many()
        self._groups = list(combinations(range(len(self.dimensions)), self._group_size))
        self._ends = np.ones((5, len(self.dimensions)))
        for d, dim in enumerate(self.dimensions):
            middle = (dim.low + dim.high) / 2
            middle = 0.0 if dim.states or not np.isfinite(middle) else middle
            self._ends[:SPREAD, d] = dim.first if dim.states else dim.low, dim.high, dim.states, middle

    @property
    def middle(self) -> Floats:
        """Mean of each dimension, (dimensions,), used for dimensions without bounds."""
        middle: Floats = self._ends[MIDDLE]
        return middle

    @property
    def spread(self) -> Floats:
        """Standard deviation of each dimension, (dimensions,), used for dimensions without bounds."""
        spread: Floats = self._ends[SPREAD]
        return spread

    def learn(self, vectors: Floats) -> None:
        """Set middle and spread of unbounded dimensions from at least two vectors, (vectors, dimensions)."""
        for d, dim in enumerate(self.dimensions):
            if not dim.bounded and len(vectors) > 1:
                self.middle[d] = vectors[:, d].mean()
                self.spread[d] = max(float(vectors[:, d].std()), 1e-9)

    def spikes(self, vectors: Floats, ticks: int, rng: np.random.Generator | None = None) -> tuple[Ints, Ints, Ints]:
        """Return the spikes of some vectors. Each vector is shown for a number of ticks to its own copy of the neurons.

        Args:
            vectors: (vectors, dimensions), finite.
            ticks: number of ticks per vector.
            rng: random generator of Poisson spikes, with probability activity / 5 in each tick; None for regular
                spikes, every 5 / activity ticks.

        Returns:
            (offsets, ticks, ids) as for `neuro.Stepper.step`: vector k has the spikes offsets[k] : offsets[k + 1], by
            tick, then id. No neuron spikes in the last tick.
        """
        raise NotImplementedError

    def activity(self, vector: Floats) -> tuple[Ints, Floats]:
        """Return the spiking neurons for a vector, (n,), and their activities in (0, 1], (n,)."""
        raise NotImplementedError

    def cells(self, vector: Floats) -> Ints:
        """Return the most active neuron of each grid or group for a vector, (active,)."""
        raise NotImplementedError

    def work(self, ticks: int, poisson: bool = False) -> Work:
        """Return the operations of `spikes` for one vector.

        Args:
            ticks: number of ticks of the vector.
            poisson: whether spikes are drawn at random.
        """
        raise NotImplementedError

    def _position_macs(self, continuous: int, states: int) -> float:
        """Return the number of operations that find the position of a vector along the dimensions of all groups.

        The position of a value between its bounds takes at most 5 operations, see `_share`: a difference, two limits,
        and a division, or a factor and a tanh in place of the division.

        Args:
            continuous: further operations for a continuous dimension.
            states: further operations for a dimension with states, after two limits and a difference.
        """
        return sum(3 + states if self.dimensions[d].states else 5 + continuous for d in self._member.ravel().tolist())

    def _layout(self, members: Sequence[Sequence[int]], cells: Sequence[int]) -> None:
        """Number the neurons of each grid or group, from the number of neurons along each dimension."""
        strides, first_neurons = [], []
        for dims in members:
            steps = np.cumprod([1, *(cells[d] for d in dims)], dtype=np.float64)
            strides.append(steps[:-1])
            first_neurons.append(self.size)
            if self.size + steps[-1] > MOST:
                raise self._too_many()
            self.size += int(steps[-1])
        self.active = len(first_neurons)
        self._member = np.array(members, dtype=np.int64)
        self._stride, self._first = np.array(strides, dtype=np.int64), np.array(first_neurons, dtype=np.int64)

    def _too_many(self) -> ModelError:
        return ModelError(
            f"places of {len(self.dimensions)} dimensions in groups of {self._group_size}: expected at most {MOST}",
            hint="lower group, fields or active, or use a wrapper that leaves out dimensions or makes features",
        )


class _Grids(Fields):
    """Base of the encoders by grids. Each grid has one active neuron."""

    _shift_growth: ClassVar[int] = 0
    """Dimension k of a group is shifted by 1 + _shift_growth * k times the shift of dimension 0."""

    def __init__(self, dimensions: Sequence[Dimension], group: int, fields: int, active: int) -> None:
        super().__init__(dimensions, group)
        self._fields = float(argument("fields", fields, kind="integer", at_least=2))
        grids = max(1, round(argument("active", active, kind="integer", at_least=1) / len(self._groups)))
        # A shifted grid has one more field along a dimension, since the fields at both ends reach beyond the bounds.
        cells = [dimension.states or fields + 1 for dimension in self.dimensions]
        members: list[tuple[int, ...]] = []
        shift = []
        for dims in self._groups:
            # Grids of dimensions with few values would all be the same.
            count = 1 if all(self.dimensions[d].states for d in dims) else grids
            if len(members) + count > MOST:
                raise self._too_many()
            for grid in range(count):
                members.append(dims)
                shift.append([0.0 if self.dimensions[d].states else (grid * (1 + self._shift_growth * k) / grids) % 1.0
                              for k, d in enumerate(dims)])  # fmt: skip
        self._layout(members, cells)
        self._shift = np.array(shift, dtype=np.float64)

    def spikes(self, vectors: Floats, ticks: int, rng: np.random.Generator | None = None) -> tuple[Ints, Ints, Ints]:
        """Return the spikes of some vectors, see `Fields.spikes`. The phase of a neuron is its index modulo 5."""
        n, vectors = len(vectors), np.ascontiguousarray(vectors)
        limit = n * self.active * len(range(0, ticks - 1, PERIOD if rng is None else 1))
        spike_ticks, ids, count = np.empty(limit, np.int64), np.empty(limit, np.int64), np.zeros(n + 1, np.int64)
        cells = np.empty(self.active, np.int64)
        draws = _NONE if rng is None else rng.random((n, ticks, self.active))
        parts = (self._member, self._stride, self._shift, self._first)
        _spikes(vectors, parts, self._ends, self._fields, ticks - 1, draws, cells, count, spike_ticks, ids)
        total = count[-1]
        return count, spike_ticks[:total], ids[:total]

    def work(self, ticks: int, poisson: bool = False) -> Work:
        """Return the operations for one vector, see `Fields.work`.

        Each dimension of a grid takes the position of the vector, a shift, a rounding and a stride. Each tick of a grid
        takes a comparison, and with `poisson` also a product with the draw.
        """
        macs = self._position_macs(3, 2) + self.active * (ticks - 1) * (2 if poisson else 1)
        return on_numbers(macs, len(self.dimensions) + self.active)

    def activity(self, vector: Floats) -> tuple[Ints, Floats]:
        """Return the active neurons, see `Fields.activity`. All have activity 1."""
        return self.cells(vector), np.ones(self.active)

    def cells(self, vector: Floats) -> Ints:
        """Return the active neuron of each grid, see `Fields.cells`."""
        _, _ticks, ids = self.spikes(vector[None], PERIOD + 1)
        return np.sort(ids)


class Places(_Grids):
    """Place cells: several shifted grids for each group of dimensions. In each grid the vector lies in a single field.

    Dimensions are shifted by different odd shares of a field, so that no grids lie along a diagonal of each other.

    Args:
        dimensions: dimensions of the vectors.
        group: number of dimensions of a grid. There are grids for each combination of `group` dimensions.
        fields: number of fields of a grid along a continuous dimension, at least 2. A dimension with states has a field
            for each state.
        active: approximate number of active neurons and of grids. Each group has at least one grid.

    Raises:
        ModelError: there is no dimension, a number is out of bounds, or there would be more than 2^20 neurons.

    Source: Albus, J. Dyn. Syst. Meas. Control 97:220, 1975 (CMAC); displacement: Miller & Glanz 1996, after Parks &
        Militzer 1991; place cells as input to an actor and a critic: Foster, Morris & Dayan, Hippocampus 10:1, 2000.
    """

    _shift_growth: ClassVar[int] = 2

    def __init__(self, dimensions: Sequence[Dimension], group: int = 2, fields: int = 6, active: int = 24) -> None:
        super().__init__(dimensions, group, fields, active)


class Tiles(_Grids):
    """Tile coding: like `Places`, but with equal shifts along all dimensions, and by default with grids of all of them.

    Args:
        dimensions: dimensions of the vectors.
        group: number of dimensions of a grid; None for all.
        fields: see `Places`.
        active: see `Places`.

    Raises:
        ModelError: see `Places`.

    Source: Albus, J. Dyn. Syst. Meas. Control 97:220, 1975; Sutton & Barto, Reinforcement Learning, 2nd ed., section
        9.5.4.
    """

    def __init__(
        self, dimensions: Sequence[Dimension], group: int | None = None, fields: int = 6, active: int = 8
    ) -> None:
        super().__init__(dimensions, max(1, len(dimensions)) if group is None else group, fields, active)


class OneHot(_Grids):
    """A neuron for each value of each dimension. Each dimension has one active neuron.

    Args:
        dimensions: dimensions of the vectors, each with `states`, or with bounds and `whole`.

    Raises:
        ModelError: a dimension is continuous, there is no dimension, or there would be more than 2^20 neurons.

    Source: the tabular case, Sutton & Barto, Reinforcement Learning, 2nd ed., section 9.4.
    """

    def __init__(self, dimensions: Sequence[Dimension]) -> None:
        super().__init__([_with_states(dimension) for dimension in dimensions], 1, 2, 1)


def _with_states(number: Dimension) -> Dimension:
    """Return a dimension with a state for each value."""
    if number.states:
        return number
    if not (number.whole and number.bounded):
        raise ModelError(
            f"one_hot: {number.name} is continuous: expected a number of values, as of Discrete or a Box of integers",
            hint="places, tiles and population take continuous dimensions",
        )
    return replace(number, states=int(number.high - number.low) + 1, first=int(number.low))


class Population(Fields):
    """Tuning curves: n bells along each dimension. The activity of a neuron is the product of a bell of each dimension.

    A neuron is tuned to a group of dimensions. For a value at the share s of the range between its bounds, bell i is
    exp(-(1.5 (s (n - 2) - i + 1/2))^2 / 2), i from 0, as in `population`. For a dimension with states the bell is 1
    for the present state and 0 otherwise.

    Args:
        dimensions: dimensions of the vectors.
        group: number of dimensions to which a neuron is tuned; 1 gives a separate population for each dimension.
        fields: number n of bells along a continuous dimension, at least 3.

    Raises:
        ModelError: there is no dimension, a number is out of bounds, or there would be more than 2^20 neurons.

    Source: Bohte, La Poutre & Kok, IEEE Trans. Neural Networks 13, 2002; products of bells: Poggio & Girosi, Proc.
        IEEE 78:1481, 1990.
    """

    def __init__(self, dimensions: Sequence[Dimension], group: int = 1, fields: int = 8) -> None:
        super().__init__(dimensions, group)
        self._fields = float(argument("fields", fields, kind="integer", at_least=3))
        self._layout(self._groups, [dimension.states or fields for dimension in self.dimensions])
        self._room = min(self.size, self.active * NEAR**self._group_size)

    def spikes(self, vectors: Floats, ticks: int, rng: np.random.Generator | None = None) -> tuple[Ints, Ints, Ints]:
        """Return the spikes of some vectors, see `Fields.spikes`. Phases of neurons are spread evenly."""
        n = len(vectors)
        limit = n * self._room * (ticks - 1)
        spike_ticks, ids, count = np.empty(limit, np.int64), np.empty(limit, np.int64), np.zeros(n + 1, np.int64)
        draws = _NONE if rng is None else rng.random((n, ticks, self._room))
        end = 0
        for k in range(n):
            cells, amounts = self.activity(vectors[k])
            end = _bell_spikes(cells, amounts, ticks - 1, draws[k : k + 1], end, spike_ticks, ids)
            count[k + 1] = end
        return count, spike_ticks[:end], ids[:end]

    def work(self, ticks: int, poisson: bool = False) -> Work:
        """Return the operations for one vector, see `Fields.work`.

        Each dimension of a group takes the position of the vector, the middle bell, two roundings and a limit. Each of
        up to five bells takes a difference, a factor, a square, a factor and an exp. A combination of bells takes a
        product and a stride for each dimension, and a comparison with the least activity. A tick of regular spikes
        takes the phase, two sums and two roundings. A tick of random spikes takes a comparison.
        """
        bells = [1 if dimension.states else min(NEAR, int(self._fields)) for dimension in self.dimensions]
        groups = [[bells[d] for d in group] for group in self._groups]
        macs = self._position_macs(4, 1) + sum(5 * n for group in groups for n in group if n > 1)
        combinations = sum(math.prod(group) for group in groups)
        macs += combinations * (2 * self._group_size + 1)
        macs += combinations * (1 + (ticks - 1)) if poisson else combinations * (2 + 5 * (ticks - 1))
        return on_numbers(macs, len(self.dimensions) + combinations)

    def activity(self, vector: Floats) -> tuple[Ints, Floats]:
        """Return the neurons that spike and their activities, see `Fields.activity`."""
        cells, amounts = np.empty(self._room, np.int64), np.empty(self._room)
        bells, lowest = np.empty((self._group_size, NEAR)), np.empty((2, self._group_size), np.int64)
        parts = (self._member, self._stride, self._first)
        n = _bells(np.ascontiguousarray(vector), *parts, self._ends, self._fields, bells, lowest, cells, amounts)
        return cells[:n], amounts[:n]

    def cells(self, vector: Floats) -> Ints:
        """Return the most active neuron of each group, see `Fields.cells`."""
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
    """Return the position of a value of dimension d between its bounds, from 0 to 1."""
    low, high = ends[LOW, d], ends[HIGH, d]
    if np.isfinite(low) and np.isfinite(high):
        share = (x - low) / (high - low) if high > low else 0.5
        return min(max(share, 0.0), 1.0)
    # Beyond a few deviations fields widen, so that values outside the range of `learn` have a position, too.
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
    spike_ticks: Ints,
    ids: Ints,
) -> None:
    """Write the spikes of each vector to `spike_ticks` and `ids`, by tick, then id. Empty `draws`: regular spikes."""
    member, stride, shift, first = parts
    end = 0
    for k in range(vectors.shape[0]):
        for g in range(member.shape[0]):
            neuron = first[g]
            for j in range(member.shape[1]):
                d = member[g, j]
                x = vectors[k, d]
                if ends[STATES, d] > 0.0:
                    position = min(max(x - ends[LOW, d], 0.0), ends[STATES, d] - 1.0)
                else:
                    position = _share(x, ends, d) * fields * (1.0 - 1e-12) + shift[g, j]
                neuron += stride[g, j] * np.int64(position)
            cell[g] = neuron
        # Cells of later grids have larger indices, so the cells are sorted.
        for tick in range(1, last + 1):
            for g in range(member.shape[0]):
                if draws[k, tick, g] * PERIOD < 1.0 if draws.size else (tick - 1) % PERIOD == cell[g] % PERIOD:
                    spike_ticks[end], ids[end] = tick, cell[g]
                    end += 1
        count[k + 1] = end


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
    """Write the active neurons and the activities to `cells` and `amounts`, and return the number of neurons."""
    n = 0
    for g in range(member.shape[0]):
        combinations = 1
        for j in range(member.shape[1]):  # the bells near the value: lowest[1, j] bells from lowest[0, j] on
            d = member[g, j]
            if ends[STATES, d] > 0.0:
                position = min(max(vector[d] - ends[LOW, d], 0.0), ends[STATES, d] - 1.0)
                lowest[0, j], lowest[1, j] = np.int64(position), 1
                bells[j, 0] = 1.0
            else:
                position = _share(vector[d], ends, d) * (fields - 2.0) + 0.5
                lowest[0, j] = np.int64(max(0.0, np.floor(position + 0.5) - NEAR // 2))
                lowest[1, j] = np.int64(min(float(NEAR), fields - lowest[0, j]))
                for i in range(lowest[1, j]):
                    bells[j, i] = np.exp(-0.5 * (WIDTH * (position - (lowest[0, j] + i))) ** 2)
            combinations *= lowest[1, j]
        for k in range(combinations):
            cell, amount, remainder = first[g], 1.0, k
            for j in range(member.shape[1]):
                i = remainder % lowest[1, j]
                remainder //= lowest[1, j]
                cell += stride[g, j] * (lowest[0, j] + i)
                amount *= bells[j, i]
            if amount >= SILENT:
                cells[n], amounts[n] = cell, amount
                n += 1
    return n


@kernel
def _bell_spikes(cells: Ints, amounts: Floats, last: int, draws: Floats, end: int, spike_ticks: Ints, ids: Ints) -> int:
    """Write the spikes of one vector to `spike_ticks` and `ids` from entry `end`, by tick. Return the new end."""
    for tick in range(1, last + 1):
        for i in range(cells.size):
            amount = amounts[i] / PERIOD
            phase = (cells[i] * GOLDEN) % 1.0
            regular = np.floor(amount * tick + phase) > np.floor(amount * (tick - 1) + phase)
            if draws[0, tick, i] < amount if draws.size else regular:
                spike_ticks[end], ids[end] = tick, cells[i]
                end += 1
    return end
