"""Which neurons share a core: populations cut into pieces that a core's limits allow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.chips.arithmetics import placed_as
from neuro.chips.description import Chip
from neuro.chips.placing import fill
from neuro.chips.placing.incoming import Incoming
from neuro.chips.placing.memory import core_bytes
from neuro.chips.placing.mesh import LARGEST
from neuro.chips.placing.packing import index_bits, memory_limit
from neuro.program.program import Ints, Program

Part = tuple[int, int, int]
"""A population and its neurons first <= i < last."""

_NO_LIMIT = 1 << 62

LISTED = LARGEST
"""Most cores of which all pairs of a source and a core are listed, where routers do not copy spikes: those of more
cores, which are laid out as they come, are only counted.
"""


@dataclass(frozen=True, slots=True, eq=False)
class Split:
    """Cores without a place yet, and what reaches them.

    Attributes:
        cores: what each core holds, as runs of neighbouring ids.
        core_of: the core of every neuron, numbered through as in `Incoming`; -1 for generators.
        line, core, synapses: how many synapses a line has onto a core, one entry for each such pair.
        sent: whether an entry is the first of its source neuron on that core: then a spike is sent for it.
        listed: whether the entries are there; of more than `LISTED` cores they are only counted.
        pieces: core, and first and last place in `queue`, of what each core takes of a population.
        queue: all neurons in the order in which they were taken.
        sends: destination cores of every neuron.
        neurons, memory, axons_in, axons_out: of every core; memory in bytes.
    """

    cores: tuple[tuple[Part, ...], ...]
    core_of: Ints
    line: NDArray[np.int32]
    core: NDArray[np.int32]
    synapses: NDArray[np.int32]
    sent: NDArray[np.bool_]
    sends: Ints
    neurons: Ints
    memory: Ints
    axons_in: Ints
    axons_out: Ints
    listed: bool
    pieces: tuple[Ints, Ints, Ints]
    queue: Ints

    def taken(self, order: Ints) -> Split:
        """The same cores numbered anew: core i is what core order[i] was."""
        rank = np.argsort(order)
        core, first, last = self.pieces
        moved = rank[core] if len(rank) else core
        by_core = np.argsort(moved, kind="stable")
        return replace(
            self,
            cores=tuple(self.cores[i] for i in order),
            core_of=np.where(self.core_of >= 0, rank[self.core_of], -1) if len(rank) else self.core_of,
            core=rank[self.core].astype(np.int32),
            neurons=self.neurons[order],
            memory=self.memory[order],
            axons_in=self.axons_in[order],
            axons_out=self.axons_out[order],
            pieces=(moved[by_core], first[by_core], last[by_core]),
        )


def split(
    program: Program,
    chip: Chip,
    into: Incoming,
    order: Sequence[int],
    neurons_per_core: int | None = None,
    by_place: bool = False,
) -> Split:
    """Fill cores one after the other.

    A core takes neurons of a population until one more would exceed a limit. How many axons leave a core depends on
    how the targets are split: where too many do, all is filled again with those counts. A neuron that fits on no
    core has one of its own.

    Args:
        program: tells the populations.
        chip: has the limits.
        into: all synapses.
        order: of the populations.
        neurons_per_core: at most so many, beside the chip's own limit.
        by_place: whether neurons at one place of a grid are taken together, since they share their sources; otherwise
            all are taken in order of id.
    """
    queue = _queue(program, into, by_place)
    sends = np.zeros(into.start[-1], dtype=np.int64)
    limit = chip.limit("axons_out_per_core")
    while True:
        room = _Room(chip, into, neurons_per_core, sends, queue)
        found = _reached(_fill(program, chip, room, order), chip, into, queue)
        over = (found.neurons > 1) & (found.axons_out > (_NO_LIMIT if limit is None else limit))
        if not over.any():
            return found
        sends = np.maximum(sends, found.sends)


def _queue(program: Program, into: Incoming, by_place: bool) -> Ints:
    """All neurons in the order in which they are taken, population by population."""
    queue = np.arange(into.start[-1])
    for part in program.projections if by_place else ():
        if part.grid is not None:
            own = queue[into.start[part.target] : into.start[part.target + 1]]
            own[:] = into.start[part.target] + np.arange(own.size).reshape(part.grid.maps, -1).T.reshape(-1)
    return queue


class _Room:
    """A core that is being filled."""

    def __init__(self, chip: Chip, into: Incoming, neurons_per_core: int | None, sends: Ints, queue: Ints) -> None:
        memory = memory_limit(chip)
        least = [n for n in (chip.limit("neurons_per_core"), neurons_per_core) if n is not None]
        limits = (
            min(least, default=None),
            chip.limit("axons_in_per_core"),
            None if memory is None else 8 * memory,
            chip.limit("axons_out_per_core"),
        )
        self.rows, self.sends, self.start, self.queue = placed_as(chip).in_rows, sends, into.start, queue
        self.limits = np.array([_NO_LIMIT if n is None else n for n in limits], dtype=np.int64)
        self.graph = (into.ends, into.line, into.source, into.projection, into.bits, into.sources)
        lines, sources, projections = len(into.source), int(into.start[-1]), len(into.bits)
        shapes = (lines, lines, sources, projections, projections, lines)
        self.marks = tuple(np.full(shape, -1, dtype=np.int32) for shape in shapes)
        self.core = -1
        self.open()

    def open(self) -> None:
        """Begin a new core."""
        self.core += 1
        self.load = np.zeros(5, dtype=np.int64)

    def fill(self, population: int, first: int, last: int) -> int:
        """Add neurons first <= i < last of a population's queue; returns the first that does not fit, or last."""
        base = int(self.start[population])
        rest = (self.core, self.rows, self.graph, self.sends, self.limits, self.load, self.marks)
        return int(fill.fill(self.queue, base + first, base + last, *rest)) - base


