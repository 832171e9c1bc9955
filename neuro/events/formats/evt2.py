"""RAW files of Prophesee in the coding EVT 2.0.

A header (see `_prophesee`), then little-endian uint32 words; the kind is in bits 28-31.
0 and 1: an event of this polarity (1 = ON), low bits of its time in bits 22-27, x in bits 11-21, y in bits 0-10.
8, TIME_HIGH: bits 6-33 of the time of what follows, in bits 0-27.
10, 14, 15 and other kinds (triggers, the vendor's own) are no events of pixels and are left out, as are events before
the first TIME_HIGH, whose time no word tells; ``metadata["other_words"]`` counts them.

A recording longer than 2^34 us (4.8 hours) begins again at 0: a TIME_HIGH in the last sixteenth of its range followed
by one in the first sixteenth is taken for that, and 2^34 us are added from there on.

Source: Prophesee, "EVT 2.0 format", docs.prophesee.ai.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt

from neuro.events._events import Events
from neuro.events.formats._evt import Bytes, Decoder, Evt
from neuro.events.formats._format import Format
from neuro.events.formats._prophesee import GEN3, GEN4, check_room, parse, raw_text
from neuro.events.formats._seek import begin
from neuro.events.formats._write import in_order

TIME_HIGH = 8
LOW_BITS = 6
PERIOD = 1 << 28
"""Values of TIME_HIGH, which tells the bits of the time above the low ones."""
LOOK = 1 << 14
"""Bytes of a block in which a TIME_HIGH is looked for; cameras send one every 16 us."""
ROOM = (1 << 34, 1 << 11)
"""Times and sides that the words can tell."""


class Evt2(Evt):
    """An open EVT 2.0 file; see `Evt`."""

    coding = "EVT2"
    title = "EVT 2.0"
    word = 4

    def decoder(self) -> Decoder:
        """See `Evt`."""
        from neuro.events.formats import _evt2_kernel as kernel

        return Decoder("<u4", np.zeros(kernel.STATES, np.int64), len, kernel.decode)

    def sought(self, decoder: Decoder, step: int, start_us: int) -> int:
        """See `Evt`."""
        from neuro.events.formats import _evt2_kernel as kernel

        samples = self.source.samples(self.header.length, step, min(step, LOOK))
        at = begin(self.header.length, self._highs(decoder, samples), start_us >> LOW_BITS, PERIOD)
        decoder.state[kernel.WRAPS] = at.added << LOW_BITS
        return at.place

    def _highs(self, decoder: Decoder, samples: Iterable[tuple[int, Bytes]]) -> Iterator[tuple[int, int]]:
        """The first TIME_HIGH of each sample that has one."""
        for place, data in samples:
            words = self.upper(decoder.order(data[: data.size // self.word * self.word].view(decoder.dtype)))
            found = np.flatnonzero(words >> 28 == TIME_HIGH)
            if found.size:
                yield place, int(words[found[0]] & 0x0FFFFFFF)

    def upper(self, words: npt.NDArray[np.uint32]) -> npt.NDArray[np.uint32]:
        """Of words the 32 bits with the kind."""
        return words


def write(parts: Iterator[Events], path: Path) -> None:
    """Encode, with the sensor in the header; metadata are not kept."""
    high = -1
    with path.open("wb") as file:
        for done, events in in_order(parts):
            if file.tell() == 0:
                file.write(raw_text("2.0", events.sensor_size))
            check_room(events, done, *ROOM)
            words, high = _words(events, high)
            file.write(words.tobytes())
        if file.tell() == 0:
            file.write(raw_text("2.0", None))


def _words(events: Events, high: int) -> tuple[npt.NDArray[np.uint32], int]:
    """Words of events after a TIME_HIGH of this value, and the value after them."""
    highs = events.t >> 6
    new = np.diff(highs, prepend=high) != 0
    place = np.arange(len(events)) + np.cumsum(new)
    words = np.empty(len(events) + int(new.sum()), "<u4")
    words[place[new] - 1] = TIME_HIGH << 28 | highs[new]
    low = events.t.astype(np.uint32) & np.uint32(0x3F)
    x, p = events.x.astype(np.uint32), events.p.astype(np.uint32)
    words[place] = p << 28 | low << 22 | x << 11 | events.y
    return words, int(highs[-1]) if len(events) else high


EVT2 = Format(
    "evt2", "Prophesee EVT 2.0", (".raw",), lambda head: parse(head).coding == Evt2.coding, Evt2, write,
    usual=GEN3, larger=(GEN4,),
)  # fmt: skip
"""Read and written."""
