"""What readers of several formats share: a cursor over bytes, packets gathered into pieces, and where to begin."""

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


def decoded(
    room: Columns, n: int, highest: tuple[int, int], ordered: bool, place: Callable[[int], int | None]
) -> Piece:
    """The first n events of what a kernel filled.

    Args:
        room: the columns.
        n: how many events there are.
        highest: largest x and y, as the kernel has them.
        ordered: whether time does not run back.
        place: gives the byte at which an event begins.
    """
    t, x, y, p = room
    largest = (int(highest[0]), int(highest[1])) if n else (-1, -1)
    return Piece(t[:n], x[:n], y[:n], p[:n], largest, bool(ordered), place)


def write_words(
    parts: Iterator[Events], path: Path, header: Callable[[Size | None], bytes], words: Callable[[int, Events], bytes]
) -> None:
    """Write a recording as a header and words.

    Args:
        parts: of the recording, in order.
        path: where to.
        header: of a sensor's width and height, None where there is no part.
        words: of a part, and the number of events before it; raises `Unsavable`.
    """
    with growing(path.open("wb")) as append:
        begun = False
        for done, events in in_order(parts):
            if not begun:
                append(header(events.sensor_size))
            begun = True
            append(words(done, events))
        if not begun:
            append(header(None))


@contextmanager
def growing(opened: BinaryIO) -> Iterator[Callable[[Any], None]]:
    """Let a new file grow piece by piece, and close it. Gives the function that appends a piece.

    A piece is with the system when the next one begins, so a killed process leaves it. If one cannot be written, as on
    a full disk, the file is cut where that piece began.
    """
    size, name = 0, getattr(opened, "name", None)
    try:
        with opened as file:

            def append(data: Any) -> None:
                nonlocal size
                file.write(data)
                file.flush()
                size += memoryview(data).nbytes

            yield append
    except BaseException:
        if name is not None:  # none is of standard output
            with suppress(OSError):
                os.truncate(name, size)
        raise


class Cursor:
    """Takes the bytes of a source one after the other.

    Args:
        source: where they come from.
        start: first byte.
        block: bytes to hold at a time.

    Attributes:
        at: the next byte.
    """

    def __init__(self, source: Source, start: int, block: int) -> None:
        self.at = start
        self._blocks = source.blocks(start, block)
        self._held: Bytes = np.zeros(0, np.uint8)
        self._used = 0

    @property
    def held(self) -> Bytes:
        """What comes next, as far as it is read."""
        return self._held[self._used :]

    def take(self, count: int) -> Bytes:
        """The next ``count`` bytes; fewer only at the end of the file."""
        if self._held.size - self._used < count:
            self._fill(count)
        taken = self._held[self._used : self._used + count]
        self._used += taken.size
        self.at += taken.size
        return taken

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
    """Gathers the events of packets.

    Attributes:
        t: int64, us; filled up to ``used``, as are the others.
        x, y: uint16, px.
        p: uint8, 1 = ON.
        used: number of events.
    """

    def __init__(self) -> None:
        self._reset(0)

    def _reset(self, room: int) -> None:
        self.t, self.x, self.y, self.p = empty_columns(room)
        self.used = 0
        self._highest = (-1, -1)
        self._ordered = True
        self._begins: list[int] = []
        self._places: list[int | None] = []

    def room(self, count: int) -> None:
        """Make room for so many events after those that are there."""
        needed = self.used + count
        if needed > self.t.size:
            size = max(needed, 2 * self.t.size)
            self.t, self.p = _longer(self.t, size), _longer(self.p, size)
            self.x, self.y = _longer(self.x, size), _longer(self.y, size)

    def added(
        self, begins: Sequence[int], places: Sequence[int | None], used: int, highest: tuple[int, int], ordered: bool
    ) -> None:
        """Say what was filled in.

        Args:
            begins: first event of each packet.
            places: byte at which each begins.
            used: number of events that there are now.
            highest: largest x and y of the new ones.
            ordered: whether time does not run back among them, and from the last one before them.
        """
        if used == self.used:
            return
        self._ordered &= ordered
        self._highest = (max(self._highest[0], highest[0]), max(self._highest[1], highest[1]))
        self._begins += begins
        self._places += places
        self.used = used

    def piece(self) -> Piece:
        """What there is; what comes next begins anew."""
        begins, places, n = np.array(self._begins, np.int64), self._places, self.used

        def place(event: int) -> int | None:
            return places[int(np.searchsorted(begins, event, side="right")) - 1]

        piece = Piece(self.t[:n], self.x[:n], self.y[:n], self.p[:n], self._highest, self._ordered, place)
        self._reset(n)
        return piece


@dataclass(frozen=True, slots=True)
class Begin:
    """Where to begin.

    Attributes:
        place: the byte of a block.
        clock: a time that the clock shows in this block, before any event that is wanted; None at the beginning.
        added: what its new beginnings so far add to the clock.
    """

    place: int
    clock: int | None = None
    added: int = 0


def begin(start: int, clocks: Iterable[tuple[int, int]], wanted: int, period: int) -> Begin:
    """The last block that begins before a time.

    Args:
        start: the byte at which to begin if nothing can be left out.
        clocks: of each block its byte and a time that the clock shows in it, at or after all events before; blocks may
            be missing.
        wanted: the time, in units of the clock.
        period: range of the clock, in the same units.

    Returns:
        The block; all events before it are earlier than `wanted`, in a file that is whole.

    In files of which each part can be had alone, bisection finds the place. In others it is enough to look at one time
    in each block, without decoding, where times do not run back. A clock that begins again is seen as a fall of these
    times from the last sixteenth of its range to the first. What would not be seen is a block of 1 MiB that takes a
    whole range: in DAT fewer than 31 events a second during 71 minutes, in EVT 2.0 fewer than 15 during 4.8 hours,
    within a long recording. Any other fall means damage, or events that are not in order: then all is decoded from the
    beginning.
    """
    found = Begin(start)
    last = added = 0
    for place, clock in clocks:
        if clock < last:
            if last < period - period // 16 or clock >= period // 16:
                return Begin(start)
            added += period
        last = clock
        if clock + added >= wanted:
            break
        found = Begin(place, clock, added)
    return found


def bisected(first: Callable[[int], int], blocks: int, wanted: int) -> int:
    """The block before the last that begins before a time, so that one is read in which time could run back.

    Args:
        first: gives a time that is at or after all events before a block.
        blocks: how many there are.
        wanted: the time.

    Returns:
        The number of a block, 0 where the times seen are not in order.
    """
    low, high, seen = 0, blocks, []
    while high - low > 1:
        middle = (low + high) // 2
        time = first(middle)
        seen.append((middle, time))
        low, high = (middle, high) if time < wanted else (low, middle)
    times = [time for _, time in sorted(seen)]
    return max(low - 1, 0) if times == sorted(times) else 0
