"""The synapses of a program as placing looks at them, and the bits that they take in the memory of a core.

Loihi keeps, for each source neuron and projection, a list of the synapses onto the core in blocks of at most 64. A
block of n takes n (weight + delay + tag + index bits) + 10 bits, rounded up to 64: nengo-loihi 1.1.0's packing, where
the 10 bits are 4 for the format and 6 for the length. The bits of one synapse:

- weight: 8, or `num_weight_bits` of a `loihi_static`;
- delay: those of the largest delay register of the projection, none where that is 0 (shared delays are stored, too:
  a synapse has no other place for its delay);
- tag: 9 where the chip learns, none where the host applies the rule (`r_stdp`);
- index: those that tell the compartments of the core apart, none for one compartment, otherwise at least 6.

SpiNNaker keeps, for each projection and core, one row per source neuron in SDRAM: 3 words of header and one word of 32
bits per synapse, all rows as long as the longest, so that a row is found by multiplying (sPyNNaker's static rows). A
plastic row has the time of its last packet and its traces, too, and of each synapse a half word for the weight, one for
the eligibility where dopamine teaches, and one for its place (sPyNNaker 7.4.1).

Kernels of a grid are spelled out on both: these chips share no weights between neurons. A chip without an arithmetic
here is packed as Loihi 1.

Loihi 2 packs other synapses as Loihi 1, but keeps a kernel once on each core: for each place of the kernel and channel
a row of 8 bits a map, rounded up to 64. A core has fewer than 4,096 neurons of a layer with a kernel, whole columns of
its maps, of which there are a power of 2. So the layers of PilotNet take the cores that Intel's compiler prints for
them: 13, 25, 13, 3, 3 and 2 (lava-dl, `pilotnet_snn/benchmark.ipynb`), whose kernels have fewer bits where few do.
"""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.chips.description import Chip
from neuro.chips.inputs import longest_lag, register
from neuro.chips.loihi_registers import REGISTER_OF_ONE
from neuro.chips.spinnaker_rule import KNOWN, program_of
from neuro.kernels.jit import kernel, subkernel
from neuro.model.synapses import loihi2_convolution
from neuro.program.program import Floats, Ints, Program

BLOCK = 64
BLOCK_BITS = 10
UNIT_BITS = 64
WEIGHT_BITS = 8
TAG_BITS = 9
SHORTEST_INDEX = 6
LAYER_NEURONS = 4096
"""A core of Loihi 2 has fewer neurons of a layer with a kernel."""
SHARED = -1
"""In place of the bits of a synapse where a core keeps a kernel once."""
ROW_WORDS = 3
WORD_BITS = 32


def memory_limit(chip: Chip) -> int | None:
    """Bytes that the synapses of one core can take at most: its own memory, or all that its chip shares."""
    own = chip.limit("synapse_bytes_per_core")
    return chip.limit("synapse_bytes_per_chip") if own is None else own


def row_form(program: Program, index: int) -> tuple[int, int, int]:
    """Return the bytes of a row of SpiNNaker: of traces, of each weight, and of the place of each synapse."""
    synapse = program.projections[index].synapse
    if not isinstance(synapse, KNOWN):
        return 0, 4, 0
    timing, taught = program_of(synapse)
    return 8 if taught or timing == "triplet" else 6, 4 if taught else 2, 2


def row_words(synapses: Any, form: Any) -> Any:
    """Return the words of a row of SpiNNaker with some synapses, of a form as of `row_form`; numbers or arrays."""
    return ROW_WORDS + (form[0] + form[1] * synapses + 3) // 4 + (form[2] * synapses + 3) // 4


