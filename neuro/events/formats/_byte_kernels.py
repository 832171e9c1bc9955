# mypy: ignore-errors
"""Decoding the words of N-MNIST and Event Stream, of 5 bytes, and of AEDAT 2.0 and 3.1, of 8; encoding Event Stream."""

from __future__ import annotations

import numpy as np

from neuro.kernels.jit import kernel, subkernel

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


AEDAT2_WORD = 8
T_WRAP = 1 << 32
T_HALF = 1 << 31


@kernel
def decode_aedat2(words, layout, clock, skipped, t, x, y, p):
    """Decode words up to the first that is none of the chip.

    Args:
        words: (8 n,) uint8.
        layout: shift and mask of x, shift and mask of y, shift of the polarity, what it is where ON, bits of samples,
            bits of external events, bits that no word has; where addresses count down -1, width and height, px,
            else 0 three times.
        clock: (2,) int64, the last 32-bit time (-1 before the first) and us added to it; both are brought up to date.
        skipped: (2,) int64, samples and external events; they are counted on.
        t: (n,) int64, filled.
        x: (n,) uint16, filled.
        y: (n,) uint16, filled.
        p: (n,) uint8, filled.

    Returns:
        number of events and of words, largest x and y, and whether time does not run back.
    """
    x_shift, x_mask, y_shift, y_mask, p_shift, on, sample, external, unused, turn, width, height = layout
    last = clock[0]
    begin = clock[1]
    n = 0
    x_max = np.int64(0)
    y_max = np.int64(0)
    ordered = True
    before = np.int64(-1)
    done = t.size
    for k in range(t.size):
        at = AEDAT2_WORD * k
        address = (
            np.int64(words[at]) << 24 | np.int64(words[at + 1]) << 16 | np.int64(words[at + 2]) << 8 | words[at + 3]
        )
        raw = (
            np.int64(words[at + 4]) << 24 | np.int64(words[at + 5]) << 16 | np.int64(words[at + 6]) << 8 | words[at + 7]
        )
        if address & unused:
            done = k
            break
        if raw - last < -T_HALF:
            begin += T_WRAP
        elif last >= 0 and begin > 0 and raw - last > T_HALF:
            begin -= T_WRAP
        last = raw
        if address & (sample | external):
            skipped[0 if address & sample else 1] += 1
            continue
        # Turned it is width - 1 - address, with e.g. ~5 = -6; an address beyond the sensor gives a column beyond it.
        column = ((address >> x_shift ^ turn) + width) & x_mask
        row = ((address >> y_shift ^ turn) + height) & y_mask
        t[n] = now = begin + raw
        x[n] = column
        y[n] = row
        p[n] = (address >> p_shift & 1) == on
        x_max = max(x_max, column)
        y_max = max(y_max, row)
        ordered &= now >= before
        before = now
        n += 1
    clock[0] = last
    clock[1] = begin
    return n, done, x_max, y_max, ordered


PACKET = 28
AEDAT3_EVENT = 8
POLARITY = 1
OTHER, INVALID = 0, 1


@subkernel
def word(data, at):
    """A little-endian signed 32-bit number."""
    low = np.int64(data[at]) | np.int64(data[at + 1]) << 8 | np.int64(data[at + 2]) << 16 | np.int64(data[at + 3]) << 24
    return low - ((low & 0x80000000) << 1)


@subkernel
def wrong(data, at):
    """Whether these are not the sizes of a packet: events, their bytes and their times have none below zero."""
    size, offset = word(data, at + 4), word(data, at + 8)
    capacity, number, valid = word(data, at + 16), word(data, at + 20), word(data, at + 24)
    kind = np.int64(data[at]) | np.int64(data[at + 1]) << 8
    counts = size <= 0 or not 0 <= valid <= number <= capacity
    return counts or not 0 <= offset < size or word(data, at + 12) < 0 or (kind == POLARITY and size != AEDAT3_EVENT)


@kernel
def decode_aedat3(data, source, state, left_out, t, x, y, p):
    """Decode bytes that begin where `state` says.

    Args:
        data: (n,) uint8.
        source: number of the camera, -1 for all.
        state: (3,) int64: bytes to skip, polarity events that the packet still has, us to add to them; kept up to date.
        left_out: (2,) int64: events of other kinds or cameras, and invalid ones; they are counted on.
        t: at least (n // 8,) int64, filled.
        x: as long, uint16, filled.
        y: as long, uint16, filled.
        p: as long, uint8, filled.

    Returns:
        number of events and of bytes used, largest x and y, whether time does not run back, and whether the packet that
        follows is none.
    """
    n = 0
    at = np.int64(0)
    x_max = np.int64(0)
    y_max = np.int64(0)
    ordered = True
    before = np.int64(-1)
    skip = state[0]
    left = state[1]
    begin = state[2]
    broken = False
    while not broken:
        step = min(skip, data.size - at)
        at += step
        skip -= step
        here = min(left, (data.size - at) // AEDAT3_EVENT)
        for _ in range(here):
            address = word(data, at)
            if address & 1:
                t[n] = now = begin + word(data, at + 4)
                x[n] = column = address >> 17 & 0x7FFF
                y[n] = row = address >> 2 & 0x7FFF
                p[n] = address >> 1 & 1
                x_max = max(x_max, column)
                y_max = max(y_max, row)
                ordered &= now >= before
                before = now
                n += 1
            else:
                left_out[INVALID] += 1
            at += AEDAT3_EVENT
        left -= here
        if skip or left or at + PACKET > data.size:
            break
        broken = wrong(data, at)
        if not broken:
            kind = np.int64(data[at]) | np.int64(data[at + 1]) << 8
            camera = np.int64(data[at + 2]) | np.int64(data[at + 3]) << 8
            size, number = word(data, at + 4), word(data, at + 20)
            begin = word(data, at + 12) << 31
            wanted = kind == POLARITY and (source < 0 or source == camera)
            left = number if wanted else 0
            skip = 0 if wanted else number * size
            left_out[OTHER] += 0 if wanted else number
            at += PACKET
    state[0], state[1], state[2] = skip, left, begin
    return n, at, x_max, y_max, ordered, broken
