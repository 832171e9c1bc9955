# mypy: ignore-errors
"""Compiled loops that receive from a socket into a ring of bytes, and decode the entries of the ring.

The receiving loop runs outside the interpreter, so that Python code cannot delay the loop. A ring has a writer,
`receive`, and a reader, which reads the entries of the index in order and stores the number of entries read.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numba import types

from neuro.apps import address, caller, load_acquire, store_release
from neuro.extend import kernel, subkernel
from neuro_events.formats._evt_kernels import BASE, ROW, STATES_3, TIME_HIGH, capacity3, decode3
from neuro_events.formats._word_kernels import decoder, field, word
from neuro_events.formats._words import OTHER

PUT, TAKEN, STOP, AT, LAST, REFUSED, OVERFLOWN, ROWS = range(8)
"""Rows of the state. `PUT`, `TAKEN`: number of entries written and read. `STOP`: 1 to stop. `AT`: next byte of the
ring. `LAST`: time of the last receipt, ns. `REFUSED`, `OVERFLOWN`: datagrams lost because the ring, or the system's
queue, was full."""
START, SIZE, RECEIVED, MISSING, EVENTS, FIELDS = range(6)
"""Columns of the index, which has a row for each entry (a datagram, or bytes of a connection). `START`, `SIZE`: first
byte and number of bytes. `RECEIVED`: time of receipt, ns. `MISSING`: number of all datagrams lost before the entry.
`EVENTS`: number of events from the first entry of a decoder's call up to the end of this entry; set by the decoder."""

LARGEST = 1 << 16
"""Largest number of bytes that one call can receive."""
ALIGNED = 16
"""Alignment of entries, bytes, so that they can be read as words."""
SECOND, SOON = 1_000_000_000, 1_000_000
"""A second, and the longest duration of a call that failed without waiting, ns."""
FULL = -2
"""Return value instead of a number of bytes: the ring is full."""

NAME, PIECE, CONTROL, TIMESPEC, BYTE, WORDS = 0, 7, 9, 17, 19, 20
"""Offsets in the words that the system reads and writes: `msghdr`, `iovec`, its control message, `timespec`, a byte."""
_LENGTH, _CONTROL_BYTES = 5, 64

_recvmsg = caller(types.int64, types.int32, types.int64, types.int32)
_clock_gettime = caller(types.int32, types.int32, types.int64)
_write = caller(types.int64, types.int32, types.int64, types.int64)


@subkernel
def place(at, put, n_read, index, bytes_):
    """Return the byte at which the next entry can begin, -1 if the ring has no space for the largest entry.

    Args:
        at: byte after the newest entry.
        put: number of entries written.
        n_read: number of entries read.
        index: index of the entries.
        bytes_: size of the ring, bytes.
    """
    if put == n_read:
        return 0
    if put - n_read >= len(index):
        return -1
    tail = index[n_read % len(index), START]
    if at > tail:
        if at + LARGEST <= bytes_:
            return at
        return 0 if tail > LARGEST else -1
    return at if at + LARGEST < tail else -1


