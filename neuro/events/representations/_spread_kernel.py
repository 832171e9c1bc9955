"""Spreading events over bins of time."""

# mypy: ignore-errors
import numpy as np

from neuro.kernels.jit import kernel


@kernel
def spread(t, x, y, p, start, stop, separate, signed, timed, out):
    """Add events to the two bins next to them.

    Args:
        t: (n,) int64.
        x: (n,) uint16.
        y: (n,) uint16.
        p: (n,) uint8.
        start: time of the first bin.
        stop: time of the last bin, >= start.
        separate: whether polarity is an axis.
        signed: whether OFF counts -1.
        timed: whether events count their time, from 0 to 1.
        out: (1 or 2, bins, height, width) float, added to.
    """
    last = out.shape[1] - 1
    # As uint64 a difference is right over all of int64.
    length = max(np.float64(np.uint64(stop) - np.uint64(start)), 1.0)
    for k in range(t.shape[0]):
        if t[k] < start or t[k] > stop:
            continue
        passed = np.float64(np.uint64(t[k]) - np.uint64(start))
        place = last * passed / length
        low = min(max(int(place), 0), last)
        above = place - low
        value = 2.0 * p[k] - 1.0 if signed else 1.0
        if timed:
            value *= passed / length
        channel = p[k] if separate else 0
        out[channel, low, y[k], x[k]] += value * (1.0 - above)
        if low < last:
            out[channel, low + 1, y[k], x[k]] += value * above
