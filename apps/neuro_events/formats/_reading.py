"""Helpers for readers of several formats: a byte cursor, a buffer for the events of packets, and seeking by time."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, TypeVar

import numpy as np
import numpy.typing as npt

from neuro_events._events import Columns, Events, empty_columns
from neuro_events.formats._format import Piece, Size, in_order
from neuro_events.source import Bytes, Source


def make_piece(
    columns: Columns, n: int, highest: tuple[int, int], ordered: bool, place: Callable[[int], int | None]
) -> Piece:
    """Return the first n events of columns that a kernel filled, as a piece.

    Args:
        columns: the columns.
        n: number of events.
        highest: largest x and y, as the kernel returns them.
        ordered: True if time never runs back.
        place: function from the index of an event to the byte at which the event begins.
    """
    t, x, y, p = columns
    largest = (int(highest[0]), int(highest[1])) if n else (-1, -1)
    return Piece(t[:n], x[:n], y[:n], p[:n], largest, bool(ordered), place)


def write_words(
    parts: Iterator[Events], path: Path, header: Callable[[Size | None], bytes], words: Callable[[int, Events], bytes]
) -> None:
    """Write a recording as a header and words.

    Args:
        parts: the parts of the recording, in order.
        path: the file to write.
        header: function from the sensor's width and height to the header. The argument is None if there are no parts.
        words: function from the number of events before a part, and the part, to its bytes; raises `Unsavable`.
    """
    with growing(path.open("wb")) as append:
        has_header = False
        for n_before, events in in_order(parts):
            if not has_header:
                append(header(events.sensor_size))
            has_header = True
            append(words(n_before, events))
        if not has_header:
            append(header(None))


@contextmanager
def growing(file_to_close: BinaryIO) -> Iterator[Callable[[Any], None]]:
    """Yield a function that appends to a new file, and close the file at the end.

    Each piece is flushed to the operating system, so that a killed process leaves a usable file. If a piece cannot be
    written, as on a full disk, the file is truncated to the pieces before.
    """
    size, name = 0, getattr(file_to_close, "name", None)
    try:
        with file_to_close as file:

            def append(data: Any) -> None:
                nonlocal size
                file.write(data)
                file.flush()
                size += memoryview(data).nbytes

            yield append
    except BaseException:
        if name is not None:  # standard output has no name and cannot be truncated
            with suppress(OSError):
                os.truncate(name, size)
        raise


class Cursor:
    """Cursor that reads the bytes of a source in order.

    Args:
        source: the source.
        start: offset of the first byte.
        block: bytes to buffer at a time.

    Attributes:
        at: offset of the next byte.
    """

    def __init__(self, source: Source, start: int, block: int) -> None:
        self.at = start
        self._blocks = source.blocks(start, block)
        self._held: Bytes = np.zeros(0, np.uint8)
        self._used = 0

    @property
    def buffered(self) -> Bytes:
        """The next bytes that are already in the buffer."""
        return self._held[self._used :]

    def take(self, count: int) -> Bytes:
        """Return the next ``count`` bytes, or fewer at the end of the file."""
        if self._held.size - self._used < count:
            self._fill(count)
        data = self._held[self._used : self._used + count]
        self._used += data.size
        self.at += data.size
        return data

    def _fill(self, count: int) -> None:
        parts = [self._held[self._used :]]
        missing = count - parts[0].size
        while missing > 0 and (more := next(self._blocks, None)) is not None:
            parts.append(more[1])
            missing -= more[1].size
        parts = [part for part in parts if part.size]
        self._held = parts[0] if len(parts) == 1 else np.concatenate([np.zeros(0, np.uint8), *parts])
        self._used = 0


Kind = TypeVar("Kind", bound=np.generic)


def _longer(old: npt.NDArray[Kind], size: int) -> npt.NDArray[Kind]:
    new = np.empty(size, old.dtype)
    new[: old.size] = old
    return new


class GrowingArray:
    """Buffer that collects the events of packets.

    Attributes:
        t: int64, us; valid up to ``used``, as are the other columns.
        x, y: uint16, px.
        p: uint8, 1 = ON.
        used: number of events.
    """

    def __init__(self) -> None:
        self._reset(0)

    def _reset(self, capacity: int) -> None:
        self.t, self.x, self.y, self.p = empty_columns(capacity)
        self.used = 0
        self._highest = (-1, -1)
        self._ordered = True
        self._begins: list[int] = []
        self._places: list[int | None] = []

    def reserve(self, count: int) -> None:
        """Enlarge the columns, if needed, for `count` more events."""
        needed = self.used + count
        if needed > self.t.size:
            size = max(needed, 2 * self.t.size)
            self.t, self.p = _longer(self.t, size), _longer(self.p, size)
            self.x, self.y = _longer(self.x, size), _longer(self.y, size)

    def commit(
        self, begins: Sequence[int], places: Sequence[int | None], used: int, highest: tuple[int, int], ordered: bool
    ) -> None:
        """Count events that the caller wrote to the columns after the first `used`.

        Args:
            begins: index of the first event of each packet.
            places: byte at which each packet begins.
            used: new number of events.
            highest: largest x and y of the new events.
            ordered: True if time never runs back among the new events, and from the last event before them.
        """
        if used == self.used:
            return
        self._ordered &= ordered
        self._highest = (max(self._highest[0], highest[0]), max(self._highest[1], highest[1]))
        self._begins += begins
        self._places += places
        self.used = used

    def piece(self) -> Piece:
        """Return the collected events, and empty the buffer."""
        begins, places, n = np.array(self._begins, np.int64), self._places, self.used

        def place(event: int) -> int | None:
            return places[int(np.searchsorted(begins, event, side="right")) - 1]

        piece = Piece(self.t[:n], self.x[:n], self.y[:n], self.p[:n], self._highest, self._ordered, place)
        self._reset(n)
        return piece


@dataclass(frozen=True, slots=True)
class SeekPoint:
    """A byte at which decoding can start, with the state of the clock.

    Attributes:
        place: first byte of a block.
        clock: a time of the clock in this block, before any requested event. None at the beginning of the file.
        added: sum that the wraps of the clock before this block add to its times.
    """

    place: int
    clock: int | None = None
    added: int = 0


def seek_point(start: int, clocks: Iterable[tuple[int, int]], time: int, period: int) -> SeekPoint:
    """Return the last block that begins before a time.

    A single time per block suffices, without decoding, as long as times do not run back. At a wrap of the clock, these
    times fall from the last sixteenth of the clock's range to the first. A wrap goes unnoticed only if a block of 1 MiB
    spans a whole range: in DAT fewer than 31 events/s during 71 minutes, in EVT 2.0 fewer than 15 events/s during 4.8
    hours, within a long recording. Any other fall means damage or unordered events. In this case the file is decoded
    from the beginning.

    Args:
        start: first byte of the events, the fallback.
        clocks: for each block its first byte and a time of the clock in the block, not before any event of the earlier
            blocks. Blocks may be missing.
        time: the time, in units of the clock.
        period: range of the clock, in the same units.

    Returns:
        The block. In an intact file all events before the block are earlier than `time`.

    Example: for start = 10, times 100, 240 and 3 at bytes 10, 40 and 50, and period = 256, a search for 260 wraps at
    byte 50, where the clock shows 3 + 256 = 259, and returns byte 50.
    """
    last_before = SeekPoint(start)
    last = added = 0
    for place, clock in clocks:
        if clock < last:
            if last < period - period // 16 or clock >= period // 16:
                return SeekPoint(start)
            added += period
        last = clock
        if clock + added >= time:
            break
        last_before = SeekPoint(place, clock, added)
    return last_before


def bisect_blocks(first: Callable[[int], int], blocks: int, time: int) -> int:
    """Find, by bisection, the block at which to start reading for the events from a time on.

    Args:
        first: function from the number of a block to a time that is not before any event of the earlier blocks.
        blocks: number of blocks.
        time: the time.

    Returns:
        The number of the block before the last one that begins before the time. Reading starts a block early, so that a
        time that runs back between the two blocks is noticed. 0 if the sampled times are not in order.
    """
    low, high, samples = 0, blocks, []
    while high - low > 1:
        middle = (low + high) // 2
        begin = first(middle)
        samples.append((middle, begin))
        low, high = (middle, high) if begin < time else (low, middle)
    times = [begin for _, begin in sorted(samples)]
    return max(low - 1, 0) if times == sorted(times) else 0