def _fill(program: Program, chip: Chip, room: _Room, order: Sequence[int]) -> list[list[Part]]:
    """A population joins the core before it where it fits there whole, else it begins a core."""
    cores: list[list[Part]] = []
    most = chip.limit("populations_per_core")
    for population in order:
        part = program.populations[population]
        first = 0
        if cores and (most is None or len(cores[-1]) < most) and room.fill(population, 0, part.size) == part.size:
            cores[-1].append((population, 0, part.size))
            continue
        while first < part.size:
            room.open()
            last = max(room.fill(population, first, part.size), first + 1)
            cores.append([(population, first, last)])
            first = last
    return cores


def _runs(core: list[Part], into: Incoming, queue: Ints, in_order: bool) -> tuple[Part, ...]:
    """The neurons of pieces of the queue as runs of neighbouring ids."""
    runs: list[Part] = []
    if in_order:
        return tuple(core)
    for population, first, last in core:
        base = into.start[population]
        ids = np.sort(queue[base + first : base + last]) - base
        gaps = np.flatnonzero(np.diff(ids) != 1)
        firsts, lasts = ids[np.append(0, gaps + 1)], ids[np.append(gaps, ids.size - 1)] + 1
        runs += [(population, int(a), int(b)) for a, b in zip(firsts, lasts, strict=True)]
    return tuple(runs)


def _reached(cores: list[list[Part]], chip: Chip, into: Incoming, queue: Ints) -> Split:
    """Count what reaches each core."""
    parts = [(core, *part) for core, held in enumerate(cores) for part in held]
    core, population, first, last = np.array(parts, dtype=np.int64).reshape(-1, 4).T.copy()
    begin, end = into.start[population] + first, into.start[population] + last
    count = len(cores)
    core_of = np.full(int(into.start[-1]), -1, dtype=np.int64)
    for number, a, b in zip(core, begin, end, strict=True):
        core_of[queue[a:b]] = number
    on_core = core_of >= 0
    neurons = np.bincount(core_of[on_core], minlength=count)
    pieces = core, begin, end
    in_order = bool(np.all(np.diff(queue) == 1))
    listed = count <= LISTED or placed_as(chip).in_rows
    found = (_listed if listed else _weighed)(chip, into, queue, pieces, neurons)
    return Split(
        cores=tuple(_runs(held, into, queue, in_order) for held in cores),
        core_of=core_of,
        neurons=neurons,
        axons_out=np.bincount(core_of[on_core], weights=found["sends"][on_core], minlength=count).astype(np.int64),
        listed=listed,
        pieces=pieces,
        queue=queue,
        **found,
    )


def _listed(chip: Chip, into: Incoming, queue: Ints, pieces: tuple[Ints, Ints, Ints], neurons: Ints) -> dict[str, Any]:
    """What reaches each core, as a list of lines and cores, and its sums."""
    total, lines, count = int(into.start[-1]), len(into.source), len(neurons)
    found = tuple(np.empty(len(into.line), dtype=np.int32) for _ in range(4))
    marks = [np.full(size, -1, dtype=np.int32) for size in (lines, total, lines, total)]
    n = fill.reach(queue, *pieces, into.ends, into.line, into.source, *marks, found)
    line, reached, synapses, new = (array[:n] for array in found)
    sent = new.astype(bool)
    return {
        "line": line,
        "core": reached,
        "synapses": synapses,
        "sent": sent,
        "sends": np.bincount(into.source[line[sent]], minlength=total),
        "memory": core_bytes(chip, neurons, reached, line, synapses, into),
        "axons_in": np.bincount(reached[sent], minlength=count),
    }


def _weighed(chip: Chip, into: Incoming, queue: Ints, pieces: tuple[Ints, Ints, Ints], neurons: Ints) -> dict[str, Any]:
    """The same sums without the list."""
    total, lines, count = int(into.start[-1]), len(into.source), len(neurons)
    none = np.zeros(0, dtype=np.int32)
    sends, axons_in, memory = (np.zeros(size, dtype=np.int64) for size in (total, count, count))
    index = np.array([index_bits(int(n)) for n in neurons], dtype=np.int64)
    marks = (
        np.zeros(lines, dtype=np.int32),
        np.full(total, -1, dtype=np.int32),
        *(np.empty(size, dtype=np.int32) for size in (lines, total)),
    )
    graph = (into.ends, into.line, into.source, into.projection, into.bits)
    fill.weigh(queue, *pieces, graph, index, marks, sends, axons_in, memory)
    entries = {"line": none, "core": none, "synapses": none, "sent": none.astype(bool)}
    return {**entries, "sends": sends, "memory": memory // 8, "axons_in": axons_in}


def fewest_cores(program: Program, chip: Chip, into: Incoming) -> int:
    """Cores that a program needs at least, by its neurons and by the bits of its synapses."""
    most, memory = chip.limit("neurons_per_core"), chip.limit("synapse_bytes_per_core")
    neurons = sum(program.populations[index].size for index in neurons_of(program))
    bits = int(into.synapses @ into.bits)
    return max(0 if most is None else -(-neurons // most), 0 if memory is None else bits // (8 * memory))


def neurons_of(program: Program) -> list[int]:
    """Indices of the populations that take cores; generators are the host's."""
    return [index for index, part in enumerate(program.populations) if part.kind == "neuron" and part.size]
