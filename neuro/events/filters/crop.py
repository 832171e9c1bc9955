"""A part of the sensor."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from neuro.events._events import Events
from neuro.events.filters._filter import Sieve, Size, _is_whole, kept


@dataclass(frozen=True, eq=False)
class Crop(Sieve):
    """Keep events of a rectangle.

    Attributes:
        x: first column and the column after the last, px; None keeps all.
        y: first row and the row after the last, px; None keeps all.
        move: whether the rectangle becomes the sensor, with its upper left pixel at (0, 0); otherwise events stay
            where they are and so does the sensor's size.
    """

    word = "crop"
    units = {"x": "px", "y": "px"}
    x: tuple[int, int] | None = None
    y: tuple[int, int] | None = None
    move: bool = True

    def _check(self) -> None:
        for name, limit in zip("xy", self.sensor_size, strict=True):
            sides = getattr(self, name) or (0, limit)
            right = len(sides) == 2 and all(map(_is_whole, sides)) and 0 <= sides[0] < sides[1] <= limit
            self._expect(right, name, sides, f"(first, after the last) within 0 to {limit} px")
            object.__setattr__(self, name, (int(sides[0]), int(sides[1])))
        self._expect(isinstance(self.move, bool), "move", self.move, "True or False")

    @property
    def out_size(self) -> Size:
        """Width and height of the events that come out, px."""
        assert self.x is not None
        assert self.y is not None
        return (self.x[1] - self.x[0], self.y[1] - self.y[0]) if self.move else self.sensor_size

    def _keep(self, events: Events, keep: npt.NDArray[np.bool_]) -> None:
        keep.fill(True)
        for values, sides, limit in zip((events.x, events.y), (self.x, self.y), self.sensor_size, strict=True):
            assert sides is not None
            if sides[0] > 0:
                keep &= values >= sides[0]
            if sides[1] < limit:
                keep &= values < sides[1]

    def _part(self, events: Events) -> Events:
        keep = np.empty(len(events), np.bool_)
        self._keep(events, keep)
        t, x, y, p = kept(events, keep)
        if self.move:
            assert self.x is not None
            assert self.y is not None
            x, y = x - np.uint16(self.x[0]), y - np.uint16(self.y[0])
        return self._of(events, (t, x, y, p))
