"""Synapses of a program for placing, and the bits of a synapse in the memory of a core.

Loihi stores, for each source neuron and projection, a list of the synapses onto the core in blocks of at most 64. A
block of n synapses needs n (weight + delay + tag + index bits) + 10 bits, rounded up to 64, as in nengo-loihi 1.1.0.
The 10 bits are 4 for the format and 6 for the length. The bits of one synapse:

- weight: 8, or `num_weight_bits` of a `loihi_static`;
- delay: bits of the largest delay register of the projection, none if it has no bits. Shared delays are stored in each
  synapse, too, because there is no other memory for them;
- tag: 9 if the chip learns, none if the host applies the rule (`r_stdp`);
- index: bits that number the compartments of the core, none for one compartment, otherwise at least 6.

SpiNNaker stores, for each projection and core, one row per source neuron in SDRAM: 3 words of header and one word of 32
bits per synapse. All rows are as long as the longest row, so that the address of a row is a product (static
rows of sPyNNaker). A plastic row also has the time of its last packet and its traces. Each plastic synapse has a half
word for the weight, one for the eligibility if dopamine modulates it, and one for its target (sPyNNaker 7.4.1).

Both chips store each synapse of a kernel of a grid, because they share no weights between neurons. A chip without an
emulated arithmetic is packed as Loihi 1.

Loihi 2 packs other synapses as Loihi 1, but stores a kernel once on each core: for each position of the kernel and
channel a row of 8 bits per map, rounded up to 64. A core has fewer than 4,096 neurons of a layer with a kernel, in
whole columns of its maps, and the number of columns is a power of 2. The layers of PilotNet then need as many cores as
Intel's compiler prints: 13, 25, 13, 3, 3 and 2 (lava-dl, `pilotnet_snn/benchmark.ipynb`). Intel's kernels have fewer
bits where fewer are enough.
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
"""Upper bound, exclusive, of the neurons of a layer with a kernel on one core of Loihi 2."""
SHARED = -1
"""Marker instead of the bits of a synapse, for projections with a kernel that a core stores once."""
ROW_WORDS = 3
WORD_BITS = 32


def memory_limit(chip: Chip) -> int | None:
    """Return the largest number of bytes for the synapses of a core, in its own or in shared memory."""
    own_bytes = chip.limit("synapse_bytes_per_core")
    return chip.limit("synapse_bytes_per_chip") if own_bytes is None else own_bytes


def row_form(program: Program, index: int) -> tuple[int, int, int]:
    """Return three numbers of bytes for a row of SpiNNaker: of the traces, of a weight, and of a synapse's target."""
    synapse = program.projections[index].synapse
    if not isinstance(synapse, KNOWN):
        return 0, 4, 0
    timing, taught = program_of(synapse)
    return 8 if taught or timing == "triplet" else 6, 4 if taught else 2, 2


def row_words(synapses: Any, form: Any) -> Any:
    """Return the words of a row of SpiNNaker; `synapses` is a number or an array, and `form` is from `row_form`."""
    return ROW_WORDS + (form[0] + form[1] * synapses + 3) // 4 + (form[2] * synapses + 3) // 4


