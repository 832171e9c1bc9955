"""Filters of noise: events of single pixels, of quiet regions and of one polarity out, shot noise in."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from math import sqrt

import numpy as np
import numpy.typing as npt

from neuro.apps import LazyModule, key
from neuro.extend import quantity
from neuro_events._events import Events, empty_columns
from neuro_events.filters._filter import NEVER, Filter, FilterError, Sieve, State

kernels = LazyModule("neuro_events._kernels")


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
        kernels.supported(events.t, events.x, events.y, self.dt_us, self._state[0], keep)


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
        kernels.rested(events.t, events.x, events.y, self.period_us, self.extend, self._state[0], keep)


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
        kernels.look_up(events.x, events.y, self._state[0], keep)


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
        (done,) = self._state
        first = int(events.t[0]) if done is None else done + 1
        last = int(events.t[-1])
        width, height = self.sensor_size
        mean_us = 1e6 / (self.rate_hz * width * height)
        room = self._room(last - first + 1, mean_us)
        t, pixel, p = np.empty(room, np.int64), np.empty(room, np.int64), np.empty(room, np.uint8)
        word = np.uint64(key(self.seed, "events", "noise"))
        n = kernels.sprinkle(first, last, word, mean_us, width * height, t, pixel, p)
        out = empty_columns(n + len(events))
        kernels.merge(t[:n], pixel[:n], p[:n], width, events._columns, out)
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


@dataclass(frozen=True, eq=False)
class TAR(Sieve):
    """Keep events in temporal active regions.

    Every event, whether it passes or not and of either polarity, adds 1 to a mask in the square of side
    ``2 radius + 1`` round its pixel; the mask decays exponentially. The event passes if the mask at its pixel, its own
    1 included, is then above `theta`. A mask value is decayed when it is next touched, by the time since the last.

    Attributes:
        tau: decay time constant, s.
        theta: the mask value that must be exceeded, events; below 1 everything passes.
        radius: R of the neighbourhood, px.
        first: so many events of a recording pass whatever the mask, against the cold start (B.3: about 10).

    Source: thesis appendix B, algorithm 14, lines 3278-3310; B.3 for `first`. The text lets an event pass at exactly
        `theta`, the algorithm does not; the algorithm is followed. Defaults: those for N-MNIST, figure 85.
    """

    word = "tar"
    tau: float = quantity(0.08, "s", above=0)
    theta: float = quantity(2.4, "events", above=0)
    radius: int = quantity(1, "px", kind="integer", at_least=0)
    first: int = quantity(0, "events", kind="integer", at_least=0)

    def _fresh(self) -> State:
        shape = (self.sensor_size[1] + 2 * self.radius, self.sensor_size[0] + 2 * self.radius)
        return np.zeros(shape), np.zeros(shape, np.int64), np.zeros(1, np.int64)

    def _keep(self, events: Events, keep: npt.NDArray[np.bool_]) -> None:
        mask, touched, seen = self._state
        if not seen[0]:
            touched.fill(events.t[0])
        kernels.tar(events.t, events.x, events.y, 1e6 * self.tau, self.theta, self.radius, mask, touched, keep)
        keep[: max(0, self.first - int(seen[0]))] = True
        seen[0] += len(events)


@dataclass(frozen=True, eq=False)
class TARSurfaces(Sieve):
    """Filter as `TAR` does and sum up the surfaces round the events that pass, as HATS does.

    HATS keeps the last events of each cell in memory to sum their decayed influence on a new one. Here one leaky value
    per pixel and polarity holds that sum, and no event is stored. The surface of an event is what its neighbours of
    the same polarity in the same cell hold just before it; the sum of what all neighbours hold, plus 1, is TAR's mask
    and decides whether the event counts. With ``theta`` below 1 this is HATS with an endless memory.

    Attributes:
        tau: decay time constant, s.
        theta: activity that must be exceeded, events.
        radius: R of the neighbourhood, px.
        cell: side of the square cells that share a histogram, px; those at the right and lower edge may be cut.

    Source: thesis B.4, line 3356, which tells the idea only; that the mask is the sum of the surface follows from
        algorithm 14. HATS: Sironi et al., CVPR 2018, eqs 5-7. Defaults: tau, theta and radius as `TAR`; cell of 10 px
        as HATS on N-CARS.
    """

    word = "tar_surfaces"
    tau: float = quantity(0.08, "s", above=0)
    theta: float = quantity(2.4, "events", above=0)
    radius: int = quantity(1, "px", kind="integer", at_least=0)
    cell: int = quantity(10, "px", kind="integer", at_least=1)

    def _fresh(self) -> State:
        (width, height), r, side = self.sensor_size, self.radius, 2 * self.radius + 1
        pixels = (height + 2 * r, width + 2 * r, 2)
        cells = (-(-height // self.cell), -(-width // self.cell))
        counts, sums = np.zeros(cells, np.int64), np.zeros((*cells, 2, side, side))
        return np.full(1, NEVER, np.int64), np.zeros(pixels), counts, sums

    def _keep(self, events: Events, keep: npt.NDArray[np.bool_]) -> None:
        origin, held, counts, sums = self._state
        if origin[0] == NEVER:
            origin[0] = events.t[0]
        constants = (1e6 * self.tau, self.theta, self.radius, self.cell)
        kernels.surfaces(events._columns, *constants, origin, held, counts, sums, keep)

    def histograms(self) -> npt.NDArray[np.float64]:
        """The averaged surfaces so far; ask before `finish`.

        Returns:
            (rows, columns, 2, 2 radius + 1, 2 radius + 1): of each cell, for OFF and ON, the sum of the surfaces of
            its events that passed, by rows and columns from the event, over the number of these events of either
            polarity; 0 where there was none.
        """
        _, _, counts, sums = self._state
        averages: npt.NDArray[np.float64] = sums / np.maximum(counts, 1)[:, :, None, None, None]
        return averages
