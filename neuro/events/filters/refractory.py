"""A dead time of each pixel."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from neuro.events._events import Events
from neuro.events.filters._filter import NEVER, Sieve, State


@dataclass(frozen=True, eq=False)
class Refractory(Sieve):
    """After an event that passes, a pixel is silent for a while.

    Attributes:
        period_us: time to the next event that can pass, us.
        extend: whether an event that does not pass begins the time anew, as in jAER's RefractoryFilter (which lets
            pass only after more than the period); otherwise it does not, as in a pixel that is held in reset.

    Source: dead time of the pixel, Lichtsteiner et al., IEEE JSSC 43:566, 2008.
    """

    word = "refractory"
    period_us: int = 1000
    extend: bool = False

    def _check(self) -> None:
        self._expect_whole("period_us", 0, " us")
        self._expect(isinstance(self.extend, bool), "extend", self.extend, "True or False")

    def _fresh(self) -> State:
        return (np.full((self.sensor_size[1], self.sensor_size[0]), NEVER, np.int64),)

    def _keep(self, events: Events, keep: npt.NDArray[np.bool_]) -> None:
        from neuro.events.filters._refractory_kernel import rested

        rested(events.t, events.x, events.y, int(self.period_us), self.extend, self._state[0], keep)
