"""Layouts of event words as data, which a single decoder and a single encoder interpret."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
import numpy.typing as npt

from neuro.apps import LazyModule
from neuro_events._events import Events, empty_columns
from neuro_events.formats._format import Damage, Limits, Piece, Size, no_place
from neuro_events.formats._reading import make_piece, seek_point, write_words
from neuro_events.source import WHOLE, Bytes, Source, step

word_kernels = LazyModule("neuro_events.formats._word_kernels")

PERIOD = 1 << 32
"""Range of a clock of 32 bits, us."""


class Field(NamedTuple):
    """A bit field of a word.

    Example: the columns of a DAVIS346, which are counted from the right, are ``Field(12, 10, backwards=346)``: an
    address of 245 << 12 is column 100.

    Attributes:
        shift: lowest bit.
        bits: number of bits.
        byte: offset of the word in the event, bytes.
        size: size of the word, bytes: 1, 2, 4 or 8.
        backwards: number of values if they are counted from the last one, else 0.
    """

    shift: int
    bits: int
    byte: int = 0
    size: int = 4
    backwards: int = 0


class Odd(NamedTuple):
    """Condition that tells words that are not events: `word & mask` equals `value`, or differs from `value`.

    Attributes:
        mask: bits of the word to compare.
        value: value to compare with.
        differs: whether a word is not an event if `word & mask` differs from `value`; else a word is not an event if
            both are equal.
        byte: offset of the word, bytes.
        size: size of the word, bytes.
    """

    mask: int = 0
    value: int = 0
    differs: bool = True
    byte: int = 0
    size: int = 4


WRAPS, HALF, GAPS = 1, 2, 3
"""Rules for the time field. 0: the field is added to the time that other words state (`BEGIN`). `WRAPS`: a clock of
32 bits wraps if the field falls from the last sixteenth of its range to the first. `HALF`: the clock wraps if the field
falls by more than half its range, and unwraps if the field rises by as much. `GAPS`: the field is the time since the
event before."""


class Layout(NamedTuple):
    """Layout of an event's bytes.

    Attributes:
        size: size of an event, bytes.
        t: time, us.
        x: column, px.
        y: row, px.
        p: polarity, 1 = ON.
        odd: condition for words that are not events. Without a mask all words are events.
        others: name of the rule in `_word_kernels` for words that are not events; "" only counts these words.
        none: mask of the bits that must be 0 in the word that `odd` tests. Decoding stops if such a bit is set.
        first: mask. A word that is not an event is counted as `OTHER` if one of the bits of the mask is set, otherwise
            as `SECOND`. With -1 all words that are not events are counted as `OTHER`.
        rule: rule for the time field: 0, `WRAPS`, `HALF` or `GAPS`.
        is_big: words are big-endian.
        is_signed: the time may be negative.
        waits: drop events before the first word that states a time.
        least: size of the shortest item in the data, bytes, if some items are shorter than an event; else 0.
        group: number of words that are decoded as a group if all are events; otherwise one by one.
    """

    size: int
    t: Field
    x: Field
    y: Field
    p: Field
    odd: Odd = Odd()
    others: str = ""
    none: int = 0
    first: int = -1
    rule: int = 0
    is_big: bool = False
    is_signed: bool = False
    waits: bool = False
    least: int = 0
    group: int = 32


State = npt.NDArray[np.int64]

OTHER, STARTED, STOPPED, BEGIN, CLOCK, SECOND, ADDED, STATES = range(8)
"""Indices into the state of a decoder. `OTHER`: number of skipped words. `STARTED`: 1 after a word that states a time.
`STOPPED`: 1 if the next bytes do not fit the layout. `BEGIN`: us to add to the times of events. `CLOCK`: last time of
the clock, -1 before the first. `SECOND`: in formats with TIME_HIGH words the last TIME_HIGH, else the number of skipped
words of a second kind (see `Layout.first`). `ADDED`: us that the wraps of TIME_HIGH add."""


def encoded(layout: Layout, events: Events) -> npt.NDArray[np.uint8]:
    """Return events as bytes of a layout, (n, size). Of a time, only the bits that fit into its field are stored."""
    out = np.empty((len(events), layout.size), np.uint8)
    words: dict[tuple[int, int], Any] = {}
    for name in "txyp":
        field: Field = getattr(layout, name)
        if not field.bits:
            continue
        kind = np.dtype(f"u{field.size}").type
        values = getattr(events, name)
        if field.backwards:
            values = kind(field.backwards - 1) - values.astype(kind)
        if name == "t" and field.bits < 8 * field.size:
            values = values.astype(kind) & kind((1 << field.bits) - 1)
        if field.shift:
            values = values.astype(kind, copy=False) << kind(field.shift)
        place = field.byte, field.size
        words[place] = words[place] | values if place in words else values
    for (byte, size), values in words.items():
        order = ">" if layout.is_big else "<"
        word = np.dtype({"names": ["w"], "formats": [f"{order}u{size}"], "offsets": [byte], "itemsize": layout.size})
        out.view(word)["w"][:, 0] = values
    return out


def first_state(more: int = 0) -> State:
    """Return the initial state of a decoder, with `more` additional numbers."""
    state = np.zeros(STATES + more, np.int64)
    state[CLOCK] = -1
    return state


FIND_STEP = 1 << 16
"""Number of bytes that `Decoder.find` decodes at a time."""


@dataclass(slots=True)
class Decoder:
    """A decoding kernel and its state.

    Attributes:
        decode: (bytes, state, t, x, y, p) -> number of events, number of bytes used, largest x, largest y, and True if
            time never runs back.
        state: updated by `decode`.
        size: size of an event, or of a word that may contain several events, bytes.
        unit: the data are multiples of this size, bytes.
        capacity: function that returns the largest number of events in some bytes. None: one event in `size` bytes.
        used: number of bytes that the last call used.
    """

    decode: Callable[..., tuple[int, int, int, int, bool]]
    state: State
    size: int
    unit: int
    capacity: Callable[[Bytes], int] | None = None
    used: int = 0

    def piece(self, data: Bytes, place: Callable[[int], int | None] = no_place) -> Piece:
        """Decode bytes to events, and set `used`."""
        columns = empty_columns(self.capacity(data) if self.capacity else data.size // self.size)
        count, self.used, x_max, y_max, ordered = self.decode(data, self.state, *columns)
        return make_piece(columns, count, (x_max, y_max), ordered, place)

    def count(self, data: Bytes) -> int:
        """Return the number of events in some bytes. The state does not change."""
        return self.copy().piece(data).t.size

    def copy(self) -> Decoder:
        """Return a decoder with a copy of the state."""
        return replace(self, state=self.state.copy())

    def find(self, data: Bytes, event: int) -> int:
        """Return the byte at which the event with an index begins.

        Bisection finds the shortest data that contain the event. The event is the last one in these data.
        """
        decoder, at = self.copy(), 0
        while event >= (count := decoder.count(data[at : at + FIND_STEP])):
            event -= count
            decoder.piece(data[at : at + FIND_STEP])
            at += decoder.used
        low, high = 0, min(FIND_STEP, data.size - at) // self.unit
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if decoder.count(data[at : at + middle * self.unit]) > event else (middle, high)
        return at + high * self.unit - self.size


def layout_writer(
    header: Callable[[Size | None], bytes], layout: Layout, limits: Limits
) -> Callable[[Iterator[Events], Path], None]:
    """Return a function that writes the parts of a recording to a path, as words of a layout after a header."""

    def words(n_before: int, events: Events) -> bytes:
        limits.check(events, n_before)
        return encoded(layout, events).tobytes()

    return lambda parts, path: write_words(parts, path, header, words)


class WordReader:
    """A reader of words after a header.

    Attributes:
        layout: layout of the words, unless `decoder` returns a decoder of another kind.
        word_noun: noun for words in messages.
        block_divisor: factor by which `stream` reduces its blocks, since a word may contain many events.
        start: byte at which the words begin.
    """

    layout: Layout
    word_noun: ClassVar[str] = "words"
    block_divisor: ClassVar[int] = 1

    source: Source
    start: int
    metadata: dict[str, Any]

    def decoder(self) -> Decoder:
        """Return a new decoder."""
        size = self.layout.size
        return Decoder(word_kernels.decoder(self.layout), first_state(), size, self.layout.least or size)

    def pieces(self, block: int) -> Iterator[Piece]:
        """Yield the events; see `Reader`."""
        return self._pieces(block, self.decoder(), self.start)

    def _pieces(self, block: int, decoder: Decoder, start: int) -> Iterator[Piece]:
        leftover, end = np.zeros(0, np.uint8), start
        for place, block_data in self.source.blocks(start, self.block(block, decoder), decoder.unit):
            data = np.concatenate((leftover, block_data)) if leftover.size else block_data
            begin, previous = place - leftover.size, decoder.copy()

            def byte(event: int, begin: int = begin, data: Bytes = data, previous: Decoder = previous) -> int:
                return begin + previous.find(data, event)

            piece = decoder.piece(data, byte)
            self.count(decoder.state)
            yield piece
            leftover, end = data[decoder.used :], begin + decoder.used
            if decoder.state[STOPPED]:
                raise Damage(self.stop_reason(leftover), end)
        self.check_end(leftover, end, decoder)

    def block(self, size: int, decoder: Decoder) -> int:
        """Return the size of a block, bytes, for a requested size."""
        return step(size if size >= WHOLE else size // self.block_divisor, decoder.unit)

    def count(self, state: State) -> None:
        """Update the number of skipped words in the metadata."""

    def stop_reason(self, rest: Bytes) -> str:
        """Return the fault of the bytes at which the decoder stopped."""
        raise NotImplementedError

    def check_end(self, rest: Bytes, end: int, decoder: Decoder) -> None:
        """Check the end of the file.

        Args:
            rest: bytes that are not a complete word.
            end: offset of `rest`.
            decoder: the decoder of the file.

        Raises:
            Damage: the file is incomplete.
        """
        if rest.size:
            n_words = (end - self.start) // decoder.size
            raise Damage(f"{rest.size} bytes left over after {n_words} {self.word_noun} of {decoder.size} bytes", end)


class SeekingReader(WordReader):
    """A reader of words with a clock, which can start at a later block; see `Seeker`."""

    def pieces_from(self, block: int, start_us: int) -> Iterator[Piece]:
        """Yield the events from a block on; see `Seeker`."""
        decoder = self.decoder()
        return self._pieces(block, decoder, self.seek(decoder, self.block(block, decoder), start_us))

    def seek(self, decoder: Decoder, step: int, start_us: int) -> int:
        """Return a byte before which all events are earlier than `start_us`, and set the decoder's clock to that byte.

        Args:
            decoder: a new decoder.
            step: size of a block, bytes. The result is the beginning of a block.
            start_us: time, us.
        """
        at = seek_point(self.start, self.clocks(step), start_us, PERIOD)
        if at.clock is not None:
            decoder.state[CLOCK], decoder.state[BEGIN] = at.clock, at.added
        return at.place

    def clocks(self, step: int) -> Iterable[tuple[int, int]]:
        """Return pairs of the first byte of a block and a time of the clock in the block.

        Blocks without a time may be left out.
        """
        return ()
