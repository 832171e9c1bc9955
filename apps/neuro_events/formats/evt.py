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
    """A reader of RAW files.

    ``metadata`` has the lines of the ``header`` and, after reading, the number of skipped ``other_words``.

    Attributes:
        coding: name of the coding in headers.
        title: name of the coding in messages.
        orders: supported byte orders.
        word: size of a word, bytes.
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
            raise header.damage(key, f"a file of {self.title}")
        if header.options.get("endianness", self.orders[0]) not in self.orders:
            raise header.damage("format", f"endianness {' or '.join(self.orders)}")
        if not header.length and source.size == 0:
            raise Damage(f"is empty, expected a header or words of {self.title}", 0)
        self.sensor_size = header.sensor_size()
        self.metadata = {"format": self.coding.lower(), "header": dict(header.fields)}

    def count(self, state: State) -> None:
        """Update the number of skipped words in the metadata; see `WordReader`."""
        self.metadata["other_words"] = int(state[OTHER])

    def check_end(self, rest: Bytes, end: int, decoder: Decoder) -> None:
        """Check the end of the file, and that a word stated a time; see `WordReader`."""
        super().check_end(rest, end, decoder)
        if decoder.state[OTHER] and not decoder.state[STARTED]:
            raise Damage(f"no TIME_HIGH word of {self.title}: the times of the events are unknown", self.start)


TIME_HIGH = 8
LOW_BITS = 6
PERIOD = 1 << 28
"""Number of values of TIME_HIGH, which states the bits of the time above `LOW_BITS`."""
HIGH_LOOK = 1 << 14
"""Number of bytes at the beginning of a block to search for a TIME_HIGH; cameras send one every 16 us."""
LIMITS_2 = Limits(1 << 34, 1 << 11)

LAYOUT_2 = Layout(
    4, t=Field(22, LOW_BITS), x=Field(11, 11), y=Field(0, 11), p=Field(28, 1),
    odd=Odd(0xE0000000), others="time_high", waits=True,
)  # fmt: skip


class Evt2(Evt):
    """A reader of EVT 2.0 files; see `Evt`.

    After the header (see `dat`) come little-endian uint32 words with the kind in bits 28-31.
    0 and 1: an event of this polarity (1 = ON), low bits of its time in bits 22-27, x in bits 11-21, y in bits 0-10.
    8, TIME_HIGH: bits 6-33 of the time of the following events, in bits 0-27.
    10, 14, 15 and other kinds (triggers, the vendor's own) are not pixel events and are skipped. Events before the
    first TIME_HIGH are skipped too, because their times are unknown. ``metadata["other_words"]`` counts all skipped
    words.

    The clock wraps after 2^34 us (4.8 hours). A fall of TIME_HIGH from the last sixteenth of the range to the first
    counts as a wrap, and 2^34 us are added to all later times.

    Source: Prophesee, "EVT 2.0 format", docs.prophesee.ai.
    """

    coding = "EVT2"
    title = "EVT 2.0"
    word = 4
    layout = LAYOUT_2

    def seek(self, decoder: Decoder, step: int, start_us: int) -> int:
        """Return a byte from which to read, and set the decoder's clock; see `SeekingReader`."""
        at = seek_point(self.start, self.clocks(step), start_us >> LOW_BITS, PERIOD)
        decoder.state[ADDED] = at.added << LOW_BITS
        return at.place

    def clocks(self, step: int) -> Iterator[tuple[int, int]]:
        """Return the place and the first TIME_HIGH of each sample with a TIME_HIGH."""
        for place, data in self.source.samples(self.start, step, min(step, HIGH_LOOK)):
            words = self.upper(data[: data.size // self.word * self.word].view("<u4"))
            indices = np.flatnonzero(words >> 28 == TIME_HIGH)
            if indices.size:
                yield place, int(words[indices[0]] & 0x0FFFFFFF)

    def upper(self, words: npt.NDArray[np.uint32]) -> npt.NDArray[np.uint32]:
        """Return the half of each word that contains the kind."""
        return words


def write_evt2(parts: Iterator[Events], path: Path) -> None:
    """Write a recording as EVT 2.0, with the sensor in the header and without metadata."""
    high = -1

    def words(n_before: int, events: Events) -> bytes:
        nonlocal high
        LIMITS_2.check(events, n_before)
        highs = events.t >> LOW_BITS
        is_new = np.diff(highs, prepend=high) != 0
        high = int(highs[-1]) if len(events) else high
        place = np.arange(len(events)) + np.cumsum(is_new)
        out = np.empty(len(events) + int(is_new.sum()), "<u4")
        out[place[is_new] - 1] = TIME_HIGH << 28 | highs[is_new]
        out[place] = encoded(LAYOUT_2, events).view("<u4")[:, 0]
        return out.tobytes()

    write_words(parts, path, partial(raw_text, "2.0"), words)


EVT2 = Format(
    "evt2", "Prophesee EVT 2.0", (".raw",), lambda head: parse(head).coding == Evt2.coding, Evt2, write_evt2,
    holds=LIMITS_2.holds, grows=True, usual=GEN3, larger=(GEN4,),
)  # fmt: skip
"""EVT 2.0, read and written."""


class Evt21(Evt2):
    """A reader of EVT 2.1 files; see `Evt`.

    After the header (see `dat`) come little-endian uint64 words with the kind in bits 60-63.
    0 and 1: events of this polarity (1 = ON), low bits of their time in bits 54-59, x of the first pixel in bits 43-53,
    y in bits 32-42. Bit i of bits 0-31 is set if pixel x + i has an event.
    8, TIME_HIGH: bits 6-33 of the time of the following events, in bits 32-59. Other words and wraps are handled as in
    `Evt2`.

    The IMX636 sends the upper half of each word before the lower half (``endianness=legacy`` in the header). Without a
    header, the order is detected from the first words: in the right order x of events is a multiple of 32, and there is
    a TIME_HIGH.

    Source: Prophesee, "EVT 2.1 format", docs.prophesee.ai.
    """

    coding = "EVT21"
    title = "EVT 2.1"
    word = 8
    orders = ("little", "legacy")
    block_divisor = 16

    def decoder(self) -> Decoder:
        """Return a new decoder; see `WordReader`."""
        half = self._upper_half()
        decode, capacity = (partial(kernel, half) for kernel in (evt_kernels.decode21, evt_kernels.capacity21))
        return Decoder(decode, first_state(), self.word, self.word, capacity)

    def upper(self, words: npt.NDArray[np.uint32]) -> npt.NDArray[np.uint32]:
        """Return the upper half of each word; see `Evt2`."""
        return words[self._upper_half() :: 2]

    def _upper_half(self) -> int:
        """Return the position of the upper half in a word: 0 if first, else 1."""
        if order := self.header.options.get("endianness"):
            return int(order != "legacy")
        data = self.source.head(self.header.length + HEAD)[self.header.length :]
        words = np.frombuffer(data[: len(data) // self.word * self.word], "<u4").reshape(-1, 2)
        # The upper half has few invalid words and some TIME_HIGH, so it is the half with the smaller difference.
        misfits = [int(invalid_words(half).sum()) - int((half >> 28 == TIME_HIGH).sum()) for half in words.T]
        return int(misfits[1] <= misfits[0])


def invalid_words(upper: npt.NDArray[np.uint32]) -> npt.NDArray[np.bool_]:
    """Return True for each upper half that is not valid in EVT 2.1."""
    kind = upper >> 28
    is_event = kind < 2
    is_known: npt.NDArray[np.bool_] = is_event | (kind == TIME_HIGH) | (kind == 10) | (kind >= 14)
    is_aligned: npt.NDArray[np.bool_] = (upper >> 11 & 31) == 0
    return ~is_known | (is_event & ~is_aligned)


EVT21 = Format(
    "evt21", "Prophesee EVT 2.1", (".raw",), lambda head: parse(head).coding == Evt21.coding, Evt21,
    untested="made from the vendor's description; no recording was available",
    usual=GEN3, larger=(GEN4,),
)  # fmt: skip
"""EVT 2.1, read only."""


LIMITS_3 = Limits(1 << 40, 1 << 11)
"""Range of times and positions that `write_evt3` accepts. Wraps, of two words each, could state any time. The limit of
the times bounds the number of wraps."""

OTHER_ROW, VECT_BASE_X, TIME_LOW = 1, 3, 6
"""Kinds of words. A row has kind 0 or 1."""

SLICE = 1 << 16
"""Number of events that are encoded at a time."""


def _uint16_words(data: Bytes) -> npt.NDArray[np.uint16]:
    return data[: data.size // 2 * 2].view("<u2")


def evt3_decoder() -> Decoder:
    """Return a new decoder of EVT 3.0."""
    state = np.zeros(evt_kernels.STATES_3, np.int64)
    state[evt_kernels.ROW] = state[evt_kernels.BASE] = -1

    def decode(data: Bytes, *rest: Any) -> tuple[int, int, int, int, bool]:
        words = _uint16_words(data)
        count, x_max, y_max, ordered = evt_kernels.decode3(words, *rest)
        return count, words.nbytes, x_max, y_max, ordered

    return Decoder(decode, state, 2, 2, lambda data: evt_kernels.capacity3(_uint16_words(data)))


class Evt3(Evt):
    """A reader of EVT 3.0 files; see `Evt`.

    After the header (see `dat`) come little-endian uint16 words with the kind in bits 12-15. The time, the row and the
    base of vectors hold until the next word that changes them.
    0: row in bits 0-10. 2: an event at the column in bits 0-10, polarity in bit 11 (1 = ON).
    3: base column and polarity of vectors. 4 and 5: events at base + i for each set bit i of 12 or 8; the base advances
    by 12 or 8. 6, TIME_LOW and 8, TIME_HIGH: bits 0-11 and 12-23 of the time. A TIME_HIGH with a new value sets the low
    bits to 0 until the next TIME_LOW. A TIME_LOW may be smaller than the TIME_LOW before; the last one holds.
    A TIME_HIGH smaller by 2048 or more is a wrap of the 24 bits (16.8 s), and 2^24 us are added from there on.

    Triggers and other kinds are not pixel events and are skipped. Also skipped are events before the first TIME_HIGH
    or the first row, and events of a row of kind 1 (intensity pixels of older sensors). ``metadata["other_words"]``
    counts all skipped words.

    Source: Prophesee, "EVT 3.0 format", docs.prophesee.ai; the rules of TIME_HIGH and of kind 1 as in the vendor's
    decoder (OpenEB, ``evt3_decoder.h``).
    """

    coding = "EVT3"
    title = "EVT 3.0"
    word = 2
    block_divisor = 4

    def decoder(self) -> Decoder:
        """Return a new decoder; see `WordReader`."""
        return evt3_decoder()

    def seek(self, decoder: Decoder, step: int, start_us: int) -> int:
        """Return a byte from which to read, and set the decoder's clock; see `SeekingReader`.

        The clock wraps every 16.8 s, so every TIME_HIGH up to `start_us` is tracked, without decoding the events.
        """
        begin = self.start
        # `previous` is the first byte of the block before, and the TIME_HIGH (with wraps) at that byte.
        high, kinds, previous = -1, 0, (begin, -1)
        previous_words = np.zeros(0, np.uint16)
        for place, data in self.source.blocks(begin, step, self.word):
            words = _uint16_words(data)
            at_begin, kinds_before = high, kinds
            high, kinds, latest = evt_kernels.track3(words, high, kinds)
            if latest >= start_us >> 12:
                if previous[1] < 0 or not _states_everything(previous_words, bool(kinds_before >> VECT_BASE_X & 1)):
                    return begin
                decoder.state[STARTED], decoder.state[evt_kernels.TIME] = 1, previous[1] << 12
                return previous[0]
            previous, previous_words = (place, at_begin), words
        return begin


def _states_everything(words: npt.NDArray[np.uint16], vectors: bool) -> bool:
    """Return whether the words of a block set the whole state of the decoder, apart from TIME_HIGH.

    The state consists of the low bits of the time, the row, and the base of vectors.

    Args:
        words: the words of a block.
        vectors: True if the file had a base of vectors so far.
    """
    kinds = words >> 12
    rows = np.flatnonzero(kinds <= OTHER_ROW)
    has_row_and_time = rows.size > 0 and bool(np.any(kinds == TIME_LOW))
    return has_row_and_time and (not vectors or bool(np.any(kinds[rows[0] :] == VECT_BASE_X)))


def write_evt3(parts: Iterator[Events], path: Path) -> None:
    """Write a recording as EVT 3.0, with the sensor in the header and without metadata."""
    state = np.array([-1, -1], np.int64)

    def encode_part(n_before: int, events: Events) -> bytes:
        LIMITS_3.check(events, n_before)
        return b"".join(map(encode_slice, (events[first : first + SLICE] for first in range(0, len(events), SLICE))))

    def encode_slice(part: Events) -> bytes:
        wraps = (int(part.t[-1]) >> 24) - (max(int(state[0]), 0) >> 24)
        words = np.empty(4 * len(part) + 2 * wraps + 1, "<u2")
        return words[: evt_kernels.encode3(part.t, part.x, part.y, part.p, state, words)].tobytes()

    write_words(parts, path, partial(raw_text, "3.0"), encode_part)


EVT3 = Format(
    "evt3", "Prophesee EVT 3.0", (".raw",), lambda head: parse(head).coding == Evt3.coding, Evt3, write_evt3,
    holds=LIMITS_3.holds, grows=True, usual=GEN3, larger=(GEN4,),
)  # fmt: skip
"""EVT 3.0, read and written."""


GUESS_BYTES = 1 << 16
KINDS_2 = (0, 1, 8, 10, 14, 15)
KINDS_3 = (0, 2, 3, 4, 5, 6, 7, 8, 10, 14, 15)

ReaderKind = type[Evt21] | type[Evt3] | type[Evt2]


def open_raw(source: Source) -> Evt21 | Evt3 | Evt2:
    """Find the coding of a RAW file whose header names no coding, and return its reader.

    The first 64 KiB decide. A coding fits if at least 63 of 64 words have a known kind, there is a TIME_HIGH, and
    TIME_HIGH never falls, except at a wrap.

    Raises:
        Damage: no coding fits, or the header names an unknown coding.
    """
    header = read_header(source)
    if header.coding is not None:
        raise header.damage("format" if "format" in header.fields else "evt", "EVT 2.0, 2.1 or 3.0")
    data = source.head(header.length + GUESS_BYTES)[header.length :]
    if not data:
        raise Damage("no words, and no header that names the coding", header.length)
    for reader, fits in _GUESSES:
        if fits(data):
            return reader(source)
    raise Damage("no header names the coding, and the words are none of EVT 2.0, 2.1 or 3.0", header.length)


def _fits21(data: bytes) -> bool:
    halves = _words(data, "<u4", 8).reshape(-1, 2)
    return any(_likely(invalid_words(half), half, 28) for half in (halves[:, 1], halves[:, 0]))


def _fits(dtype: str, size: int, kind_at: int, kinds: tuple[int, ...], data: bytes) -> bool:
    words = _words(data, dtype, size)
    return _likely(~np.isin(words >> kind_at, kinds), words, kind_at)


def _words(data: bytes, dtype: str, size: int) -> Words:
    return np.frombuffer(data[: len(data) // size * size], dtype)


def _likely(invalid: npt.NDArray[np.bool_], words: Words, kind_at: int) -> bool:
    """Return whether a coding is likely.

    Args:
        invalid: (n,) True for words that are invalid in the coding.
        words: (n,) words.
        kind_at: lowest bit of the kind in a word.
    """
    high = (words[words >> kind_at == TIME_HIGH] & ((1 << kind_at) - 1)).astype(np.int64)
    step = np.diff(high)
    falls = (step < 0) & (step > -(1 << (kind_at - 1)))
    return bool(high.size and 64 * invalid.sum() <= words.size and not falls.any())


_GUESSES: tuple[tuple[ReaderKind, Callable[[bytes], bool]], ...] = (
    (Evt21, _fits21),
    (Evt3, partial(_fits, "<u2", 2, 12, KINDS_3)),
    (Evt2, partial(_fits, "<u4", 4, 28, KINDS_2)),
)


def _names_unknown_coding(head: bytes) -> bool:
    return parse(head).coding not in (None, Evt21.coding, Evt3.coding, Evt2.coding)


RAW = Format("raw", "Prophesee RAW", (".raw",), _names_unknown_coding, open_raw, usual=GEN3, larger=(GEN4,))
"""RAW without a coding in the header, read only. Registered before the codings, so that ``.raw`` leads here."""
