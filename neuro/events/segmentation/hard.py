"""Segments of fixed time or fixed count, whatever happens in them."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from neuro.core.errors import ModelError
from neuro.events._arguments import moment, whole
from neuro.events.segmentation._cutter import NONE, Times, bounds

MOST = 10**8
"""More windows at once than this are a mistake in the unit or in a time: their bounds alone would take 1 GB."""


class TimeWindows:
    """Segments of equal length, each with its first us and without its last; one without events is empty.

    A window is complete when an event at or after its end is seen.

    Args:
        window_us: length, us.
        start_us: where the first begins, us; None: at the first event.

    Raises:
        ModelError: the length is not a whole number of at least 1, or the start not a whole number.
    """

    def __init__(self, window_us: int, start_us: int | None = None) -> None:
        self._window = whole("window_us", window_us)
        self._begin = None if start_us is None else moment("start_us", start_us)
        self._seen = 0

    def cuts(self, t: Times) -> Times:
        """The ends of windows; see `Cutter`.

        Raises:
            ModelError: an event lies before the first window, or there are more than 10^8 windows.
        """
        if not t.size:
            return NONE
        begin = int(t[0]) if self._begin is None else self._begin
        if t[0] < begin:
            raise ModelError(
                f"event {self._seen} is at {t[0]} us, before start_us = {begin}",
                hint="leave earlier events out with events.between(start_us, stop_us)",
            )
        n = (int(t[-1]) - begin) // self._window
        if n > MOST:
            raise ModelError(
                f"window_us is {self._window}: {n} windows from {begin} to {t[-1]} us, expected at most {MOST}",
                hint="is the window in us, and are the times those of one recording?",
            )
        found = self._seen + np.searchsorted(t, begin + self._window * np.arange(1, n + 1)).astype(np.int64)
        self._begin = begin + n * self._window
        self._seen += t.size
        return found

    def end(self) -> Times:
        """None: an incomplete window is left over."""
        return NONE


class Counts:
    """Segments of equally many events.

    The thesis' remark holds: this is a leaky neuron without leak.

    Args:
        count: events of a segment.

    Raises:
        ModelError: the count is not a whole number of at least 1.
    """

    def __init__(self, count: int) -> None:
        self._count = whole("count", count)
        self._seen = 0

    def cuts(self, t: Times) -> Times:
        """The ends of segments; see `Cutter`."""
        first = (self._seen // self._count + 1) * self._count
        self._seen += t.size
        return np.arange(first, self._seen + 1, self._count, dtype=np.int64)

    def end(self) -> Times:
        """None: a shorter segment is left over."""
        return NONE


def time_segments(
    t: npt.NDArray[np.integer], window_us: int, *, start_us: int | None = None, rest: bool = False
) -> Times:
    """Cut by the clock.

    Args:
        t: (n,) times, us, non-decreasing.
        window_us: length of a segment, us.
        start_us: where the first begins, us, not after the first event; None: at the first event.
        rest: whether the last window counts although no event ends it.

    Returns:
        (segments + 1,) int64: segment i is events ``[out[i], out[i + 1])``, with times from
        ``start + i * window_us`` to before ``start + (i + 1) * window_us``.

    Raises:
        ModelError: an argument is wrong; the message says which.
    """
    return bounds(TimeWindows(window_us, start_us), t, rest)


def count_segments(t: npt.NDArray[np.integer], count: int, *, rest: bool = False) -> Times:
    """Cut after every so many events.

    Args:
        t: (n,) times, us, non-decreasing.
        count: events of a segment.
        rest: whether a last segment may have fewer.

    Returns:
        (segments + 1,) int64: segment i is events ``[out[i], out[i + 1])``.

    Raises:
        ModelError: an argument is wrong; the message says which.
    """
    return bounds(Counts(count), t, rest)
