"""Layouts of words as data, which one decoder and one encoder interpret."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
import numpy.typing as npt

from neuro.apps import LazyModule
from neuro_events._events import Events, empty_columns
from neuro_events.formats._format import Damage, Piece, Room, Size, no_place
from neuro_events.formats._reading import begin, decoded, write_words
from neuro_events.source import WHOLE, Bytes, Source, step

word_kernels = LazyModule("neuro_events.formats._word_kernels")

PERIOD = 1 << 32
"""us; times of a clock of 32 bits."""


class Field(NamedTuple):
    """Some bits of a word.

    Example: the columns of a DAVIS346, which are counted from the right, are ``Field(12, 10, backwards=346)``: an
    address of 245 << 12 is column 100.

    Attributes:
        shift: its lowest bit.
        bits: number of bits.
        byte: where in the event the word begins.
        size: bytes of the word: 1, 2, 4 or 8.
        backwards: number of values where they are counted from the last one, else 0.
    """

    shift: int
    bits: int
    byte: int = 0
    size: int = 4
    backwards: int = 0


class Odd(NamedTuple):
    """Words that are no events: those whose bits of `mask` are `value`, or differ from it.

    Attributes:
        mask: bits of the word.
        value: what they are compared with.
        differs: whether words that differ are no events, rather than those that are equal.
        byte: where the word begins.
        size: bytes of the word.
    """

    mask: int = 0
    value: int = 0
    differs: bool = True
    byte: int = 0
    size: int = 4


WRAPS, HALF, GAPS = 1, 2, 3
"""Rules of time. Without one, the field is added to what other words say (`BEGIN`). `WRAPS`: a clock of 32 bits begins
again where it falls from the last sixteenth of its range to the first. `HALF`: it does so where it falls by more than
half its range, and returns where it rises by as much. `GAPS`: the field is the time since the event before."""


class Layout(NamedTuple):
    """How the bytes of an event are laid out.

    Attributes:
        size: bytes of an event.
        t: time, us.
        x: column, px.
        y: row, px.
        p: polarity, 1 = ON.
        odd: words that are no events; without a mask there are none.
        others: name of the rule for those words in `_word_kernels`; "" counts them.
        none: bits of the odd word that no word of the layout has: the data end before one that does.
        first: bits of the odd word of those that are counted as `OTHER`, the rest as `SECOND`; -1: all are.
        rule: of time; 0, `WRAPS`, `HALF` or `GAPS`.
        is_big: whether the highest byte of a word comes first.
        is_signed: whether the time may be below 0.
        waits: whether events before the first word that tells the time are left out.
        least: bytes of the shortest thing that is no event; 0: those of an event.
        group: words of which one that is no event makes the decoder look at each.
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
"""State of a decoder: words left out; whether a word told the time; whether the bytes that follow are none of the
layout; us to add to the times of events; the last time of a clock, -1 before the first. By the format: words of a
second kind that were left out, or the last TIME_HIGH; us that the wraps of TIME_HIGH add."""


def encoded(layout: Layout, events: Events) -> npt.NDArray[np.uint8]:
    """Return the bytes (n, size) of events for which the layout has room; of times the upper bits are left out."""
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
    """The state of a decoder before any word, with room for so many more numbers."""
    state = np.zeros(STATES + more, np.int64)
    state[CLOCK] = -1
    return state


FIND_STEP = 1 << 16
"""Bytes decoded at a time to find an event."""


