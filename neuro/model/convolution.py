"""A convolution as pairs, where its stride, dilation or groups are not those of a `grid`."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Ints = NDArray[np.int64]
Two = tuple[int, int]


def out_size(size: Two, kernel: Two, stride: Two, padding: Two, dilation: Two) -> Two:
    """Rows and columns of a convolution of a sheet of some rows and columns."""
    rows, columns = (
        (n + 2 * p - d * (k - 1) - 1) // s + 1
        for n, k, s, p, d in zip(size, kernel, stride, padding, dilation, strict=True)
    )
    return rows, columns


def synapses_of(
    shape: tuple[int, int, int], kernel: NDArray[np.float64], stride: Two, padding: Two, dilation: Two, groups: int
) -> tuple[Ints, Ints, NDArray[np.float64]]:
    """Source, target and weight of each synapse, where the kernel is laid on the source as it is (a correlation).

    Args:
        shape: channels, rows and columns of the source.
        kernel: (maps, channels / groups, height, width).
        stride: of the kernel, down and across.
        padding: silent lines above and below, and left and right.
        dilation: steps from one entry of the kernel to the next, down and across.
        groups: into which channels and maps are divided in order.

    Returns:
        ids count channels, then rows, then columns; weights of 0 are left out.
    """
    _, height, width = shape
    maps, depth, *size = kernel.shape
    rows, columns = out_size((height, width), (size[0], size[1]), stride, padding, dilation)
    m, k, i, j = (index.ravel() for index in np.nonzero(kernel))
    r, c = (index.ravel() for index in np.indices((rows, columns)))
    y = r[None, :] * stride[0] + (i * dilation[0] - padding[0])[:, None]
    x = c[None, :] * stride[1] + (j * dilation[1] - padding[1])[:, None]
    inside = (y >= 0) & (y < height) & (x >= 0) & (x < width)
    channel = (m // (maps // groups) * depth + k)[:, None]
    pre = ((channel * height + y) * width + x)[inside]
    post = ((m[:, None] * rows + r[None, :]) * columns + c[None, :])[inside]
    weight = np.broadcast_to(kernel[m, k, i, j][:, None], inside.shape)[inside]
    return pre.astype(np.int64), post.astype(np.int64), weight
