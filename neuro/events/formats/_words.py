"""The reader of all files of words, by the decoder of their layout."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from neuro.events._events import empty_columns
from neuro.events.formats._format import Damage, Piece, no_place
from neuro.events.formats._layout import BEGIN, CLOCK, PERIOD, STOPPED, Layout, first_state
from neuro.events.formats._reading import begin, decoded
from neuro.events.source import WHOLE, Bytes, Source, step

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
    state: npt.NDArray[np.int64]
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


def layout_decoder(layout: Layout, unit: int | None = None) -> Decoder:
    """A new decoder of a layout; `unit` is that of `Decoder`, else the size of an event."""
    from neuro.events.formats._word_kernels import decoder

    return Decoder(decoder(layout), first_state(), layout.size, unit or layout.size)


class WordReader(ABC):
    """A reader of words that follow a header.

    Attributes:
        word: bytes of a word.
        called: what messages call words.
        swell: `stream` takes blocks smaller by this, since a word may hold many events.
        start: the byte at which the words begin.
    """

    word: ClassVar[int]
    called: ClassVar[str] = "words"
    swell: ClassVar[int] = 1

    source: Source
    start: int
    metadata: dict[str, Any]

    @abstractmethod
    def decoder(self) -> Decoder:
        """A new decoder."""

    def pieces(self, block: int) -> Iterator[Piece]:
        """The events; see `Reader`."""
        return self._pieces(block, self.decoder(), self.start)

    def _pieces(self, block: int, decoder: Decoder, start: int) -> Iterator[Piece]:
        rest, end = np.zeros(0, np.uint8), start
        for place, more in self.source.blocks(start, self.block(block), decoder.unit):
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
        self.ended(rest, end, decoder.state)

    def block(self, size: int) -> int:
        """Bytes of a block where a caller asks for so many."""
        return step(size if size >= WHOLE else size // self.swell, self.word)

    def count(self, state: npt.NDArray[np.int64]) -> None:  # noqa: B027 (not every format leaves words out)
        """Tell in the metadata what was left out so far."""

    def stopped(self, rest: Bytes) -> str:
        """Tell what is wrong with the bytes at which the decoder stopped."""
        raise NotImplementedError

    def ended(self, rest: Bytes, end: int, state: npt.NDArray[np.int64]) -> None:
        """Check the end of the file.

        Args:
            rest: bytes that are no whole word.
            end: where they begin.
            state: of the decoder.

        Raises:
            Damage: something is missing.
        """
        if rest.size:
            words = (end - self.start) // self.word
            raise Damage(f"{rest.size} bytes left over after {words} {self.called} of {self.word} bytes", end)


class SeekingReader(WordReader):
    """A reader of words with a clock, by which it can begin later; see `Seeker`."""

    def pieces_from(self, block: int, start_us: int) -> Iterator[Piece]:
        """The events from some block on; see `Seeker`."""
        decoder = self.decoder()
        return self._pieces(block, decoder, self.sought(decoder, self.block(block), start_us))

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
