"""All synapses of a program as placing looks at them: by the neuron that sends, and by the one on which they end.

Beside them stands how many synapses a spike of a projection travels along, and the projection's size as a dense layer.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from neuro.chips.placing.fill import onto, scatter
from neuro.chips.placing.packing import SHARED, columns_per_core, has_kernel, kernel_bits, synapse_bits
from neuro.program.program import Floats, Grid, Ints, Program, Projection


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
        sources: source neurons of each projection.
        synapses: of each projection, a grid's spelled out.
    """

    start: Ints
    rows: tuple[IncomingRows | None, ...]
    begins_at: tuple[int, ...]
    ends_at: tuple[int, ...]
    first: Ints
    bits: Ints
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
        source, target = _grid_ends(part.grid)
        ends = np.concatenate([[0], np.cumsum(np.bincount(source, minlength=n_source))])
        return IncomingRows(ends[:-1], ends[1:], target[np.argsort(source, kind="stable")].astype(np.int32))
    if part.layout == "dense":
        begin, end = np.zeros(n_source, dtype=np.int64), np.full(n_source, n_target, dtype=np.int64)
        return IncomingRows(begin, end, np.arange(n_target, dtype=np.int32))
    if part.layout == "one_to_one":
        each = np.arange(n_source, dtype=np.int64)
        return IncomingRows(each, each + 1, np.arange(n_source, dtype=np.int32))
    return IncomingRows(part.row_ends[:-1], part.row_ends[1:], part.targets)


def _grid_ends(g: Grid) -> tuple[Ints, Ints]:
    """A neuron at (row, column) sees the kernel's window of its channels, as far as it lies inside; all maps alike."""
    y = _window(g.rows, g.top, g.kernel_height, g.stride)[:, None, None, :, None]
    x = _window(g.columns, g.left, g.kernel_width, g.stride)[None, :, None, None, :]
    channel = np.arange(g.kernels[1])[None, None, :, None, None]
    inside = (channel >= 0) & (y >= 0) & (y < g.height) & (x >= 0) & (x < g.width)
    place = np.arange(g.rows * g.columns).reshape(g.rows, g.columns, 1, 1, 1)
    source = ((channel * g.height + y) * g.width + x)[inside]
    target = np.broadcast_to(place, inside.shape)[inside]
    maps = np.arange(g.maps)[:, None]
    first = maps // g.reach * (g.height * g.width)
    return (source + first).reshape(-1), (target + maps * (g.rows * g.columns)).reshape(-1)


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
        return _grid_fan_out(part.grid, counts)
    if part.layout == "one_to_one":
        return counts
    if part.layout == "dense":
        return np.asarray(counts.reshape(n_pre, -1).sum(axis=1))
    return _csr_fan_out(part, counts)


def _csr_fan_out(part: Projection, counts: Ints) -> Ints:
    before = np.concatenate([[0], np.cumsum(counts)])
    return np.asarray(np.diff(before[part.row_ends]))


def _grid_fan_out(g: Grid, counts: Ints) -> Ints:
    """A source meets each weight of its channel once for every place of the kernel that puts it there."""
    of_maps = counts.reshape(-1, g.reach, *g.kernels[1:])  # of a depthwise grid by channel
    kernels = of_maps.sum(axis=1).reshape(g.channels, g.kernel_height, g.kernel_width)
    rows = _meets(g.height, g.top, g.kernel_height, g.rows, g.stride)
    columns = _meets(g.width, g.left, g.kernel_width, g.columns, g.stride)
    return np.asarray(np.einsum("yk,ckl,xl->cyx", rows, kernels, columns).reshape(-1))


def _meets(length: int, before: int, kernel: int, places: int, stride: int) -> NDArray[np.int64]:
    """Whether the kernel has a place at which its line k lies on line y, shape (length, kernel)."""
    offset = np.arange(length)[:, None] + before - np.arange(kernel)[None, :]
    place, rest = np.divmod(offset, stride)
    return np.asarray((rest == 0) & (place >= 0) & (place < places), dtype=np.int64)
