"""What changes about the drone in flight: the wind, and what it carries."""

from __future__ import annotations

from math import cos, exp, radians, sin, sqrt

import numpy as np

from neuro_drone.parts import Load, Wind

__all__ = ["Weather"]

ROUNDING = 1e-6
"""s; a sum of steps may be a little less than the time that is meant."""


class Weather:
    """Wind with gusts, and a load that is taken up.

    Gusts on each axis are an Ornstein-Uhlenbeck process, solved exactly, so that their spread does not depend on how
    time is cut.

    Args:
        wind: of the scenario.
        load: of the scenario.

    Attributes:
        still: whether nothing ever changes.
        wind: x and y in the world, m/s, of the step that was begun last.
        load: kg, of that step.
    """

    def __init__(self, wind: Wind, load: Load) -> None:
        self._wind, self._load = wind, load
        self.still = not (wind.speed or wind.gust or load.mass)
        self.reset(0)

    def reset(self, seed: int) -> None:
        """An episode begins.

        Args:
            seed: of the gusts.
        """
        self._rng = np.random.default_rng([seed, 3])
        self._time = 0.0
        self._gust = (0.0, 0.0)
        self.wind, self.load = (0.0, 0.0), 0.0

    def step(self, seconds: float) -> None:
        """Let time pass: `wind` and `load` are then those of this time, as at its beginning."""
        wind, load = self._wind, self._load
        now = self._time + ROUNDING
        self.load = load.mass if now >= load.since else 0.0
        if (wind.speed or wind.gust) and now >= wind.since:
            self._blow(seconds)
        self._time += seconds

    def _blow(self, seconds: float) -> None:
        wind, (x, y) = self._wind, self._gust
        if wind.gust:
            kept = exp(-seconds / wind.gust_time)
            fresh = self._rng.normal(0.0, wind.gust * sqrt(1.0 - kept * kept), 2).tolist()
            x, y = self._gust = (kept * x + fresh[0], kept * y + fresh[1])
        way = radians(wind.towards + wind.turning * (self._time - wind.since))
        self.wind = (wind.speed * cos(way) + x, wind.speed * sin(way) + y)
