"""Columns and rows exchanged."""

from __future__ import annotations

from dataclasses import dataclass

from neuro.events._events import Events
from neuro.events.filters._filter import Filter, Size


@dataclass(frozen=True, eq=False)
class Transpose(Filter):
    """Exchange columns and rows (``frame.T``)."""

    word = "transpose"

    @property
    def out_size(self) -> Size:
        """Height and width of what comes in, px."""
        return self.sensor_size[1], self.sensor_size[0]

    def _part(self, events: Events) -> Events:
        return self._of(events, (events.t, events.y, events.x, events.p))
