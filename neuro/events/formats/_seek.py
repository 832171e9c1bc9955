"""Where to begin reading, for events from some time on, in files whose clock begins again at 0.

Looking at one time in each block is enough, without decoding, where times do not run back. A clock that begins again
is seen as a fall of these times from the last sixteenth of its range to the first. What would not be seen is a block of
1 MiB that takes a whole range: in DAT fewer than 31 events a second during 71 minutes, in EVT 2.0 fewer than 15 a
second during 4.8 hours, within a long recording. Any other fall means damage, or events that are not in order: then all
is decoded from the beginning.
"""

from __future__ import annotations

from collections.abc import Iterable
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
