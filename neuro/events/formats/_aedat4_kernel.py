"""Decoding the packets of AEDAT 4 that are like those before them."""

# mypy: ignore-errors

from neuro.events.formats._aedat4_packet import LIMIT, RECORD
from neuro.events.formats._lz4_kernel import HEADER, WIDE, frame, straight
from neuro.events.formats._unaligned import address, load4, load8
from neuro.kernels.jit import inner, kernel

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


@inner
def _same(data, at, expected):
    """Whether data go on like that at a place."""
    same = at + len(expected) <= data.size
    for k in range(len(expected) if same else 0):
        same &= data[at + k] == expected[k]
    return same


@inner
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
