# mypy: ignore-errors
"""Decoding datagrams where they lie in the ring, and what all codings share: clocks that wrap, sensors that end."""

from __future__ import annotations

import numpy as np

from neuro.events.formats._evt_kernels import BASE, ROW, STATES_3, TIME_HIGH, decode3, room3
from neuro.events.streams._ring_kernel import EVENTS, MISSING, RECEIVED, SIZE, START
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
        index[row, EVENTS] = n
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
        index[row, EVENTS] = n
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
        index[row, EVENTS] = n
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
        index[row, EVENTS] = n
        damaged += size % 2
    return n, damaged


CLOCK, ADDED, DOUBT, BEHIND, OUTSIDE, BACK, RESTARTS, DAMAGED, FACTS = range(9)
"""What `settle` remembers: the time of the last event; what is added to times; that of an event that was not believed;
datagrams in a row that began behind the clock; and counts of events that were left out and of clocks that began anew.
"""
BACKWARD, FORWARD = 100_000, 10_000_000
"""A clock that moves by more, us, has begun anew, or stood still with its sender, or the time is damaged; the network
brings datagrams in another order by far less."""
AGAIN = 4
"""So many datagrams in a row that begin behind the clock are those of a sender that began anew."""
NOWHERE = -1 << 61
"""A time that no event is near."""


@kernel
def settle(index, first, last, width, height, period, ordered, forward, facts, t, x, y, p):
    """Keep the events that can be, with a time that does not run back; move them to the front.

    A time far from the clock is believed if that of the event before it, or after it in its datagram, is near it.

    Args:
        index: of the entries.
        first: the first entry.
        last: the one after the last.
        width: of the sensor, px.
        height: likewise.
        period: after which the clock begins again, us; 0: never.
        ordered: whether nothing is damaged or comes in another order, as by TCP.
        forward: how far the clock may move between two events unless a second one agrees, us.
        facts: (FACTS,) int64, changed.
        t: (m,) int64, us, as are the others all events of the entries.
        x: uint16.
        y: uint16.
        p: uint8.

    Returns:
        number of events that stay.
    """
    kept = 0
    begin = 0
    clock, added, doubt, behind = facts[CLOCK], facts[ADDED], facts[DOUBT], facts[BEHIND]
    if period:
        forward = min(forward, period - BACKWARD - 1)
    for entry in range(first, last):
        end = index[entry % len(index), EVENTS]
        begins = True
        for k in range(begin, end):
            if (x[k] >= width) | (y[k] >= height):
                facts[OUTSIDE] += 1
                continue
            now = t[k] + added
            if not 0 <= now - clock <= forward or clock == 0:  # else nothing is to be asked
                if period and clock - now > period // 2:
                    now += period
                elif period and added and clock > now - period >= clock - BACKWARD:  # of before it began again
                    now -= period
                ahead = now - clock
                if not ordered and (clock == 0 or ahead > forward or ahead < -BACKWARD):
                    agrees = -BACKWARD <= t[k] - doubt <= forward or (clock == 0 and k + 1 == end)
                    if k + 1 < end:
                        agrees |= -BACKWARD <= t[k + 1] - t[k] <= forward
                    if not agrees:
                        doubt = t[k]
                        facts[DAMAGED] += 1
                        continue
                if ahead < 0:
                    behind += begins
                    begins = False
                    if not (ordered or ahead < -BACKWARD or behind >= AGAIN):
                        doubt = NOWHERE
                        facts[BACK] += 1
                        continue
                    now = clock
                    facts[RESTARTS] += 1
                    behind = 0
                added = now - t[k]
            behind = 0 if begins else behind
            begins = False
            doubt = NOWHERE
            clock = now
            t[kept] = now
            x[kept] = x[k]
            y[kept] = y[k]
            p[kept] = p[k]
            kept += 1
        begin = end
    facts[CLOCK], facts[ADDED], facts[DOUBT], facts[BEHIND] = clock, added, doubt, behind
    return kept
