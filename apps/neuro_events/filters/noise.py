"""Filters that remove noise (isolated events, hot pixels, refractory periods, one polarity) or add shot noise."""

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
    """Keep events with a recent event in one of the 8 neighbouring pixels.

    An event of the same pixel does not count. A dropped event still counts for later events of its neighbours.

    Attributes:
        dt_us: longest time since the neighbour's event, us, inclusive.

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
    """Drop events of a pixel during a refractory period after an event that passed.

    Attributes:
        period_us: shortest time between events that pass, us.
        extend: restart the period at a dropped event too, as jAER's RefractoryFilter does. (In jAER an event exactly
            one period later is still dropped.) False: a dropped event has no effect, as in a pixel held in reset.

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
    """Drop all events of given pixels.

    Attributes:
        pixels: (n, 2) columns and rows, a list or the result of `hot_pixels`.
    """

    word = "hot"
    units = {"pixels": "px"}
    pixels: npt.ArrayLike = ()

    def _check(self) -> None:
        pixels = np.asarray(self.pixels)
        shaped = pixels.size == 0 or (pixels.ndim == 2 and pixels.shape[1] == 2 and pixels.dtype.kind in "iu")
        self._expect(shaped, "pixels", self.pixels, "pairs of column and row, whole numbers")
        positions = pixels.reshape(-1, 2).astype(np.int64)
        width, height = self.sensor_size
        for x, y in positions[((positions < 0) | (positions >= self.sensor_size)).any(1)][:1]:
            raise FilterError(f"{self._name}: pixel ({x}, {y}), expected one of the {width}x{height} sensor")
        object.__setattr__(self, "pixels", positions)

    def _fresh(self) -> State:
        is_good = np.ones((self.sensor_size[1], self.sensor_size[0]), np.bool_)
        x, y = np.asarray(self.pixels).T
        is_good[y, x] = False
        return (is_good,)

    def _keep(self, events: Events, keep: npt.NDArray[np.bool_]) -> None:
        kernels.look_up(events.x, events.y, self._state[0], keep)


def hot_pixels(
    events: Events | Iterable[Events], *, above_hz: float | None = None, times: float = 10.0
) -> npt.NDArray[np.int64]:
    """Find the pixels with too many events.

    Args:
        events: a recording or its parts.
        above_hz: highest rate of a normal pixel, events/s, from the first to the last event of the recording.
        times: without `above_hz`, a pixel is hot if it has more than `times` the events of the busiest of its
            8 neighbours. If all neighbours are silent, a hot pixel has more than `times` events. The edge of an object
            passes over neighbours too, while a defect affects one pixel. The default of 10 is this library's choice.

    Returns:
        (n, 2) columns and rows, ordered by row.

    Raises:
        FilterError: a limit is not positive, parts have different sensors, or `above_hz` is given and the recording
            has no duration.
    """
    for name, value in (("above_hz", above_hz), ("times", times)):
        if value is not None and not 0 < value < np.inf:
            raise FilterError(f"hot_pixels: {name} = {value!r}: expected a number > 0")
    counts, span_us = _counts_and_span([events] if isinstance(events, Events) else events)
    if above_hz is None:
        hot = busier_than_neighbours(counts, times)
    else:
        if not span_us and counts.any():
            raise FilterError("hot_pixels: all events have one time, expected a recording with a duration for above_hz")
        hot = counts * 1e6 > above_hz * span_us
    return np.argwhere(hot)[:, ::-1]


def busier_than_neighbours(counts: npt.NDArray[np.int64], times: float = 10.0) -> npt.NDArray[np.bool_]:
    """Return the pixels with more than `times` the events of the busiest of their 8 neighbours (at least 1).

    Args:
        counts: (height, width) events of each pixel.
        times: see `hot_pixels`.

    Returns:
        (height, width) True for hot pixels.
    """
    rows, columns = counts.shape
    padded = np.pad(counts, 1)
    busiest = np.ones_like(counts)
    for i, j in ((i, j) for i in range(3) for j in range(3) if (i, j) != (1, 1)):
        np.maximum(busiest, padded[i : i + rows, j : j + columns], out=busiest)
    hot: npt.NDArray[np.bool_] = counts > times * busiest
    return hot


def _counts_and_span(parts: Iterable[Events]) -> tuple[npt.NDArray[np.int64], int]:
    """Return the number of events of each pixel (height, width), and the time from the first to the last event, us."""
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
"""Largest number of noise events in one part; their arrays have 6 GB."""


