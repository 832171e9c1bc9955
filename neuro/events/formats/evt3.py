"""RAW files of Prophesee in the coding EVT 3.0.

A header (see `_prophesee`), then little-endian uint16 words; the kind is in bits 12-15. Time, row and the base of
vectors hold until the next word that changes them.
0: row in bits 0-10. 2: an event at the column in bits 0-10, polarity in bit 11 (1 = ON).
3: base column and polarity of vectors. 4 and 5: events at base + i for each bit i of 12 or 8; the base advances as
much. 6, TIME_LOW and 8, TIME_HIGH: bits 0-11 and 12-23 of the time. A TIME_HIGH that differs from that before sets the
low bits to 0 until the next TIME_LOW. A TIME_LOW may be smaller than that before; the last one counts.
A TIME_HIGH smaller by 2048 or more is a wrap of the 24 bits (16.8 s), and 2^24 us are added from there on.

Triggers and other kinds are no events of pixels and are left out, as are events before the first TIME_HIGH and the
first row, and those of a row of kind 1 (intensity pixels of older sensors); ``metadata["other_words"]`` counts them.

Source: Prophesee, "EVT 3.0 format", docs.prophesee.ai; the rules of TIME_HIGH and of kind 1 as in the vendor's decoder
(OpenEB, ``evt3_decoder.h``).
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt

from neuro.events._events import Events
from neuro.events.formats._evt import Decoder, Evt
from neuro.events.formats._format import Format
from neuro.events.formats._prophesee import GEN3, GEN4, check_room, parse, raw_text
from neuro.events.formats._write import in_order

ROOM = (1 << 40, 1 << 11)
"""Times and sides that are written. Wraps could tell any time, with two words each; this bounds their number."""

OTHER_ROW, VECT_BASE_X, TIME_LOW = 1, 3, 6
"""Kinds of words; a row has kind 0 or 1."""

SLICE = 1 << 16
"""Events encoded at a time."""


class Evt3(Evt):
    """An open EVT 3.0 file; see `Evt`."""

    coding = "EVT3"
    title = "EVT 3.0"
    word = 2
    swell = 4

    def decoder(self) -> Decoder:
        """See `Evt`."""
        from neuro.events.formats import _evt3_kernel as kernel

        state = np.zeros(kernel.STATES, np.int64)
        state[kernel.ROW] = state[kernel.BASE] = -1
        return Decoder("<u2", state, kernel.room, kernel.decode)

    def sought(self, decoder: Decoder, step: int, start_us: int) -> int:
        """See `Evt`. The clock wraps so soon that all TIME_HIGH before are looked at, and nothing else."""
        from neuro.events.formats import _evt3_kernel as kernel
        from neuro.events.formats._evt3_seek_kernel import track

        begin = self.header.length
        high, kinds, margin = -1, 0, (begin, -1)
        before = np.zeros(0, np.uint16)
        for place, data in self.source.blocks(begin, step, self.word):
            words = data[: data.size // self.word * self.word].view("<u2")
            at_begin, kinds_before = high, kinds
            high, kinds, most = track(words, high, kinds)
            if most >= start_us >> 12:
                if margin[1] < 0 or not _settled(before, bool(kinds_before >> VECT_BASE_X & 1)):
                    return begin
                decoder.state[kernel.STARTED], decoder.state[kernel.TIME] = 1, margin[1] << 12
                return margin[0]
            margin, before = (place, at_begin), words
        return begin


def _settled(words: npt.NDArray[np.uint16], vectors: bool) -> bool:
    """Whether words tell all that those after them need but TIME_HIGH: low bits of the time, row, base of vectors.

    Args:
        words: of a block.
        vectors: whether the file had a base so far.
    """
    kinds = words >> 12
    rows = np.flatnonzero(kinds <= OTHER_ROW)
    told = rows.size > 0 and bool(np.any(kinds == TIME_LOW))
    return told and (not vectors or bool(np.any(kinds[rows[0] :] == VECT_BASE_X)))


def write(parts: Iterator[Events], path: Path) -> None:
    """Encode, with the sensor in the header; metadata are not kept."""
    from neuro.events.formats._evt3_kernel import encode

    state = np.array([-1, -1], np.int64)
    with path.open("wb") as file:
        for done, events in in_order(parts):
            if file.tell() == 0:
                file.write(raw_text("3.0", events.sensor_size))
            check_room(events, done, *ROOM)
            for first in range(0, len(events), SLICE):
                part = events[first : first + SLICE]
                wraps = (int(part.t[-1]) >> 24) - (max(int(state[0]), 0) >> 24)
                words = np.empty(4 * len(part) + 2 * wraps + 1, "<u2")
                count = encode(part.t, part.x, part.y, part.p, state, words)
                file.write(words[:count].tobytes())
        if file.tell() == 0:
            file.write(raw_text("3.0", None))


EVT3 = Format(
    "evt3", "Prophesee EVT 3.0", (".raw",), lambda head: parse(head).coding == Evt3.coding, Evt3, write,
    usual=GEN3, larger=(GEN4,),
)  # fmt: skip
"""Read and written."""
