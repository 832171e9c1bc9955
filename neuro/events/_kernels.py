# mypy: ignore-errors
"""Loops over the columns of any events: what they reach, and those that are kept."""

from __future__ import annotations

import numpy as np

from neuro.kernels.jit import kernel


@kernel
def survey(t, x, y):
    """Largest x and y, and whether time does not run back."""
    x_max = np.uint16(0)
    y_max = np.uint16(0)
    back = False
    for k in range(t.size):
        x_max = max(x_max, x[k])
        y_max = max(y_max, y[k])
    for k in range(1, t.size):
        back |= t[k] < t[k - 1]
    return x_max, y_max, not back


@kernel
def compact(keep, values, out):
    """keep: bool[n]; values: [n]; out: at least one longer than what is kept, since every value is written first."""
    j = 0
    for k in range(keep.shape[0]):
        out[j] = values[k]
        j += keep[k]