@kernel
def receive(calls, descriptor, wake, datagrams, ring, index, state, message):
    """Receive until the connection ends, a call fails, or the state says stop.

    Args:
        calls: (4,) int64, addresses of `recvmsg`, `clock_gettime` and `write`, and the number of the clock.
        descriptor: file descriptor of the socket.
        wake: file descriptor of a pipe to which a byte is written for each entry.
        datagrams: True: drop datagrams while the ring is full. False: stop receiving while the ring is full.
        ring: (n,) uint8; the last `LARGEST` bytes are a buffer for datagrams that are dropped.
        index: (m, FIELDS) int64.
        state: (ROWS, 8) int64; each row has a cache line of its own.
        message: (WORDS,) int64, laid out as `msghdr` of 64-bit systems.

    Returns:
        The number of bytes of the last call, 0 at the end of a connection, -1 if the call failed immediately, or
        `FULL`.
    """
    words = address(message)
    bytes_ = ring.size - LARGEST
    message[NAME + 2], message[NAME + 3] = words + 8 * PIECE, 1
    message[NAME + 4] = words + 8 * CONTROL
    n_received = -1
    while load_acquire(state, STOP) == 0:
        put = state[PUT, 0]
        at = place(state[AT, 0], put, load_acquire(state, TAKEN), index, bytes_)
        if at < 0 and not datagrams:
            return FULL
        message[_LENGTH], message[_LENGTH + 1] = _CONTROL_BYTES, 0
        message[PIECE], message[PIECE + 1] = address(ring) + (bytes_ if at < 0 else at), LARGEST
        n_received = _recvmsg(calls[0], (descriptor, words, 0))
        previous = message[TIMESPEC] * SECOND + message[TIMESPEC + 1]
        _clock_gettime(calls[1], (calls[3], words + 8 * TIMESPEC))
        received = message[TIMESPEC] * SECOND + message[TIMESPEC + 1]
        if n_received < 0 and received - previous > SOON:  # the call waited until its timeout
            continue
        if n_received < 0 or (n_received == 0 and not datagrams):
            return n_received
        if datagrams and message[_LENGTH] & 0xFFFFFFFF > 0:
            state[OVERFLOWN, 0] = message[CONTROL + 2] & 0xFFFFFFFF
        state[LAST, 0] = received
        if at < 0:  # the reader may have released space in the meantime
            at = place(state[AT, 0], put, load_acquire(state, TAKEN), index, bytes_)
            if at < 0:
                state[REFUSED, 0] += 1
                continue
            for k in range(n_received):
                ring[at + k] = ring[bytes_ + k]
        row = put % len(index)
        index[row, START], index[row, SIZE], index[row, RECEIVED] = at, n_received, received
        index[row, MISSING] = state[REFUSED, 0] + state[OVERFLOWN, 0]
        state[AT, 0] = at + (n_received // ALIGNED + 1) * ALIGNED
        store_release(state, PUT, put + 1)
        _write(calls[2], (wake, words + 8 * BYTE, 1))
    return n_received


@kernel
def arrived(state):
    """Return the number of entries written so far."""
    return load_acquire(state, PUT)


@kernel
def release(state, n_read):
    """Release the space of the first `n_read` entries."""
    store_release(state, TAKEN, n_read)


@kernel
def end_entry(index, state):
    """Write an empty entry, which separates two connections. Return False if the index is full."""
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
"""Bit of a SPIF word that is set if no time follows."""


@cache
def plain_decoder(layout):
    """Return a decoder of datagrams with events of a layout.

    The decoder's arguments are the ring, (n,) uint8, the index of its entries, the first entry and the end, the time at
    which the stream was opened, ns, the state, and the output arrays (m,) of times, columns, rows and polarities. The
    decoder returns the number of events and the number of damaged entries. Impossible events are dropped.
    """
    decode = decoder(layout, subkernel)

    def decode_datagrams(ring, index, first, last, opened_ns, state, t, x, y, p):
        n = 0
        damaged = 0
        for entry in range(first, last):
            row = entry % len(index)
            start, size = index[row, START], index[row, SIZE]
            others = state[OTHER]
            count, used, _, _, _ = decode(ring[start : start + size], state, t[n:], x[n:], y[n:], p[n:])
            n += count
            index[row, EVENTS] = n
            damaged += (used != size) | (state[OTHER] != others)
        return n, damaged

    return kernel(decode_datagrams)


@cache
def spif_decoder(layout):
    """Return a decoder of SPIF, as `plain_decoder` does.

    A word for an event is followed by a word of time, unless the uppermost bit of the event's word is set. An event
    without a time gets the time of its receipt, us.
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
def capacity_evt3(ring, index, first, last):
    """Return the largest number of events of entries of EVT 3.0, plus 1 for each entry."""
    n = 1
    for entry in range(first, last):
        row = entry % len(index)
        start, size = index[row, START] // 2, index[row, SIZE] // 2
        n += capacity3(ring[start : start + size])
    return n


SEEKS, LOST, STATES = STATES_3, STATES_3 + 1, STATES_3 + 2
"""Indices into the state after those of `decode3`. `SEEKS`: 1 while words before the next TIME_HIGH are skipped.
`LOST`: number of datagrams lost so far."""


@kernel
def decode_evt3(ring, index, first, last, state, t, x, y, p):
    """Decode EVT 3.0, with arguments as for `plain_decoder` and a ring of 16-bit words.

    The row, the base of vectors and the low bits of the time hold across datagrams. After a loss they are unknown:
    words before the next TIME_HIGH are skipped, and then events before the next row.
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
        count, _, _, _ = decode3(words[at:], state[:STATES_3], t[n:], x[n:], y[n:], p[n:])
        n += count
        index[row, EVENTS] = n
        damaged += size % 2
    return n, damaged


CLOCK, ADDED, DOUBT, BEHIND, OUTSIDE, BACK, RESTARTS, DAMAGED, FACTS = range(9)
"""Indices into the state of `settle`. `CLOCK`: time of the last event. `ADDED`: offset added to times. `DOUBT`: time of
the last implausible event. `BEHIND`: datagrams in a row that began before the clock. The others count dropped events
(`OUTSIDE` the sensor, `BACK` in time, `DAMAGED` time) and `RESTARTS` of the sender's clock."""
BACKWARD, FORWARD = 100_000, 10_000_000
"""Largest plausible steps of the clock, backward and forward, us. A larger step means that the sender restarted or
paused, or that the time is damaged. The network reorders datagrams by far less."""
RESTART_DATAGRAMS = 4
"""Number of datagrams in a row before the clock that identify a restarted sender."""
NOWHERE = -1 << 61
"""Time that is far from that of any event."""


@kernel
def settle(index, first, last, width, height, period, ordered, forward, facts, columns):
    """Select the events on the sensor, with times that never run back, and move them to the front of the columns.

    A time far from the clock is accepted only if the event before, or the next event in the same datagram, has a
    similar time.

    Args:
        index: index of the entries.
        first: first entry.
        last: end of the entries.
        width: width of the sensor, px.
        height: height of the sensor, px.
        period: period after which the clock wraps, us; 0: never.
        ordered: True if data are neither damaged nor reordered, as with TCP.
        forward: largest step of the clock without confirmation, us.
        facts: (FACTS,) int64, updated.
        columns: all events of the entries: t, (m,) int64, us; x and y, uint16; p, uint8.

    Returns:
        The number of selected events.
    """
    t, x, y, p = columns
    n_selected = 0
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
            if not 0 <= now - clock <= forward or clock == 0:  # otherwise the time is plausible
                if period and clock - now > period // 2:
                    now += period
                elif period and added and clock > now - period >= clock - BACKWARD:  # an event from before the wrap
                    now -= period
                lead = now - clock
                if not ordered and (clock == 0 or lead > forward or lead < -BACKWARD):
                    agrees = -BACKWARD <= t[k] - doubt <= forward or (clock == 0 and k + 1 == end)
                    if k + 1 < end:
                        step = t[k + 1] - t[k]
                        step += period * (step < -(period // 2))
                        agrees |= -BACKWARD <= step <= forward
                    if not agrees:
                        doubt = t[k]
                        facts[DAMAGED] += 1
                        continue
                if lead < 0:
                    behind += begins
                    begins = False
                    if not (ordered or lead < -BACKWARD or behind >= RESTART_DATAGRAMS):
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
            t[n_selected] = now
            x[n_selected] = x[k]
            y[n_selected] = y[k]
            p[n_selected] = p[k]
            n_selected += 1
        begin = end
    facts[CLOCK], facts[ADDED], facts[DOUBT], facts[BEHIND] = clock, added, doubt, behind
    return n_selected
