# mypy: ignore-errors
"""The loop that receives: from a socket into a ring of bytes, without the interpreter, so that nothing holds it up.

A ring has one writer, `receive`, and one reader, who takes entries of the index in their order and stores how many.
"""

from __future__ import annotations

from numba import types

from neuro.kernels.address import caller
from neuro.kernels.instructions import address, load_acquire, store_release
from neuro.kernels.jit import kernel, subkernel

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

NAME, PIECE, CONTROL, CLOCK, BYTE, WORDS = 0, 7, 9, 17, 19, 20
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
        before = message[CLOCK] * SECOND + message[CLOCK + 1]
        _clock_gettime(calls[1], (calls[3], words + 8 * CLOCK))
        received = message[CLOCK] * SECOND + message[CLOCK + 1]
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
