# mypy: ignore-errors
"""Decoding the packets of AEDAT 4, and unpacking LZ4 frames of the usual kind, with all offsets and lengths checked.

A block is a row of sequences: a token (4 bits number of literals, 4 bits length of the match less 4; 15 says that bytes
follow which are added, up to one below 255), the literals, and how many bytes back the match begins (uint16). The last
sequence has literals only.

Sequences of packed events are short. So the path that these take has no loops, and copies a match in parts as short as
those by which it was written: the processor can read a byte that is not yet in its cache only from a write that has all
bytes of the read.

What is unpacked here is unpacked alike by the reference decoder, whose limits this one keeps: a block has 8 bytes after
the last literals that a match follows; the last match begins 12 and ends 5 bytes before the most that a block may hold.

Source: lz4_Block_format.md and lz4_Frame_format.md of the LZ4 project.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import types
from numba.extending import intrinsic

from neuro.apps import ir
from neuro.extend import kernel, subkernel
from neuro_events.formats.aedat4 import LIMIT, RECORD

WIDE = 16
"""Bytes of the largest copy, and so the most that is written beyond what is unpacked."""
HEADER = 7
"""Bytes of the header of a frame that tells neither its length nor a dictionary."""
TAIL, MATCH_TAIL, PACKED_TAIL = 5, 12, 8
"""Least bytes after the end and the beginning of a match, and packed ones after the literals before it."""


@subkernel
def _longer(at, end, count):
    """Address after the bytes that make a length longer, and the length."""
    apart()
    more = 255
    while more == 255 and at < end:
        more = load1(at)
        count += more
        at += 1
    return at, count


@subkernel
def _each(to, start, count):
    """Copy bytes one after the other; those that are written are read again where the places overlap."""
    apart()
    for k in range(count):
        copy1(to + k, start + k)


@subkernel
def _wide(to, start, count):
    """Copy bytes, and some more."""
    apart()
    k = 0
    while k < count:
        copy16(to + k, start + k)
        k += WIDE


@subkernel
def straight(to, start, count):
    """Copy bytes to an address from another that is not near, and no more."""
    whole = count & -WIDE
    _wide(to, start, whole)
    _each(to + whole, start + whole, count - whole)


@subkernel
def block(at, end, readable, to, base, limit):
    """Unpack a block.

    Args:
        at: address of its first byte.
        end: address after its last.
        readable: address after the last byte that may be read; with less than `WIDE` bytes after the end, a block
            that is right may be refused.
        to: address of the first byte to write; `WIDE` bytes after `limit` may be written, too.
        base: address of the first byte that a match may have.
        limit: address that the unpacked bytes may reach.

    Returns:
        address after the last unpacked byte, 0 where this is no block or does not fit.
    """
    last = min(end - PACKED_TAIL, readable - WIDE)
    while at < end:
        token = load1(at)
        at += 1
        count = token >> 4
        if count == 15:
            at, count = _longer(at, end, count)
        if at + count > last or to + count > limit - MATCH_TAIL:
            if at + count != end or to + count > limit:
                return 0
            straight(to, at, count)
            return to + count
        copy16(to, at)
        if count > WIDE:
            _wide(to + WIDE, at + WIDE, count - WIDE)
        at += count
        to += count
        start = to - load2(at)
        at += 2
        count = token & 15
        if count == 15:
            at, count = _longer(at, end, count)
        count += 4
        if start < base or start == to or to + count > limit - TAIL:
            return 0
        if to - start < WIDE:
            _each(to, start, count)
        elif count <= 8:
            copy4(to, start)
            copy4(to + count - 4, start + count - 4)
        elif count <= 16:
            copy8(to, start)
            copy8(to + count - 8, start + count - 8)
        else:
            _wide(to, start, count)
        to += count
    return 0


@kernel
def frame(data, at, end, plain):
    """Unpack a frame of which the header is known to be right, without checksums.

    Args:
        data: (n,) uint8.
        at: its first byte.
        end: the byte after its last.
        plain: (m,) uint8, m > `WIDE`, filled.

    Returns:
        number of unpacked bytes; -1 where this is no frame, has more than m - `WIDE` bytes, or is damaged; perhaps also
        where it ends within `WIDE` bytes from the end of the data.
    """
    source, first = address(data), address(plain)
    readable, room = source + data.size, first + plain.size - WIDE
    together = load1(source + at + 4) & 0x20 == 0
    largest = 1 << (8 + 2 * (load1(source + at + 5) >> 4))
    to = first
    at += HEADER
    while at + 4 <= end:
        word = load4(source + at)
        at += 4
        if word == 0:
            return to - first
        size = word & 0x7FFFFFFF
        if size > min(largest, end - at):
            return -1
        if word == size:
            base = first if together else to
            to = block(source + at, source + at + size, readable, to, base, min(to + largest, room))
        elif to + size <= room:
            straight(to, source + at, size)
            to += size
        else:
            return -1
        if to == 0:
            return -1
        at += size
    return -1


def _pointer(builder, address, bits):
    return builder.inttoptr(address, ir.IntType(bits).as_pointer())


def _load(bits):
    """A function that gives the number at an address, as int64."""

    @intrinsic
    def load(typing, address):
        def build(context, builder, signature, arguments):
            value = builder.load(_pointer(builder, arguments[0], bits), align=1)
            return builder.zext(value, ir.IntType(64)) if bits < 64 else value

        return types.int64(types.intp), build

    return load


def _copy(bits):
    """A function that copies bytes to one address from another; they are all read before one is written."""

    @intrinsic
    def copy(typing, to, start):
        def build(context, builder, signature, arguments):
            value = builder.load(_pointer(builder, arguments[1], bits), align=1)
            builder.store(value, _pointer(builder, arguments[0], bits), align=1)
            return context.get_dummy_value()

        return types.void(types.intp, types.intp), build

    return copy


load1, load2, load4, load8 = (_load(8 * count) for count in (1, 2, 4, 8))
copy1, copy4, copy8, copy16 = (_copy(8 * count) for count in (1, 4, 8, 16))


@subkernel
def address(array):
    """The address of the first item, as int64."""
    return np.int64(array.ctypes.data)


@intrinsic
def apart(typing):
    """Compile the function in which this stands by itself, not within its callers, whose fast path it would slow."""

    def build(context, builder, signature, arguments):
        builder.function.attributes.add("noinline")
        return context.get_dummy_value()

    return types.void(), build


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


class Alike(NamedTuple):
    """Packets that begin alike.

    Attributes:
        wanted: the stream with the events.
        head: how the packets begin, bytes; empty where they are not packed.
        lead: how they begin when unpacked, after their size and up to the number of events, bytes.
        highest: largest x and y that may be.
    """

    wanted: int
    head: bytes
    lead: bytes
    highest: int


@kernel
def walk(data, counts, alike, plain, begins, places, n, columns):
    """Decode packets up to the first that is cut, has no room, or is not like those before it.

    Args:
        data: (m,) uint8, from the beginning of a packet on.
        counts: (streams,) int64: packets of each stream, counted on; -1 for a number that is no stream.
        alike: an `Alike`.
        plain: room for an unpacked packet, uint8.
        begins: int64, filled with the first event of each packet that has any.
        places: int64, as long, filled with the byte of `data` at which it begins.
        n: number of events that there are.
        columns: filled from n on: t, int64; x and y, uint16; p, uint8, 0 or 1.

    Returns:
        number of bytes used, packets with events, events that there are, largest (x, y), whether time does not run
        back from event n - 1 on.
    """
    wanted, head, lead, highest = alike
    t, x, y, p = columns
    at, found, x_max, y_max, ordered = 0, 0, 0, 0, True
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
