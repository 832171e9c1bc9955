"""RAW files of Prophesee that do not tell their coding: cut from a stream, or with the header of a very old recorder.

The coding is the one in which the first 64 KiB are of known kinds (but for one word of 64, at most), there is a
TIME_HIGH, and TIME_HIGH never falls, except in a wrap.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro.events.formats._format import Damage, Format
from neuro.events.formats._prophesee import GEN3, GEN4, parse, read_header
from neuro.events.formats.evt2 import Evt2
from neuro.events.formats.evt3 import Evt3
from neuro.events.formats.evt21 import Evt21, strange
from neuro.events.source import Source

LOOK = 1 << 16
KINDS_2 = (0, 1, 8, 10, 14, 15)
KINDS_3 = (0, 2, 3, 4, 5, 6, 7, 8, 10, 14, 15)
TIME_HIGH = 8

Words = npt.NDArray[np.unsignedinteger[Any]]
Reads = type[Evt21] | type[Evt3] | type[Evt2]


def opened(source: Source) -> Evt21 | Evt3 | Evt2:
    """The reader of the coding that the words are of.

    Raises:
        Damage: they are of none, or the header names one that is not known.
    """
    header = read_header(source)
    if header.coding is not None:
        raise header.damage("format" if "format" in header.fields else "evt", "that of EVT 2.0, 2.1 or 3.0")
    data = source.head(header.length + LOOK)[header.length :]
    if not data:
        raise Damage("no words, and no header that tells their coding", header.length)
    for reads, fits in _GUESSES:
        if fits(data):
            return reads(source)
    raise Damage("no header tells the coding, and the words are none of EVT 2.0, 2.1 or 3.0", header.length)


def _fits21(data: bytes) -> bool:
    halves = _words(data, "<u4", 8).reshape(-1, 2)
    return any(_likely(strange(half), half, 28) for half in (halves[:, 1], halves[:, 0]))


def _fits3(data: bytes) -> bool:
    words = _words(data, "<u2", 2)
    return _likely(~np.isin(words >> 12, KINDS_3), words, 12)


def _fits2(data: bytes) -> bool:
    words = _words(data, "<u4", 4)
    return _likely(~np.isin(words >> 28, KINDS_2), words, 28)


def _words(data: bytes, dtype: str, size: int) -> Words:
    return np.frombuffer(data[: len(data) // size * size], dtype)


def _likely(odd: npt.NDArray[np.bool_], words: Words, kind_at: int) -> bool:
    """Whether words, some of them odd, are of a coding whose kinds begin at this bit."""
    high = (words[words >> kind_at == TIME_HIGH] & ((1 << kind_at) - 1)).astype(np.int64)
    step = np.diff(high)
    falls = (step < 0) & (step > -(1 << (kind_at - 1)))
    return bool(high.size and 64 * odd.sum() <= words.size and not falls.any())


_GUESSES: tuple[tuple[Reads, Callable[[bytes], bool]], ...] = ((Evt21, _fits21), (Evt3, _fits3), (Evt2, _fits2))


def _knows(head: bytes) -> bool:
    return parse(head).coding not in (None, Evt21.coding, Evt3.coding, Evt2.coding)


RAW = Format("raw", "Prophesee RAW", (".raw",), _knows, opened, usual=GEN3, larger=(GEN4,))
"""Read only. Among our formats it stands before the codings, so that the ending ``.raw`` alone leads here."""
