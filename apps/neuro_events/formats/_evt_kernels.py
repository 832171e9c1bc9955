# mypy: ignore-errors
"""Compiled decoders of EVT 2.1 and EVT 3.0, whose words can contain several events, and an encoder of EVT 3.0."""

from __future__ import annotations

import numpy as np

from neuro.extend import kernel, subkernel
from neuro_events.formats._word_kernels import time_high, word
from neuro_events.formats._words import BEGIN, OTHER, STARTED

TIME, ROW, BASE, ON, LAST_3, STATES_3 = range(3, 9)
"""Indices into the state of EVT 3.0 after `OTHER`, `STARTED` and `STOPPED` (never set). `TIME`: time with all wraps.
`ROW`: row, -1: none. `BASE`: next column of a vector, -1: none. `ON`: polarity of a vector. `LAST_3`: time of the last
event."""

ADDR_Y, ADDR_X, VECT_BASE_X, VECT_12, VECT_8, TIME_LOW, TIME_HIGH = 0, 2, 3, 4, 5, 6, 8
OTHER_ROW = 1
"""Kind of a row of the absolute-intensity pixels of older sensors. The events of such a row are not contrast events."""

FIRST = np.array([0] + [(m & -m).bit_length() - 1 for m in range(1, 4096)], np.uint8)
"""Lowest set bit of each number of 12 bits."""

U = np.uint32


@kernel
def capacity3(words):
    """Return the largest number of events of some words, plus 1, since `decode3` writes one element beyond."""
    n = 1
    for k in range(words.size):
        word = U(words[k])
        kind = word >> U(12)
        bits = word & U(0xFFF if kind == VECT_12 else 0xFF)
        bits -= (bits >> U(1)) & U(0x555)
        bits = (bits & U(0x333)) + ((bits >> U(2)) & U(0x333))
        bits += bits >> U(4)
        bits = (bits & U(0xF)) + ((bits >> U(8)) & U(0xF))
        n += U(kind == ADDR_X) + (bits if (kind == VECT_12) | (kind == VECT_8) else U(0))
    return n


@kernel
def decode3(words, state, t, x, y, p):
    """Decode words.

    Words of rows and of single events share a branch, because a processor cannot predict the order of such words. Both
    kinds are written to the output, but only events advance the index.

    Args:
        words: (n,) uint16.
        state: (STATES_3,) int64, updated; initially 0, and -1 for ROW and BASE.
        t: (`capacity3`,) int64, output, as are the other columns.
        x: uint16.
        y: uint16.
        p: uint8.

    Returns:
        The number of events, the largest x and y, and True if time never runs back.
    """
    n = 0
    x_max = np.int64(0)
    y_max = np.int64(0)
    ordered = True
    other = 0
    k = 0
    while not state[STARTED] and k < words.size:
        if words[k] >> 12 == TIME_HIGH:
            state[STARTED] = 1
            state[TIME] = np.int64(words[k] & 0xFFF) << 12
        else:
            other += 1
            k += 1
    now, row, base, on, last = state[TIME], state[ROW], state[BASE], state[ON], state[LAST_3]
    for at in range(k, words.size):
        word = np.int64(words[at])
        kind = word >> 12
        if kind in (ADDR_X, ADDR_Y):
            value = word & 0x7FF
            single = kind >> 1
            event = single & np.int64(row >= 0)
            other += single - event
            t[n] = now
            x[n] = value
            y[n] = row
            p[n] = (word >> 11) & 1
            n += event
            x_max = max(x_max, value & -event)
            y_max = max(y_max, row & -event)
            ordered &= (now >= last) | (event == 0)
            last = now if event else last
            row = row if single else value
        elif kind == TIME_LOW:
            now = (now & ~0xFFF) | (word & 0xFFF)
        elif kind == TIME_HIGH:
            high = (now >> 12) & 0xFFF
            value = word & 0xFFF
            if value != high:
                now = (((now >> 24) + np.int64(high >= value + 2048)) << 24) | (value << 12)
        elif kind in (VECT_12, VECT_8):
            wide = kind == VECT_12
            bits = word & (0xFFF if wide else 0xFF)
            if row < 0 or base < 0:
                other += 1
                continue
            if bits:
                ordered &= now >= last
                last = now
                y_max = max(y_max, row)
            while bits:
                value = base + FIRST[bits]
                bits &= bits - 1
                t[n] = now
                x[n] = value
                y[n] = row
                p[n] = on
                x_max = max(x_max, value)
                n += 1
            base = min(base + (12 if wide else 8), 0xFF00)
        elif kind == VECT_BASE_X:
            base = word & 0x7FF
            on = (word >> 11) & 1
        else:
            other += 1
            row = -1 if kind == OTHER_ROW else row
    state[TIME], state[ROW], state[BASE], state[ON], state[LAST_3] = now, row, base, on, last
    state[OTHER] += other
    return n, x_max, y_max, ordered


@subkernel
def vector(t, x, y, p, k, start):
    """Return the number of events from `k` on that fit into a vector of 12 columns from `start`, and its bits."""
    bits = 0
    at = k
    column = start
    while at < t.size and t[at] == t[k] and y[at] == y[k] and p[at] == p[k] and column <= x[at] < start + 12:
        bits |= 1 << (x[at] - start)
        column = np.int64(x[at]) + 1
        at += 1
    return at - k, bits


