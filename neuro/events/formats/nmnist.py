"""The 5-byte ``.bin`` of N-MNIST and N-Caltech101.

Five bytes an event, big-endian: x, y, then one bit polarity (1 = ON) and 23 bits of time in us.
The file has no header, so neither its kind nor its sensor is written in it.

Source: Orchard et al., Front. Neurosci. 9:437, 2015, and the data set's own Matlab reader, from which
the rule for y = 240 comes: such a word is no event but adds 2^13 us to all times after it.
"""

from __future__ import annotations

import numpy as np

from neuro.events._events import Events
from neuro.events.formats._format import Damage, Decoded, Format, Unsavable

SENSOR_SIZE = (34, 34)
"""Of N-MNIST, px."""

WORD = 5
OVERFLOW_ROW = 240
OVERFLOW_US = 1 << 13
T_LIMIT = 1 << 23


def read(data: bytes, sensor_size: tuple[int, int] | None) -> Decoded:
    """Decode a ``.bin``.

    Args:
        data: the file.
        sensor_size: width and height; None means 34x34, or, where an event lies outside of that
            (N-Caltech101), the smallest size that holds all events.
    """
    if len(data) % WORD:
        n = len(data) // WORD
        raise Damage(f"{len(data) % WORD} bytes left over after {n} events of 5 bytes", n * WORD)
    words = np.frombuffer(data, np.uint8).reshape(-1, WORD)
    x, y = words[:, 0], words[:, 1]
    t = (words[:, 2] & 0x7F).astype(np.int64) << 16 | words[:, 3].astype(np.int64) << 8 | words[:, 4]
    p = words[:, 2] >> 7
    offsets = np.arange(0, len(data), WORD, dtype=np.int64)
    overflow = y == OVERFLOW_ROW
    if overflow.any() and (sensor_size is None or sensor_size[1] <= OVERFLOW_ROW):
        t += OVERFLOW_US * np.cumsum(overflow)
        t, x, y, p, offsets = (a[~overflow] for a in (t, x, y, p, offsets))
    return Decoded(t, x, y, p, sensor_size or _size_of(x, y), offsets)


def _size_of(x: np.ndarray, y: np.ndarray) -> tuple[int, int]:
    width = int(x.max(initial=0)) + 1
    height = int(y.max(initial=0)) + 1
    return SENSOR_SIZE if width <= SENSOR_SIZE[0] and height <= SENSOR_SIZE[1] else (width, height)


def write(events: Events) -> bytes:
    """Encode as ``.bin``; the sensor size and the metadata are not kept."""
    bad = (events.t < 0) | (events.t >= T_LIMIT) | (events.x > 255) | (events.y > 255)
    bad |= events.y == OVERFLOW_ROW
    if bad.any():
        k = int(bad.argmax())
        t, x, y = events.t[k], events.x[k], events.y[k]
        what = f"t {t}, x {x}, y {y}; expected t 0 to {T_LIMIT - 1} us, x and y 0 to 255, y not {OVERFLOW_ROW}"
        raise Unsavable(what, k)
    words = np.empty((len(events), WORD), np.uint8)
    words[:, 0], words[:, 1] = events.x, events.y
    words[:, 2] = events.p << 7 | (events.t >> 16).astype(np.uint8)
    words[:, 3], words[:, 4] = events.t >> 8 & 0xFF, events.t & 0xFF
    return words.tobytes()


NMNIST = Format("nmnist", "N-MNIST .bin", (".bin",), b"", read, write)
"""Read and written."""
