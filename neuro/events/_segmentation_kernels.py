# mypy: ignore-errors
"""Compiled loops of `neuro.events.segmentation`."""

from math import exp

from numba import njit


@njit(cache=True)
def msd(t, tau_us, threshold, bounds):
    """t: int64[n]; bounds: int64[n + 1], bounds[0] = 0. Returns the number of segments."""
    n = 0
    v = 0.0
    last = t[0] if t.shape[0] else 0
    for k in range(t.shape[0]):
        v = v * exp((last - t[k]) / tau_us) + 1.0
        last = t[k]
        if v >= threshold:
            n += 1
            bounds[n] = k + 1
            v = 0.0
    return n