@subkernel
def set_clock(now, time, words, n):
    """Write the words that advance a clock (-1: none yet) to a time, and return the next index.

    A wrap is encoded as the last and the first TIME_HIGH of the range.
    """
    high = now >> 12
    for wrap in range(max(now, 0) >> 24, time >> 24):
        if high != (wrap << 12) | 0xFFF:
            words[n] = (TIME_HIGH << 12) | 0xFFF
            n += 1
        high = (wrap + 1) << 12
        words[n] = TIME_HIGH << 12
        n += 1
    if time >> 12 != high:
        words[n] = (TIME_HIGH << 12) | ((time >> 12) & 0xFFF)
        n += 1
    words[n] = (TIME_LOW << 12) | (time & 0xFFF)
    return n + 1


@kernel
def encode3(t, x, y, p, state, words):
    """Encode events. Three or more events of one row, time and polarity, with rising columns, are encoded as vectors.

    Args:
        t: (n,) int64, us.
        x: (n,) uint16.
        y: (n,) uint16.
        p: (n,) uint8.
        state: [time, row] of the event before, initially [-1, -1]; updated.
        words: (4 n + 2 times the wraps + 1,) uint16, output.

    Returns:
        The number of words.
    """
    n = 0
    k = 0
    now, row = state[0], state[1]
    while k < t.size:
        if t[k] != now:
            n = set_clock(now, t[k], words, n)
            now = t[k]
        if y[k] != row:
            row = np.int64(y[k])
            words[n] = row
            n += 1
        count, bits = vector(t, x, y, p, k, np.int64(x[k]))
        if count < 3:
            words[n] = (ADDR_X << 12) | (np.int64(p[k]) << 11) | x[k]
            n += 1
            k += 1
            continue
        words[n] = (VECT_BASE_X << 12) | (np.int64(p[k]) << 11) | x[k]
        n += 1
        start = np.int64(x[k])
        first = k
        while count and t[k] == t[first] and y[k] == y[first] and p[k] == p[first]:
            words[n] = (VECT_12 << 12) | bits
            n += 1
            k += count
            start += 12
            if k == t.size:
                break
            count, bits = vector(t, x, y, p, k, start)
    state[0], state[1] = now, row
    return n


@kernel
def track3(words, high, kinds):
    """Track TIME_HIGH through words as `decode3` does, without decoding events.

    Args:
        words: (n,) uint16.
        high: bits 12 and above of the time with all wraps, -1 before the first TIME_HIGH.
        kinds: bit mask of the kinds of words so far.

    Returns:
        `high` and `kinds` after the words, and the largest `high`.
    """
    most = high
    for k in range(words.size):
        word = np.int64(words[k])
        kind = word >> 12
        kinds |= 1 << kind
        if kind == TIME_HIGH:
            value = word & 0xFFF
            last = high & 0xFFF
            if high < 0:
                high = value
            elif value != last:
                high = (((high >> 12) + (last >= value + 2048)) << 12) | value
            most = max(most, high)
    return high, kinds, most


WORD_21 = 8
_word = word(4, False)


@kernel
def capacity21(upper, data):
    """Return the largest number of events of EVT 2.1 words; `upper` as for `decode21`."""
    n = 0
    for at in range(0, data.size - WORD_21 + 1, WORD_21):
        if _word(data, at + 4 * upper) >> U(28) < 2:
            bits = _word(data, at + 4 - 4 * upper)
            bits -= (bits >> U(1)) & U(0x55555555)
            bits = (bits & U(0x33333333)) + ((bits >> U(2)) & U(0x33333333))
            bits = (bits + (bits >> U(4))) & U(0x0F0F0F0F)
            n += ((bits * U(0x01010101)) >> U(24)) & U(0x3F)
    return n


@kernel
def decode21(upper, data, state, t, x, y, p):
    """Decode EVT 2.1.

    Args:
        upper: position of the half of a word with kind, time, column and row, 0 or 1. The other half is the bit mask of
            pixels with an event.
        data: (n,) uint8.
        state: see the layout of EVT 2.0.
        t: (`capacity21`,) int64, output, as are the other columns.
        x: uint16.
        y: uint16.
        p: uint8.

    Returns:
        See `Decoder.decode`.
    """
    n = 0
    x_max = U(0)
    y_max = U(0)
    ordered = True
    begin = state[BEGIN]
    last = np.int64(-1)
    used = data.size // WORD_21 * WORD_21
    for at in range(0, used, WORD_21):
        word_ = _word(data, at + 4 * upper)
        kind = word_ >> U(28)
        if kind < 2 and state[STARTED]:
            now = begin + np.int64((word_ >> U(22)) & U(0x3F))
            column = (word_ >> U(11)) & U(0x7FF)
            row = word_ & U(0x7FF)
            bits = _word(data, at + 4 - 4 * upper)
            while bits:
                if bits & U(1):
                    t[n] = now
                    x[n] = column
                    y[n] = row
                    p[n] = kind
                    x_max = max(x_max, column)
                    y_max = max(y_max, row)
                    ordered &= now >= last
                    last = now
                    n += 1
                bits >>= U(1)
                column += U(1)
        elif kind == TIME_HIGH:
            begin = time_high(state, np.int64(word_ & U(0x0FFFFFFF)))
        else:
            state[OTHER] += 1
    state[BEGIN] = begin
    return n, used, x_max, y_max, ordered
