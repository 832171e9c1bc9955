# mypy: ignore-errors
"""Compiled decoder of AEDAT 4 packets and of common LZ4 frames, with a check of all offsets and lengths.

A block of LZ4 is a series of sequences. A sequence has a token, the literals, and the distance back to the match
(uint16). The upper 4 bits of the token are the number of literals, the lower 4 bits the length of the match less 4. If
4 bits are 15, the bytes that follow are added, up to and including the first byte below 255. The last sequence has
literals only.

Sequences of packed events are short. The path for short sequences therefore has no loops, and reads a match in parts
no longer than the earlier writes: a processor can forward a pending write to a read only if the write contains all
bytes of the read.

The unpacked bytes equal those of the reference decoder, and the limits of the reference decoder are kept: a block has
at least 8 bytes after literals that a match follows; the last match begins at least 12 bytes and ends at least 5 bytes
before the largest size of a block.

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
"""Size of the largest copy, bytes, and thus the largest overrun beyond the unpacked bytes."""
HEADER = 7
"""Size of a frame header without length and dictionary, bytes."""
TAIL, MATCH_TAIL, PACKED_TAIL = 5, 12, 8
"""Smallest numbers of bytes in a block: unpacked bytes after the end of a match and after its beginning, and packed
bytes after the literals that a match follows."""


@subkernel
def _extended_length(at, end, count):
    """Add the bytes that extend a length, and return the address after them and the length."""
    never_inline()
    more = 255
    while more == 255 and at < end:
        more = load1(at)
        count += more
        at += 1
    return at, count


@subkernel
def _copy_bytes(to, start, count):
    """Copy byte after byte, so that overlapping ranges repeat the bytes just written."""
    never_inline()
    for k in range(count):
        copy1(to + k, start + k)


@subkernel
def _copy_wide(to, start, count):
    """Copy bytes in steps of `WIDE`, which writes beyond `count`."""
    never_inline()
    k = 0
    while k < count:
        copy16(to + k, start + k)
        k += WIDE


@subkernel
def copy_exactly(to, start, count):
    """Copy exactly `count` bytes between ranges that do not overlap."""
    n_wide = count & -WIDE
    _copy_wide(to, start, n_wide)
    _copy_bytes(to + n_wide, start + n_wide, count - n_wide)


@subkernel
def block(at, end, readable, to, base, limit):
    """Unpack a block.

    Args:
        at: address of its first byte.
        end: address after its last byte.
        readable: address after the last readable byte. With fewer than `WIDE` readable bytes after the end, a valid
            block may be refused.
        to: address of the first byte to write. Up to `WIDE` bytes after `limit` may be overwritten.
        base: address of the first byte that a match may refer to.
        limit: largest address after the unpacked bytes.

    Returns:
        The address after the last unpacked byte, 0 if the block is invalid or too large.
    """
    last = min(end - PACKED_TAIL, readable - WIDE)
    while at < end:
        token = load1(at)
        at += 1
        count = token >> 4
        if count == 15:
            at, count = _extended_length(at, end, count)
        if at + count > last or to + count > limit - MATCH_TAIL:
            if at + count != end or to + count > limit:
                return 0
            copy_exactly(to, at, count)
            return to + count
        copy16(to, at)
        if count > WIDE:
            _copy_wide(to + WIDE, at + WIDE, count - WIDE)
        at += count
        to += count
        start = to - load2(at)
        at += 2
        count = token & 15
        if count == 15:
            at, count = _extended_length(at, end, count)
        count += 4
        if start < base or start == to or to + count > limit - TAIL:
            return 0
        if to - start < WIDE:
            _copy_bytes(to, start, count)
        elif count <= 8:
            copy4(to, start)
            copy4(to + count - 4, start + count - 4)
        elif count <= 16:
            copy8(to, start)
            copy8(to + count - 8, start + count - 8)
        else:
            _copy_wide(to, start, count)
        to += count
    return 0


@kernel
def frame(data, at, end, plain):
    """Unpack a frame with a valid header, without checksums.

    Args:
        data: (n,) uint8.
        at: offset of its first byte.
        end: offset after its last byte.
        plain: (m,) uint8, m > `WIDE`, output.

    Returns:
        The number of unpacked bytes, or -1 if the frame is damaged or has more than m - `WIDE` unpacked bytes. A frame
        that ends less than `WIDE` bytes before the end of the data may also give -1.
    """
    source, first = address(data), address(plain)
    readable, limit = source + data.size, first + plain.size - WIDE
    is_linked = load1(source + at + 4) & 0x20 == 0
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
            base = first if is_linked else to
            to = block(source + at, source + at + size, readable, to, base, min(to + largest, limit))
        elif to + size <= limit:
            copy_exactly(to, source + at, size)
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
    """Return a function that reads the number at an address, as int64."""

    @intrinsic
    def load(typing, address):
        def build(context, builder, signature, arguments):
            value = builder.load(_pointer(builder, arguments[0], bits), align=1)
            return builder.zext(value, ir.IntType(64)) if bits < 64 else value

        return types.int64(types.intp), build

    return load


def _copy(bits):
    """Return a function that copies bytes between addresses; all bytes are read before the first is written."""

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
    """Return the address of the first item, as int64."""
    return np.int64(array.ctypes.data)


@intrinsic
def never_inline(typing):
    """Keep the calling function from being inlined, because the fast path of the callers would slow down."""

    def build(context, builder, signature, arguments):
        builder.function.attributes.add("noinline")
        return context.get_dummy_value()

    return types.void(), build


ENTRY = 8
ROW = RECORD.itemsize


@kernel
def split(plain, start, count, n, t, x, y, p):
    """Split records into columns.

    Args:
        plain: uint8.
        start: offset of the first record.
        count: number of records; all lie within `plain`.
        n: number of events that the columns already hold.
        t: int64, us, written from index n on, as are the other columns.
        x: uint16.
        y: uint16.
        p: uint8, 0 or 1.

    Returns:
        The largest x and y (a coordinate of -1 counts as 2^16 - 1), and True if time never runs back from event n - 1
        on.
    """
    events = address(plain) + start
    x_max = 0
    y_max = 0
    runs_back = False
    last = t[n - 1] if n else load8(events) if count else 0
    for k in range(count):
        now = load8(events + ROW * k)
        word = load8(events + ROW * k + 8)
        column = word & 0xFFFF
        row = word >> 16 & 0xFFFF
        runs_back |= now < last
        last = now
        t[n + k] = now
        x[n + k] = column
        y[n + k] = row
        p[n + k] = word >> 32 & 0xFF != 0
        x_max = max(x_max, column)
        y_max = max(y_max, row)
    return x_max, y_max, not runs_back


@subkernel
def _matches(data, at, expected):
    """Return whether the data at an offset equal the expected bytes."""
    same = at + len(expected) <= data.size
    for k in range(len(expected) if same else 0):
        same &= data[at + k] == expected[k]
    return same


@subkernel
def _unpack_packet(data, at, size, head, plain):
    """Unpack a packet, and return its unpacked size, or -1 if the packet does not begin with `head` or is too long."""
    if len(head) == 0 and size + WIDE <= plain.size:
        copy_exactly(address(plain), address(data) + at, size)
        return size
    if len(head) == 0 or size < HEADER or not _matches(data, at, head):
        return -1
    return frame(data, at, at + size, plain)


class Pattern(NamedTuple):
    """Common beginning of packets.

    Attributes:
        number: number of the stream with the events.
        head: first bytes of the packets; empty if they are not compressed.
        lead: first bytes of the unpacked packets, after their size and up to the number of events.
        highest: largest valid x and y.
    """

    number: int
    head: bytes
    lead: bytes
    highest: int


@kernel
def walk(data, counts, pattern, plain, begins, places, n, columns):
    """Decode packets, up to the first that is incomplete, exceeds the output arrays, or does not match the pattern.

    Args:
        data: (m,) uint8, beginning with a packet.
        counts: (streams,) int64, number of packets of each stream, incremented; -1 for a number without a stream.
        pattern: a `Pattern`.
        plain: uint8, buffer for an unpacked packet.
        begins: int64, output: the first event of each packet with events.
        places: int64 of the same length, output: the offset of each of these packets in `data`.
        n: number of events that the columns already hold.
        columns: written from index n on: t, int64, us; x and y, uint16; p, uint8, 0 or 1.

    Returns:
        The number of bytes used, the number of packets with events, the new number of events, the largest (x, y), and
        True if time never runs back from event n - 1 on.
    """
    number, head, lead, highest = pattern
    t, x, y, p = columns
    at, n_packets, x_max, y_max, ordered = 0, 0, 0, 0, True
    source, first = address(data), address(plain)
    start = 4 + len(lead) + 4
    while at + ENTRY <= data.size and n_packets < begins.size:
        stream, size = load4(source + at), load4(source + at + 4)
        if stream >= counts.size or counts[stream] < 0 or size > min(LIMIT, data.size - at - ENTRY):
            break
        if stream == number:
            length = _unpack_packet(data, at + ENTRY, size, head, plain)
            if length < start or load4(first) != length - 4 or not _matches(plain, 4, lead):
                break
            count = load4(first + start - 4)
            if start + ROW * count > length or n + count > t.size:
                break
            column, row, forward = split(plain, start, count, n, t, x, y, p)
            if max(column, row) > highest:
                break
            if count:
                begins[n_packets], places[n_packets] = n, at
                n_packets += 1
            n += count
            x_max, y_max, ordered = max(x_max, column), max(y_max, row), ordered and forward
        counts[stream] += 1
        at += ENTRY + size
    return at, n_packets, n, (x_max, y_max), ordered