def block_bits(synapses: Any, bits: Any) -> Any:
    """Bits of the synapses of one source onto one core, in Loihi's blocks; numbers or arrays.

    Args:
        synapses: how many.
        bits: of one synapse.
    """
    rest = synapses % BLOCK
    full = (BLOCK * bits + BLOCK_BITS + UNIT_BITS - 1) // UNIT_BITS
    last = (rest * bits + BLOCK_BITS + UNIT_BITS - 1) // UNIT_BITS
    return UNIT_BITS * (synapses // BLOCK * full + (rest > 0) * last)


def index_bits(neurons: int) -> int:
    """Bits that tell the compartments of a core apart; the formats are 0, 6, 7, ... (nengo-loihi 1.1.0)."""
    if neurons <= 1:
        return 0
    bits = SHORTEST_INDEX
    while neurons > 1 << bits:
        bits += 1
    return bits


def has_kernel(program: Program, index: int) -> bool:
    """Whether the synapses of a projection share kernels, which Loihi 2 keeps once on a core."""
    part = program.projections[index]
    return part.grid is not None or isinstance(part.synapse, loihi2_convolution)


def kernel_bits(program: Program, index: int, fan_in: int) -> int:
    """Return the bits of a kernel on a core of Loihi 2; `fan_in` is the largest number of synapses onto a neuron."""
    part = program.projections[index]
    maps = program.populations[part.target].shape[0]
    if part.grid is not None:
        maps, fan_in = part.grid.kernels[0], math.prod(part.grid.kernels[1:])
    return fan_in * -(-maps * WEIGHT_BITS // UNIT_BITS) * UNIT_BITS


def columns_per_core(shape: tuple[int, ...]) -> int:
    """Columns of a layer's maps on a core of Loihi 2."""
    most = max((LAYER_NEURONS - 1) // math.prod(shape[:-1]), 1)
    return 1 << most.bit_length() - 1


def synapse_bits(program: Program, index: int) -> int:
    """Bits of one synapse of a projection in Loihi's blocks, without its index."""
    part = program.projections[index]
    weight = int(part.synapse.parameters().get("num_weight_bits", WEIGHT_BITS))
    longest = int(register(longest_lag(program, index), REGISTER_OF_ONE).max(initial=0))
    tagged = part.synapse.learns in ("pairs", "chip") or part.synapse.delays
    return weight + longest.bit_length() + (TAG_BITS if tagged else 0)


@kernel
def onto(begin, end, targets, count):
    """Count the synapses of a projection onto each of its targets."""
    for i in range(begin.size):
        for e in range(begin[i], end[i]):
            count[targets[e]] += 1


@kernel
def scatter(begin, end, targets, first, position, line):
    """Enter the synapses of a projection behind those that their targets already have."""
    for i in range(begin.size):
        for e in range(begin[i], end[i]):
            t = targets[e]
            line[position[t]] = first + i
            position[t] += 1


@dataclass(frozen=True, slots=True, eq=False)
class IncomingRows:
    """The synapses of a projection by source: those of source i end on targets[begin[i] : end[i]]."""

    begin: Ints
    end: Ints
    targets: NDArray[np.int32]

    @property
    def size(self) -> int:
        """How many synapses there are."""
        return int((self.end - self.begin).sum())


@dataclass(frozen=True, eq=False)
class Incoming:
    """All synapses. A line is one source neuron of one projection; all populations' neurons are numbered through.

    Attributes:
        start: the number of each population's first neuron, and the number of all neurons.
        rows: the synapses of each projection, none without spikes.
        ends_at: the population on which each projection ends, `begins_at` the one from which it comes.
        first: the first line of each projection, and the number of all lines; a projection without spikes has none.
        bits: of one synapse of each projection in Loihi's blocks, without its index; SHARED where a core keeps kernels.
        kernels: bits of the kernels onto each population that every core with some of its neurons keeps.
        columns: of a population that is placed by columns of its maps, how many a core has at most.
        forms: of the rows of each projection on SpiNNaker, see `row_form`.
        sources: source neurons of each projection.
        synapses: of each projection, a grid's spelled out.
    """

    start: Ints
    rows: tuple[IncomingRows | None, ...]
    begins_at: tuple[int, ...]
    ends_at: tuple[int, ...]
    first: Ints
    bits: Ints
    forms: Ints
    sources: Ints
    synapses: Ints
    kernels: Ints
    columns: Mapping[int, int]

    @cached_property
    def ends(self) -> Ints:
        """Synapses onto neuron t are ends[t] : ends[t + 1] of `line`, by projection."""
        ends = np.zeros(self.start[-1] + 1, dtype=np.int64)
        for index, rows in enumerate(self.rows):
            if rows is not None:
                onto(rows.begin, rows.end, rows.targets, ends[1 + self.start[self.ends_at[index]] :])
        return np.cumsum(ends)

    @cached_property
    def line(self) -> NDArray[np.int32]:
        """The line of each synapse, by target: 4 bytes a synapse, so it is made only where it is needed."""
        line = np.empty(self.synapses.sum(), dtype=np.int32)
        position = self.ends[:-1].copy()
        for index, rows in enumerate(self.rows):
            if rows is not None:
                at = position[self.start[self.ends_at[index]] :]
                scatter(rows.begin, rows.end, rows.targets, self.first[index], at, line)
        return line

    @cached_property
    def source(self) -> NDArray[np.int32]:
        """The neuron of each line."""
        starts = [self.start[k] + np.arange(n) for k, n in zip(self.begins_at, self.sources, strict=True)]
        return np.concatenate([np.zeros(0, dtype=np.int64), *starts]).astype(np.int32)

    @cached_property
    def projection(self) -> NDArray[np.int32]:
        """The projection of each line."""
        return np.repeat(np.arange(len(self.sources), dtype=np.int32), self.sources)


def incoming(program: Program, keeps_kernels: bool = False) -> Incoming:
    """Look at all synapses of a program that carry spikes.

    Args:
        program: has them.
        keeps_kernels: whether a core keeps a kernel once.
    """
    sizes = [part.size for part in program.populations]
    parts, carries = program.projections, set(spiking(program))
    rows = tuple(rows_of(program, index) if index in carries else None for index in range(len(parts)))
    bits = np.array([synapse_bits(program, index) for index in range(len(parts))], dtype=np.int64)
    kernels, columns = np.zeros(len(sizes), dtype=np.int64), {}
    for index in carries if keeps_kernels else ():
        part, own = parts[index], rows[index]
        if own is None or not has_kernel(program, index):
            continue
        most = int(np.bincount(own.targets).max(initial=0)) if part.grid is None else 0
        bits[index] = SHARED
        kernels[part.target] += kernel_bits(program, index, most)
        for k in (part.source, part.target):
            if len(program.populations[k].shape) == 3:
                columns[k] = columns_per_core(program.populations[k].shape)
    lines = np.array([sizes[p.source] if i in carries else 0 for i, p in enumerate(parts)], dtype=np.int64)
    return Incoming(
        start=np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64),
        rows=rows,
        begins_at=tuple(part.source for part in parts),
        ends_at=tuple(part.target for part in parts),
        first=np.concatenate([[0], np.cumsum(lines)]).astype(np.int64),
        bits=bits,
        forms=np.array([row_form(program, index) for index in range(len(parts))], dtype=np.int64).reshape(-1, 3),
        sources=lines,
        synapses=np.array([0 if each is None else each.size for each in rows], dtype=np.int64),
        kernels=kernels,
        columns=columns,
    )


def rows_of(program: Program, index: int) -> IncomingRows:
    """The synapses of a projection by source; rows that are alike share their targets, a grid's are spelled out."""
    part = program.projections[index]
    n_source, n_target = (program.populations[k].size for k in (part.source, part.target))
    if part.grid is not None:
        # A neuron at (row, column) sees the kernel's window of its channels, as far as it lies inside; all maps alike.
        g = part.grid
        y = _window(g.rows, g.top, g.kernel_height, g.stride)[:, None, None, :, None]
        x = _window(g.columns, g.left, g.kernel_width, g.stride)[None, :, None, None, :]
        channel = np.arange(g.kernels[1])[None, None, :, None, None]
        inside = (channel >= 0) & (y >= 0) & (y < g.height) & (x >= 0) & (x < g.width)
        place = np.arange(g.rows * g.columns).reshape(g.rows, g.columns, 1, 1, 1)
        maps = np.arange(g.maps)[:, None]
        source = (((channel * g.height + y) * g.width + x)[inside] + maps // g.reach * (g.height * g.width)).reshape(-1)
        target = (np.broadcast_to(place, inside.shape)[inside] + maps * (g.rows * g.columns)).reshape(-1)
        ends = np.concatenate([[0], np.cumsum(np.bincount(source, minlength=n_source))])
        return IncomingRows(ends[:-1], ends[1:], target[np.argsort(source, kind="stable")].astype(np.int32))
    if part.layout == "dense":
        begin, end = np.zeros(n_source, dtype=np.int64), np.full(n_source, n_target, dtype=np.int64)
        return IncomingRows(begin, end, np.arange(n_target, dtype=np.int32))
    if part.layout == "one_to_one":
        each = np.arange(n_source, dtype=np.int64)
        return IncomingRows(each, each + 1, np.arange(n_source, dtype=np.int32))
    return IncomingRows(part.row_ends[:-1], part.row_ends[1:], part.targets)


def _window(places: int, before: int, kernel: int, stride: int) -> Ints:
    return np.asarray(np.arange(places)[:, None] * stride - before + np.arange(kernel), dtype=np.int64)


def spiking(program: Program) -> list[int]:
    """Indices of the projections that carry spikes; those of a dc_generator carry a current."""
    return [index for index, part in enumerate(program.projections) if part.carries == "spikes"]


def dense_size(program: Program, index: int) -> int:
    """Multiply-accumulates of one step if every source sends: all pairs, n one to one, of a grid the convolution's."""
    part = program.projections[index]
    n_pre, n_post = program.populations[part.source].size, program.populations[part.target].size
    if part.grid is not None:
        return int(fan_out(program, index, np.ones(1)).sum())
    return n_pre if part.layout == "one_to_one" else n_pre * n_post


def fan_out(program: Program, index: int, weight: Floats) -> Ints:
    """Synapses of each source whose weight is not 0, shape (sources,).

    Args:
        program: has the projection.
        index: of the projection.
        weight: its weights, shape (1,) where shared, else one per synapse; of a grid those of its kernels.
    """
    part = program.projections[index]
    n_pre = program.populations[part.source].size
    counts = np.broadcast_to(weight != 0, part.size).astype(np.int64)
    if part.grid is not None:
        # A source meets each weight of its channel once for every place of the kernel that puts it there.
        g = part.grid
        of_maps = counts.reshape(-1, g.reach, *g.kernels[1:])  # of a depthwise grid by channel
        kernels = of_maps.sum(axis=1).reshape(g.channels, g.kernel_height, g.kernel_width)
        rows = _meets(g.height, g.top, g.kernel_height, g.rows, g.stride)
        columns = _meets(g.width, g.left, g.kernel_width, g.columns, g.stride)
        return np.asarray(np.einsum("yk,ckl,xl->cyx", rows, kernels, columns).reshape(-1))
    if part.layout == "one_to_one":
        return counts
    if part.layout == "dense":
        return np.asarray(counts.reshape(n_pre, -1).sum(axis=1))
    return np.asarray(np.diff(np.concatenate([[0], np.cumsum(counts)])[part.row_ends]))


def _meets(length: int, before: int, kernel: int, places: int, stride: int) -> NDArray[np.int64]:
    """Whether the kernel has a place at which its line k lies on line y, shape (length, kernel)."""
    offset = np.arange(length)[:, None] + before - np.arange(kernel)[None, :]
    place, rest = np.divmod(offset, stride)
    return np.asarray((rest == 0) & (place >= 0) & (place < places), dtype=np.int64)


# mypy: disable-error-code="no-untyped-def,no-untyped-call"

# the cores that the spikes of each source reach

bits_of_block = subkernel(block_bits)


@subkernel
def cores_of_source(i, rows, core_of, count, cores):
    """The cores that source i reaches, each once; returns how many there are."""
    begin, end, targets = rows
    n = 0
    for e in range(begin[i], end[i]):
        core = core_of[targets[e]]
        cores[n] = core
        n += count[core] == 0
        count[core] += 1
    return n


@subkernel
def is_new(i, core, sent):
    """Whether this is the first projection of source i that sends a spike to a core."""
    if sent.size == 0:
        return True
    bit = 1 << (core & 7)
    if sent[i, core >> 3] & bit:
        return False
    sent[i, core >> 3] |= bit
    return True


@kernel
def weigh(rows, core_of, room, bits, index, sends, axons_in, blocks, longest):
    """Count what a projection brings to each core.

    Args:
        rows: see above.
        core_of: likewise.
        room: likewise.
        bits: of one synapse, without the index of its neuron.
        index: bits that tell the neurons of each core apart, none where synapses lie in rows.
        sends: cores that each source reaches, grows.
        axons_in: sources that reach each core, grows.
        blocks: bits of each core where synapses lie in blocks, grows.
        longest: is raised, else, to the most synapses that a source has onto each core.
    """
    count, cores, sent = room
    for i in range(rows[0].size):
        for k in range(cores_of_source(i, rows, core_of, count, cores)):
            core = cores[k]
            n = count[core]
            count[core] = 0
            if bits == SHARED:
                pass  # the core keeps a kernel once, which is counted apart
            elif index.size:
                blocks[core] += bits_of_block(n, bits + index[core])
            else:
                longest[core] = max(longest[core], n)
            if is_new(i, core, sent):
                sends[i] += 1
                axons_in[core] += 1


def reached(into: Incoming, core_of: Ints, cores: int) -> Iterator[tuple[int, tuple[Any, ...]]]:
    """Every projection with spikes, those of a source in order, and what kernels take of it.

    Args:
        into: all synapses.
        core_of: the core of every neuron, -1 for generators.
        cores: how many there are.

    Yields:
        the projection; its rows, the core of each of its targets, and room to count in.
    """
    held = [core_of[a:b].astype(np.int32) for a, b in zip(into.start[:-1], into.start[1:], strict=True)]
    count, listed = np.zeros((2, cores), dtype=np.int32)
    listed = np.append(listed, np.int32(0))
    on = np.zeros((len(held), cores), dtype=np.int64)
    for population, own in enumerate(held):
        on[population, own[own >= 0]] = 1
    of_each: dict[int, list[int]] = {}
    for index, rows in enumerate(into.rows):
        if rows is not None and rows.size:
            of_each.setdefault(into.begins_at[index], []).append(index)
    for source, projections in of_each.items():
        size = int(into.start[source + 1] - into.start[source])
        apart = bool(np.all(np.sum([on[into.ends_at[index]] for index in projections], axis=0) <= 1))
        sent = np.zeros((0, 0) if apart else (size, cores // 8 + 1), dtype=np.uint8)
        for index in projections:
            rows = into.rows[index]
            assert rows is not None
            yield index, ((rows.begin, rows.end, rows.targets), held[into.ends_at[index]], (count, listed, sent))