def block_bits(synapses: Any, bits: Any) -> Any:
    """Return the bits of a source's synapses onto a core in Loihi's blocks; takes numbers or arrays.

    For example 70 synapses of 17 bits need a block of 64 (1,098 bits, rounded up to 1,152) and one of 6 (112, rounded
    up to 128): 1,280.

    Args:
        synapses: number of synapses.
        bits: bits of one synapse.
    """
    remainder = synapses % BLOCK
    full_bits = (BLOCK * bits + BLOCK_BITS + UNIT_BITS - 1) // UNIT_BITS
    last_bits = (remainder * bits + BLOCK_BITS + UNIT_BITS - 1) // UNIT_BITS
    return UNIT_BITS * (synapses // BLOCK * full_bits + (remainder > 0) * last_bits)


def index_bits(neurons: int) -> int:
    """Return the bits that number the compartments of a core: 0, 6, 7, ... (nengo-loihi 1.1.0)."""
    if neurons <= 1:
        return 0
    bits = SHORTEST_INDEX
    while neurons > 1 << bits:
        bits += 1
    return bits


def has_kernel(program: Program, index: int) -> bool:
    """Return whether the synapses of a projection share kernels. Loihi 2 stores a kernel once on a core."""
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
    """Return the number of columns of a layer's maps that fit on a core of Loihi 2."""
    columns = max((LAYER_NEURONS - 1) // math.prod(shape[:-1]), 1)
    return 1 << columns.bit_length() - 1


def synapse_bits(program: Program, index: int) -> int:
    """Return the bits of a synapse of a projection in Loihi's blocks, without the index."""
    part = program.projections[index]
    weight = int(part.synapse.parameters().get("num_weight_bits", WEIGHT_BITS))
    longest = int(register(longest_lag(program, index), REGISTER_OF_ONE).max(initial=0))
    tagged = part.synapse.learns in ("pairs", "chip") or part.synapse.delays
    return weight + longest.bit_length() + (TAG_BITS if tagged else 0)


@kernel
def count_onto(begin, end, targets, count):
    """Count the synapses of a projection onto each of its targets."""
    for i in range(begin.size):
        for e in range(begin[i], end[i]):
            count[targets[e]] += 1


@kernel
def scatter(begin, end, targets, first, position, line):
    """Append the line of each synapse to the list of its target. `position` has the end of each list."""
    for i in range(begin.size):
        for e in range(begin[i], end[i]):
            t = targets[e]
            line[position[t]] = first + i
            position[t] += 1


@dataclass(frozen=True, slots=True, eq=False)
class IncomingRows:
    """The synapses of a projection by source: the targets of source i are targets[begin[i] : end[i]]."""

    begin: Ints
    end: Ints
    targets: NDArray[np.int32]

    @property
    def size(self) -> int:
        """Number of synapses."""
        return int((self.end - self.begin).sum())


@dataclass(frozen=True, eq=False)
class Incoming:
    """All synapses of a program.

    A line is a source neuron of a projection. Neurons are numbered over all populations.

    Attributes:
        start: number of the first neuron of each population, and number of all neurons.
        rows: synapses of each projection, None for a projection without spikes.
        begins_at: source population of each projection.
        ends_at: target population of each projection.
        first: first line of each projection, and number of all lines. A projection without spikes has no line.
        bits: bits of one synapse of each projection in Loihi's blocks, without its index; SHARED for stored kernels.
        kernels: bits of the kernels onto each population, which every core with some of its neurons stores.
        columns: largest number of columns of maps on a core, for populations that are split by columns.
        forms: form of the rows of each projection on SpiNNaker, see `row_form`.
        sources: number of source neurons of each projection.
        synapses: number of synapses of each projection; a kernel counts each synapse of the grid.
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
        """Bounds of `line`: the synapses onto neuron t are line[ends[t] : ends[t + 1]], in the order of projections."""
        ends = np.zeros(self.start[-1] + 1, dtype=np.int64)
        for index, rows in enumerate(self.rows):
            if rows is not None:
                count_onto(rows.begin, rows.end, rows.targets, ends[1 + self.start[self.ends_at[index]] :])
        return np.cumsum(ends)

    @cached_property
    def line(self) -> NDArray[np.int32]:
        """Line of each synapse, sorted by target. Made on first use, because the array has 4 bytes per synapse."""
        line = np.empty(self.synapses.sum(), dtype=np.int32)
        position = self.ends[:-1].copy()
        for index, rows in enumerate(self.rows):
            if rows is not None:
                insert_at = position[self.start[self.ends_at[index]] :]
                scatter(rows.begin, rows.end, rows.targets, self.first[index], insert_at, line)
        return line

    @cached_property
    def source(self) -> NDArray[np.int32]:
        """Source neuron of each line."""
        starts = [self.start[k] + np.arange(n) for k, n in zip(self.begins_at, self.sources, strict=True)]
        return np.concatenate([np.zeros(0, dtype=np.int64), *starts]).astype(np.int32)

    @cached_property
    def projection(self) -> NDArray[np.int32]:
        """Projection of each line."""
        return np.repeat(np.arange(len(self.sources), dtype=np.int32), self.sources)


def incoming(program: Program, keeps_kernels: bool = False) -> Incoming:
    """Collect all synapses of a program that carry spikes.

    Args:
        program: the whole network.
        keeps_kernels: whether a core stores a kernel once.
    """
    sizes = [part.size for part in program.populations]
    parts, carries = program.projections, set(spiking(program))
    rows = tuple(rows_of(program, index) if index in carries else None for index in range(len(parts)))
    bits = np.array([synapse_bits(program, index) for index in range(len(parts))], dtype=np.int64)
    kernels, columns = np.zeros(len(sizes), dtype=np.int64), {}
    for index in carries if keeps_kernels else ():
        part, own_rows = parts[index], rows[index]
        if own_rows is None or not has_kernel(program, index):
            continue
        largest_fan_in = int(np.bincount(own_rows.targets).max(initial=0)) if part.grid is None else 0
        bits[index] = SHARED
        kernels[part.target] += kernel_bits(program, index, largest_fan_in)
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
        synapses=np.array([0 if synapses is None else synapses.size for synapses in rows], dtype=np.int64),
        kernels=kernels,
        columns=columns,
    )


def rows_of(program: Program, index: int) -> IncomingRows:
    """Return the synapses of a projection by source. Equal rows share their targets. A grid lists each synapse."""
    part = program.projections[index]
    n_source, n_target = (program.populations[k].size for k in (part.source, part.target))
    if part.grid is not None:
        # A neuron at (row, column) receives the part of the kernel's window inside of the input, from each channel.
        # All maps have the same windows.
        g = part.grid
        y = _window(g.rows, g.top, g.kernel_height, g.stride)[:, None, None, :, None]
        x = _window(g.columns, g.left, g.kernel_width, g.stride)[None, :, None, None, :]
        channel = np.arange(g.kernels[1])[None, None, :, None, None]
        valid = (channel >= 0) & (y >= 0) & (y < g.height) & (x >= 0) & (x < g.width)
        neuron = np.arange(g.rows * g.columns).reshape(g.rows, g.columns, 1, 1, 1)
        maps = np.arange(g.maps)[:, None]
        source = (((channel * g.height + y) * g.width + x)[valid] + maps // g.reach * (g.height * g.width)).reshape(-1)
        target = (np.broadcast_to(neuron, valid.shape)[valid] + maps * (g.rows * g.columns)).reshape(-1)
        ends = np.concatenate([[0], np.cumsum(np.bincount(source, minlength=n_source))])
        return IncomingRows(ends[:-1], ends[1:], target[np.argsort(source, kind="stable")].astype(np.int32))
    if part.layout == "dense":
        begin, end = np.zeros(n_source, dtype=np.int64), np.full(n_source, n_target, dtype=np.int64)
        return IncomingRows(begin, end, np.arange(n_target, dtype=np.int32))
    if part.layout == "one_to_one":
        targets_of_all = np.arange(n_source, dtype=np.int64)
        return IncomingRows(targets_of_all, targets_of_all + 1, np.arange(n_source, dtype=np.int32))
    return IncomingRows(part.row_ends[:-1], part.row_ends[1:], part.targets)


def _window(n_places: int, padding: int, kernel: int, stride: int) -> Ints:
    return np.asarray(np.arange(n_places)[:, None] * stride - padding + np.arange(kernel), dtype=np.int64)


def spiking(program: Program) -> list[int]:
    """Return the indices of the projections with spikes. Projections of a dc_generator carry currents."""
    return [index for index, part in enumerate(program.projections) if part.carries == "spikes"]


def dense_size(program: Program, index: int) -> int:
    """Return the multiply-accumulates of one step if every source sends.

    The result is the number of pairs, n for one_to_one, or the operations of the convolution for a grid.
    """
    part = program.projections[index]
    n_pre, n_post = program.populations[part.source].size, program.populations[part.target].size
    if part.grid is not None:
        return int(fan_out(program, index, np.ones(1)).sum())
    return n_pre if part.layout == "one_to_one" else n_pre * n_post


def fan_out(program: Program, index: int, weight: Floats) -> Ints:
    """Return the number of synapses of each source whose weight is not 0, shape (sources,).

    Args:
        program: the whole network.
        index: index of the projection.
        weight: weights of the projection, shape (1,) if shared, else one per synapse, for a grid one per kernel weight.
    """
    part = program.projections[index]
    n_pre = program.populations[part.source].size
    counts = np.broadcast_to(weight != 0, part.size).astype(np.int64)
    if part.grid is not None:
        # A source uses each weight of its channel once for every kernel position that covers the source.
        g = part.grid
        of_maps = counts.reshape(-1, g.reach, *g.kernels[1:])  # by channel in a depthwise grid
        kernels = of_maps.sum(axis=1).reshape(g.channels, g.kernel_height, g.kernel_width)
        rows = _covers(g.height, g.top, g.kernel_height, g.rows, g.stride)
        columns = _covers(g.width, g.left, g.kernel_width, g.columns, g.stride)
        return np.asarray(np.einsum("yk,ckl,xl->cyx", rows, kernels, columns).reshape(-1))
    if part.layout == "one_to_one":
        return counts
    if part.layout == "dense":
        return np.asarray(counts.reshape(n_pre, -1).sum(axis=1))
    return np.asarray(np.diff(np.concatenate([[0], np.cumsum(counts)])[part.row_ends]))


def _covers(length: int, padding: int, kernel: int, n_places: int, stride: int) -> NDArray[np.int64]:
    """Return whether a position of the kernel puts its line k on line y of the input, shape (length, kernel)."""
    offset = np.arange(length)[:, None] + padding - np.arange(kernel)[None, :]
    position, remainder = np.divmod(offset, stride)
    return np.asarray((remainder == 0) & (position >= 0) & (position < n_places), dtype=np.int64)


# mypy: disable-error-code="no-untyped-def,no-untyped-call"

# kernels that follow the spikes of each source to cores

bits_of_block = subkernel(block_bits)


@subkernel
def cores_of_source(i, rows, core_of, count, cores):
    """List the cores that source i reaches and count its synapses on each. Return the number of cores."""
    begin, end, targets = rows
    n = 0
    for e in range(begin[i], end[i]):
        core = core_of[targets[e]]
        cores[n] = core
        n += count[core] == 0
        count[core] += 1
    return n


@subkernel
def is_new(i, core, visited):
    """Return whether source i has not sent to a core before, and mark the core as visited."""
    if visited.size == 0:
        return True
    bit = 1 << (core & 7)
    if visited[i, core >> 3] & bit:
        return False
    visited[i, core >> 3] |= bit
    return True


@kernel
def weigh(rows, core_of, scratch, bits, index, sends, axons_in, blocks, longest):
    """Add the memory and the axons that a projection needs on each core.

    Args:
        rows: rows of the projection, from `projections_by_source`.
        core_of: core of each target, from `projections_by_source`.
        scratch: scratch arrays, from `projections_by_source`.
        bits: bits of one synapse, without the index of its neuron.
        index: bits that number the neurons of each core; empty if synapses are stored in rows.
        sends: output: adds the number of cores that each source reaches.
        axons_in: output: adds the number of sources that reach each core.
        blocks: output for blocks: adds the bits on each core.
        longest: output for rows: the largest number of synapses of one source onto each core.
    """
    count, cores, visited = scratch
    for i in range(rows[0].size):
        for k in range(cores_of_source(i, rows, core_of, count, cores)):
            core = cores[k]
            n = count[core]
            count[core] = 0
            if bits == SHARED:
                pass  # `Incoming.kernels` has the bits of kernels
            elif index.size:
                blocks[core] += bits_of_block(n, bits + index[core])
            else:
                longest[core] = max(longest[core], n)
            if is_new(i, core, visited):
                sends[i] += 1
                axons_in[core] += 1


def projections_by_source(into: Incoming, core_of: Ints, cores: int) -> Iterator[tuple[int, tuple[Any, ...]]]:
    """Yield each projection with spikes, grouped by source population, with arguments for the kernels above.

    Args:
        into: all synapses.
        core_of: core of every neuron, -1 for generators.
        cores: number of cores.

    Yields:
        The index of the projection, its rows, the core of each of its targets, and scratch arrays. The scratch arrays
        count synapses per core, list the reached cores, and mark the cores that a source has reached by an earlier
        projection (empty if no two projections of a source reach the same core).
    """
    target_cores = [core_of[a:b].astype(np.int32) for a, b in zip(into.start[:-1], into.start[1:], strict=True)]
    count, reached_cores = np.zeros((2, cores), dtype=np.int32)
    reached_cores = np.append(reached_cores, np.int32(0))
    has_neurons = np.zeros((len(target_cores), cores), dtype=np.int64)
    for population, core_of_target in enumerate(target_cores):
        has_neurons[population, core_of_target[core_of_target >= 0]] = 1
    by_source: dict[int, list[int]] = {}
    for index, rows in enumerate(into.rows):
        if rows is not None and rows.size:
            by_source.setdefault(into.begins_at[index], []).append(index)
    for source, projections in by_source.items():
        size = int(into.start[source + 1] - into.start[source])
        is_disjoint = bool(np.all(np.sum([has_neurons[into.ends_at[index]] for index in projections], axis=0) <= 1))
        visited = np.zeros((0, 0) if is_disjoint else (size, cores // 8 + 1), dtype=np.uint8)
        for index in projections:
            rows = into.rows[index]
            assert rows is not None
            yield (
                index,
                (
                    (rows.begin, rows.end, rows.targets),
                    target_cores[into.ends_at[index]],
                    (count, reached_cores, visited),
                ),
            )
