# mypy: ignore-errors
"""Leaky values per pixel and polarity, read round each event."""

from math import exp

import numpy as np

from neuro.kernels.jit import inner, kernel

LIMIT = 600.0
"""Time constants after which the unit is set anew; exp(600) is far from the end of float64."""


@kernel
def surfaces(t, x, y, p, tau_us, theta, radius, cell, origin, held, counts, sums, keep):
    """held: float64[height + 2 radius, width + 2 radius, 2]; origin: int64[1], us; counts: int64[rows, columns].

    sums: float64[rows, columns, 2, side, side]; keep: bool[n]. What is held is in units of exp((t - origin) / tau), so
    all values decay at once as the unit grows: an event needs one exponential, and only every 600 tau all are touched.
    Times are subtracted as uint64, which is right over all of int64.
    """
    side = 2 * radius + 1
    for k in range(t.shape[0]):
        age = (np.uint64(t[k]) - np.uint64(origin[0])) / tau_us
        if age > LIMIT:
            held *= exp(-age)
            origin[0] = t[k]
            age = 0.0
        unit = exp(age)
        active = unit
        for row in range(y[k], y[k] + side):
            for column in range(x[k], x[k] + side):
                active += held[row, column, 0] + held[row, column, 1]
        keep[k] = active > theta * unit
        if keep[k]:
            add_surface(unit, x[k], y[k], p[k], radius, cell, held, counts, sums)
        held[y[k] + radius, x[k] + radius, p[k]] += unit


@inner
def add_surface(unit, x, y, p, radius, cell, held, counts, sums):
    """Add what the neighbours in the event's cell hold to the sum of the cell."""
    cell_row, cell_column = y // cell, x // cell
    counts[cell_row, cell_column] += 1
    first_row, first_column = cell_row * cell - y + radius, cell_column * cell - x + radius
    side = 2 * radius + 1
    for i in range(max(0, first_row), min(side, first_row + cell)):
        for j in range(max(0, first_column), min(side, first_column + cell)):
            sums[cell_row, cell_column, p, i, j] += held[y + i, x + j, p] / unit
