# mypy: ignore-errors
"""Decoding the words of EVT 2.0 and EVT 2.1."""

from __future__ import annotations

import numpy as np

from neuro.kernels.jit import kernel, subkernel

OTHER, STARTED, HIGH, WRAPS, LAST, STATES = range(6)
"""State: words left out; whether a TIME_HIGH was seen; its value; us that wraps add; last time."""

NEAR_WRAP = (1 << 28) // 16
T_BITS = 34
BLOCK = 64
"""Words that are looked at together: where all are events, as most are, they go a faster way."""

U = np.uint32


@subkernel
def time_high(state, value):
    """A new TIME_HIGH: the time of events whose low bits are 0."""
    if state[HIGH] >= (1 << 28) - NEAR_WRAP and value < NEAR_WRAP:
        state[WRAPS] += 1 << T_BITS
    state[STARTED] = 1
    state[HIGH] = value
    return state[WRAPS] + (value << 6)


@subkernel
def decode_events(words, begin, t, x, y, p):
    """Decode words that are all events, without a branch, so that the compiler makes vector instructions of it.

    Returns:
        largest column and row as a word has them together, largest row, whether low times do not run back.
    """
    place = U(0)
    row = U(0)
    back = U(0)
    before = U(0)
    for k in range(words.size):
        word = words[k]
        low = (word >> U(22)) & U(0x3F)
        t[k] = begin + np.int64(low)
        x[k] = (word >> U(11)) & U(0x7FF)
        y[k] = word & U(0x7FF)
        p[k] = word >> U(28)
        place = max(place, word & U(0x3FFFFF))
        row = max(row, word & U(0x7FF))
        back |= U(low < before)
        before = low
    return place, row, back == 0


@kernel
def decode(words, state, t, x, y, p):
    """Decode EVT 2.0.

    Args:
        words: (n,) uint32.
        state: (STATES,) int64, zeros at first, changed.
        t: (n,) int64, filled.
        x: (n,) uint16, filled.
        y: (n,) uint16, filled.
        p: (n,) uint8, filled.

    Returns:
        number of events, largest x and y, whether time does not run back.
    """
    n = 0
    place = U(0)
    row = U(0)
    ordered = True
    begin = state[WRAPS] + (state[HIGH] << 6)
    last = state[LAST]
    for first in range(0, words.size, BLOCK):
        block = words[first : first + BLOCK]
        kinds = U(0)
        for k in range(block.size):
            kinds |= block[k]
        if kinds >> U(29) == 0 and state[STARTED]:
            most, low, whole = decode_events(block, begin, t[n:], x[n:], y[n:], p[n:])
            place = max(place, most)
            row = max(row, low)
            ordered &= whole & (t[n] >= last)
            n += block.size
            last = t[n - 1]
            continue
        for k in range(block.size):
            word = block[k]
            if word >> U(29) == 0 and state[STARTED]:
                now = begin + np.int64((word >> U(22)) & U(0x3F))
                t[n] = now
                x[n] = (word >> U(11)) & U(0x7FF)
                y[n] = word & U(0x7FF)
                p[n] = word >> U(28)
                place = max(place, word & U(0x3FFFFF))
                row = max(row, word & U(0x7FF))
                ordered &= now >= last
                last = now
                n += 1
            elif word >> U(28) == 8:
                begin = time_high(state, np.int64(word & U(0x0FFFFFFF)))
            else:
                state[OTHER] += 1
    state[LAST] = last
    return n, place >> U(11), row, ordered


@kernel
def room21(words):
    """Events that EVT 2.1 words have at most."""
    n = 0
    for k in range(words.size // 2):
        if words[2 * k + 1] >> U(28) < 2:
            bits = words[2 * k]
            bits -= (bits >> U(1)) & U(0x55555555)
            bits = (bits & U(0x33333333)) + ((bits >> U(2)) & U(0x33333333))
            bits = (bits + (bits >> U(4))) & U(0x0F0F0F0F)
            n += ((bits * U(0x01010101)) >> U(24)) & U(0x3F)
    return n


@kernel
def decode21(words, state, t, x, y, p):
    """Decode EVT 2.1.

    Args:
        words: (2 n,) uint32, the pixels that have an event, then kind, time and place.
        state: as of `decode`.
        t: (`room21`,) int64, filled, as are the others.
        x: uint16.
        y: uint16.
        p: uint8.

    Returns:
        as `decode`.
    """
    n = 0
    x_max = U(0)
    y_max = U(0)
    ordered = True
    begin = state[WRAPS] + (state[HIGH] << 6)
    last = state[LAST]
    for k in range(words.size // 2):
        word = words[2 * k + 1]
        kind = word >> U(28)
        if kind < 2 and state[STARTED]:
            now = begin + np.int64((word >> U(22)) & U(0x3F))
            column = (word >> U(11)) & U(0x7FF)
            row = word & U(0x7FF)
            bits = words[2 * k]
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
        elif kind == 8:
            begin = time_high(state, np.int64(word & U(0x0FFFFFFF)))
        else:
            state[OTHER] += 1
    state[LAST] = last
    return n, x_max, y_max, ordered


@kernel
def decode_dat(words, side, shift, up, t, x, y, p):
    """Decode events; one simple loop, which the compiler turns into vector instructions.

    Args:
        words: (2 n,) uint32, time and address in turn.
        side: bits of x, all set.
        shift: bit at which y begins; its bits end below `up`.
        up: bit of the polarity.
        t: (n,) int64, filled with the 32-bit times as they are.
        x: (n,) uint16, filled.
        y: (n,) uint16, filled.
        p: (n,) uint8, filled.

    Returns:
        largest x and y, whether time does not run back, all addresses or-ed.
    """
    x_max = U(0)
    y_max = U(0)
    seen = U(0)
    back = U(0)
    rows = (U(1) << U(up - shift)) - U(1)
    last = U(0)
    for k in range(t.size):
        now = words[2 * k]
        address = words[2 * k + 1]
        column = address & U(side)
        row = (address >> U(shift)) & rows
        t[k] = now
        x[k] = column
        y[k] = row
        p[k] = (address >> U(up)) & U(1)
        x_max = max(x_max, column)
        y_max = max(y_max, row)
        seen |= address
        back |= U(now < last)
        last = now
    return x_max, y_max, back == 0, seen
