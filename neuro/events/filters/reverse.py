"""Events from the last to the first."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from neuro.events._events import Events
from neuro.events.filters._filter import Filter
from neuro.events.parts import together


@dataclass(frozen=True, eq=False)
class Reverse(Filter):
    """Play backwards: the last event comes first, and the recording begins and ends at the same times as before.

    All events are held until `finish`, so the memory is not constant.

    Attributes:
        invert: whether ON becomes OFF and OFF becomes ON, since a rise played backwards is a fall.
    """

    word = "reverse"
    invert: bool = True

    def _check(self) -> None:
        self._expect(isinstance(self.invert, bool), "invert", self.invert, "True or False")

    def _part(self, events: Events) -> Events:
        self._hold(*self._state, events)
        return events[:0]

    def _rest(self) -> Events:
        if not self._state:
            return super()._rest()
        events = together(list(self._state))
        t = events.t[0] + (events.t[-1] - events.t[::-1])
        p = 1 - events.p if self.invert else events.p
        return self._of(events, (t, *(np.ascontiguousarray(a[::-1]) for a in (events.x, events.y, p))))
