"""Splitting the events of an AEDAT 4 packet into columns."""

# mypy: ignore-errors
import numpy as np
from numba import njit


@njit(cache=True)
def split(events, t, x, y, p, at):
    """Copy events into columns.

    Args:
        events: (n,) records with t int64, x and y int16, p uint8.
        t: int64, filled from `at` on.
        x: uint16, filled.
        y: uint16, filled.
        p: uint8, filled with 0 or 1.
        at: first place to fill.

    Returns:
        largest x and y (a negative one counts as 2^16 plus itself), whether time does not run back among the events.
    """
    x_max = np.uint16(0)
    y_max = np.uint16(0)
    back = False
    last = events[0].t
    for k in range(events.size):
        now = events[k].t
        column = np.uint16(events[k].x)
        row = np.uint16(events[k].y)
        back |= now < last
        last = now
        t[at + k] = now
        x[at + k] = column
        y[at + k] = row
        p[at + k] = events[k].p != 0
        x_max = max(x_max, column)
        y_max = max(y_max, row)
    return x_max, y_max, not back
