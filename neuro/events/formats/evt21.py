"""RAW files of Prophesee in the coding EVT 2.1.

A header (see `_prophesee`), then little-endian uint64 words; the kind is in bits 60-63.
0 and 1: events of this polarity (1 = ON), low bits of their time in bits 54-59, x of the first pixel in bits 43-53, y
in bits 32-42; bit i of bits 0-31 tells whether pixel x + i has one.
8, TIME_HIGH: bits 6-33 of the time of what follows, in bits 32-59. What is said of other words and of wraps in `evt2`
holds here, too.

The IMX636 sends the upper half of each word before the lower (``endianness=legacy`` in the header). Where no header
tells, the order is that in which the first words can be: x of events is a multiple of 32, and TIME_HIGH is there.

Source: Prophesee, "EVT 2.1 format", docs.prophesee.ai.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from neuro.events.formats._evt import Decoder
from neuro.events.formats._format import HEAD, Format
from neuro.events.formats._prophesee import GEN3, GEN4, parse
from neuro.events.formats.evt2 import Evt2

WORD = 8
TIME_HIGH = 8


class Evt21(Evt2):
    """An open EVT 2.1 file; see `Evt`."""

    coding = "EVT21"
    title = "EVT 2.1"
    word = WORD
    orders = ("little", "legacy")
    swell = 16

    def decoder(self) -> Decoder:
        """See `Evt`."""
        from neuro.events.formats import _evt2_kernel as kernel

        order = self.header.options.get("endianness")
        legacy = order == "legacy" if order else self._upper_first()

        def halves(words: npt.NDArray[Any]) -> npt.NDArray[Any]:
            return words.reshape(-1, 2)[:, ::-1].reshape(-1) if legacy else words

        return Decoder("<u4", np.zeros(kernel.STATES, np.int64), kernel.room21, kernel.decode21, halves)

    def upper(self, words: npt.NDArray[np.uint32]) -> npt.NDArray[np.uint32]:
        """See `Evt2`."""
        return words[1::2]

    def _upper_first(self) -> bool:
        data = self.source.head(self.header.length + HEAD)[self.header.length :]
        words = np.frombuffer(data[: len(data) // WORD * WORD], "<u4").reshape(-1, 2)
        lower, upper = (int(strange(half).sum()) - int((half >> 28 == TIME_HIGH).sum()) for half in words.T)
        return upper > lower


def strange(upper: npt.NDArray[np.uint32]) -> npt.NDArray[np.bool_]:
    """Which of these upper halves of words can be none."""
    kind = upper >> 28
    event = kind < 2
    known: npt.NDArray[np.bool_] = event | (kind == TIME_HIGH) | (kind == 10) | (kind >= 14)
    aligned: npt.NDArray[np.bool_] = (upper >> 11 & 31) == 0
    return ~known | (event & ~aligned)


EVT21 = Format(
    "evt21", "Prophesee EVT 2.1", (".raw",), lambda head: parse(head).coding == Evt21.coding, Evt21,
    untested="made from the vendor's description; no recording was to be had",
    usual=GEN3, larger=(GEN4,),
)  # fmt: skip
"""Read only."""
