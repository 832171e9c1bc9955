"""Where to begin reading, for events from some time on.

In files of which each part can be had alone, bisection finds the place. In others it is enough to look at one time in
each block, without decoding, where times do not run back. A clock that begins again is seen as a fall of these times
from the last sixteenth of its range to the first. What would not be seen is a block of 1 MiB that takes a whole range:
in DAT fewer than 31 events a second during 71 minutes, in EVT 2.0 fewer than 15 during 4.8 hours, within a long
recording. Any other fall means damage, or events that are not in order: then all is decoded from the beginning.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass


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
