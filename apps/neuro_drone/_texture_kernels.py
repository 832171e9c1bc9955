# mypy: ignore-errors
"""Compiled loops of the ground's pattern."""

from math import floor, log2

import numpy as np

from neuro.apps import subkernel

RUN = 8
"""Pixels of a row that take one level of the pattern."""
HIGHEST = 64.0
"""Level of what is at the horizon or above."""


@subkernel
def texel(levels, start, mask, i, j):
    """A texel of the tile, which is repeated. All are unsigned, so that no index is from the end."""
    return levels[start + (j & mask) * (mask + np.uint64(1)) + (i & mask)]


@subkernel
def lookup(levels, start, size, x, y):
    """Bilinear mean of the four texels round a place. x, y: texels of this level, middles at halves."""
    left, upper = floor(x - 0.5), floor(y - 0.5)
    a, b = np.float32(x - 0.5 - left), np.float32(y - 0.5 - upper)
    i, j, one, start = np.uint64(left), np.uint64(upper), np.uint64(1), np.uint64(start)
    mask = np.uint64(size - 1)
    upper_left, lower_left = texel(levels, start, mask, i, j), texel(levels, start, mask, i, j + one)
    above = upper_left + a * (texel(levels, start, mask, i + one, j) - upper_left)
    below = lower_left + a * (texel(levels, start, mask, i + one, j + one) - lower_left)
    return above + b * (below - above)


@subkernel
def sharpness(matrix, focal, middle, wide, out):
    """Logarithm (2) of the longer side of a pixel on the ground, in texels, in the middle of each run; at least 0.

    It is the same for any heading and place. wide: size of a texel, m. out: (height, runs).
    """
    for row in range(out.shape[0]):
        for run in range(out.shape[1]):
            a, b = (run * RUN + 0.5 * (RUN - 1) - middle) / focal, (row - middle) / focal
            fall = -(a * matrix[0, 2] + b * matrix[1, 2] + matrix[2, 2])
            out[row, run] = HIGHEST
            if fall * focal > 1.0:
                x = (a * matrix[0, 0] + b * matrix[1, 0] + matrix[2, 0]) / fall
                y = (a * matrix[0, 1] + b * matrix[1, 1] + matrix[2, 1]) / fall
                across = (matrix[0, 0] + x * matrix[0, 2]) ** 2 + (matrix[0, 1] + y * matrix[0, 2]) ** 2
                along = (matrix[1, 0] + x * matrix[1, 2]) ** 2 + (matrix[1, 1] + y * matrix[1, 2]) ** 2
                square = max(across, along) * (matrix[3, 2] / (focal * fall * wide)) ** 2
                out[row, run] = 0.5 * log2(max(square, 1.0))


@subkernel
def places(row, matrix, focal, middle, x, y):
    """Where the pixels of a row meet the ground, m; anywhere where they do not."""
    b = (row - middle) / focal
    height = matrix[3, 2]
    for column in range(x.size):
        a = (column - middle) / focal
        fall = -(a * matrix[0, 2] + b * matrix[1, 2] + matrix[2, 2])
        reach = height / (fall if fall * focal > 1.0 else 1.0)
        x[column] = matrix[3, 0] + reach * (a * matrix[0, 0] + b * matrix[1, 0] + matrix[2, 0])
        y[column] = matrix[3, 1] + reach * (a * matrix[0, 1] + b * matrix[1, 1] + matrix[2, 1])


@subkernel
def textured_ground(matrix, focal, middle, levels, size, wide, sharp, x, y, base):
    """Replace the ground of a base by a pattern; where that is one shade for its distance, the base stays.

    A pixel is the mean over a square as wide as its longer side on the ground: bilinear in the two levels of the
    pattern next to that width, and straight between them by its logarithm. levels: of `texture.pyramid`; size: texels
    of a side of the first; wide: size of a texel, m; sharp: of `sharpness`; x, y: (width,), buffers.
    """
    top = log2(size)
    for row in range(base.shape[0]):
        places(row, matrix, focal, middle, x, y)
        for run in range(sharp.shape[1]):
            level = sharp[row, run]
            if level >= top:
                continue
            lower = int(level)
            share = np.float32(level - lower)
            side = size >> lower
            start = (size * size - side * side) // 3 * 4
            scale = 1.0 / (wide * (1 << lower))
            for column in range(run * RUN, min(run * RUN + RUN, x.size)):
                fine = lookup(levels, start, side, scale * x[column], scale * y[column])
                coarse = lookup(
                    levels, start + side * side, side >> 1, 0.5 * scale * x[column], 0.5 * scale * y[column]
                )
                base[row, column] = fine + share * (coarse - fine)
