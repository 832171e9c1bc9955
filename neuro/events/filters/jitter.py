"""Times shaken."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from neuro.core.keyed_random import key
from neuro.events._events import Events
from neuro.events.filters._filter import Filter, State
from neuro.events.parts import together


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
    amount_us: int = 100
    seed: int = 0

    def _check(self) -> None:
        self._expect_whole("amount_us", 0, " us")
        self._expect_whole("seed", 0)

    def _fresh(self) -> State:
        return 0, ()

    def _part(self, events: Events) -> Events:
        from neuro.events.filters._jitter_kernel import shake

        seen, held = self._state
        t = np.empty(len(events), np.int64)
        shake(events.t, np.uint64(key(self.seed, "events", "jitter")), seen, int(self.amount_us), t)
        shaken = together([*held, self._of(events, (t, events.x, events.y, events.p))])
        order = sorting(shaken.t)
        ready = self._of(events, (shaken.t[order], shaken.x[order], shaken.y[order], shaken.p[order]))
        n = int(np.searchsorted(ready.t, int(events.t[-1]) - int(self.amount_us), side="right"))
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
    from neuro.events.filters._jitter_kernel import DIGIT, by_digit

    lowest = int(t.min())
    order, other, counts = np.arange(t.size), np.empty(t.size, np.int64), np.empty(1 << DIGIT, np.int64)
    for shift in range(0, (int(t.max()) - lowest).bit_length(), DIGIT):
        by_digit(t, lowest, shift, order, counts, other)
        order, other = other, order
    return order
