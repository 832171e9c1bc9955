"""Times stretched."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from neuro.events._events import Events
from neuro.events.filters._filter import Filter, FilterError, State

EXACT = 1 << 53
"""Whole numbers below this are exact in float64."""


@dataclass(frozen=True, eq=False)
class Scale(Filter):
    """Stretch the times from an origin.

    A time becomes ``origin + (t - origin) factor``, rounded to whole us, halves to the even one.

    Attributes:
        factor: above 1 is slow motion.
        origin_us: the time that stays, us; None takes that of the recording's first event.
    """

    word = "scale"
    factor: float = 1.0
    origin_us: int | None = None

    def _check(self) -> None:
        self._expect_positive("factor")
        if self.origin_us is not None:
            self._expect_whole("origin_us", None, " us")

    def _fresh(self) -> State:
        return (None if self.origin_us is None else int(self.origin_us),)

    def _part(self, events: Events) -> Events:
        (origin,) = self._state
        if origin is None:
            origin = int(events.t[0])
            self._hold(origin)
        for end in (int(events.t[0]), int(events.t[-1])):
            if abs(end - origin) * max(1.0, self.factor) >= EXACT:
                raise FilterError(
                    f"Scale: {end} us is too far from the origin at {origin} us for a factor of {self.factor}, "
                    "expected a product below 2^53 us, which is exact"
                )
        t = np.rint((events.t - origin) * float(self.factor)).astype(np.int64) + origin
        return self._of(events, (t, events.x, events.y, events.p))
