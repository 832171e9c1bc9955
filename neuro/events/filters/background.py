"""Background activity: events that no neighbour supports."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from neuro.events._events import Events
from neuro.events.filters._filter import NEVER, Sieve, State


@dataclass(frozen=True, eq=False)
class BackgroundActivity(Sieve):
    """Keep events that had an event in one of the 8 neighbouring pixels a short while before.

    The pixel itself does not support its events, and an event that does not pass still supports those after it.

    Attributes:
        dt_us: longest time since the neighbour's event, us; that time itself counts.

    Source: Delbruck, Frame-free dynamic digital vision, Int. Symp. Secure-Life Electronics, 2008.
    """

    word = "background"
    dt_us: int = 10_000

    def _check(self) -> None:
        self._expect_whole("dt_us", 0, " us")

    def _fresh(self) -> State:
        return (np.full((self.sensor_size[1] + 2, self.sensor_size[0] + 2), NEVER, np.int64),)

    def _keep(self, events: Events, keep: npt.NDArray[np.bool_]) -> None:
        from neuro.events.filters._background_kernel import supported

        supported(events.t, events.x, events.y, int(self.dt_us), self._state[0], keep)
