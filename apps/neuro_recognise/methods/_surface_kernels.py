# mypy: ignore-errors
"""Compiled loops of `neuro_recognise.methods.tar_hats`."""

import math

from neuro.apps import kernel


@kernel
def last_surfaces(t, x, y, p, cell, tau_us, last, sums, counts):
    """Add to each cell what its events see: exp(-age / tau) of the last event of their polarity at each pixel round.

    t: int64[n]; x, y: uint16[n]; p: uint8[n]; last: int64[2, height + 2 radius, width + 2 radius], long ago where there
    was none; sums: float64[rows, columns, 2, side, side]; counts: int64[rows, columns]. An event sees itself.
    """
    side = sums.shape[3]
    radius = side // 2
    for k in range(len(t)):
        last[p[k], y[k] + radius, x[k] + radius] = t[k]
        seen = sums[y[k] // cell, x[k] // cell, p[k]]
        counts[y[k] // cell, x[k] // cell] += 1
        for i in range(side):
            for j in range(side):
                age = t[k] - last[p[k], y[k] + i, x[k] + j]
                seen[i, j] += math.exp(-age / tau_us)
