"""All synapses of a program by the neuron on which they end: what placing looks at."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from neuro.chips.placing.fan_out import spiking
from neuro.chips.placing.fill import scatter, scatter_all, scatter_rows
from neuro.chips.placing.packing import synapse_bits
from neuro.program.program import Grid, Ints, Program


@dataclass(frozen=True, slots=True, eq=False)
class Incoming:
    """Synapses by target. A line is one source neuron of one projection; all populations' neurons are numbered through.

    Attributes:
        start: the number of each population's first neuron, and the number of all neurons.
        ends: synapses onto neuron t are ends[t] : ends[t + 1], by projection.
        line: the line of each synapse.
        first: the first line of each projection, and the number of all lines; a projection without spikes has none.
        source: the neuron of each line.
        projection: the projection of each line.
        bits: of one synapse of each projection in Loihi's blocks, without its index.
        sources: source neurons of each projection.
        synapses: of each projection, a grid's spelled out.
    """

    start: Ints
    ends: Ints
    line: NDArray[np.int32]
    first: Ints
    source: NDArray[np.int32]
    projection: NDArray[np.int32]
    bits: Ints
    sources: Ints
    synapses: Ints


def incoming(program: Program) -> Incoming:
    """Spell out all synapses of a program that carry spikes."""
    sizes = [part.size for part in program.populations]
    start = np.concatenate([[0], np.cumsum(sizes)]).astype(np.int64)
    carries = set(spiking(program))
    parts = program.projections
    lines = np.array([sizes[p.source] if i in carries else 0 for i, p in enumerate(parts)], dtype=np.int64)
    first = np.concatenate([[0], np.cumsum(lines)]).astype(np.int64)
    pairs = {index: ends_of(program, index) for index in sorted(carries) if parts[index].layout in _LISTED}
    synapses = np.zeros(len(parts), dtype=np.int64)
    ends = np.zeros(start[-1] + 1, dtype=np.int64)
    for index in sorted(carries):
        into, each = parts[index].target, _onto(program, index, pairs)
        synapses[index] = each.sum()
        ends[start[into] + 1 : start[into + 1] + 1] += each
    np.cumsum(ends, out=ends)
    line = np.zeros(synapses.sum(), dtype=np.int32)
    position = ends[:-1].copy()
    for index in sorted(carries):
        _enter(program, index, pairs, first[index], position[start[parts[index].target] :], line)
    starts = [start[p.source] + np.arange(n) for p, n in zip(parts, lines, strict=True)]
    return Incoming(
        start=start,
        ends=ends,
        line=line,
        first=first,
        source=np.concatenate([np.zeros(0, dtype=np.int64), *starts]).astype(np.int32),
        projection=np.repeat(np.arange(len(parts), dtype=np.int32), lines),
        bits=np.array([synapse_bits(program, index) for index in range(len(parts))], dtype=np.int64),
        sources=lines,
        synapses=synapses,
    )


_LISTED = ("grid", "one_to_one")
"""Layouts whose synapses are listed; the others are counted and entered as they lie."""

_Pairs = dict[int, tuple[Ints, Ints]]


def _onto(program: Program, index: int, pairs: _Pairs) -> Ints:
    """Synapses of a projection onto each of its targets."""
    part = program.projections[index]
    n_source, n_target = (program.populations[k].size for k in (part.source, part.target))
    if part.layout == "dense":
        return np.full(n_target, n_source, dtype=np.int64)
    return np.bincount(pairs[index][1] if index in pairs else part.targets, minlength=n_target)


def _enter(program: Program, index: int, pairs: _Pairs, first: int, position: Ints, line: NDArray[np.int32]) -> None:
    """Enter the synapses of a projection behind those that their targets already have."""
    part = program.projections[index]
    if index in pairs:
        scatter(*pairs[index], first, position, line)
    elif part.layout == "dense":
        scatter_all(program.populations[part.source].size, program.populations[part.target].size, first, position, line)
    else:
        scatter_rows(part.row_ends, part.targets, first, position, line)


def ends_of(program: Program, index: int) -> tuple[Ints, Ints]:
    """Source and target of every synapse of a projection, those of a grid spelled out."""
    g = program.projections[index].grid
    return program.connections(index) if g is None else _grid_ends(g)


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
