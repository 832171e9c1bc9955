"""From a program to the arrays of the compiled loop."""

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
from neuro_event.loop.arrivals import by_delay

WORD = t.BLOCK * t.GROUPED
"""Neurons of a group of blocks; populations begin at multiples of it."""


@dataclass(frozen=True, eq=False)
class PopulationPlace:
    """Where a population lies.

    Attributes:
        begin, end: its neurons among all.
        inside: internal place of each neuron, or None where it is the id; grids are kept with the maps innermost.
        outside: id at each internal place.
    """

    begin: int
    end: int
    inside: Ints | None
    outside: Ints

    def by_place(self, values: NDArray[Any]) -> NDArray[Any]:
        """One value per neuron, from ids to internal places."""
        return values if self.inside is None else values[self.outside]

    def by_id(self, values: NDArray[Any]) -> NDArray[Any]:
        """One value per neuron, from internal places to ids."""
        return values if self.inside is None else values[self.inside]

    def steps(self, shape: tuple[int, ...]) -> tuple[int, ...]:
        """How far apart inside those of a population of a shape lie that are next to each other along each axis."""
        steps = [math.prod(shape[axis + 1 :]) for axis in range(len(shape))]
        return tuple(steps) if self.inside is None else (1, *(shape[0] * step for step in steps[1:]))


