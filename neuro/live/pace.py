"""When a network may go on: at a speed beside the clock on the wall, paused, or step by step."""

from __future__ import annotations

import math
import time

from neuro.core.quantities import Quantity

LATE_S = 0.2
"""A run that is later than this is not caught up with: it goes on from where it is."""
SPEED = Quantity(doc="times real time", above=0.0, infinite=True)


class Pace:
    """Says how long to wait.

    Args:
        speed: times real time; infinite as fast as it can.

    Attributes:
        paused: whether it waits for `pause(False)` or `step`.
    """

    def __init__(self, speed: float) -> None:
        self.speed, self.paused = speed, False
        self._steps = 0
        self._began: tuple[float, float] | None = None

    def set(self, speed: float) -> None:
        """Go on at another speed."""
        self.speed, self._began = speed, None

    def pause(self, paused: bool) -> None:
        """Wait, or go on."""
        self.paused, self._steps, self._began = paused, 0, None

    def step(self) -> None:
        """Pause, but let one stretch more be run."""
        if not self.paused:
            self.pause(True)
        self._steps += 1

    def begin(self) -> None:
        """The time of the network was set."""
        self._began = None

    def wait_s(self, ms: float) -> float:
        """How long to wait, at most, before the network runs on from a time; 0 or less: not at all."""
        if self.paused:
            if not self._steps:
                return math.inf
            self._steps -= 1
            return 0.0
        now = time.perf_counter()
        if self._began is None or math.isinf(self.speed):
            self._began = now, ms
        wait = self._began[0] + (ms - self._began[1]) * 1e-3 / self.speed - now
        if wait < -LATE_S:
            self._began = now, ms
        return wait
