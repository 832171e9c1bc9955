# mypy: ignore-errors
"""Decoding the 5-byte words of N-MNIST."""

from __future__ import annotations

import numpy as np

from neuro.kernels.jit import kernel

WORD = 5
OVERFLOW_ROW = 240
NMNIST_OVERFLOW_US = 1 << 13


@kernel
def decode_nmnist(words, begin, t, x, y, p):
    """Decode words.

    Args:
        words: (5 n,) uint8.
        begin: us added to every time so far.
        t: (n,) int64, filled.
        x: (n,) uint16, filled.
        y: (n,) uint16, filled.
        p: (n,) uint8, filled.

    Returns:
        number of events, largest x and y, whether time does not run back, and us added from here on.
    """
    n = 0
    x_max = np.uint8(0)
    y_max = np.uint8(0)
    ordered = True
    last = np.int64(-1)
    for k in range(t.size):
        at = WORD * k
        row = words[at + 1]
        if row == OVERFLOW_ROW:
            begin += NMNIST_OVERFLOW_US
            continue
        high = words[at + 2]
        now = begin + ((np.int64(high & 0x7F) << 16) | (np.int64(words[at + 3]) << 8) | np.int64(words[at + 4]))
        t[n] = now
        x[n] = words[at]
        y[n] = row
        p[n] = high >> 7
        x_max = max(x_max, words[at])
        y_max = max(y_max, row)
        ordered &= now >= last
        last = now
        n += 1
    return n, x_max, y_max, ordered, begin


EVENT = 5
OVERFLOW = 0xFF
RESET = 0xFE
EVENT_STREAM_OVERFLOW_US = 127


@kernel
def decode_event_stream(data, now, t, x, y, p):
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
            now += EVENT_STREAM_OVERFLOW_US if first == OVERFLOW else 0
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
    """The byte at which an event begins, of bytes that `decode_event_stream` took."""
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
def encode_event_stream(t, x, y, p, now, out):
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
        while gap >= EVENT_STREAM_OVERFLOW_US:
            out[at] = OVERFLOW
            gap -= EVENT_STREAM_OVERFLOW_US
            at += 1
        out[at] = gap << 1 | p[k]
        out[at + 1] = x[k] & 0xFF
        out[at + 2] = x[k] >> 8
        out[at + 3] = y[k] & 0xFF
        out[at + 4] = y[k] >> 8
        at += EVENT
