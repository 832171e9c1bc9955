"""Counting events per pixel."""

# mypy: ignore-errors
from neuro.kernels.jit import kernel


@kernel
def count(x, y, p, ranges, separate, signed, out):
    """Add events to frames.

    Args:
        x: (n,) uint16.
        y: (n,) uint16.
        p: (n,) uint8.
        ranges: (segments, 2) int64.
        separate: whether polarity is an axis.
        signed: whether OFF counts -1.
        out: (segments, 1 or 2, height, width) int32, added to.
    """
    for s in range(ranges.shape[0]):
        for k in range(ranges[s, 0], ranges[s, 1]):
            channel = p[k] if separate else 0
            out[s, channel, y[k], x[k]] += 2 * p[k] - 1 if signed else 1
