"""Splitting the events of an AEDAT 4 packet into columns."""

# mypy: ignore-errors
import numpy as np
from numba import njit


@njit(cache=True)
def split(events, t, x, y, p):
    """Copy events into columns.

    Args:
        events: (n,) records with t int64, x and y int16, p uint8.
        t: int64, filled.
        x: uint16, filled.
        y: uint16, filled.
        p: uint8, filled with 0 or 1.

    Returns:
        largest x and y (a negative one counts as 2^16 plus itself), whether time does not run back among the events.
    """
    x_max = np.uint16(0)
    y_max = np.uint16(0)
    back = False
    last = np.int64(np.iinfo(np.int64).min)
    for k in range(events.size):
        now = events[k].t
        column = np.uint16(events[k].x)
        row = np.uint16(events[k].y)
        back |= now < last
        last = now
        t[k] = now
        x[k] = column
        y[k] = row
        p[k] = events[k].p != 0
        x_max = max(x_max, column)
        y_max = max(y_max, row)
    return x_max, y_max, not back
