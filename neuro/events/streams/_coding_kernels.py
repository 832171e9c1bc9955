# mypy: ignore-errors
"""Decoding datagrams where they lie in the ring, and what all codings share: clocks that wrap, sensors that end."""

from __future__ import annotations

import numpy as np

from neuro.events.formats._evt_kernels import BASE, ROW, STATES_3, TIME_HIGH, decode3, room3
from neuro.events.streams._ring_kernel import MISSING, RECEIVED, SIZE, START
from neuro.kernels.jit import kernel

U = np.uint32
UNTIMED = 1 << 31
"""The bit of a word of SPIF that says that no time follows."""


@kernel
def decode_spif(ring, index, first, last, opened_ns, t, x, y, p):
    """Decode SPIF: a word for an event, and a word of time after it unless its uppermost bit is set.

    Args:
        ring: (n,) uint32.
        index: of its entries.
        first: the first entry.
        last: the one after the last.
        opened_ns: an event without a time has that of its receipt, us after this.
        t: (m,) int64, filled as are the others.
        x: uint16.
        y: uint16.
        p: uint8.

    Returns:
        number of events, and of entries that are damaged.
    """
    n = 0
    damaged = 0
    for entry in range(first, last):
        row = entry % len(index)
        start, size = index[row, START] // 4, index[row, SIZE]
        received = (index[row, RECEIVED] - opened_ns) // 1000
        end = start + size // 4
        bad = size % 4 != 0
        at = start
        while at < end:
            word = ring[at]
            at += 1
            time = received
            if word & U(UNTIMED) == 0:
                if at == end:
                    bad = True
                    break
                time = np.int64(ring[at])
                at += 1
            t[n] = time
            x[n] = (word >> U(16)) & U(0x7FFF)
            y[n] = word & U(0x7FFF)
            p[n] = (word >> U(15)) & U(1)
            n += 1
        damaged += bad
    return n, damaged


@kernel
def decode_13(ring, index, first, last, opened_ns, t, x, y, p):
    """Decode `t64_x16_y16_on8`; as `decode_spif`, with a ring of bytes. An event that cannot be is left out."""
    n = 0
    damaged = 0
    for entry in range(first, last):
        row = entry % len(index)
        start, size = index[row, START], index[row, SIZE]
        bad = size % 13 != 0
        for at in range(start, start + size // 13 * 13, 13):
            time = np.int64(0)
            for k in range(8):
                time |= np.int64(ring[at + k]) << (8 * k)
            t[n] = time
            x[n] = np.uint16(ring[at + 8]) | np.uint16(ring[at + 9]) << 8
            y[n] = np.uint16(ring[at + 10]) | np.uint16(ring[at + 11]) << 8
            p[n] = ring[at + 12]
            right = (ring[at + 12] <= 1) & (time >> 62 == 0)
            n += right
            bad |= not right
        damaged += bad
    return n, damaged


@kernel
def decode_8(ring, index, first, last, opened_ns, t, x, y, p):
    """Decode `t32_x16_y15_on1`; as `decode_spif`, with a ring of words."""
    n = 0
    damaged = 0
    for entry in range(first, last):
        row = entry % len(index)
        start, size = index[row, START] // 4, index[row, SIZE]
        for at in range(start, start + size // 8 * 2, 2):
            word = ring[at + 1]
            t[n] = np.int64(ring[at])
            x[n] = word & U(0xFFFF)
            y[n] = word >> U(17)
            p[n] = (word >> U(16)) & U(1)
            n += 1
        damaged += size % 8 != 0
    return n, damaged


@kernel
def room_evt3(ring, index, first, last):
    """Events that entries of EVT 3.0 have at most, with one more for each."""
    n = 1
    for entry in range(first, last):
        row = entry % len(index)
        start, size = index[row, START] // 2, index[row, SIZE] // 2
        n += room3(ring[start : start + size])
    return n


SEEKS, LOST, STATES = STATES_3, STATES_3 + 1, STATES_3 + 2
"""State of EVT 3.0 after that of `decode3`: whether a TIME_HIGH has to come first; what was lost so far."""


@kernel
def decode_evt3(ring, index, first, last, state, t, x, y, p):
    """Decode EVT 3.0; as `decode_spif`, with a ring of words of 16 bits.

    A row, a base of vectors and the lower bits of the time hold across datagrams. After a loss none of them is known:
    words up to the next TIME_HIGH are left out, then events up to the next row.
    """
    n = 0
    damaged = 0
    for entry in range(first, last):
        row = entry % len(index)
        if index[row, MISSING] != state[LOST]:
            state[LOST] = index[row, MISSING]
            state[ROW] = state[BASE] = -1
            state[SEEKS] = 1
        start, size = index[row, START] // 2, index[row, SIZE]
        words = ring[start : start + size // 2]
        at = 0
        while state[SEEKS] and at < words.size:
            if words[at] >> 12 == TIME_HIGH:
                state[SEEKS] = 0
            else:
                at += 1
        found, _, _, _ = decode3(words[at:], state[:STATES_3], t[n:], x[n:], y[n:], p[n:])
        n += found
        damaged += size % 2
    return n, damaged


CLOCK, ADDED, OUTSIDE, BACK, RESTARTS, FACTS = range(6)
"""What `settle` remembers: the time of the last event; what is added to times; events off the sensor, and earlier than
one before them; clocks that began anew."""
JUMP = 100_000
"""A clock that falls by more, us, has begun anew; the network brings datagrams in another order by far less."""


@kernel
def settle(n, width, height, period, facts, t, x, y, p):
    """Keep the events that can be, with a time that does not run back.

    Args:
        n: number of events; those that stay are moved to the front.
        width: of the sensor, px.
        height: likewise.
        period: after which the clock begins again, us; 0: never.
        facts: (FACTS,) int64, changed.
        t: (m,) int64, as are the others at least n long.
        x: uint16.
        y: uint16.
        p: uint8.

    Returns:
        number of events that stay.
    """
    kept = 0
    last, added = facts[CLOCK], facts[ADDED]
    outside = np.int64(0)
    for k in range(n):
        if x[k] >= width or y[k] >= height:
            outside += 1
            continue
        now = t[k] + added
        if now < last:
            if period and last - now > period // 2:
                added += period
                now += period
            elif last - now > JUMP:
                added += last - now
                now = last
                facts[RESTARTS] += 1
            else:
                facts[BACK] += 1
                continue
        elif period and added and last > now - period >= last - JUMP:
            facts[BACK] += 1
            continue
        last = now
        t[kept] = now
        x[kept] = x[k]
        y[kept] = y[k]
        p[kept] = p[k]
        kept += 1
    facts[CLOCK], facts[ADDED] = last, added
    facts[OUTSIDE] += outside
    return kept
