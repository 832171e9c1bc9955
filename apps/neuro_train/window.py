"""The part of a sensor that a network sees, where that has fewer pixels."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from neuro import ModelError

if TYPE_CHECKING:
    from neuro.events import Events

__all__ = ["CENTRED", "MAX_OUTSIDE", "corner", "windowed"]

CENTRED = "centred"
"""Asks for a window round what each recording shows."""

MAX_OUTSIDE = 0.05
"""Share of a recording's events that may lie outside of the window and be left out."""

EDGES = (0.01, 0.99)
"""Shares of the events between whose columns, and rows, lies what a recording shows: a few of noise do not count."""


def corner(text: str) -> tuple[int, int] | None:
    """Column and row of the window's first pixel; None for one round what each recording shows.

    Raises:
        ModelError: it is neither "centred" nor a column and a row, as in "40,32".
    """
    if text == CENTRED:
        return None
    column, comma, row = (part.strip() for part in text.partition(","))
    if not (comma and column.isdecimal() and row.isdecimal()):
        expected = "expected 'centred', or column and row of its first pixel"
        raise ModelError(f"--window {text}: {expected}", hint="--window centred, or --window 0,0")
    return int(column), int(row)


def windowed(
    events: Events, size: tuple[int, int], at: tuple[int, int] | None, start: float, duration: float, name: str
) -> Events:
    """The events inside a window, as of a sensor of its size.

    Args:
        events: a recording.
        size: width and height of the window, px.
        at: its first column and row, see `corner`; round the middle of the events that are seen if None. It may reach
            beyond the sensor: those pixels are silent.
        start: ms from the first event to what is seen.
        duration: of what is seen, ms.
        name: of the recording.

    Raises:
        ModelError: more than `MAX_OUTSIDE` of the events that are seen lie outside of it.
    """
    from neuro.events import Events

    since = events.t - (events.t[0] if len(events.t) else 0) - round(1000.0 * start)
    seen = (since >= 0) & (since < round(1000.0 * duration))
    left, top = at or (_first(each[seen], side) for each, side in zip((events.x, events.y), size, strict=True))
    x, y = events.x.astype(np.int64) - left, events.y.astype(np.int64) - top
    inside = (x >= 0) & (x < size[0]) & (y >= 0) & (y < size[1])
    outside, total = int((seen & ~inside).sum()), int(seen.sum())
    if outside > MAX_OUTSIDE * total:
        window = f"the window of {size[0]}x{size[1]} px at {left},{top}"
        message = f"{name}: {outside} of {total} events lie outside of {window}"
        hint = "another --window, a larger --scale or population of pixels, or recordings without noise"
        raise ModelError(f"{message}: expected at most {MAX_OUTSIDE:.0%}", hint=hint)
    places = x[inside].astype(np.uint16), y[inside].astype(np.uint16)
    return Events(events.t[inside], *places, events.p[inside], size)


def _first(places: npt.NDArray[np.uint16], side: int) -> int:
    """The first of so many columns, or rows, whose middle is that of what is shown; 0 where that is nothing."""
    if not len(places):
        return 0
    low, high = (float(place) for place in np.quantile(places, EDGES))
    return math.floor((low + high - side) / 2.0 + 1.0)
