"""Decoding the packets of AEDAT 3.1."""

# mypy: ignore-errors
import numpy as np

from neuro.kernels.jit import inner, kernel

PACKET = 28
EVENT = 8
POLARITY = 1
OTHER, INVALID = 0, 1


@inner
def word(data, at):
    """A little-endian signed 32-bit number."""
    low = np.int64(data[at]) | np.int64(data[at + 1]) << 8 | np.int64(data[at + 2]) << 16 | np.int64(data[at + 3]) << 24
    return low - ((low & 0x80000000) << 1)


@inner
def wrong(data, at):
    """Whether these are not the sizes of a packet: events, their bytes and their times have none below zero."""
    size, offset = word(data, at + 4), word(data, at + 8)
    capacity, number, valid = word(data, at + 16), word(data, at + 20), word(data, at + 24)
    kind = np.int64(data[at]) | np.int64(data[at + 1]) << 8
    counts = size <= 0 or not 0 <= valid <= number <= capacity
    return counts or not 0 <= offset < size or word(data, at + 12) < 0 or (kind == POLARITY and size != EVENT)


@kernel
def decode(data, source, state, left_out, t, x, y, p):
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
