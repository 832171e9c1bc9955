"""A part of a larger sensor: a window at a place, or round what a recording shows."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from neuro.core.errors import ModelError
from neuro.events._events import Events

MAX_OUTSIDE = 0.05
"""Share of a recording's events that may lie outside of the window and be left out."""

EDGES = (0.01, 0.99)
"""Shares of the events between whose columns, and rows, lies what a recording shows: a few of noise do not count."""


def windowed(
    events: Events, size: tuple[int, int], at: tuple[int, int] | None, start: float, duration: float, name: str
) -> Events:
    """The events inside a window, as of a sensor of its size.

    Args:
        events: a recording.
        size: width and height of the window, px.
        at: its first column and row, px; round the middle of the events that are seen if None. It may reach
            beyond the sensor: those pixels are silent.
        start: ms from the first event to what is seen.
        duration: of what is seen, ms.
        name: of the recording.

    Raises:
        ModelError: more than `MAX_OUTSIDE` of the events that are seen lie outside of it.
    """
    since = events.t - (events.t[0] if len(events.t) else 0) - round(1000.0 * start)
    seen = (since >= 0) & (since < round(1000.0 * duration))
    left, top = at or (_first(each[seen], side) for each, side in zip((events.x, events.y), size, strict=True))
    x, y = events.x.astype(np.int64) - left, events.y.astype(np.int64) - top
    inside = (x >= 0) & (x < size[0]) & (y >= 0) & (y < size[1])
    outside, total = int((seen & ~inside).sum()), int(seen.sum())
    if outside > MAX_OUTSIDE * total:
        window = f"the window of {size[0]}x{size[1]} px at {left},{top}"
        message = f"{name}: {outside} of {total} events lie outside of {window}"
        hint = "another window, a larger scale or population of pixels, or recordings without noise"
        raise ModelError(f"{message}: expected at most {MAX_OUTSIDE:.0%}", hint=hint)
    places = x[inside].astype(np.uint16), y[inside].astype(np.uint16)
    return Events(events.t[inside], *places, events.p[inside], size)


def _first(places: npt.NDArray[np.uint16], side: int) -> int:
    """The first of so many columns, or rows, whose middle is that of what is shown; 0 where that is nothing."""
    if not len(places):
        return 0
    low, high = (float(place) for place in np.quantile(places, EDGES))
    return math.floor((low + high - side) / 2.0 + 1.0)
