"""Surfaces: marking and leaking pixels, and reading all of them."""

# mypy: ignore-errors
from math import exp

import numpy as np

from neuro.kernels.jit import inner, kernel

NEVER = np.iinfo(np.int64).min


@inner
def passed(before, now):
    """From one time to a later one, us; subtracted as uint64, which is right over all of int64."""
    return np.float64(np.uint64(now) - np.uint64(before))


@kernel
def mark(t, x, y, p, separate, last):
    """Note the time of each pixel's last event in last, int64 (1 or 2, height, width)."""
    for k in range(t.shape[0]):
        last[p[k] if separate else 0, y[k], x[k]] = t[k]


@kernel
def ages(last, now, tau, linear, out):
    """Read the surface of last, int64 (pixels,), at a time into out, float (pixels,)."""
    for i in range(last.shape[0]):
        if last[i] == NEVER:
            out[i] = 0.0
        elif linear:
            out[i] = max(0.0, 1.0 - passed(last[i], now) / tau)
        else:
            out[i] = exp(-passed(last[i], now) / tau)


@kernel
def leak(t, x, y, p, before, options, values, value, since):
    """Add events to leaky pixels.

    Args:
        t: (n,) int64.
        x: (n,) uint16.
        y: (n,) uint16.
        p: (n,) uint8.
        before: time of the event before the first.
        options: whether polarity is an axis, decay is linear, and events count from the event before them.
        values: tau and increment.
        value: (1 or 2, height, width) float64 of the pixels.
        since: (1 or 2, height, width) int64, the time that the value is of.
    """
    separate, linear, late = options
    tau, increment = values
    for k in range(t.shape[0]):
        when = before if late else t[k]
        before = t[k]
        c = p[k] if separate else 0
        u = value[c, y[k], x[k]]
        if u > 0.0:
            gone = passed(since[c, y[k], x[k]], when) / tau
            u = max(0.0, u - gone) if linear else u * exp(-gone)
        value[c, y[k], x[k]] = u + increment
        since[c, y[k], x[k]] = when


@kernel
def leaked(value, since, now, tau, linear, out):
    """Read leaky pixels, float64 and int64 (pixels,), at a time into out, float (pixels,)."""
    for i in range(value.shape[0]):
        if value[i] == 0.0:
            out[i] = 0.0
        elif linear:
            out[i] = max(0.0, value[i] - passed(since[i], now) / tau)
        else:
            out[i] = value[i] * exp(-passed(since[i], now) / tau)
