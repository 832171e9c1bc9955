"""Cut a recording into windows, or join its parts."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator

import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro_events._events import Events, joined_columns
from neuro_events.source import EventFileError

MOST_EMPTY = 10**6
"""Largest number of empty windows between two events. A larger number is reported as a jump in the times."""


def between(parts: Iterable[Events], start_us: int | None, stop_us: int | None) -> Iterator[Events]:
    """Yield the events from a start time up to an end time.

    Args:
        parts: the parts of one recording, in order.
        start_us: first time, us. None: from the first event on.
        stop_us: end time, us, exclusive. None: up to the last event. Parts after the end are not requested.
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
        parts: the parts of one recording, in order.
        window_us: length of a window, us.
        start_us: start of the first window, us. None: at the first event.
        path: the file, for the message.

    Raises:
        EventFileError: more than 10^6 windows in a row have no events.
    """
    pending: list[Events] = []
    begin = start_us
    for part in parts:
        if not len(part):
            continue
        begin = int(part.t[0]) if begin is None else begin
        while len(part) and part.t[-1] >= begin + window_us:
            cut = int(np.searchsorted(part.t, begin + window_us))
            n_empty = (int(part.t[0]) - begin) // window_us
            if n_empty > MOST_EMPTY:
                message = f"{n_empty} windows of {window_us} us without events before {part.t[0]} us, "
                hint = "look for a jump in the times, or use longer windows"
                raise EventFileError(path, f"{message}expected at most {MOST_EMPTY}: {hint}")
            yield joined_parts([*pending, part[:cut]])
            pending, part, begin = [], part[cut:], begin + window_us
        pending.append(part)
    if pending:
        yield joined_parts(pending)


def joined_parts(parts: list[Events]) -> Events:
    """Join the parts of one recording."""
    if len(parts) == 1:
        return parts[0]
    columns = joined_columns(part._columns for part in parts)
    return Events._trusted(*columns, parts[0].sensor_size, parts[0].metadata)


MAX_OUTSIDE = 0.05
"""Largest accepted share of a recording's events outside the window. Events outside are dropped."""

EDGES = (0.01, 0.99)
"""Quantiles of the events' columns, and of their rows, between which the object lies. Noise events lie beyond them."""


def windowed(
    events: Events, size: tuple[int, int], at: tuple[int, int] | None, start: float, duration: float, name: str
) -> Events:
    """Return the events inside a window of the sensor, as events of a sensor with the window's size.

    Args:
        events: a recording.
        size: width and height of the window, px.
        at: first column and row of the window, px. None: centred on the events in the time span. The window may extend
            beyond the sensor; pixels outside are silent.
        start: start of the time span, ms after the first event.
        duration: length of the time span, ms.
        name: name of the recording, for messages.

    Raises:
        ModelError: more than `MAX_OUTSIDE` of the events in the time span lie outside the window.
    """
    elapsed = events.t - (events.t[0] if len(events.t) else 0) - round(1000.0 * start)
    is_in_time = (elapsed >= 0) & (elapsed < round(1000.0 * duration))
    first_column, first_row = at or (
        _first_line(coordinate[is_in_time], side) for coordinate, side in zip((events.x, events.y), size, strict=True)
    )
    x, y = events.x.astype(np.int64) - first_column, events.y.astype(np.int64) - first_row
    is_inside = (x >= 0) & (x < size[0]) & (y >= 0) & (y < size[1])
    n_outside, total = int((is_in_time & ~is_inside).sum()), int(is_in_time.sum())
    if n_outside > MAX_OUTSIDE * total:
        window = f"the window of {size[0]}x{size[1]} px at {first_column},{first_row}"
        message = f"{name}: {n_outside} of {total} events lie outside of {window}"
        hint = "another window, a larger scale or population of pixels, or recordings without noise"
        raise ModelError(f"{message}: expected at most {MAX_OUTSIDE:.0%}", hint=hint)
    positions = x[is_inside].astype(np.uint16), y[is_inside].astype(np.uint16)
    return Events(events.t[is_inside], *positions, events.p[is_inside], size)


def _first_line(lines: npt.NDArray[np.uint16], side: int) -> int:
    """Return the first column (or row) of a window of `side` columns, centred between the quantiles `EDGES` of `lines`.

    Without events the result is 0. Example: columns mostly from 10 to 19 and side = 4 give 13.
    """
    if not len(lines):
        return 0
    low, high = (float(place) for place in np.quantile(lines, EDGES))
    return math.floor((low + high - side) / 2.0 + 1.0)
