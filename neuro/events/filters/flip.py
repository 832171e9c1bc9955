"""Events mirrored."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from neuro.events._events import Events
from neuro.events.filters._filter import Filter


@dataclass(frozen=True, eq=False)
class Flip(Filter):
    """Mirror.

    Attributes:
        axis: "x" exchanges left and right (``frame[:, ::-1]``), "y" top and bottom (``frame[::-1]``).
    """

    word = "flip"
    axis: str = "x"

    def _check(self) -> None:
        self._expect(self.axis in ("x", "y"), "axis", self.axis, "'x' or 'y'")

    def _part(self, events: Events) -> Events:
        x, y = events.x, events.y
        if self.axis == "x":
            x = np.uint16(self.sensor_size[0] - 1) - x
        else:
            y = np.uint16(self.sensor_size[1] - 1) - y
        return self._of(events, (events.t, x, y, events.p))
