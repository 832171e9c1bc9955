"""Filters of noise: events of single pixels, unsupported ones and one polarity out, shot noise in."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import sqrt

import numpy as np
import numpy.typing as npt

from neuro.core.keyed_random import key
from neuro.core.quantities import quantity
from neuro.events._events import Events
from neuro.events.filters._filter import NEVER, Filter, FilterError, Sieve, State


@dataclass(frozen=True, eq=False)
class BackgroundActivity(Sieve):
    """Keep events that had an event in one of the 8 neighbouring pixels a short while before.

    The pixel itself does not support its events, and an event that does not pass still supports those after it.

    Attributes:
        dt_us: longest time since the neighbour's event, us; that time itself counts.

    Source: Delbruck, Frame-free dynamic digital vision, Int. Symp. Secure-Life Electronics, 2008.
    """

    word = "background"
    dt_us: int = quantity(10_000, kind="microseconds", at_least=0)

    def _fresh(self) -> State:
        return (np.full((self.sensor_size[1] + 2, self.sensor_size[0] + 2), NEVER, np.int64),)

    def _keep(self, events: Events, keep: npt.NDArray[np.bool_]) -> None:
        from neuro.events.filters._kernels import supported

        supported(events.t, events.x, events.y, self.dt_us, self._state[0], keep)


@dataclass(frozen=True, eq=False)
class Refractory(Sieve):
    """After an event that passes, a pixel is silent for a while.

    Attributes:
        period_us: time to the next event that can pass, us.
        extend: whether an event that does not pass begins the time anew, as in jAER's RefractoryFilter (which lets
            pass only after more than the period); otherwise it does not, as in a pixel that is held in reset.

    Source: dead time of the pixel, Lichtsteiner et al., IEEE JSSC 43:566, 2008.
    """

    word = "refractory"
    period_us: int = quantity(1000, kind="microseconds", at_least=0)
    extend: bool = False

    def _fresh(self) -> State:
        return (np.full((self.sensor_size[1], self.sensor_size[0]), NEVER, np.int64),)

    def _keep(self, events: Events, keep: npt.NDArray[np.bool_]) -> None:
        from neuro.events.filters._kernels import rested

        rested(events.t, events.x, events.y, self.period_us, self.extend, self._state[0], keep)


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
        from neuro.events.filters._kernels import look_up

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
            raise FilterError(f"hot_pixels: {name} = {value!r}: expected a number > 0")
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


@dataclass(frozen=True, eq=False)
class Polarity(Sieve):
    """Keep ON or OFF events.

    Attributes:
        keep: 1 = ON, 0 = OFF.
    """

    word = "polarity"
    keep: int = quantity(1, kind="integer", at_least=0, at_most=1)

    def _keep(self, events: Events, keep: npt.NDArray[np.bool_]) -> None:
        np.equal(events.p, np.uint8(self.keep), out=keep)


MOST = 1 << 28
"""Noise events that may be asked of one part; they take 6 GB."""


@dataclass(frozen=True, eq=False)
class ShotNoise(Filter):
    """Add events at random times and pixels, ON and OFF alike, from the first event of a recording to its last.

    The noise is a Poisson process; what it does at a time depends on the seed, the sensor, the rate and that time only,
    so a recording that is read from the middle gets the same noise there. It comes before other events of its time.

    Attributes:
        rate_hz: noise events of each pixel, Hz.
        seed: of the noise, not negative.

    Source: shot noise as independent Poisson events per pixel, Hu, Liu, Delbruck, v2e, CVPR Workshops 2021,
        section 3.
    """

    word = "noise"
    rate_hz: float = quantity(0.1, "Hz", above=0)
    seed: int = quantity(0, kind="integer", at_least=0, at_most=2**63 - 1)

    def _fresh(self) -> State:
        return (None,)

    def _part(self, events: Events) -> Events:
        from neuro.events.filters._kernels import merge, sprinkle

        (done,) = self._state
        first = int(events.t[0]) if done is None else done + 1
        last = int(events.t[-1])
        width, height = self.sensor_size
        mean_us = 1e6 / (self.rate_hz * width * height)
        room = self._room(last - first + 1, mean_us)
        t, pixel, p = np.empty(room, np.int64), np.empty(room, np.int64), np.empty(room, np.uint8)
        n = sprinkle(first, last, np.uint64(key(self.seed, "events", "noise")), mean_us, width * height, t, pixel, p)
        out = tuple(np.empty(n + len(events), a.dtype) for a in (events.t, events.x, events.y, events.p))
        merge(t[:n], pixel[:n], p[:n], width, events.t, events.x, events.y, events.p, *out)
        self._hold(last)
        return self._of(events, out)

    def _room(self, span_us: int, mean_us: float) -> int:
        """Room for the noise; 12 standard deviations more than expected do not happen."""
        expected = span_us / mean_us
        if expected > MOST:
            raise FilterError(
                f"ShotNoise: {span_us} us would get {expected:.3g} noise events, expected at most {MOST} in one part; "
                "cut the recording, or look for a jump in its times"
            )
        return int(expected + 12 * sqrt(expected) + 64)
