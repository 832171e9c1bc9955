"""The division of populations into pieces that the limits of a core allow."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from neuro.chips.description import Chip
from neuro.chips.incoming import (
    SHARED,
    WORD_BITS,
    Incoming,
    block_bits,
    index_bits,
    memory_limit,
    projections_by_source,
    row_words,
    weigh,
)
from neuro.chips.known import placed_as
from neuro.kernels.jit import kernel, subkernel
from neuro.program.program import Ints, Program

Part = tuple[int, int, int]
"""A population and its neurons first <= i < last."""

_NO_LIMIT = 1 << 62

NEURONS, AXONS, MEMORY, EDGES, LINES, KERNELS = range(6)
"""Columns of the load of a core: neurons, axons in, bits of synapses, axons out, lines, and bits of kernels."""

bits_of_block, bits_of_index, words_of_row = subkernel(block_bits), subkernel(index_bits), subkernel(row_words)


@kernel
def fill_core(queue, begin, end, core, rows, graph, sends, limits, load, marks):
    """Add the neurons queue[begin:end] to a core until a neuron does not fit; return its position, or end.

    Args:
        queue: neurons in the order in which cores are filled.
        begin: position of the first neuron.
        end: position after the last neuron.
        core: unique number of the core; marks of other cores are void.
        rows: whether synapses are stored in rows, not in blocks.
        graph: ends, line, first, source, projection, bits, forms and sources of `Incoming`. If `ends` is all 0,
            synapses are ignored.
        sends: known number of axons out of each neuron.
        limits: limits of NEURONS, AXONS, MEMORY and EDGES.
        load: present load of this core, by the columns above.
        marks: arrays: core and count of each line (core << 32 | count), core of each source, longest row of each
            projection, core of that row, and the lines that reach this core.
    """
    ends, line, first, source_of, projection_of, all_bits, forms, sources = graph
    mark, source_core, longest, row_core, lines = marks
    most_axons, most_memory = limits[AXONS], limits[MEMORY]
    axons, memory, n_lines = load[AXONS], load[MEMORY], load[LINES]
    empty = core << 32
    stopped = end
    for position in range(begin, end):
        if load[NEURONS] == limits[NEURONS]:
            stopped = position
            break
        t = queue[position]
        before = bits_of_index(load[NEURONS])
        load[NEURONS] += 1
        width = bits_of_index(load[NEURONS])
        if width != before and not rows:  # the index of each synapse on the core needs one more bit
            memory = load[KERNELS]
            for k in range(n_lines):
                own_bits = all_bits[projection_of[lines[k]]]
                memory += 0 if own_bits == SHARED else bits_of_block(mark[lines[k]] - empty, own_bits + width)
        next_first, to_source, bits, one_line, projection, shared = 0, 0, 0, 0, 0, False
        for e in range(ends[t], ends[t + 1]):
            source_line = line[e]
            if source_line >= next_first:  # lines of a neuron are sorted by projection
                projection = projection_of[source_line]
                next_first = first[projection + 1]
                to_source = source_of[source_line] - source_line
                shared = all_bits[projection] == SHARED
                bits = all_bits[projection] + width
                one_line = bits_of_block(1, bits)
            count = mark[source_line] - empty
            if count <= 0:
                count = 0
                if not rows:
                    lines[n_lines] = source_line
                    n_lines += 1
                if source_core[source_line + to_source] != core:
                    source_core[source_line + to_source] = core
                    axons += 1
            count += 1
            mark[source_line] = empty + count
            if shared:
                pass
            elif not rows:
                memory += one_line if count == 1 else bits_of_block(count, bits) - bits_of_block(count - 1, bits)
            else:
                words = words_of_row(longest[projection], forms[projection])
                if row_core[projection] != core:
                    row_core[projection] = core
                    longest[projection] = words = 0
                if count > longest[projection]:
                    longest[projection] = count
                    words = words_of_row(count, forms[projection]) - words
                    memory += sources[projection] * WORD_BITS * words
            if axons > most_axons or memory > most_memory:
                stopped = position
                break
        if stopped < end:
            break
        load[EDGES] += sends[t]
        if axons > most_axons or memory > most_memory or load[EDGES] > limits[EDGES]:
            stopped = position
            break
    load[AXONS], load[MEMORY], load[LINES] = axons, memory, n_lines
    return stopped


@dataclass(frozen=True, slots=True, eq=False)
class Split:
    """Cores without positions, and their loads.

    Attributes:
        cores: neurons of each core, as runs of consecutive ids.
        core_of: core of every neuron, numbered over all populations as in `Incoming`; -1 for generators.
        sends: number of destination cores of every neuron.
        neurons: number of neurons of each core.
        memory: bytes of synapses of each core.
        own: bytes of each core's own memory that learning needs.
        axons_in, axons_out: number of axons of each core.
    """

    cores: tuple[tuple[Part, ...], ...]
    core_of: Ints
    sends: Ints
    neurons: Ints
    memory: Ints
    own: Ints
    axons_in: Ints
    axons_out: Ints

    def reordered(self, order: Ints) -> Split:
        """Return the cores renumbered: core i is the former core order[i]."""
        rank = np.argsort(order)
        return replace(
            self,
            cores=tuple(self.cores[i] for i in order),
            core_of=np.where(self.core_of >= 0, rank[self.core_of], -1) if len(rank) else self.core_of,
            neurons=self.neurons[order],
            memory=self.memory[order],
            own=self.own[order],
            axons_in=self.axons_in[order],
            axons_out=self.axons_out[order],
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

    A core gets neurons of a population until one more would exceed a limit. The number of axons that leave a core
    depends on the split of the targets. If a core has too many, all cores are filled again with the known numbers. A
    neuron that fits on no core is alone on a core.

    The input of a core only grows with its neurons. Cores are therefore filled by the other limits first. If memory and
    input axons are then within their limits, the synapses of single neurons need not be read.

    Args:
        program: the whole network.
        chip: the chip with the limits.
        into: all synapses.
        order: order of the populations.
        neurons_per_core: largest number of neurons on a core, in addition to the chip's own limit.
        by_place: whether neurons at one position of a grid are placed together, because they share their sources;
            otherwise neurons are placed in the order of ids.
    """
    queue = _queue(program, into, by_place)
    sends = np.zeros(into.start[-1], dtype=np.int64)
    limit = chip.limit("axons_out_per_core")
    reads_synapses = False
    while True:
        filler = _CoreFiller(chip, into, neurons_per_core, sends, queue, reads_synapses)
        cores = _with_loads(program, _fill(program, chip, filler, order), chip, into, queue)
        if not reads_synapses and not _input_fits(cores, filler.limits):
            reads_synapses = True
            continue
        has_too_many = (cores.neurons > 1) & (cores.axons_out > (_NO_LIMIT if limit is None else limit))
        if not has_too_many.any():
            return cores
        sends = np.maximum(sends, cores.sends)


