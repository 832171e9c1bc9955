# mypy: ignore-errors
"""The loop that receives: from a socket into a ring of bytes, without the interpreter, so that nothing holds it up.

A ring has one writer, `receive`, and one reader, who takes entries of the index in their order and stores how many.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numba import types

from neuro.apps import address, caller, load_acquire, store_release
from neuro.extend import kernel, subkernel
from neuro_events.formats._evt_kernels import BASE, ROW, STATES_3, TIME_HIGH, decode3, room3
from neuro_events.formats._word_kernels import decoder, field, word
from neuro_events.formats._words import OTHER

PUT, TAKEN, STOP, AT, LAST, REFUSED, OVERFLOWN, ROWS = range(8)
"""Rows of the state: entries written and taken; whether to stop; the next byte of the ring; time of the last receipt,
ns; datagrams for which the ring, and before it the kernel's own queue, had no room."""
START, SIZE, RECEIVED, MISSING, EVENTS, FIELDS = range(6)
"""Columns of the index: first byte, bytes, time of receipt in ns, how many datagrams were lost before it in all; and,
by whoever decodes it, the number of events up to its end among those that were decoded at once."""

LARGEST = 1 << 16
"""Bytes that one call can receive."""
ALIGNED = 16
"""Entries begin at multiples of it, so that they can be read as words."""
SECOND, SOON = 1_000_000_000, 1_000_000
"""ns of a second, and of a call that did not wait for anything to come."""
FULL = -2
"""Instead of a number of bytes: the ring has no room."""

NAME, PIECE, CONTROL, TIMESPEC, BYTE, WORDS = 0, 7, 9, 17, 19, 20
"""Places in the words that the system reads and writes: `msghdr`, `iovec`, its control message, `timespec`, a byte."""
_LENGTH, _ROOM = 5, 64

_recvmsg = caller(types.int64, types.int32, types.int64, types.int32)
_clock_gettime = caller(types.int32, types.int32, types.int64)
_write = caller(types.int64, types.int32, types.int64, types.int64)


@subkernel
def place(at, put, taken, index, bytes_):
    """Where the next entry may begin, -1 without room for the largest."""
    if put == taken:
        return 0
    if put - taken >= len(index):
        return -1
    tail = index[taken % len(index), START]
    if at > tail:
        if at + LARGEST <= bytes_:
            return at
        return 0 if tail > LARGEST else -1
    return at if at + LARGEST < tail else -1


