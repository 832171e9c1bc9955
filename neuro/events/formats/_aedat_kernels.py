# mypy: ignore-errors
"""Decoding the 8-byte words of AEDAT 2.0."""

from __future__ import annotations

import numpy as np

from neuro.events.formats._aedat4_packet import LIMIT, RECORD
from neuro.events.formats._lz4_kernel import HEADER, WIDE, address, frame, load4, load8, straight
from neuro.kernels.jit import kernel, subkernel

AEDAT2_WORD = 8
T_WRAP = 1 << 32
T_HALF = 1 << 31


@kernel
def decode_aedat2(words, layout, clock, skipped, t, x, y, p):
    """Decode words up to the first that is none of the chip.

    Args:
        words: (8 n,) uint8.
        layout: shift and mask of x, shift and mask of y, shift of the polarity, what it is where ON, bits of samples,
            bits of external events, bits that no word has.
        clock: (2,) int64, the last 32-bit time (-1 before the first) and us added to it; both are brought up to date.
        skipped: (2,) int64, samples and external events; they are counted on.
        t: (n,) int64, filled.
        x: (n,) uint16, filled.
        y: (n,) uint16, filled.
        p: (n,) uint8, filled.

    Returns:
        number of events and of words, largest x and y, and whether time does not run back.
    """
    x_shift, x_mask, y_shift, y_mask, p_shift, on, sample, external, unused = layout
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
        column = address >> x_shift & x_mask
        row = address >> y_shift & y_mask
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
EVENT = 8
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
    return counts or not 0 <= offset < size or word(data, at + 12) < 0 or (kind == POLARITY and size != EVENT)


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
        here = min(left, (data.size - at) // EVENT)
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
            at += EVENT
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


ENTRY = 8
ROW = RECORD.itemsize


@kernel
def split(plain, start, count, n, t, x, y, p):
    """Copy records into columns.

    Args:
        plain: uint8.
        start: its byte at which the first record begins.
        count: number of records, which are all within it.
        n: number of events that there are.
        t: int64, filled from n on, as are the others.
        x: uint16.
        y: uint16.
        p: uint8, filled with 0 or 1.

    Returns:
        largest x and y (a negative one counts as 2^16 plus itself), whether time does not run back from event n - 1 on.
    """
    events = address(plain) + start
    x_max = 0
    y_max = 0
    back = False
    last = t[n - 1] if n else load8(events) if count else 0
    for k in range(count):
        now = load8(events + ROW * k)
        word = load8(events + ROW * k + 8)
        column = word & 0xFFFF
        row = word >> 16 & 0xFFFF
        back |= now < last
        last = now
        t[n + k] = now
        x[n + k] = column
        y[n + k] = row
        p[n + k] = word >> 32 & 0xFF != 0
        x_max = max(x_max, column)
        y_max = max(y_max, row)
    return x_max, y_max, not back


@subkernel
def _same(data, at, expected):
    """Whether data go on like that at a place."""
    same = at + len(expected) <= data.size
    for k in range(len(expected) if same else 0):
        same &= data[at + k] == expected[k]
    return same


@subkernel
def _unpacked(data, at, size, head, plain):
    """Number of bytes that a packet has when unpacked, -1 where it is not of the usual kind or too long."""
    if len(head) == 0 and size + WIDE <= plain.size:
        straight(address(plain), address(data) + at, size)
        return size
    if len(head) == 0 or size < HEADER or not _same(data, at, head):
        return -1
    return frame(data, at, at + size, plain)


@kernel
def walk(data, counts, wanted, head, lead, highest, plain, begins, places, n, t, x, y, p):
    """Decode packets up to the first that is cut, has no room, or is not like those before it.

    Args:
        data: (m,) uint8, from the beginning of a packet on.
        counts: (streams,) int64: packets of each stream, counted on; -1 for a number that is no stream.
        wanted: the stream with the events.
        head: how the packets begin, bytes; empty where they are not packed.
        lead: how they begin when unpacked, after their size and up to the number of events, bytes.
        highest: largest x and y that may be.
        plain: room for an unpacked packet, uint8.
        begins: int64, filled with the first event of each packet that has any.
        places: int64, as long, filled with the byte of `data` at which it begins.
        n: number of events that there are.
        t: int64, filled from n on, as are the others.
        x: uint16.
        y: uint16.
        p: uint8, filled with 0 or 1.

    Returns:
        number of bytes used, packets with events, events that there are, largest (x, y), whether time does not run
        back from event n - 1 on.
    """
    at = 0
    found = 0
    x_max = 0
    y_max = 0
    ordered = True
    source, first = address(data), address(plain)
    start = 4 + len(lead) + 4
    while at + ENTRY <= data.size and found < begins.size:
        stream, size = load4(source + at), load4(source + at + 4)
        if stream >= counts.size or counts[stream] < 0 or size > min(LIMIT, data.size - at - ENTRY):
            break
        if stream == wanted:
            length = _unpacked(data, at + ENTRY, size, head, plain)
            if length < start or load4(first) != length - 4 or not _same(plain, 4, lead):
                break
            count = load4(first + start - 4)
            if start + ROW * count > length or n + count > t.size:
                break
            column, row, forward = split(plain, start, count, n, t, x, y, p)
            if max(column, row) > highest:
                break
            if count:
                begins[found], places[found] = n, at
                found += 1
            n += count
            x_max, y_max, ordered = max(x_max, column), max(y_max, row), ordered and forward
        counts[stream] += 1
        at += ENTRY + size
    return at, found, n, (x_max, y_max), ordered