def _input_fits(cores: Split, limits: Ints) -> bool:
    """Return whether all cores are within the limits of memory and of input axons."""
    return bool(np.all(cores.memory <= limits[MEMORY] // 8) and np.all(cores.axons_in <= limits[AXONS]))


def _queue(program: Program, into: Incoming, by_place: bool) -> Ints:
    """Return all neurons in the order in which cores are filled, population by population."""
    queue = np.arange(into.start[-1])
    for part in program.projections if by_place else ():
        if part.grid is not None:
            neurons = queue[into.start[part.target] : into.start[part.target + 1]]
            neurons[:] = into.start[part.target] + np.arange(neurons.size).reshape(part.grid.maps, -1).T.reshape(-1)
    for population in into.columns:
        neurons = queue[into.start[population] : into.start[population + 1]]
        shape = program.populations[population].shape
        neurons[:] = into.start[population] + np.arange(neurons.size).reshape(shape).transpose(2, 1, 0).reshape(-1)
    return queue


class _CoreFiller:
    """The core that is being filled, and its limits."""

    def __init__(
        self, chip: Chip, into: Incoming, neurons_per_core: int | None, sends: Ints, queue: Ints, each: bool
    ) -> None:
        memory = memory_limit(chip)
        fewest = [n for n in (chip.limit("neurons_per_core"), neurons_per_core) if n is not None]
        limits = (
            min(fewest, default=None),
            chip.limit("axons_in_per_core"),
            None if memory is None else 8 * memory,
            chip.limit("axons_out_per_core"),
        )
        self.rows, self.sends, self.start, self.queue = placed_as(chip).in_rows, sends, into.start, queue
        self.limits = np.array([_NO_LIMIT if n is None else n for n in limits], dtype=np.int64)
        no_lines = np.zeros(0, dtype=np.int32)
        ends, line = (into.ends, into.line) if each else (np.zeros(int(into.start[-1]) + 1, dtype=np.int64), no_lines)
        self.graph = (ends, line, into.first, into.source, into.projection, into.bits, into.forms, into.sources)
        lines, sources, projections = len(into.source), int(into.start[-1]), len(into.bits)
        mark = np.full(lines if each else 0, -1, dtype=np.int64)
        shapes = (sources, projections, projections, len(mark))
        self.marks = (mark, *(np.full(shape, -1, dtype=np.int32) for shape in shapes))
        self.core = -1
        self.kernels, self.columns, self.most = into.kernels, into.columns, int(self.limits[NEURONS])
        self.open(-1)

    def open(self, population: int) -> None:
        """Begin a new core for a population; -1 if the population is not known yet."""
        self.core += 1
        self.load = np.zeros(6, dtype=np.int64)
        if population >= 0:
            self.load[[MEMORY, KERNELS]] = self.kernels[population]

    def fill(self, population: int, first: int, last: int) -> int:
        """Add neurons first <= i < last of a population's queue. Return the first that does not fit, or `last`."""
        base = int(self.start[population])
        arguments = (self.core, self.rows, self.graph, self.sends, self.limits, self.load, self.marks)
        return int(fill_core(self.queue, base + first, base + last, *arguments)) - base


def _fill(program: Program, chip: Chip, filler: _CoreFiller, order: Sequence[int]) -> list[list[Part]]:
    """Fill cores in an order of populations.

    A population joins the core of the previous population if it fits there completely; otherwise it begins a core.
    """
    cores: list[list[Part]] = []
    most = chip.limit("populations_per_core")
    for population in order:
        part = program.populations[population]
        begin = 0
        slab = filler.columns.get(population, 0) * math.prod(part.shape[:-1])
        filler.limits[NEURONS] = min(filler.most, slab or filler.most, most_by_memory(program, chip, population))
        if cores and (most is None or len(cores[-1]) < most) and filler.fill(population, 0, part.size) == part.size:
            cores[-1].append((population, 0, part.size))
            continue
        while begin < part.size:
            filler.open(population)
            end = max(filler.fill(population, begin, part.size), begin + 1)
            cores.append([(population, begin, end)])
            begin = end
    return cores


def most_by_memory(program: Program, chip: Chip, population: int) -> int:
    """Return the number of a population's neurons that fit into a core's own memory, at least 1."""
    limit, size = chip.limit("memory_bytes_per_core"), program.populations[population].size
    sizes = range(1, min(size, chip.limit("neurons_per_core") or size) + 1)
    need = partial(placed_as(chip).core_bytes, program, chip, population)
    if limit is None or need(sizes[-1]) <= limit:
        return _NO_LIMIT
    return max(1, bisect_right(sizes, limit, key=need))


def _with_loads(program: Program, cores: list[list[Part]], chip: Chip, into: Incoming, queue: Ints) -> Split:
    """Return the cores with their memory and axons."""
    count, total = len(cores), int(into.start[-1])
    core_of = np.full(total, -1, dtype=np.int64)
    kernels = np.zeros(count, dtype=np.int64)
    runs: list[tuple[Part, ...]] = []
    for number, parts in enumerate(cores):
        own_runs: list[Part] = []
        for population, first, last in parts:
            base = into.start[population]
            neurons = queue[base + first : base + last]
            core_of[neurons] = number
            kernels[number] += into.kernels[population]
            ids = np.sort(neurons) - base
            gaps = np.flatnonzero(np.diff(ids) != 1)
            firsts, lasts = ids[np.append(0, gaps + 1)], ids[np.append(gaps, ids.size - 1)] + 1
            own_runs += [(population, int(a), int(b)) for a, b in zip(firsts, lasts, strict=True)]
        runs.append(tuple(own_runs))
    on_core = core_of >= 0
    sizes = np.bincount(core_of[on_core], minlength=count)
    rows = placed_as(chip).in_rows
    index = np.array([] if rows else [index_bits(int(n)) for n in sizes], dtype=np.int64)
    sends, axons_in, blocks, in_rows, longest = (np.zeros(size, dtype=np.int64) for size in (total, *[count] * 4))
    for projection, ways in projections_by_source(into, core_of, count):
        own = sends[into.start[into.begins_at[projection]] :]
        longest[:] = 0
        weigh(*ways, into.bits[projection], index, own, axons_in, blocks, longest)
        words = np.where(longest > 0, row_words(longest, into.forms[projection]), 0)
        in_rows += words * (WORD_BITS * into.sources[projection])
    own_bytes = partial(placed_as(chip).core_bytes, program, chip)
    return Split(
        cores=tuple(runs),
        core_of=core_of,
        sends=sends,
        neurons=sizes,
        memory=(in_rows if rows else blocks + kernels) // 8,
        own=np.array([sum(own_bytes(p, last - first) for p, first, last in parts) for parts in cores], dtype=np.int64),
        axons_in=axons_in,
        axons_out=np.bincount(core_of[on_core], weights=sends[on_core], minlength=count).astype(np.int64),
    )


def fewest_cores(program: Program, chip: Chip, into: Incoming) -> int:
    """Return a lower bound of the cores that a program needs, from the neurons and the bits of synapses."""
    most, memory = chip.limit("neurons_per_core"), chip.limit("synapse_bytes_per_core")
    neurons = sum(program.populations[index].size for index in neurons_of(program))
    bits = int(into.synapses @ np.maximum(into.bits, 0))
    return max(0 if most is None else -(-neurons // most), 0 if memory is None else bits // (8 * memory))


def neurons_of(program: Program) -> list[int]:
    """Return the indices of the populations that need cores; generators run on the host."""
    return [index for index, part in enumerate(program.populations) if part.kind == "neuron" and part.size]
