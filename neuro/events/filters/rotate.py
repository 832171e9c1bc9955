"""Events turned."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from neuro.events._events import Events
from neuro.events.filters._filter import Filter, Size


@dataclass(frozen=True, eq=False)
class Rotate90(Filter):
    """Turn by right angles.

    Attributes:
        turns: quarters of a turn, counter-clockwise as the picture is seen (``numpy.rot90(frame, turns)``).
    """

    word = "rotate"
    units = {"turns": "quarters"}
    turns: int = 1

    def _check(self) -> None:
        self._expect_whole("turns", None)

    @property
    def out_size(self) -> Size:
        """Width and height of the turned sensor, px."""
        width, height = self.sensor_size
        return (height, width) if self.turns % 2 else (width, height)

    def _part(self, events: Events) -> Events:
        right, bottom = np.uint16(self.sensor_size[0] - 1), np.uint16(self.sensor_size[1] - 1)
        x, y, turns = events.x, events.y, self.turns % 4
        if turns in (1, 2):
            x = right - x
        if turns in (2, 3):
            y = bottom - y
        return self._of(events, (events.t, y, x, events.p) if turns % 2 else (events.t, x, y, events.p))
