"""The 5-byte ``.bin`` of N-MNIST and N-Caltech101.

Five bytes an event, big-endian: x, y, then one bit polarity (1 = ON) and 23 bits of time in us.
The file has no header, so neither its kind nor its sensor is written in it.

Source: Orchard et al., Front. Neurosci. 9:437, 2015, and the data set's own Matlab reader, from which
the rule for y = 240 comes: such a word is no event but adds 2^13 us to all times after it.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro.events._events import Events, empty_columns
from neuro.events.formats._format import Damage, Format, Piece, Size, outside, refuse, within
from neuro.events.formats._reading import decoded, write_words
from neuro.events.source import Source

SENSOR_SIZE = (34, 34)
"""Of N-MNIST, px."""

WORD = 5
OVERFLOW_ROW = 240
OVERFLOW_US = 1 << 13
T_LIMIT = 1 << 23


class Bin:
    """An open ``.bin``; ``sensor_size`` is None, since the file does not tell it."""

    sensor_size: Size | None = None

    def __init__(self, source: Source) -> None:
        self._source = source
        self.metadata: Mapping[str, Any] = {}

    def pieces(self, block: int) -> Iterator[Piece]:
        """The events; see `Reader`."""
        from neuro.events.formats._byte_kernels import decode_nmnist

        begin = 0
        for place, data in self._source.blocks(0, block, WORD):
            n = data.size // WORD
            room = empty_columns(n)
            found, x_max, y_max, ordered, begin = decode_nmnist(data, begin, *room)
            whole = found == n

            def byte(event: int, place: int = place, data: Any = data, whole: bool = whole) -> int:
                return place + WORD * (event if whole else int(np.flatnonzero(data[1::WORD] != OVERFLOW_ROW)[event]))

            yield decoded(room, found, (x_max, y_max), ordered, byte)
            if rest := data.size % WORD:
                raise Damage(f"{rest} bytes left over after {place // WORD + n} events of 5 bytes", place + n * WORD)


def write(parts: Iterator[Events], path: Path) -> None:
    """Encode as ``.bin``; the sensor size and the metadata are not kept."""
    write_words(parts, path, lambda size: b"", _words)


def _words(done: int, events: Events) -> bytes:
    off = _outside(events)
    limits = f"t 0 to {T_LIMIT - 1} us, x and y 0 to 255, y not {OVERFLOW_ROW}"
    refuse(events, ~within(events, T_LIMIT) | off, done, limits, off)
    words = np.empty((len(events), WORD), np.uint8)
    words[:, 0], words[:, 1] = events.x, events.y
    words[:, 2] = events.p << 7 | (events.t >> 16).astype(np.uint8)
    words[:, 3], words[:, 4] = events.t >> 8 & 0xFF, events.t & 0xFF
    return words.tobytes()


def _outside(events: Events) -> npt.NDArray[np.bool_]:
    off = outside(events, 256, 256)
    off |= events.y == OVERFLOW_ROW
    return off


NMNIST = Format(
    "nmnist", "N-MNIST .bin", (".bin",), lambda head: False, Bin, write,
    holds=lambda events, last: within(events, T_LIMIT) & ~_outside(events), grows=True, usual=SENSOR_SIZE,
)  # fmt: skip
"""Read and written."""
