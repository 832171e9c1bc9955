"""The 5-byte ``.bin`` of N-MNIST and N-Caltech101.

Five bytes an event, big-endian: x, y, then one bit polarity (1 = ON) and 23 bits of time in us.
The file has no header, so neither its kind nor its sensor is written in it.

Source: Orchard et al., Front. Neurosci. 9:437, 2015, and the data set's own Matlab reader, from which
the rule for y = 240 comes: such a word is no event but adds 2^13 us to all times after it.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt

from neuro.events._events import Events
from neuro.events.formats._format import Format, Size, outside, refuse, within
from neuro.events.formats._layout import Field, Layout, Odd, encoded
from neuro.events.formats._reading import write_words
from neuro.events.formats._words import Decoder, WordReader, layout_decoder
from neuro.events.source import Source

SENSOR_SIZE = (34, 34)
"""Of N-MNIST, px."""

OVERFLOW_ROW = 240
T_LIMIT = 1 << 23

LAYOUT = Layout(
    5, t=Field(0, 23, byte=1), x=Field(0, 8, size=1), y=Field(24, 8, byte=1), p=Field(23, 1, byte=1),
    odd=Odd(0xFF, OVERFLOW_ROW, differs=False, byte=1, size=1), others="overflow", is_big=True,
)  # fmt: skip


class Bin(WordReader):
    """An open ``.bin``; ``sensor_size`` is None, since the file does not tell it."""

    word = LAYOUT.size
    called = "events"
    sensor_size: Size | None = None
    start = 0

    def __init__(self, source: Source) -> None:
        self.source = source
        self.metadata = {}

    def decoder(self) -> Decoder:
        """See `WordReader`."""
        return layout_decoder(LAYOUT)


def write(parts: Iterator[Events], path: Path) -> None:
    """Encode as ``.bin``; the sensor size and the metadata are not kept."""
    write_words(parts, path, lambda size: b"", _encoded)


def _encoded(done: int, events: Events) -> bytes:
    off = _outside(events)
    limits = f"t 0 to {T_LIMIT - 1} us, x and y 0 to 255, y not {OVERFLOW_ROW}"
    refuse(events, ~within(events, T_LIMIT) | off, done, limits, off)
    return encoded(LAYOUT, events).tobytes()


def _outside(events: Events) -> npt.NDArray[np.bool_]:
    off = outside(events, 256, 256)
    off |= events.y == OVERFLOW_ROW
    return off


NMNIST = Format(
    "nmnist", "N-MNIST .bin", (".bin",), lambda head: False, Bin, write,
    holds=lambda events, last: within(events, T_LIMIT) & ~_outside(events), grows=True, usual=SENSOR_SIZE,
)  # fmt: skip
"""Read and written."""
