"""Filters of times: moved, stretched, played backwards, or shaken."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from neuro.core.keyed_random import key
from neuro.core.quantities import quantity
from neuro.events._events import Events
from neuro.events.filters._filter import Filter, FilterError, State
from neuro.events.parts import together


@dataclass(frozen=True, eq=False)
class Shift(Filter):
    """Move all times by the same.

    Attributes:
        by_us: added to each time, us.
        to_us: instead, the time that the first event of the recording gets, us.
    """

    word = "shift"
    by_us: int = quantity(0, kind="microseconds")
    to_us: int | None = quantity(None, kind="microseconds")

    def _check(self) -> None:
        if self.to_us is not None:
            self._expect(self.by_us == 0, "by_us", self.by_us, "0 where to_us is given")

    def _fresh(self) -> State:
        return (self.by_us if self.to_us is None else None,)

    def _part(self, events: Events) -> Events:
        (by,) = self._state
        if by is None:
            assert self.to_us is not None
            by = self.to_us - int(events.t[0])
            self._hold(by)
        for end in (int(events.t[0]), int(events.t[-1])):
            if not -(1 << 63) <= end + by < 1 << 63 or abs(by) >= 1 << 63:
                raise FilterError(f"Shift: {end} us moved by {by} us, expected a time that 64 bits can hold")
        return self._of(events, (events.t + np.int64(by), events.x, events.y, events.p))


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
    factor: float = quantity(1.0, above=0)
    origin_us: int | None = quantity(None, kind="microseconds")

    def _fresh(self) -> State:
        return (self.origin_us,)

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
        t = np.rint((events.t - origin) * self.factor).astype(np.int64) + origin
        return self._of(events, (t, events.x, events.y, events.p))


@dataclass(frozen=True, eq=False)
class Reverse(Filter):
    """Play backwards: the last event comes first, and the recording begins and ends at the same times as before.

    All events are held until `finish`, so the memory is not constant.

    Attributes:
        invert: whether ON becomes OFF and OFF becomes ON, since a rise played backwards is a fall.
    """

    word = "reverse"
    invert: bool = True

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


@dataclass(frozen=True, eq=False)
class Jitter(Filter):
    """Add a random whole number of us to each time and sort anew.

    The numbers from ``-amount_us`` to ``amount_us`` are equally likely (standard deviation about ``amount_us / 1.73``);
    that of an event depends on the seed and its number in the recording only. An event is held back until no later
    one can come before it, so `finish` gives the last ones. Events of one time keep their order.

    Attributes:
        amount_us: the largest change, us.
        seed: of the changes, not negative.
    """

    word = "jitter"
    amount_us: int = quantity(100, kind="microseconds", at_least=0)
    seed: int = quantity(0, kind="integer", at_least=0, at_most=2**63 - 1)

    def _fresh(self) -> State:
        return 0, ()

    def _part(self, events: Events) -> Events:
        from neuro.events.filters._kernels import shake

        seen, held = self._state
        t = np.empty(len(events), np.int64)
        shake(events.t, np.uint64(key(self.seed, "events", "jitter")), seen, self.amount_us, t)
        shaken = together([*held, self._of(events, (t, events.x, events.y, events.p))])
        order = sorting(shaken.t)
        ready = self._of(events, (shaken.t[order], shaken.x[order], shaken.y[order], shaken.p[order]))
        n = int(np.searchsorted(ready.t, int(events.t[-1]) - self.amount_us, side="right"))
        self._hold(seen + len(events), (ready[n:],))
        return ready[:n]

    def _rest(self) -> Events:
        _, held = self._state
        return held[0] if held else super()._rest()


def sorting(t: npt.NDArray[np.int64]) -> npt.NDArray[np.int64]:
    """The stable order of some times, faster than a comparing sort where they span little.

    Args:
        t: (n,) us, n > 0.
    """
    from neuro.events.filters._kernels import DIGIT, by_digit

    lowest = int(t.min())
    order, other, counts = np.arange(t.size), np.empty(t.size, np.int64), np.empty(1 << DIGIT, np.int64)
    for shift in range(0, (int(t.max()) - lowest).bit_length(), DIGIT):
        by_digit(t, lowest, shift, order, counts, other)
        order, other = other, order
    return order
