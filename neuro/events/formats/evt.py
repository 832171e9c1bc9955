"""RAW files of Prophesee in the codings EVT 2.0, 2.1 and 3.0."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from neuro.events._events import Events, empty_columns
from neuro.events.formats._format import HEAD, Damage, Format, Piece, no_place
from neuro.events.formats._reading import begin, decoded, write_words
from neuro.events.formats.dat import GEN3, GEN4, check_room, has_room, parse, raw_text, read_header
from neuro.events.source import WHOLE, Bytes, Source, step

Words = npt.NDArray[Any]
OTHER, STARTED = 0, 1
"""Places in the state of every kernel: words left out, and whether a TIME_HIGH was seen."""

STEP = 1 << 16
"""Bytes decoded at a time to find an event."""


def _same(words: Words) -> Words:
    return words


@dataclass(slots=True)
class Decoder:
    """A kernel and its state.

    Attributes:
        dtype: of the array that the kernel takes.
        state: changed by `decode`.
        room: events that words have at most.
        decode: (words, state, t, x, y, p) -> events, largest x and y, whether time does not run back.
        order: puts words in the order that the kernel takes.
    """

    dtype: str
    state: npt.NDArray[np.int64]
    room: Callable[[Words], int]
    decode: Callable[..., tuple[int, int, int, bool]]
    order: Callable[[Words], Words] = _same

    def piece(self, data: Bytes, place: Callable[[int], int | None] = no_place) -> Piece:
        """The events of whole words."""
        words = self.order(data.view(self.dtype))
        room = empty_columns(self.room(words))
        found, x_max, y_max, ordered = self.decode(words, self.state, *room)
        return decoded(room, found, (x_max, y_max), ordered, place)

    def count(self, data: Bytes) -> int:
        """Number of events of whole words; the state stays as it is."""
        return self.copy().piece(data).t.size

    def copy(self) -> Decoder:
        """One with a state of its own."""
        return replace(self, state=self.state.copy())

    def find(self, data: Bytes, word: int, event: int) -> int:
        """The byte of whole words at which an event begins."""
        here, at = self.copy(), 0
        while event >= (count := here.count(data[at : at + STEP])):
            event -= count
            here.piece(data[at : at + STEP])
            at += STEP
        low, high = 0, min(STEP, data.size - at) // word
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if here.count(data[at : at + middle * word]) > event else (middle, high)
        return at + low * word


class Evt(ABC):
    """An open RAW file.

    ``metadata`` has the lines of the ``header`` and, once all is read, ``other_words``: words left out.

    Attributes:
        coding: the word that a header has for it.
        title: the one that messages have.
        word: bytes of a word.
        orders: orders of bytes that are read.
        swell: `stream` takes blocks smaller by this, since a word may hold many events.
    """

    coding: ClassVar[str]
    title: ClassVar[str]
    word: ClassVar[int]
    orders: ClassVar[tuple[str, ...]] = ("little",)
    swell: ClassVar[int] = 1

    def __init__(self, source: Source) -> None:
        self.source = source
        self.header = header = read_header(source)
        if header.coding not in (None, self.coding):
            key = "format" if "format" in header.fields else "evt"
            raise header.damage(key, f"that of {self.title}")
        if header.options.get("endianness", self.orders[0]) not in self.orders:
            raise header.damage("format", f"endianness {' or '.join(self.orders)}")
        if not header.length and source.size == 0:
            raise Damage(f"is empty, expected a header or words of {self.title}", 0)
        self.sensor_size = header.sensor_size()
        self.metadata: dict[str, Any] = {"format": self.coding.lower(), "header": dict(header.fields)}

    @abstractmethod
    def decoder(self) -> Decoder:
        """A new decoder of this coding."""

    def pieces(self, block: int) -> Iterator[Piece]:
        """The events; see `Reader`."""
        return self._pieces(block, self.decoder(), self.header.length)

    def pieces_from(self, block: int, start_us: int) -> Iterator[Piece]:
        """The events from some block on; see `Seeker`."""
        decoder = self.decoder()
        return self._pieces(block, decoder, self.sought(decoder, self._step(block), start_us))

    @abstractmethod
    def sought(self, decoder: Decoder, step: int, start_us: int) -> int:
        """A byte before which all events are earlier than `start_us`; the decoder is set for it.

        Args:
            decoder: a new one.
            step: bytes of a block; the byte is at the beginning of one.
            start_us: time, us.
        """

    def _step(self, block: int) -> int:
        return step(block if block >= WHOLE else block // self.swell, self.word)

    def _pieces(self, block: int, decoder: Decoder, begin: int) -> Iterator[Piece]:
        start = self.header.length
        for place, data in self.source.blocks(begin, self._step(block), self.word):
            whole = data[: data.size // self.word * self.word]
            piece = decoder.piece(whole, self._places(decoder.copy(), place, whole))
            self.metadata["other_words"] = int(decoder.state[OTHER])
            yield piece
            if rest := data.size - whole.size:
                n = (place + whole.size - start) // self.word
                raise Damage(f"{rest} bytes left over after {n} words of {self.word} bytes", place + whole.size)
        if decoder.state[OTHER] and not decoder.state[STARTED]:
            raise Damage(f"no word of {self.title} gives the time of what follows", start)

    def _places(self, decoder: Decoder, place: int, data: Bytes) -> Callable[[int], int]:
        return lambda event: place + decoder.find(data, self.word, event)


TIME_HIGH = 8
LOW_BITS = 6
PERIOD = 1 << 28
"""Values of TIME_HIGH, which tells the bits of the time above the low ones."""
HIGH_LOOK = 1 << 14
"""Bytes of a block in which a TIME_HIGH is looked for; cameras send one every 16 us."""
ROOM_2 = (1 << 34, 1 << 11)
"""Times and sides that the words can tell."""


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

    def decoder(self) -> Decoder:
        """See `Evt`."""
        from neuro.events.formats import _evt_kernels as kernel

        return Decoder("<u4", np.zeros(kernel.STATES_2, np.int64), len, kernel.decode2)

    def sought(self, decoder: Decoder, step: int, start_us: int) -> int:
        """See `Evt`."""
        from neuro.events.formats import _evt_kernels as kernel

        samples = self.source.samples(self.header.length, step, min(step, HIGH_LOOK))
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


def write_evt2(parts: Iterator[Events], path: Path) -> None:
    """Encode, with the sensor in the header; metadata are not kept."""
    high = -1

    def encoded(done: int, events: Events) -> bytes:
        nonlocal high
        check_room(events, done, *ROOM_2)
        words, high = _words_2(events, high)
        return words.tobytes()

    write_words(parts, path, partial(raw_text, "2.0"), encoded)


def _words_2(events: Events, high: int) -> tuple[npt.NDArray[np.uint32], int]:
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
    "evt2", "Prophesee EVT 2.0", (".raw",), lambda head: parse(head).coding == Evt2.coding, Evt2, write_evt2,
    holds=has_room(*ROOM_2), grows=True, usual=GEN3, larger=(GEN4,),
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
    swell = 16

    def decoder(self) -> Decoder:
        """See `Evt`."""
        from neuro.events.formats import _evt_kernels as kernel

        order = self.header.options.get("endianness")
        legacy = order == "legacy" if order else self._upper_first()

        def halves(words: npt.NDArray[Any]) -> npt.NDArray[Any]:
            return words.reshape(-1, 2)[:, ::-1].reshape(-1) if legacy else words

        return Decoder("<u4", np.zeros(kernel.STATES_2, np.int64), kernel.room21, kernel.decode21, halves)

    def upper(self, words: npt.NDArray[np.uint32]) -> npt.NDArray[np.uint32]:
        """See `Evt2`."""
        return words[1::2]

    def _upper_first(self) -> bool:
        data = self.source.head(self.header.length + HEAD)[self.header.length :]
        words = np.frombuffer(data[: len(data) // self.word * self.word], "<u4").reshape(-1, 2)
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


ROOM_3 = (1 << 40, 1 << 11)
"""Times and sides that are written. Wraps could tell any time, with two words each; this bounds their number."""

OTHER_ROW, VECT_BASE_X, TIME_LOW = 1, 3, 6
"""Kinds of words; a row has kind 0 or 1."""

SLICE = 1 << 16
"""Events encoded at a time."""


def evt3_decoder() -> Decoder:
    """A new decoder of EVT 3.0."""
    from neuro.events.formats import _evt_kernels as kernel

    state = np.zeros(kernel.STATES_3, np.int64)
    state[kernel.ROW] = state[kernel.BASE] = -1
    return Decoder("<u2", state, kernel.room3, kernel.decode3)


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
    swell = 4

    def decoder(self) -> Decoder:
        """See `Evt`."""
        return evt3_decoder()

    def sought(self, decoder: Decoder, step: int, start_us: int) -> int:
        """See `Evt`. The clock wraps so soon that all TIME_HIGH before are looked at, and nothing else."""
        from neuro.events.formats import _evt_kernels as kernel

        begin = self.header.length
        high, kinds, margin = -1, 0, (begin, -1)
        before = np.zeros(0, np.uint16)
        for place, data in self.source.blocks(begin, step, self.word):
            words = data[: data.size // self.word * self.word].view("<u2")
            at_begin, kinds_before = high, kinds
            high, kinds, most = kernel.track3(words, high, kinds)
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
    settled = rows.size > 0 and bool(np.any(kinds == TIME_LOW))
    return settled and (not vectors or bool(np.any(kinds[rows[0] :] == VECT_BASE_X)))


def write_evt3(parts: Iterator[Events], path: Path) -> None:
    """Encode, with the sensor in the header; metadata are not kept."""
    from neuro.events.formats._evt_kernels import encode3

    state = np.array([-1, -1], np.int64)

    def encoded(done: int, events: Events) -> bytes:
        check_room(events, done, *ROOM_3)
        return b"".join(map(sliced, (events[first : first + SLICE] for first in range(0, len(events), SLICE))))

    def sliced(part: Events) -> bytes:
        wraps = (int(part.t[-1]) >> 24) - (max(int(state[0]), 0) >> 24)
        words = np.empty(4 * len(part) + 2 * wraps + 1, "<u2")
        return words[: encode3(part.t, part.x, part.y, part.p, state, words)].tobytes()

    write_words(parts, path, partial(raw_text, "3.0"), encoded)


EVT3 = Format(
    "evt3", "Prophesee EVT 3.0", (".raw",), lambda head: parse(head).coding == Evt3.coding, Evt3, write_evt3,
    holds=has_room(*ROOM_3), grows=True, usual=GEN3, larger=(GEN4,),
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
