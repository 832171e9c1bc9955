"""How many synapses the spikes of a projection travel along, and how large it is as a dense layer."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from neuro.program.program import Floats, Grid, Ints, Program, Projection


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