def places(program: Program) -> list[PopulationPlace]:
    """Lay the populations side by side."""
    grids = {p.target: p.grid for p in program.projections if p.grid is not None}
    found, at = [], 0
    for index, population in enumerate(program.populations):
        outside = np.arange(population.size, dtype=np.int64)
        inside = None
        grid = grids.get(index)
        if grid is not None:
            outside = np.ascontiguousarray(outside.reshape(grid.maps, grid.rows * grid.columns).T).ravel()
            inside = np.empty_like(outside)
            inside[outside] = np.arange(population.size)
        found.append(PopulationPlace(at, at + population.size, inside, outside))
        at += -(-population.size // WORD) * WORD
    return found


def total(program: Program) -> int:
    """Neurons of all populations, with the gaps between them."""
    return max(WORD, sum(-(-p.size // WORD) * WORD for p in program.populations))


def computes(population: Population) -> bool:
    """Whether a population has constants and states: neurons, and generators with an `emit` of their own."""
    return population.kind in ("neuron", "generator")


def receptors(program: Program) -> int:
    """Rows of the input: as many as the neurons with the most receptors have, at least 2."""
    return max([2, *(p.model.receptors for p in program.populations if isinstance(p.model, Neuron))])


def width(program: Program) -> int:
    """Room that each of the program's models has for its parameters and for its constants."""
    return max([Model.width, *(p.model.width for p in program.populations if computes(p))])


def parameter_rows(population: Population, place: PopulationPlace) -> Floats:
    """Parameters of a population of neurons: one row, or one per neuron where they differ."""
    columns = [np.atleast_1d(values) for values in population.parameters.values()]
    n = max(c.size for c in columns)
    return np.stack([np.broadcast_to(place.by_place(c) if c.size > 1 else c, n) for c in columns], axis=1).astype(
        np.float64
    )


@dataclass(frozen=True, eq=False)
class ArrangedSynapses:
    """A projection in internal order.

    Attributes:
        layout: as in `tables`.
        row_ends, targets: of a CSR projection; empty otherwise.
        order: internal weight k is the program's weight order[k]; None where they are the same.
    """

    layout: int
    row_ends: Ints
    targets: NDArray[np.int32]
    order: Ints | None


_FEW_RUNS = 1 << 16
_NO_INTS = np.zeros(0, dtype=np.int64)
_NO_TARGETS = np.zeros(0, dtype=np.int32)


def own_delays(p: Projection) -> bool:
    """Whether the synapses of a projection differ in delay, or may do so later."""
    if p.synapse.delays:
        return True
    shortest, longest = p.delay_span
    return shortest < longest


def is_timed(p: Projection) -> bool:
    """Whether synapses are static and differ in delay."""
    return not p.synapse.learns and p.carries == "spikes" and p.grid is None and own_delays(p)


def in_runs(program: Program, p: Projection) -> bool:
    """Whether spikes are delivered at arrival though synapses differ in delay: these are static, and not too few."""
    if not is_timed(p):
        return False
    shortest, longest = p.delay_range(program.resolution)
    return program.populations[p.source].size * (longest - shortest + 1) <= max(p.size, _FEW_RUNS)


def learns_pairs(p: Projection) -> bool:
    """Whether spike pairs change each of its weights; shared kernels learn otherwise."""
    return p.synapse.learns == "pairs" and p.grid is None


def synapses(
    program: Program, index: int, where: list[PopulationPlace], joined: frozenset[int] = frozenset()
) -> ArrangedSynapses:
    """Arrange a projection for the kernels: CSR where it learns, has delays of its own, or its ends are permuted.

    Synapses lie by source, then target; where they are delivered in runs, by source, delay, target. Joined rows have an
    order of their own.
    """
    p = program.projections[index]
    source, target = where[p.source], where[p.target]
    permuted = source.inside is not None or target.inside is not None
    if p.layout == "grid":
        assert p.grid is not None
        k = np.arange(p.size, dtype=np.int64).reshape(p.grid.maps, -1)
        return ArrangedSynapses(t.GRID, _NO_INTS, _NO_TARGETS, np.ascontiguousarray(k.T).ravel())
    plain = not (permuted or own_delays(p) or learns_pairs(p))
    if plain and p.layout in ("dense", "one_to_one"):
        return ArrangedSynapses(t.DENSE if p.layout == "dense" else t.ONE_TO_ONE, _NO_INTS, _NO_TARGETS, None)
    if index in joined and p.layout == "csr" and not permuted:
        return ArrangedSynapses(t.CSR, p.row_ends, _NO_TARGETS, None)
    timed = in_runs(program, p) and index not in joined
    if p.layout == "csr" and not permuted and (not timed or by_delay(p.row_ends, p.targets, p.delay)):
        return ArrangedSynapses(t.CSR, p.row_ends, p.targets, None)
    pre, post = program.connections(index)
    pre = pre if source.inside is None else source.inside[pre]
    post = post if target.inside is None else target.inside[post]
    order = np.lexsort((post, p.delay, pre)) if timed else np.lexsort((post, pre)) if permuted else None
    if order is not None:
        pre, post = pre[order], post[order]
    n = program.populations[p.source].size
    row_ends = np.concatenate([[0], np.cumsum(np.bincount(pre, minlength=n))]).astype(np.int64)
    return ArrangedSynapses(t.CSR, row_ends, post.astype(np.int32), order)


def internal_weights(program: Program, index: int, order: Ints | None) -> NDArray[np.floating[Any]]:
    """The weights that a static delivery adds: what arrives of the program's, in internal order; 1 for a relay."""
    p = program.projections[index]
    target = program.populations[p.target].model
    if p.carries == "spikes" and isinstance(target, Neuron) and target.relay:
        return np.ones(1)
    _, own, _ = p.stored()
    own = p.arriving(own[order] if order is not None and own.size > 1 else own)
    if own.size == 1 and (p.grid is not None or p.synapse.learns in ("moves", "trials")):
        own = np.repeat(own, p.size)
    return own


def split_rows(row_ends: Ints, targets: NDArray[np.integer[Any]], edges: Ints) -> Ints:
    """Row ends cut at the threads' edges (local target ids): synapses of source s for thread k are rows[s T + k] on."""
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
    """The smallest power of two that is at least n."""
    return 1 << max(0, int(n - 1).bit_length())


def sign(weights: NDArray[np.floating[Any]]) -> int:
    """Whether all weights go to one receptor."""
    negative = sum(int(np.count_nonzero(weights[k : k + _PIECE] < 0.0)) for k in range(0, weights.size, _PIECE))
    if negative == 0:
        return t.POSITIVE
    return t.NEGATIVE if negative == weights.size else t.MIXED


_PIECE = 1 << 16
"""Weights that are looked at together, in the cache."""


def map_of_weights(a: EventArrays, projection: int, maps: int) -> Ints:
    """The map of the trials' output that each weight of a projection leads to, in internal order."""
    p, s = a.program.projections[projection], a.synapses[projection]
    if s.layout == t.GRID:
        return np.tile(np.arange(maps), p.size // maps)
    targets = a.places[p.target].outside // (a.program.populations[p.target].size // maps)
    return targets[s.targets] if s.layout == t.CSR else np.tile(targets, p.size // targets.size)


@dataclass(eq=False)
class EventArrays:
    """Everything the loop needs, by the names of `loop.Net`, and how a program's parts map to it.

    Without `eager` all synapses learn lazily: tests compare the two ways. `joined` are the projections in joined rows,
    `parted` whether these are still to be laid out.
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
    asked: list[tuple[Ints, int, Callable[[], Entry]]] = field(default_factory=list)
    parted: bool = True

    def ask(self, row: Ints, column: int, entry: Callable[[], Entry]) -> None:
        """Ask for the address of an entry in a row of a table, when all are known: they compile side by side."""
        self.asked.append((row, column, entry))


def edges_of(a: EventArrays, projection: int) -> Ints:
    """The edges of the threads among the targets of a projection."""
    target = a.program.projections[projection].target
    edges: Ints = a.net["edges"][target] * t.BLOCK - a.places[target].begin
    return edges


JOINED_ARRAYS = ("joined_runs", "joined_steps", "joined_weights", "joined_singles", "joined_bases")
JOINED_TABLES = ("joined", "joined_reach")
"""The arrays of joined rows, see `joined_rows`."""

LINE = 64
PAGE = 4096


def aligned_zeros(n: int, dtype: Any, line: int = 0) -> NDArray[Any]:
    """Zeros that begin at a cache line, which is counted within its page."""
    size = n * np.dtype(dtype).itemsize
    memory = np.zeros(size + PAGE, dtype=np.uint8)
    skip = (line * LINE - memory.ctypes.data) % PAGE
    return memory[skip : skip + size].view(dtype)


def aligned_table(rows: int, columns: int) -> Ints:
    """A table of zeros whose first row begins at a cache line."""
    return aligned_zeros(rows * columns, np.int64).reshape(rows, columns)


def zeros(arrays: Iterable[Declared], sizes: Mapping[str, int]) -> dict[str, Any]:
    """Make those of some declared arrays whose sizes are known, filled with 0."""
    made: dict[str, Any] = {}
    for each in arrays:
        shape: list[Any] = [
            int(word) if word.isdigit() else sizes.get(word, getattr(t, word, None)) for word in each.shape
        ]
        if None not in shape:
            n = math.prod(shape)
            flat = np.zeros(n, each.kind) if each.line is None else aligned_zeros(n, each.kind, each.line)
            made[each.name] = flat.reshape(shape)
    return made


def part_joined_rows(a: EventArrays) -> None:
    """Let there be no joined rows until they are laid out anew, as they must be before the next step."""
    a.parted = bool(a.joined)
    pops = a.net["pops"]
    pops[:, t.JOINED] = pops[:, t.JOINED_END] = pops[:, t.ARRIVALS]
    empty = [each for each in t.NET_ARRAYS if each.name in (*JOINED_ARRAYS, *JOINED_TABLES)]
    a.net |= zeros(empty, {"threads": a.net["edges"].shape[1] - 1, "populations": len(a.program.populations)})
