"""Parts of one recording, cut anew or put together."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro_events._events import Events, joined_columns
from neuro_events.source import EventFileError

MOST_EMPTY = 10**6
"""Windows without events between two events; more are a jump in the times of a damaged file."""


def between(parts: Iterable[Events], start_us: int | None, stop_us: int | None) -> Iterator[Events]:
    """Leave out what is before a time, and what is at or after another.

    Args:
        parts: of one recording, in order.
        start_us: the first time, us; None: from the first event on.
        stop_us: the time after the last, us; None: up to the last event. No later part is asked for.
    """
    for part in parts:
        if stop_us is not None and len(part) and part.t[0] >= stop_us:
            return
        first = 0 if start_us is None else int(np.searchsorted(part.t, start_us))
        last = len(part) if stop_us is None else int(np.searchsorted(part.t, stop_us))
        if first < last:
            yield part[first:last] if last - first < len(part) else part


def windows(
    parts: Iterable[Events], window_us: int, start_us: int | None = None, path: str = "the recording"
) -> Iterator[Events]:
    """Cut ordered parts of a recording into windows of equal length.

    Args:
        parts: of one recording, in order.
        window_us: length of a window, us.
        start_us: where the first begins; None: at the first event.
        path: the file, for the message.

    Raises:
        EventFileError: more than 10^6 windows in a row have no events.
    """
    held: list[Events] = []
    begin = start_us
    for part in parts:
        if not len(part):
            continue
        begin = int(part.t[0]) if begin is None else begin
        while len(part) and part.t[-1] >= begin + window_us:
            cut = int(np.searchsorted(part.t, begin + window_us))
            empty = (int(part.t[0]) - begin) // window_us
            if empty > MOST_EMPTY:
                message = f"{empty} windows of {window_us} us without events before {part.t[0]} us, "
                hint = "look for a jump in the times, or take longer windows"
                raise EventFileError(path, f"{message}expected at most {MOST_EMPTY}: {hint}")
            yield together([*held, part[:cut]])
            held, part, begin = [], part[cut:], begin + window_us
        held.append(part)
    if held:
        yield together(held)


def together(parts: list[Events]) -> Events:
    """Parts of one recording as one."""
    if len(parts) == 1:
        return parts[0]
    columns = joined_columns(part._columns for part in parts)
    return Events._trusted(*columns, parts[0].sensor_size, parts[0].metadata)


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
