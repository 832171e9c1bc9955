"""The order of populations, synapses and weights in the arrays of the compiled loop, and the memory of these arrays."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.kernels.address import Declared, Entry
from neuro.model.neurons import Model, Neuron
from neuro.program.program import Floats, Ints, Population, Program, Projection
from neuro_event.loop import tables as t

WORD = t.BLOCK * t.GROUPED
"""Number of neurons in a group of blocks. Each population begins at a multiple of `WORD`."""


@dataclass(frozen=True, eq=False)
class PopulationPlace:
    """The neurons of a population in the arrays of all neurons.

    Attributes:
        begin: place of the first neuron among the neurons of all populations.
        end: place after the last neuron.
        inside: internal place of each id, (neurons,), or None if the places are the ids. Grids are stored with the maps
            innermost.
        outside: id at each internal place, (neurons,).

    Example: a grid of 2 maps of 3 places has the ids 0 1 2 (map 0) and 3 4 5 (map 1). Then `outside` is 0 3 1 4 2 5 and
    `inside` is 0 2 4 1 3 5.
    """

    begin: int
    end: int
    inside: Ints | None
    outside: Ints

    def by_place(self, values: NDArray[Any]) -> NDArray[Any]:
        """Reorder one value per neuron from ids to internal places."""
        return values if self.inside is None else values[self.outside]

    def by_id(self, values: NDArray[Any]) -> NDArray[Any]:
        """Reorder one value per neuron from internal places to ids."""
        return values if self.inside is None else values[self.inside]

    def steps(self, shape: tuple[int, ...]) -> tuple[int, ...]:
        """Return the distance in places between neighbours along each axis of a population of this shape."""
        steps = [math.prod(shape[axis + 1 :]) for axis in range(len(shape))]
        return tuple(steps) if self.inside is None else (1, *(shape[0] * step for step in steps[1:]))


def places(program: Program) -> list[PopulationPlace]:
    """Return the places of the populations, which follow each other."""
    grids = {p.target: p.grid for p in program.projections if p.grid is not None}
    all_places, at = [], 0
    for index, population in enumerate(program.populations):
        outside = np.arange(population.size, dtype=np.int64)
        inside = None
        grid = grids.get(index)
        if grid is not None:
            outside = np.ascontiguousarray(outside.reshape(grid.maps, grid.rows * grid.columns).T).ravel()
            inside = np.empty_like(outside)
            inside[outside] = np.arange(population.size)
        all_places.append(PopulationPlace(at, at + population.size, inside, outside))
        at += -(-population.size // WORD) * WORD
    return all_places


def neuron_places(program: Program) -> int:
    """Return the number of neurons of all populations, with the gaps between them."""
    return max(WORD, sum(-(-p.size // WORD) * WORD for p in program.populations))


def has_states(population: Population) -> bool:
    """Return whether a population has constants and states, as neurons and generators with an own `emit` have."""
    return population.kind in ("neuron", "generator")


def input_rows(program: Program) -> int:
    """Return the number of rows of the input, which is the largest number of receptors of a model, at least 2."""
    return max([2, *(p.model.receptors for p in program.populations if isinstance(p.model, Neuron))])


def constants_width(program: Program) -> int:
    """Return the width of a row of parameters or constants, which is the largest width of a model of the program."""
    return max([Model.width, *(p.model.width for p in program.populations if has_states(p))])


def parameter_rows(population: Population, place: PopulationPlace) -> Floats:
    """Return the parameters of a population: a single row, or a row per neuron if parameters differ."""
    columns = [np.atleast_1d(values) for values in population.parameters.values()]
    n = max(c.size for c in columns)
    return np.stack([np.broadcast_to(place.by_place(c) if c.size > 1 else c, n) for c in columns], axis=1).astype(
        np.float64
    )


@dataclass(frozen=True, eq=False)
class ArrangedSynapses:
    """A projection in internal order.

    Attributes:
        layout: ONE_TO_ONE, DENSE, CSR or GRID of `tables`.
        row_ends: ends of the rows of a CSR projection, (sources + 1,), else empty.
        targets: targets of a CSR projection, (synapses,), else empty.
        order: internal weight k is the weight order[k] of the program; None if both orders are equal.
    """

    layout: int
    row_ends: Ints
    targets: NDArray[np.int32]
    order: Ints | None


_FEW_RUNS = 1 << 16
"""Number of runs of a joined row up to which most of them may be empty."""

_NO_INTS = np.zeros(0, dtype=np.int64)
_NO_TARGETS = np.zeros(0, dtype=np.int32)


def has_own_delays(p: Projection) -> bool:
    """Return whether the synapses of a projection differ in delay, or may do so later."""
    if p.synapse.delays:
        return True
    shortest, longest = p.delay_span
    return shortest < longest


def is_timed(p: Projection) -> bool:
    """Return whether the synapses of a projection are static and differ in delay."""
    return not p.synapse.learns and p.carries == "spikes" and p.grid is None and has_own_delays(p)


def in_runs(program: Program, p: Projection) -> bool:
    """Return whether a projection with different delays is worth a joined row of its own.

    A row of more than `_FEW_RUNS` runs (sources x delays) must have at least as many synapses as runs.
    """
    if not is_timed(p):
        return False
    shortest, longest = p.delay_range(program.resolution)
    return program.populations[p.source].size * (longest - shortest + 1) <= max(p.size, _FEW_RUNS)


def learns_from_pairs(p: Projection) -> bool:
    """Return whether spike pairs change each weight of a projection.

    Grids are excluded, because their kernels learn in `shared_kernels`.
    """
    return p.synapse.learns == "pairs" and p.grid is None


def arrange(
    program: Program, index: int, where: list[PopulationPlace], joined: frozenset[int] = frozenset()
) -> ArrangedSynapses:
    """Arrange a projection for the kernels: as CSR if it learns, has several delays, or has a permuted population.

    Synapses are sorted by source, then target. Joined rows have their own order.
    """
    part = program.projections[index]
    source, target = where[part.source], where[part.target]
    permuted = source.inside is not None or target.inside is not None
    if part.layout == "grid":
        assert part.grid is not None
        k = np.arange(part.size, dtype=np.int64).reshape(part.grid.maps, -1)
        return ArrangedSynapses(t.GRID, _NO_INTS, _NO_TARGETS, np.ascontiguousarray(k.T).ravel())
    plain = not (permuted or has_own_delays(part) or learns_from_pairs(part))
    if plain and part.layout in ("dense", "one_to_one"):
        return ArrangedSynapses(t.DENSE if part.layout == "dense" else t.ONE_TO_ONE, _NO_INTS, _NO_TARGETS, None)
    if index in joined and part.layout == "csr" and not permuted:
        return ArrangedSynapses(t.CSR, part.row_ends, _NO_TARGETS, None)
    if part.layout == "csr" and not permuted:
        return ArrangedSynapses(t.CSR, part.row_ends, part.targets, None)
    pre, post = program.connections(index)
    pre = pre if source.inside is None else source.inside[pre]
    post = post if target.inside is None else target.inside[post]
    order = np.lexsort((post, pre)) if permuted else None
    if order is not None:
        pre, post = pre[order], post[order]
    n = program.populations[part.source].size
    row_ends = np.concatenate([[0], np.cumsum(np.bincount(pre, minlength=n))]).astype(np.int64)
    return ArrangedSynapses(t.CSR, row_ends, post.astype(np.int32), order)


def internal_weights(program: Program, index: int, order: Ints | None) -> NDArray[np.floating[Any]]:
    """Return the weights that a static delivery adds, in internal order.

    The sign of a weight is negated where the receptor asks for it. A spike that arrives at a relay adds 1.
    """
    p = program.projections[index]
    target = program.populations[p.target].model
    if p.carries == "spikes" and isinstance(target, Neuron) and target.relay:
        return np.ones(1)
    _, weights, _ = p.stored()
    weights = p.arriving(weights[order] if order is not None and weights.size > 1 else weights)
    if weights.size == 1 and (p.grid is not None or p.synapse.learns in ("moves", "trials")):
        weights = np.repeat(weights, p.size)
    return weights


def split_rows(row_ends: Ints, targets: NDArray[np.integer[Any]], edges: Ints) -> Ints:
    """Return the ends of the rows after each row was divided among the threads.

    Args:
        row_ends: ends of the rows, (sources + 1,).
        targets: targets of all synapses, sorted within each row, (synapses,).
        edges: first target of each thread and the end, (threads + 1,).

    Returns:
        An array in which the synapses of source s for thread k begin at entry s * threads + k. Example: row 0 has the
        targets 1 5, row 1 has 2 3 7, and the edges are 0 4 8. The result is 0 1 2 4 5.
    """
    threads = edges.size - 1
    if threads == 1:
        return row_ends
    rows = np.empty((row_ends.size - 1) * threads + 1, dtype=np.int64)
    rows[-1] = row_ends[-1]
    for k in range(threads):
        below = np.concatenate([[0], np.cumsum(targets < edges[k], dtype=np.int64)]) if k else np.zeros(1, np.int64)
        count = below[row_ends[1:]] - below[row_ends[:-1]] if k else 0
        rows[k:-1:threads] = row_ends[:-1] + count
    return rows


def power_of_two(n: int) -> int:
    """Return the smallest power of two that is at least n."""
    return 1 << max(0, int(n - 1).bit_length())


def sign(weights: NDArray[np.floating[Any]]) -> int:
    """Return POSITIVE, NEGATIVE or MIXED of `tables` for some weights, since their sign may choose the receptor."""
    negative = sum(int(np.count_nonzero(weights[k : k + _PIECE] < 0.0)) for k in range(0, weights.size, _PIECE))
    if negative == 0:
        return t.POSITIVE
    return t.NEGATIVE if negative == weights.size else t.MIXED


_PIECE = 1 << 16
"""Number of weights whose sign is tested at a time, few enough for the cache."""


def map_of_weights(arrays: EventArrays, projection: int, maps: int) -> Ints:
    """Return the map in which the target of each weight lies, in internal order, (weights,).

    The projection leads to the output of the trials.
    """
    p, s = arrays.program.projections[projection], arrays.synapses[projection]
    if s.layout == t.GRID:
        return np.tile(np.arange(maps), p.size // maps)
    targets = arrays.places[p.target].outside // (arrays.program.populations[p.target].size // maps)
    return targets[s.targets] if s.layout == t.CSR else np.tile(targets, p.size // targets.size)


@dataclass(eq=False)
class EventArrays:
    """All arrays of the loop, by the names in `tables`, and the place of each part of the program in them.

    Attributes:
        program: the program.
        places: the place of each population.
        synapses: each projection in internal order.
        plastic_of: row of a projection in the table of plastic projections, by the index of the projection.
        net: the arrays of `tables.NET`, by name.
        plastic: the arrays of `tables.PLASTIC`, by name.
        longest_slice: number of steps of a slice. A spike that is emitted in a slice arrives after the slice.
        reach: steps for which the spike log keeps spikes.
        eager: whether synapses may learn eagerly. If false, all learn lazily; tests compare the two.
        joined: indices of the projections in joined rows.
        moves_of: row in the table of projections that learn by moves, by the index of the projection.
        shared_of: row in the table of grids whose kernels learn, by the index of the projection.
        requests: pending requests for addresses of compiled functions, as (row of a table, column, function).
        rows_outdated: whether the joined rows must be laid out before the next step.
    """

    program: Program
    places: list[PopulationPlace]
    synapses: list[ArrangedSynapses]
    plastic_of: dict[int, int]
    net: dict[str, Any]
    plastic: dict[str, NDArray[Any]]
    longest_slice: int
    reach: int
    eager: bool
    joined: frozenset[int]
    moves_of: dict[int, int] = field(default_factory=dict)
    shared_of: dict[int, int] = field(default_factory=dict)
    requests: list[tuple[Ints, int, Callable[[], Entry]]] = field(default_factory=list)
    rows_outdated: bool = True

    def request(self, row: Ints, column: int, entry: Callable[[], Entry]) -> None:
        """Request the address of a compiled function for a row of a table. All requests are compiled together later."""
        self.requests.append((row, column, entry))


def edges_of(arrays: EventArrays, projection: int) -> Ints:
    """Return the first target of each thread among the targets of a projection, and the end, (threads + 1,)."""
    target = arrays.program.projections[projection].target
    edges: Ints = arrays.net["edges"][target] * t.BLOCK - arrays.places[target].begin
    return edges


JOINED_ARRAYS = ("joined_runs", "joined_steps", "joined_weights", "joined_singles", "joined_bases")
JOINED_TABLES = ("joined", "joined_reach")
"""Names of the arrays of joined rows, see `joined_rows`."""

LINE = 64
"""Size of a cache line in bytes."""

PAGE = 4096
"""Size of a page of memory in bytes."""


def aligned_zeros(n: int, dtype: Any, line: int = 0) -> NDArray[Any]:
    """Return n zeros, whose memory begins at cache line `line` of a page."""
    size = n * np.dtype(dtype).itemsize
    memory = np.zeros(size + PAGE, dtype=np.uint8)
    skip = (line * LINE - memory.ctypes.data) % PAGE
    return memory[skip : skip + size].view(dtype)


def aligned_table(rows: int, columns: int) -> Ints:
    """Return a table of zeros whose first row begins at a cache line."""
    return aligned_zeros(rows * columns, np.int64).reshape(rows, columns)


def zeros(arrays: Iterable[Declared], sizes: Mapping[str, int]) -> dict[str, Any]:
    """Return those declared arrays whose sizes are all known, filled with 0, by name."""
    new_arrays: dict[str, Any] = {}
    for array in arrays:
        shape: list[Any] = [
            int(word) if word.isdigit() else sizes.get(word, getattr(t, word, None)) for word in array.shape
        ]
        if None not in shape:
            n = math.prod(shape)
            flat = np.zeros(n, array.kind) if array.line is None else aligned_zeros(n, array.kind, array.line)
            new_arrays[array.name] = flat.reshape(shape)
    return new_arrays


def clear_joined_rows(arrays: EventArrays) -> None:
    """Remove the joined rows. The next run lays out new ones before the first step."""
    arrays.rows_outdated = bool(arrays.joined)
    pops = arrays.net["pops"]
    pops[:, t.JOINED] = pops[:, t.JOINED_END] = pops[:, t.ARRIVALS]
    arrays.net["projections"][:, t.JOINED_ROW] = t.NONE
    empty = [array for array in t.NET_ARRAYS if array.name in (*JOINED_ARRAYS, *JOINED_TABLES)]
    arrays.net |= zeros(
        empty, {"threads": arrays.net["edges"].shape[1] - 1, "populations": len(arrays.program.populations)}
    )
