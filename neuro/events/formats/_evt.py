"""What the readers of EVT 2.0, 2.1 and 3.0 share: words in, events out, the state kept from block to block."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from neuro.events.formats._format import Damage, Piece
from neuro.events.formats._prophesee import read_header
from neuro.events.source import WHOLE, Source, step

Words = npt.NDArray[Any]
Bytes = npt.NDArray[np.uint8]
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

    def piece(self, data: Bytes, place: Callable[[int], int | None] | None = None) -> Piece:
        """The events of whole words."""
        words = self.order(data.view(self.dtype))
        n = self.room(words)
        t, x, y = np.empty(n, np.int64), np.empty(n, np.uint16), np.empty(n, np.uint16)
        p = np.empty(n, np.uint8)
        found, x_max, y_max, ordered = self.decode(words, self.state, t, x, y, p)
        highest = (int(x_max), int(y_max)) if found else (-1, -1)
        piece = Piece(t[:found], x[:found], y[:found], p[:found], highest, bool(ordered))
        return replace(piece, place=place) if place else piece

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
            raise Damage(f"no word of {self.title} tells the time of what follows", start)

    def _places(self, decoder: Decoder, place: int, data: Bytes) -> Callable[[int], int]:
        return lambda event: place + decoder.find(data, self.word, event)
