"""Times moved."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from neuro.events._events import Events
from neuro.events.filters._filter import Filter, FilterError, State


@dataclass(frozen=True, eq=False)
class Shift(Filter):
    """Move all times by the same.

    Attributes:
        by_us: added to each time, us.
        to_us: instead, the time that the first event of the recording gets, us.
    """

    word = "shift"
    by_us: int = 0
    to_us: int | None = None

    def _check(self) -> None:
        self._expect_whole("by_us", None, " us")
        if self.to_us is not None:
            self._expect_whole("to_us", None, " us")
            self._expect(self.by_us == 0, "by_us", self.by_us, "0 where to_us is given")

    def _fresh(self) -> State:
        return (int(self.by_us) if self.to_us is None else None,)

    def _part(self, events: Events) -> Events:
        (by,) = self._state
        if by is None:
            assert self.to_us is not None
            by = int(self.to_us) - int(events.t[0])
            self._hold(by)
        for end in (int(events.t[0]), int(events.t[-1])):
            if not -(1 << 63) <= end + by < 1 << 63 or abs(by) >= 1 << 63:
                raise FilterError(f"Shift: {end} us moved by {by} us, expected a time that 64 bits can hold")
        return self._of(events, (events.t + np.int64(by), events.x, events.y, events.p))
