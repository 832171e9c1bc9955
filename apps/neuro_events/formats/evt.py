"""RAW files of Prophesee in the codings EVT 2.0, 2.1 and 3.0."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from neuro.apps import LazyModule
from neuro_events._events import Events
from neuro_events.formats._format import HEAD, Damage, Format, Limits
from neuro_events.formats._reading import seek_point, write_words
from neuro_events.formats._words import (
    ADDED,
    OTHER,
    STARTED,
    Decoder,
    Field,
    Layout,
    Odd,
    SeekingReader,
    State,
    encoded,
    first_state,
)
from neuro_events.formats.dat import GEN3, GEN4, parse, raw_text, read_header
from neuro_events.source import Bytes, Source

evt_kernels = LazyModule("neuro_events.formats._evt_kernels")

Words = npt.NDArray[Any]


class Evt(SeekingReader):
    """An open RAW file.

    ``metadata`` has the lines of the ``header`` and, once all is read, ``other_words``: words left out.

    Attributes:
        coding: the word that a header has for it.
        title: the one that messages have.
        orders: orders of bytes that are read.
        word: bytes of a word.
    """

    coding: ClassVar[str]
    title: ClassVar[str]
    orders: ClassVar[tuple[str, ...]] = ("little",)
    word: ClassVar[int]

    def __init__(self, source: Source) -> None:
        self.source = source
        self.header = header = read_header(source)
        self.start = header.length
        if header.coding not in (None, self.coding):
            key = "format" if "format" in header.fields else "evt"
            raise header.damage(key, f"that of {self.title}")
        if header.options.get("endianness", self.orders[0]) not in self.orders:
            raise header.damage("format", f"endianness {' or '.join(self.orders)}")
        if not header.length and source.size == 0:
            raise Damage(f"is empty, expected a header or words of {self.title}", 0)
        self.sensor_size = header.sensor_size()
        self.metadata = {"format": self.coding.lower(), "header": dict(header.fields)}

    def count(self, state: State) -> None:
        """See `WordReader`."""
        self.metadata["other_words"] = int(state[OTHER])

    def check_end(self, rest: Bytes, end: int, decoder: Decoder) -> None:
        """See `WordReader`."""
        super().check_end(rest, end, decoder)
        if decoder.state[OTHER] and not decoder.state[STARTED]:
            raise Damage(f"no word of {self.title} gives the time of what follows", self.start)


TIME_HIGH = 8
LOW_BITS = 6
PERIOD = 1 << 28
"""Values of TIME_HIGH, which tells the bits of the time above the low ones."""
HIGH_LOOK = 1 << 14
"""Bytes of a block in which a TIME_HIGH is looked for; cameras send one every 16 us."""
LIMITS_2 = Limits(1 << 34, 1 << 11)

LAYOUT_2 = Layout(
    4, t=Field(22, LOW_BITS), x=Field(11, 11), y=Field(0, 11), p=Field(28, 1),
    odd=Odd(0xE0000000), others="time_high", waits=True,
)  # fmt: skip


class Evt2(Evt):
    """An open EVT 2.0 file; see `Evt`.

    A header (see `dat`), then little-endian uint32 words; the kind is in bits 28-31.
    0 and 1: an event of this polarity (1 = ON), low bits of its time in bits 22-27, x in bits 11-21, y in bits 0-10.
    8, TIME_HIGH: bits 6-33 of the time of what follows, in bits 0-27.
    10, 14, 15 and other kinds (triggers, the vendor's own) are no events of pixels and are left out, as are events
    before the first TIME_HIGH, of unknown time; ``metadata["other_words"]`` counts them.

    A recording longer than 2^34 us (4.8 hours) begins again at 0: a TIME_HIGH in the last sixteenth of its range
    followed by one in the first sixteenth is taken for that, and 2^34 us are added from there on.

    Source: Prophesee, "EVT 2.0 format", docs.prophesee.ai.
    """

    coding = "EVT2"
    title = "EVT 2.0"
    word = 4
    layout = LAYOUT_2

    def seek(self, decoder: Decoder, step: int, start_us: int) -> int:
        """See `SeekingReader`."""
        at = seek_point(self.start, self.clocks(step), start_us >> LOW_BITS, PERIOD)
        decoder.state[ADDED] = at.added << LOW_BITS
        return at.place

    def clocks(self, step: int) -> Iterator[tuple[int, int]]:
        """The first TIME_HIGH of each sample that has one."""
        for place, data in self.source.samples(self.start, step, min(step, HIGH_LOOK)):
            words = self.upper(data[: data.size // self.word * self.word].view("<u4"))
            found = np.flatnonzero(words >> 28 == TIME_HIGH)
            if found.size:
                yield place, int(words[found[0]] & 0x0FFFFFFF)

    def upper(self, words: npt.NDArray[np.uint32]) -> npt.NDArray[np.uint32]:
        """Of words the 32 bits with the kind."""
        return words


def write_evt2(parts: Iterator[Events], path: Path) -> None:
    """Encode, with the sensor in the header; metadata are not kept."""
    high = -1

    def words(done: int, events: Events) -> bytes:
        nonlocal high
        LIMITS_2.check(events, done)
        highs = events.t >> LOW_BITS
        new = np.diff(highs, prepend=high) != 0
        high = int(highs[-1]) if len(events) else high
        place = np.arange(len(events)) + np.cumsum(new)
        out = np.empty(len(events) + int(new.sum()), "<u4")
        out[place[new] - 1] = TIME_HIGH << 28 | highs[new]
        out[place] = encoded(LAYOUT_2, events).view("<u4")[:, 0]
        return out.tobytes()

    write_words(parts, path, partial(raw_text, "2.0"), words)


EVT2 = Format(
    "evt2", "Prophesee EVT 2.0", (".raw",), lambda head: parse(head).coding == Evt2.coding, Evt2, write_evt2,
    holds=LIMITS_2.holds, grows=True, usual=GEN3, larger=(GEN4,),
)  # fmt: skip
"""Read and written."""


class Evt21(Evt2):
    """An open EVT 2.1 file; see `Evt`.

    A header (see `dat`), then little-endian uint64 words; the kind is in bits 60-63.
    0 and 1: events of this polarity (1 = ON), low bits of their time in bits 54-59, x of the first pixel in bits 43-53,
    y in bits 32-42; bit i of bits 0-31 tells whether pixel x + i has one.
    8, TIME_HIGH: bits 6-33 of the time of what follows, in bits 32-59. What is said of other words and of wraps in
    `evt2` holds here, too.

    The IMX636 sends the upper half of each word before the lower (``endianness=legacy`` in the header). Where no header
    tells, the order is that in which the first words can be: x of events is a multiple of 32, and TIME_HIGH is there.

    Source: Prophesee, "EVT 2.1 format", docs.prophesee.ai.
    """

    coding = "EVT21"
    title = "EVT 2.1"
    word = 8
    orders = ("little", "legacy")
    block_divisor = 16

    def decoder(self) -> Decoder:
        """See `WordReader`."""
        half = self._upper_half()
        decode, room = (partial(kernel, half) for kernel in (evt_kernels.decode21, evt_kernels.room21))
        return Decoder(decode, first_state(), self.word, self.word, room)

    def upper(self, words: npt.NDArray[np.uint32]) -> npt.NDArray[np.uint32]:
        """See `Evt2`."""
        return words[self._upper_half() :: 2]

    def _upper_half(self) -> int:
        """Which half of a word is the upper one: 0 where it comes first, else 1."""
        if order := self.header.options.get("endianness"):
            return int(order != "legacy")
        data = self.source.head(self.header.length + HEAD)[self.header.length :]
        words = np.frombuffer(data[: len(data) // self.word * self.word], "<u4").reshape(-1, 2)
        lower, upper = (int(strange(half).sum()) - int((half >> 28 == TIME_HIGH).sum()) for half in words.T)
        return int(upper <= lower)


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


LIMITS_3 = Limits(1 << 40, 1 << 11)
"""Times and sides that are written. Wraps could tell any time, with two words each; this bounds their number."""

OTHER_ROW, VECT_BASE_X, TIME_LOW = 1, 3, 6
"""Kinds of words; a row has kind 0 or 1."""

SLICE = 1 << 16
"""Events encoded at a time."""


def _whole(data: Bytes) -> npt.NDArray[np.uint16]:
    return data[: data.size // 2 * 2].view("<u2")


def evt3_decoder() -> Decoder:
    """A new decoder of EVT 3.0."""
    state = np.zeros(evt_kernels.STATES_3, np.int64)
    state[evt_kernels.ROW] = state[evt_kernels.BASE] = -1

    def decode(data: Bytes, *rest: Any) -> tuple[int, int, int, int, bool]:
        words = _whole(data)
        count, x_max, y_max, ordered = evt_kernels.decode3(words, *rest)
        return count, words.nbytes, x_max, y_max, ordered

    return Decoder(decode, state, 2, 2, lambda data: evt_kernels.room3(_whole(data)))


class Evt3(Evt):
    """An open EVT 3.0 file; see `Evt`.

    A header (see `dat`), then little-endian uint16 words; the kind is in bits 12-15. Time, row and the base of
    vectors hold until the next word that changes them.
    0: row in bits 0-10. 2: an event at the column in bits 0-10, polarity in bit 11 (1 = ON).
    3: base column and polarity of vectors. 4 and 5: events at base + i for each bit i of 12 or 8; the base advances as
    much. 6, TIME_LOW and 8, TIME_HIGH: bits 0-11 and 12-23 of the time. A TIME_HIGH that differs from that before sets
    the low bits to 0 until the next TIME_LOW. A TIME_LOW may be smaller than that before; the last one counts.
    A TIME_HIGH smaller by 2048 or more is a wrap of the 24 bits (16.8 s), and 2^24 us are added from there on.

    Triggers and other kinds are no events of pixels and are left out, as are events before the first TIME_HIGH and the
    first row, and those of a row of kind 1 (intensity pixels of older sensors); ``metadata["other_words"]`` counts
    them.

    Source: Prophesee, "EVT 3.0 format", docs.prophesee.ai; the rules of TIME_HIGH and of kind 1 as in the vendor's
    decoder (OpenEB, ``evt3_decoder.h``).
    """

    coding = "EVT3"
    title = "EVT 3.0"
    word = 2
    block_divisor = 4

    def decoder(self) -> Decoder:
        """See `WordReader`."""
        return evt3_decoder()

    def seek(self, decoder: Decoder, step: int, start_us: int) -> int:
        """See `SeekingReader`. The clock wraps so soon that all TIME_HIGH before are looked at, and nothing else."""
        begin = self.start
        high, kinds, margin = -1, 0, (begin, -1)
        before = np.zeros(0, np.uint16)
        for place, data in self.source.blocks(begin, step, self.word):
            words = _whole(data)
            at_begin, kinds_before = high, kinds
            high, kinds, most = evt_kernels.track3(words, high, kinds)
            if most >= start_us >> 12:
                if margin[1] < 0 or not _settled(before, bool(kinds_before >> VECT_BASE_X & 1)):
                    return begin
                decoder.state[STARTED], decoder.state[evt_kernels.TIME] = 1, margin[1] << 12
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
    settled = rows.size > 0 and bool(np.any(kinds == TIME_LOW))
    return settled and (not vectors or bool(np.any(kinds[rows[0] :] == VECT_BASE_X)))


def write_evt3(parts: Iterator[Events], path: Path) -> None:
    """Encode, with the sensor in the header; metadata are not kept."""
    state = np.array([-1, -1], np.int64)

    def encoded(done: int, events: Events) -> bytes:
        LIMITS_3.check(events, done)
        return b"".join(map(sliced, (events[first : first + SLICE] for first in range(0, len(events), SLICE))))

    def sliced(part: Events) -> bytes:
        wraps = (int(part.t[-1]) >> 24) - (max(int(state[0]), 0) >> 24)
        words = np.empty(4 * len(part) + 2 * wraps + 1, "<u2")
        return words[: evt_kernels.encode3(part.t, part.x, part.y, part.p, state, words)].tobytes()

    write_words(parts, path, partial(raw_text, "3.0"), encoded)


EVT3 = Format(
    "evt3", "Prophesee EVT 3.0", (".raw",), lambda head: parse(head).coding == Evt3.coding, Evt3, write_evt3,
    holds=LIMITS_3.holds, grows=True, usual=GEN3, larger=(GEN4,),
)  # fmt: skip
"""Read and written."""


GUESS_BYTES = 1 << 16
KINDS_2 = (0, 1, 8, 10, 14, 15)
KINDS_3 = (0, 2, 3, 4, 5, 6, 7, 8, 10, 14, 15)

Reads = type[Evt21] | type[Evt3] | type[Evt2]


def opened(source: Source) -> Evt21 | Evt3 | Evt2:
    """The reader of the coding that the words are of.

    Raises:
        Damage: they are of none, or the header names one that is not known.

    The coding is the one in which the first 64 KiB are of known kinds (but for one word of 64, at most), there is a
    TIME_HIGH, and TIME_HIGH never falls, except in a wrap.
    """
    header = read_header(source)
    if header.coding is not None:
        raise header.damage("format" if "format" in header.fields else "evt", "that of EVT 2.0, 2.1 or 3.0")
    data = source.head(header.length + GUESS_BYTES)[header.length :]
    if not data:
        raise Damage("no words, and no header that names their coding", header.length)
    for reads, fits in _GUESSES:
        if fits(data):
            return reads(source)
    raise Damage("no header names the coding, and the words are none of EVT 2.0, 2.1 or 3.0", header.length)


def _fits21(data: bytes) -> bool:
    halves = _words(data, "<u4", 8).reshape(-1, 2)
    return any(_likely(strange(half), half, 28) for half in (halves[:, 1], halves[:, 0]))


def _fits(dtype: str, size: int, kind_at: int, kinds: tuple[int, ...], data: bytes) -> bool:
    words = _words(data, dtype, size)
    return _likely(~np.isin(words >> kind_at, kinds), words, kind_at)


def _words(data: bytes, dtype: str, size: int) -> Words:
    return np.frombuffer(data[: len(data) // size * size], dtype)


def _likely(odd: npt.NDArray[np.bool_], words: Words, kind_at: int) -> bool:
    """Whether words, some of them odd, are of a coding whose kinds begin at this bit."""
    high = (words[words >> kind_at == TIME_HIGH] & ((1 << kind_at) - 1)).astype(np.int64)
    step = np.diff(high)
    falls = (step < 0) & (step > -(1 << (kind_at - 1)))
    return bool(high.size and 64 * odd.sum() <= words.size and not falls.any())


_GUESSES: tuple[tuple[Reads, Callable[[bytes], bool]], ...] = (
    (Evt21, _fits21),
    (Evt3, partial(_fits, "<u2", 2, 12, KINDS_3)),
    (Evt2, partial(_fits, "<u4", 4, 28, KINDS_2)),
)


def _knows(head: bytes) -> bool:
    return parse(head).coding not in (None, Evt21.coding, Evt3.coding, Evt2.coding)


RAW = Format("raw", "Prophesee RAW", (".raw",), _knows, opened, usual=GEN3, larger=(GEN4,))
"""Read only. Among our formats it stands before the codings, so that the ending ``.raw`` alone leads here."""