@kernel
def receive(calls, descriptor, wake, datagrams, ring, index, state, message):
    """Receive until the connection ends, nothing can be received, or it is to stop.

    Args:
        calls: (4,) int64, addresses of `recvmsg`, `clock_gettime` and `write`, and the number of the clock.
        descriptor: the socket.
        wake: a pipe that gets a byte for each entry.
        datagrams: whether what finds no room is dropped; else nothing is received before there is room.
        ring: (n,) uint8; the last `LARGEST` bytes receive what is dropped.
        index: (m, FIELDS) int64.
        state: (ROWS, 8) int64, each row on a line of the cache.
        message: (WORDS,) int64, as `msghdr` lies in 64-bit systems.

    Returns:
        bytes of the last call: 0 at the end of a connection, -1 if it failed at once; or `FULL`.
    """
    words = address(message)
    bytes_ = ring.size - LARGEST
    message[NAME + 2], message[NAME + 3] = words + 8 * PIECE, 1
    message[NAME + 4] = words + 8 * CONTROL
    got = -1
    while load_acquire(state, STOP) == 0:
        put = state[PUT, 0]
        at = place(state[AT, 0], put, load_acquire(state, TAKEN), index, bytes_)
        if at < 0 and not datagrams:
            return FULL
        message[_LENGTH], message[_LENGTH + 1] = _ROOM, 0
        message[PIECE], message[PIECE + 1] = address(ring) + (bytes_ if at < 0 else at), LARGEST
        got = _recvmsg(calls[0], (descriptor, words, 0))
        before = message[TIMESPEC] * SECOND + message[TIMESPEC + 1]
        _clock_gettime(calls[1], (calls[3], words + 8 * TIMESPEC))
        received = message[TIMESPEC] * SECOND + message[TIMESPEC + 1]
        if got < 0 and received - before > SOON:
            continue
        if got < 0 or (got == 0 and not datagrams):
            return got
        if datagrams and message[_LENGTH] & 0xFFFFFFFF > 0:
            state[OVERFLOWN, 0] = message[CONTROL + 2] & 0xFFFFFFFF
        state[LAST, 0] = received
        if at < 0:  # there may be room now
            at = place(state[AT, 0], put, load_acquire(state, TAKEN), index, bytes_)
            if at < 0:
                state[REFUSED, 0] += 1
                continue
            for k in range(got):
                ring[at + k] = ring[bytes_ + k]
        row = put % len(index)
        index[row, START], index[row, SIZE], index[row, RECEIVED] = at, got, received
        index[row, MISSING] = state[REFUSED, 0] + state[OVERFLOWN, 0]
        state[AT, 0] = at + (got // ALIGNED + 1) * ALIGNED
        store_release(state, PUT, put + 1)
        _write(calls[2], (wake, words + 8 * BYTE, 1))
    return got


@kernel
def arrived(state):
    """How many entries were written; all of them can be read."""
    return load_acquire(state, PUT)


@kernel
def release(state, taken):
    """Give the room of so many entries back."""
    store_release(state, TAKEN, taken)


@kernel
def end_entry(index, state):
    """Write an entry of no bytes, as between two connections; whether there was room for it."""
    put = state[PUT, 0]
    if put - load_acquire(state, TAKEN) >= len(index):
        return False
    row = put % len(index)
    index[row, START], index[row, SIZE], index[row, RECEIVED] = state[AT, 0], 0, state[LAST, 0]
    index[row, MISSING] = state[REFUSED, 0] + state[OVERFLOWN, 0]
    store_release(state, PUT, put + 1)
    return True


U = np.uint32
UNTIMED = 1 << 31
"""The bit of a word of SPIF that says that no time follows."""


@cache
def plain_decoder(layout):
    """Return the decoder of datagrams of events of a layout.

    Its arguments are the ring (n,) uint8, the index of its entries, the first entry and the one after the last, the
    time from which receipts count, ns, a state, and arrays (m,) of times, columns, rows and polarities to fill. It
    returns the number of events, and of entries that are damaged. An event that cannot be is left out.
    """
    decode = decoder(layout, subkernel)

    def decode_datagrams(ring, index, first, last, opened_ns, state, t, x, y, p):
        n = 0
        damaged = 0
        for entry in range(first, last):
            row = entry % len(index)
            start, size = index[row, START], index[row, SIZE]
            others = state[OTHER]
            found, used, _, _, _ = decode(ring[start : start + size], state, t[n:], x[n:], y[n:], p[n:])
            n += found
            index[row, EVENTS] = n
            damaged += (used != size) | (state[OTHER] != others)
        return n, damaged

    return kernel(decode_datagrams)


@cache
def spif_decoder(layout):
    """Return the decoder of SPIF, as `plain_decoder`.

    A word for an event is followed by a word of time, unless its uppermost bit is set: then the time is that of its
    receipt, us.
    """
    word_of, (x_of, y_of, p_of) = word(4, False), (field(getattr(layout, name)) for name in "xyp")

    def decode_spif(ring, index, first, last, opened_ns, state, t, x, y, p):
        n = 0
        damaged = 0
        for entry in range(first, last):
            row = entry % len(index)
            at, size = index[row, START], index[row, SIZE]
            time = (index[row, RECEIVED] - opened_ns) // 1000
            end = at + size // 4 * 4
            bad = size % 4 != 0
            while at < end:
                timed = word_of(ring, at) & U(UNTIMED) == 0
                if timed and at + 4 == end:
                    bad = True
                    break
                t[n] = np.int64(word_of(ring, at + 4)) if timed else time
                x[n] = x_of(ring, at)
                y[n] = y_of(ring, at)
                p[n] = p_of(ring, at)
                n += 1
                at += 8 if timed else 4
            index[row, EVENTS] = n
            damaged += bad
        return n, damaged

    return kernel(decode_spif)


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
    """Decode EVT 3.0; as `plain_decoder`, with a ring of words of 16 bits.

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
def settle(index, first, last, width, height, period, ordered, forward, facts, columns):
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
        columns: all events of the entries: t, (m,) int64, us; x and y, uint16; p, uint8.

    Returns:
        number of events that stay.
    """
    t, x, y, p = columns
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
                        step = t[k + 1] - t[k]
                        step += period * (step < -(period // 2))
                        agrees |= -BACKWARD <= step <= forward
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