@dataclass(slots=True)
class Decoder:
    """A kernel and its state.

    Attributes:
        decode: (bytes, state, t, x, y, p) -> number of events and of bytes used, largest x and y, whether time does not
            run back.
        state: changed by `decode`.
        size: bytes of an event, or of a word that may hold several.
        unit: bytes of which the data are multiples.
        room: events that bytes have at most; None: one in `size` bytes.
        used: bytes that the last call used.
    """

    decode: Callable[..., tuple[int, int, int, int, bool]]
    state: State
    size: int
    unit: int
    room: Callable[[Bytes], int] | None = None
    used: int = 0

    def piece(self, data: Bytes, place: Callable[[int], int | None] = no_place) -> Piece:
        """The events of bytes; `used` is set."""
        room = empty_columns(self.room(data) if self.room else data.size // self.size)
        count, self.used, x_max, y_max, ordered = self.decode(data, self.state, *room)
        return decoded(room, count, (x_max, y_max), ordered, place)

    def count(self, data: Bytes) -> int:
        """Number of events of bytes; the state stays as it is."""
        return self.copy().piece(data).t.size

    def copy(self) -> Decoder:
        """One with a state of its own."""
        return replace(self, state=self.state.copy())

    def find(self, data: Bytes, event: int) -> int:
        """The byte at which an event begins: `size` before the end of the shortest part of the data that has it."""
        here, at = self.copy(), 0
        while event >= (count := here.count(data[at : at + FIND_STEP])):
            event -= count
            here.piece(data[at : at + FIND_STEP])
            at += here.used
        low, high = 0, min(FIND_STEP, data.size - at) // self.unit
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if here.count(data[at : at + middle * self.unit]) > event else (middle, high)
        return at + high * self.unit - self.size


def layout_writer(
    header: Callable[[Size | None], bytes], layout: Layout, room: Room
) -> Callable[[Iterator[Events], Path], None]:
    """Return the function that writes the parts of a recording to a path, as words of a layout after a header."""

    def words(done: int, events: Events) -> bytes:
        room.check(events, done)
        return encoded(layout, events).tobytes()

    return lambda parts, path: write_words(parts, path, header, words)


class WordReader:
    """A reader of words that follow a header.

    Attributes:
        layout: of the words, unless `decoder` is another.
        called: what messages call words.
        swell: `stream` takes blocks smaller by this, since a word may hold many events.
        start: the byte at which the words begin.
    """

    layout: Layout
    called: ClassVar[str] = "words"
    swell: ClassVar[int] = 1

    source: Source
    start: int
    metadata: dict[str, Any]

    def decoder(self) -> Decoder:
        """Return a new decoder."""
        size = self.layout.size
        return Decoder(word_kernels.decoder(self.layout), first_state(), size, self.layout.least or size)

    def pieces(self, block: int) -> Iterator[Piece]:
        """The events; see `Reader`."""
        return self._pieces(block, self.decoder(), self.start)

    def _pieces(self, block: int, decoder: Decoder, start: int) -> Iterator[Piece]:
        rest, end = np.zeros(0, np.uint8), start
        for place, more in self.source.blocks(start, self.block(block, decoder), decoder.unit):
            data = np.concatenate((rest, more)) if rest.size else more
            begin, before = place - rest.size, decoder.copy()

            def byte(event: int, begin: int = begin, data: Bytes = data, before: Decoder = before) -> int:
                return begin + before.find(data, event)

            piece = decoder.piece(data, byte)
            self.count(decoder.state)
            yield piece
            rest, end = data[decoder.used :], begin + decoder.used
            if decoder.state[STOPPED]:
                raise Damage(self.stopped(rest), end)
        self.ended(rest, end, decoder)

    def block(self, size: int, decoder: Decoder) -> int:
        """Return the bytes of a block where a caller asks for so many."""
        return step(size if size >= WHOLE else size // self.swell, decoder.unit)

    def count(self, state: State) -> None:
        """Tell in the metadata what was left out so far."""

    def stopped(self, rest: Bytes) -> str:
        """Tell what is wrong with the bytes at which the decoder stopped."""
        raise NotImplementedError

    def ended(self, rest: Bytes, end: int, decoder: Decoder) -> None:
        """Check the end of the file.

        Args:
            rest: bytes that are no whole word.
            end: where they begin.
            decoder: of the file.

        Raises:
            Damage: something is missing.
        """
        if rest.size:
            words = (end - self.start) // decoder.size
            raise Damage(f"{rest.size} bytes left over after {words} {self.called} of {decoder.size} bytes", end)


class SeekingReader(WordReader):
    """A reader of words with a clock, by which it can begin later; see `Seeker`."""

    def pieces_from(self, block: int, start_us: int) -> Iterator[Piece]:
        """The events from some block on; see `Seeker`."""
        decoder = self.decoder()
        return self._pieces(block, decoder, self.sought(decoder, self.block(block, decoder), start_us))

    def sought(self, decoder: Decoder, step: int, start_us: int) -> int:
        """A byte before which all events are earlier than `start_us`; the decoder is set for it.

        Args:
            decoder: a new one.
            step: bytes of a block; the byte is at the beginning of one.
            start_us: time, us.
        """
        at = begin(self.start, self.clocks(step), start_us, PERIOD)
        if at.clock is not None:
            decoder.state[CLOCK], decoder.state[BEGIN] = at.clock, at.added
        return at.place

    def clocks(self, step: int) -> Iterable[tuple[int, int]]:
        """The byte of each block, and a time that the clock shows in it; blocks may be missing."""
        return ()
