"""Pixels that never rest."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from neuro.events._events import Events
from neuro.events.filters._filter import FilterError, Sieve, State


@dataclass(frozen=True, eq=False)
class HotPixels(Sieve):
    """Leave out all events of some pixels.

    Attributes:
        pixels: (n, 2) their columns and rows, as `hot_pixels` finds them or as a list.
    """

    word = "hot"
    units = {"pixels": "px"}
    pixels: npt.ArrayLike = ()

    def _check(self) -> None:
        pixels = np.asarray(self.pixels)
        shaped = pixels.size == 0 or (pixels.ndim == 2 and pixels.shape[1] == 2 and pixels.dtype.kind in "iu")
        self._expect(shaped, "pixels", self.pixels, "pairs of column and row, whole numbers")
        listed = pixels.reshape(-1, 2).astype(np.int64)
        width, height = self.sensor_size
        for x, y in listed[((listed < 0) | (listed >= self.sensor_size)).any(1)][:1]:
            raise FilterError(f"{self._name}: pixel ({x}, {y}), expected one of the {width}x{height} sensor")
        object.__setattr__(self, "pixels", listed)

    def _fresh(self) -> State:
        good = np.ones((self.sensor_size[1], self.sensor_size[0]), np.bool_)
        x, y = np.asarray(self.pixels).T
        good[y, x] = False
        return (good,)

    def _keep(self, events: Events, keep: npt.NDArray[np.bool_]) -> None:
        from neuro.events.filters._hot_kernel import look_up

        look_up(events.x, events.y, self._state[0], keep)


def hot_pixels(
    events: Events | Iterable[Events], *, above_hz: float | None = None, times: float = 10.0
) -> npt.NDArray[np.int64]:
    """Find the pixels that send too much.

    Args:
        events: a recording or its parts.
        above_hz: pixels with more events a second between the first and the last event of the recording are hot.
        times: without `above_hz`, pixels are hot that have more than so many times the events of the busiest of their
            8 neighbours, which counts as 1 at least: the edge of an object passes over neighbours too, a fault is
            alone. 10 is this library's choice.

    Returns:
        (n, 2) columns and rows, by rows.

    Raises:
        FilterError: a limit is not positive, parts are of different sensors, or the recording has no duration and
            `above_hz` is given.
    """
    for name, value in (("above_hz", above_hz), ("times", times)):
        if value is not None and not 0 < value < np.inf:
            raise FilterError(f"hot_pixels: {name} is {value!r}, expected a number > 0")
    counts, span_us = _counted([events] if isinstance(events, Events) else events)
    if above_hz is None:
        hot = alone(counts, times)
    else:
        if not span_us and counts.any():
            raise FilterError("hot_pixels: all events have one time, expected a recording that lasts, for above_hz")
        hot = counts * 1e6 > above_hz * span_us
    return np.argwhere(hot)[:, ::-1]


def alone(counts: npt.NDArray[np.int64], times: float = 10.0) -> npt.NDArray[np.bool_]:
    """Which pixels have more than so many times the events of the busiest of their 8 neighbours, or of 1.

    Args:
        counts: (height, width) events of each pixel.
        times: as for `hot_pixels`.

    Returns:
        (height, width).
    """
    rows, columns = counts.shape
    around = np.pad(counts, 1)
    busiest = np.ones_like(counts)
    for i, j in ((i, j) for i in range(3) for j in range(3) if (i, j) != (1, 1)):
        np.maximum(busiest, around[i : i + rows, j : j + columns], out=busiest)
    hot: npt.NDArray[np.bool_] = counts > times * busiest
    return hot


def _counted(parts: Iterable[Events]) -> tuple[npt.NDArray[np.int64], int]:
    """Events of each pixel (height, width), and the time from the first to the last, us."""
    counts, size, first, last = np.zeros((0, 0), np.int64), None, None, 0
    for part in parts:
        width, height = part.sensor_size
        if size is None:
            size, counts = part.sensor_size, np.zeros((height, width), np.int64)
        if part.sensor_size != size:
            raise FilterError(f"hot_pixels: events of a {width}x{height} sensor, expected {size[0]}x{size[1]}")
        if len(part):
            pixels = part.y.astype(np.int64) * width + part.x
            counts += np.bincount(pixels, minlength=width * height).reshape(height, width)
            first, last = int(part.t[0]) if first is None else first, int(part.t[-1])
    return counts, last - first if first is not None else 0
