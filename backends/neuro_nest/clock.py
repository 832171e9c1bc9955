"""Times as NEST computes them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from neuro.core.clock import Clock
from neuro_nest.tables import TICKS_PER_MS

MS_PER_TICK = 1 / TICKS_PER_MS


class NestClock(Clock):
    """Clock whose times in ms are bit for bit those of NEST's `Time::get_ms`, ticks times the length of a tick.

    NEST compares `min_delay` with its own number, and some decimal numbers are below it: 700 ticks of 0.001 ms are
    0.7000000000000001 ms, so that 0.7 ms would be no step. All times given to NEST are made here.
    """

    def __init__(self, resolution: float) -> None:
        super().__init__(resolution)
        self._ticks = round(resolution * TICKS_PER_MS)

    def ms(self, step: int) -> float:
        """The time of a step in ms."""
        return MS_PER_TICK * (step * self._ticks)

    def array_ms(self, steps: NDArray[np.int64]) -> NDArray[np.float64]:
        """The times of many steps in ms."""
        return np.multiply(steps.astype(np.int64) * self._ticks, MS_PER_TICK, dtype=np.float64)