@dataclass(frozen=True, eq=False)
class ShotNoise(Filter):
    """Add random events, ON and OFF equally likely, between the first and the last event of a recording.

    The noise is a Poisson process. The noise at a time depends only on the seed, the sensor, the rate and that time, so
    a recording that is read from the middle gets the same noise. At equal times, noise precedes the recorded events.

    Attributes:
        rate_hz: rate of noise events per pixel, Hz.
        seed: seed of the noise, not negative.

    Source: shot noise as independent Poisson events per pixel, Hu, Liu, Delbruck, v2e, CVPR Workshops 2021,
        section 3.
    """

    word = "noise"
    rate_hz: float = quantity(0.1, "Hz", above=0)
    seed: int = quantity(0, kind="integer", at_least=0, at_most=2**63 - 1)

    def _fresh(self) -> State:
        return (None,)

    def _part(self, events: Events) -> Events:
        (last_us,) = self._state
        first = int(events.t[0]) if last_us is None else last_us + 1
        last = int(events.t[-1])
        width, height = self.sensor_size
        mean_us = 1e6 / (self.rate_hz * width * height)
        capacity = self._capacity(last - first + 1, mean_us)
        t, pixel, p = np.empty(capacity, np.int64), np.empty(capacity, np.int64), np.empty(capacity, np.uint8)
        word = np.uint64(key(self.seed, "events", "noise"))
        n = kernels.sprinkle(first, last, word, mean_us, width * height, t, pixel, p)
        out = empty_columns(n + len(events))
        kernels.merge(t[:n], pixel[:n], p[:n], width, events._columns, out)
        self._hold(last)
        return self._of(events, out)

    def _capacity(self, span_us: int, mean_us: float) -> int:
        """Return the size of the noise arrays, which no draw exceeds: the mean number and 12 standard deviations."""
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

    Every event adds 1 to a mask in the square of side ``2 radius + 1`` around the event's pixel. Events of both
    polarities count, and also events that do not pass. The mask decays exponentially. An event passes if the mask at
    its pixel, including the event's own 1, exceeds `theta`. The decay of a mask value is computed at the next update of
    the value.

    Attributes:
        tau: decay time constant, s.
        theta: threshold of the mask, exclusive, events. Below 1 every event passes.
        radius: R of the neighbourhood, px.
        first: number of events at the start of a recording that pass regardless of the mask, since the mask starts
            empty (B.3: about 10).

    Source: thesis appendix B, algorithm 14, lines 3278-3310; B.3 for `first`. In the text an event passes at exactly
        `theta`, in the algorithm it does not; this class follows the algorithm. Defaults: for N-MNIST, figure 85.
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
        mask, last_update, n_events = self._state
        if not n_events[0]:
            last_update.fill(events.t[0])
        kernels.tar(events.t, events.x, events.y, 1e6 * self.tau, self.theta, self.radius, mask, last_update, keep)
        keep[: max(0, self.first - int(n_events[0]))] = True
        n_events[0] += len(events)


@dataclass(frozen=True, eq=False)
class TARSurfaces(Sieve):
    """Filter as `TAR` does, and sum the time surfaces around the events that pass, as HATS does.

    HATS stores the last events of each cell to sum their decayed influence on a new event. Here one leaky value per
    pixel and polarity holds that sum, and no event is stored. The surface of an event consists of the values of its
    neighbours of the same polarity in the same cell just before the event. The sum of all neighbours' values, plus 1,
    is TAR's mask: the surface of the event is added to the histograms if the mask exceeds `theta`. With ``theta`` below
    1 every surface is added, and the result is HATS with an infinite memory.

    Attributes:
        tau: decay time constant, s.
        theta: threshold of the activity, exclusive, events.
        radius: R of the neighbourhood, px.
        cell: side of the square cells that share a histogram, px. Cells at the right and lower edges may be incomplete.

    Source: thesis B.4, line 3356, which states only the idea; that the mask is the sum of the surface follows from
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
        origin, values, counts, sums = self._state
        if origin[0] == NEVER:
            origin[0] = events.t[0]
        constants = (1e6 * self.tau, self.theta, self.radius, self.cell)
        kernels.surfaces(events._columns, *constants, origin, values, counts, sums, keep)

    def histograms(self) -> npt.NDArray[np.float64]:
        """Return the averaged surfaces so far. Call before `finish`, which resets them.

        Returns:
            (rows, columns, 2, 2 radius + 1, 2 radius + 1): for each cell, the sums of the surfaces of OFF and of ON
            events that passed. Both sums are divided by the number of all events that passed in the cell. The last axes
            are rows and columns relative to the event. Cells in which no event passed have 0.
        """
        _, _, counts, sums = self._state
        averages: npt.NDArray[np.float64] = sums / np.maximum(counts, 1)[:, :, None, None, None]
        return averages
