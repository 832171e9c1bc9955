"""Decoding and encoding the bytes of Event Stream's DVS events."""

# mypy: ignore-errors
import numpy as np

from neuro.kernels.jit import kernel

EVENT = 5
OVERFLOW = 0xFF
RESET = 0xFE
OVERFLOW_US = 127


@kernel
def decode(data, now, t, x, y, p):
    """Decode bytes that begin with an event or between events.

    Args:
        data: (n,) uint8.
        now: us, time so far.
        t: at least (n // 5,) int64, filled.
        x: as long, uint16, filled.
        y: as long, uint16, filled.
        p: as long, uint8, filled.

    Returns:
        number of events, of bytes used (fewer than there are where the last event is cut), largest x and y, and time.
    """
    n = 0
    at = 0
    x_max = np.uint16(0)
    y_max = np.uint16(0)
    size = data.size
    while at < size:
        first = data[at]
        if first >= RESET:
            now += OVERFLOW_US if first == OVERFLOW else 0
            at += 1
            continue
        if at + EVENT > size:
            break
        now += first >> 1
        column = np.uint16(data[at + 1]) | np.uint16(data[at + 2]) << np.uint16(8)
        row = np.uint16(data[at + 3]) | np.uint16(data[at + 4]) << np.uint16(8)
        t[n] = now
        x[n] = column
        y[n] = row
        p[n] = first & 1
        x_max = max(x_max, column)
        y_max = max(y_max, row)
        n += 1
        at += EVENT
    return n, at, x_max, y_max, now


@kernel
def begins(data, event):
    """The byte at which an event begins, of bytes that `decode` took."""
    at = 0
    while True:
        if data[at] >= RESET:
            at += 1
        elif event == 0:
            return at
        else:
            event -= 1
            at += EVENT


@kernel
def encode(t, x, y, p, now, out):
    """Encode events.

    Args:
        t: (n,) int64.
        x: (n,) uint16.
        y: (n,) uint16.
        p: (n,) uint8.
        now: us, time of the event before.
        out: (5 n and one for each whole 127 us between events,) uint8, filled.
    """
    at = 0
    for k in range(t.size):
        gap = t[k] - now
        now = t[k]
        while gap >= OVERFLOW_US:
            out[at] = OVERFLOW
            gap -= OVERFLOW_US
            at += 1
        out[at] = gap << 1 | p[k]
        out[at + 1] = x[k] & 0xFF
        out[at + 2] = x[k] >> 8
        out[at + 3] = y[k] & 0xFF
        out[at + 4] = y[k] >> 8
        at += EVENT
