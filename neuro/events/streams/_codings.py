"""How events are written in datagrams, by name."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from itertools import pairwise
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from neuro.core.errors import ModelError
from neuro.events._events import Columns, Events, empty_columns
from neuro.events.formats._layout import Field, Layout, Odd, encoded, first_state

DATAGRAM = 1400
"""Bytes of a datagram, at most; the usual Ethernet carries 1,472."""


class Decoder(Protocol):
    """Decodes entries of a ring."""

    def __call__(
        self, ring: NDArray[np.uint8], index: NDArray[np.int64], first: int, last: int
    ) -> tuple[int, Columns, int]:
        """The events of entries: how many, room that begins with them, and how many entries were damaged.

        Args:
            ring: the bytes of a `Receiver`.
            index: its entries.
            first: the first to decode.
            last: the one after the last.
        """


Encoder = Callable[[Events, int], Iterator[Any]]
"""Datagrams (bytes) of at most so many bytes for events; parts of one recording in their order."""


@dataclass(frozen=True, slots=True)
class Coding:
    """A way to write events in datagrams.

    Attributes:
        name: the word for `format`.
        title: what it is.
        decoder: makes a decoder for a stream that began at a time, ns.
        encoder: makes an encoder.
        period: after which its clock begins again, us; 0: never.
        sides: columns and rows that it has room for.
        datagram: bytes of a datagram, at most, unless said otherwise.
    """

    name: str
    title: str
    decoder: Callable[[int], Decoder]
    encoder: Callable[[], Encoder]
    period: int
    sides: int
    datagram: int = DATAGRAM

    def check(self, sensor: tuple[int, int]) -> None:
        """Refuse a sensor for which it has no room.

        Raises:
            ModelError: it is too wide or too high.
        """
        if max(sensor) > self.sides:
            size = "{}x{}".format(*sensor)
            raise ModelError(f"format '{self.name}': found a sensor of {size} px: expected at most {self.sides} a side")


@dataclass(slots=True)
class _Plain:
    """Events of a layout; each takes `least` bytes, at least."""

    layout: Layout
    least: int
    opened_ns: int
    state: NDArray[np.int64] = field(default_factory=first_state)

    def __call__(
        self, ring: NDArray[np.uint8], index: NDArray[np.int64], first: int, last: int
    ) -> tuple[int, Columns, int]:
        from neuro.events.streams._coding_kernels import plain_decoder, spif_decoder

        room = empty_columns(int(_sizes(index, first, last).sum()) // self.least + 1)
        decode = (plain_decoder if self.least == self.layout.size else spif_decoder)(self.layout)
        n, damaged = decode(ring, index, first, last, self.opened_ns, self.state, *room)
        return n, room, damaged


def _sizes(index: NDArray[np.int64], first: int, last: int) -> NDArray[np.int64]:
    """Bytes of entries."""
    from neuro.events.streams._ring_kernel import SIZE

    begin, count, m = first % len(index), last - first, len(index)
    sizes = index[:, SIZE]
    if begin + count <= m:
        return sizes[begin : begin + count]
    return np.concatenate((sizes[begin:], sizes[: begin + count - m]))


class _Evt3:
    """Words of EVT 3.0."""

    def __init__(self, opened_ns: int) -> None:
        from neuro.events.formats.evt import evt3_decoder
        from neuro.events.streams._coding_kernels import STATES

        begin = evt3_decoder().state
        self._state = np.zeros(STATES, np.int64)
        self._state[: begin.size] = begin

    def __call__(
        self, ring: NDArray[np.uint8], index: NDArray[np.int64], first: int, last: int
    ) -> tuple[int, Columns, int]:
        from neuro.events.streams._coding_kernels import decode_evt3, room_evt3

        words = ring.view("<u2")
        room = empty_columns(room_evt3(words, index, first, last))
        n, damaged = decode_evt3(words, index, first, last, self._state, *room)
        return n, room, damaged


def _cut(records: NDArray[Any], size: int) -> Iterator[Any]:
    """Datagrams of whole records."""
    step = max(1, size // records.itemsize)
    for k in range(0, len(records), step):
        yield records[k : k + step].data.cast("B")


SPIF = Layout(8, t=Field(0, 32, byte=4), x=Field(16, 15), y=Field(0, 15), p=Field(15, 1))
"""An event with its time."""
FAERY_13 = Layout(
    13, t=Field(0, 64, size=8), x=Field(0, 16, byte=8), y=Field(16, 16, byte=8), p=Field(0, 1, byte=12, size=1),
    odd=Odd(0xFE << 56 | 3 << 22, byte=5, size=8),
)  # fmt: skip
"""No time has its upper two bits set, and polarities are 0 or 1: the word at byte 5 tells."""
FAERY_8 = Layout(8, t=Field(0, 32), x=Field(0, 16, byte=4), y=Field(17, 15, byte=4), p=Field(16, 1, byte=4))


def _spif(events: Events, size: int, timed: bool) -> Iterator[Any]:
    if timed:
        return _cut(encoded(SPIF, events).view("V8")[:, 0], size)
    words = encoded(SPIF._replace(size=4, t=Field(0, 0)), events).view("<u4")
    return _cut(words[:, 0] | np.uint32(1 << 31), size)


def _faery13(events: Events, size: int) -> Iterator[Any]:
    if len(events) and events.t[0] < 0:
        raise ModelError(f"format 'faery13': found an event at {events.t[0]} us: expected times from 0 us on")
    return _cut(events.records().view("V13"), size)


def _faery8(events: Events, size: int) -> Iterator[Any]:
    return _cut(encoded(FAERY_8, events).view("V8")[:, 0], size)


_PERIOD_3 = 1 << 24
_BEAT = 1 << 22
"""At least so often, us, a TIME_HIGH is sent, so that a receiver counts all wraps."""
_LONGEST = 1 << 32
"""A longer silence, us, would need too many of them."""
_EVENT_BYTES = 8
"""An event takes at most so many bytes, in `encode3`: time (two words), row and column."""


def _evt3() -> Encoder:
    """Datagrams that each begin with time and row, so that one that is lost harms no other."""
    last: int | None = None

    def encode(events: Events, size: int) -> Iterator[Any]:
        nonlocal last
        from neuro.events.formats._evt_kernels import TIME_HIGH, encode3

        silent = np.flatnonzero(np.diff(events.t, prepend=events.t[:1]) > _BEAT)
        for begin, end in pairwise([0, *silent, len(events)]):
            for k in range(begin, end, max(1, size // _EVENT_BYTES)):
                part = events[k : min(end, k + size // _EVENT_BYTES)]
                first = int(part.t[0])
                if last is not None and first - last > _LONGEST:
                    silence = f"{(first - last) / 1e6:.0f} s without events before {first} us"
                    raise ModelError(f"format 'raw-evt3': found {silence}: expected at most {_LONGEST / 1e6:.0f} s")
                beats = np.arange(first if last is None else last + _BEAT, first, _BEAT) >> 12
                yield from _cut((TIME_HIGH << 12 | beats & 0xFFF).astype("<u2"), size)
                since = part.t - first // _PERIOD_3 * _PERIOD_3
                words = np.empty(4 * len(part) + 2 * (int(since[-1]) // _PERIOD_3) + 1, "<u2")
                n = encode3(since, part.x, part.y, part.p, np.full(2, -1, np.int64), words)
                last = int(part.t[-1])
                yield words[:n].data.cast("B")

    return encode


AESTREAM = 512
"""Bytes of the datagrams of aestream, which reads no more of one."""
_32 = 1 << 32

CODINGS = {
    coding.name: coding
    for coding in (
        Coding(
            "spif", "SPIF, words of 32 bits, with times or without; sent without",
            partial(_Plain, SPIF, 4), lambda: partial(_spif, timed=False), _32, 1 << 15, AESTREAM,
        ),
        Coding(
            "spif-timed", "SPIF, sent with times: two words of 32 bits",
            partial(_Plain, SPIF, 4), lambda: partial(_spif, timed=True), _32, 1 << 15, AESTREAM,
        ),
        Coding(
            "faery13", "faery's t64_x16_y16_on8, 13 bytes",
            partial(_Plain, FAERY_13, 13), lambda: _faery13, 0, 1 << 16,
        ),
        Coding(
            "faery8", "faery's t32_x16_y15_on1, 8 bytes",
            partial(_Plain, FAERY_8, 8), lambda: _faery8, _32, 1 << 15,
        ),
        Coding("raw-evt3", "Prophesee's EVT 3.0, words of 16 bits", _Evt3, _evt3, 0, 1 << 11),
    )
}  # fmt: skip
"""By name."""
