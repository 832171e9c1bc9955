"""Time surfaces, leaky surfaces, and their averages over cells (HATS)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Literal

import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro.apps import LazyModule, argument
from neuro_events._events import Events
from neuro_events.parts import joined_parts
from neuro_events.representations.frames import Representation, array_or_tensor, float_type

kernels = LazyModule("neuro_events._kernels")

Decay = Literal["exponential", "linear"]
PolarityMode = Literal["separate", "ignored"]
NEVER = np.iinfo(np.int64).min
"""Time of the last event for pixels without an event."""


class _Decaying(ABC):
    """Base class of surfaces whose values decay after each event, and that can be read at any later time."""

    def __init__(self, sensor_size: tuple[int, int], tau_us: float, decay: Decay, polarity: PolarityMode) -> None:
        self._tau = argument("tau_us", tau_us, unit="us", above=0, infinite=True)
        self._linear = argument("decay", decay, words=("exponential", "linear")) == "linear"
        self._separate = argument("polarity", polarity, words=("separate", "ignored")) == "separate"
        self._shape = 1 + self._separate, sensor_size[1], sensor_size[0]
        self._newest: int | None = None

    def add(self, events: Events) -> None:
        """Add the next events."""
        if len(events):
            self._add(events)
            self._newest = int(events.t[-1])

    def at(self, t_us: int, dtype: npt.DTypeLike = np.float32) -> npt.NDArray[np.floating]:
        """Return the surface at a time.

        Args:
            t_us: the time, us, not before the newest event.
            dtype: float32 or float64.

        Returns:
            ([2,] height, width), values >= 0. A `TimeSurface` is 1 at a pixel with an event at this time and tends to 0
            for older events.

        Raises:
            ModelError: the time is before the newest event.
        """
        read_time: int = argument("t_us", t_us, kind="microseconds")
        if self._newest is not None and read_time < self._newest:
            raise ModelError(f"at {read_time} us: events up to {self._newest} us are already in the surface")
        out = np.empty(self._shape, float_type(dtype))
        self._read(read_time, out.ravel())
        return out if self._separate else out[0]

    @abstractmethod
    def _add(self, events: Events) -> None:
        """Add events, at least one."""

    @abstractmethod
    def _read(self, read_time: int, out: npt.NDArray[np.floating]) -> None:
        """Write the value of each pixel at a time to `out`."""


def read(
    surface: _Decaying, events: Events, at_us: int | npt.ArrayLike | None, inclusive: bool, dtype: npt.DTypeLike
) -> npt.NDArray[np.floating]:
    """Return the surface at each time, in one pass over the events.

    Args:
        surface: a new surface.
        events: the recording.
        at_us: one time, (n,) times in order, or None for the time of the last event, us.
        inclusive: include events at exactly the time.
        dtype: float32 or float64.

    Returns:
        One surface, or (n, ...) surfaces.

    Raises:
        ModelError: times are not whole or run back, or the dtype is invalid.
    """
    if at_us is None:
        at_us = int(events.t[-1]) if len(events) else 0
    times = np.atleast_1d(np.asarray(at_us))
    if times.ndim != 1 or (times.size and times.dtype.kind not in "iu"):
        raise ModelError(
            f"at_us is {times.dtype} of shape {times.shape}, expected a whole number of us, or (n,) of them"
        )
    if np.any(times[1:] < times[:-1]):
        k = int((times[1:] < times[:-1]).argmax()) + 1
        raise ModelError(f"at_us runs back from {times[k - 1]} to {times[k]} us, expected an order of time")
    times = times.astype(np.int64)
    stops = np.searchsorted(events.t, times, side="right" if inclusive else "left")
    frames, begin = [], 0
    for read_time, stop in zip(times.tolist(), stops.tolist(), strict=True):
        surface.add(events[begin:stop])
        frames.append(surface.at(read_time, dtype))
        begin = stop
    if np.ndim(at_us) == 0:
        return frames[0]
    return np.stack(frames) if frames else np.zeros((0, *surface.at(0).shape), float_type(dtype))


class TimeSurface(_Decaying):
    """Times of the last event of each pixel, readable as a surface at any time, for recordings that come in parts.

    Args:
        sensor_size: width and height, px.
        tau_us: time constant of the decay, us; see `time_surface`.
        decay: ``"exponential"`` or ``"linear"``.
        polarity: ``"separate"`` or ``"ignored"``.

    Raises:
        ModelError: an argument is invalid; the message names it.
    """

    def __init__(
        self,
        sensor_size: tuple[int, int],
        *,
        tau_us: float,
        decay: Decay = "exponential",
        polarity: PolarityMode = "separate",
    ) -> None:
        super().__init__(sensor_size, tau_us, decay, polarity)
        self._last = np.full(self._shape, NEVER)

    def _add(self, events: Events) -> None:
        kernels.mark(events.t, events.x, events.y, events.p, self._separate, self._last)

    def _read(self, read_time: int, out: npt.NDArray[np.floating]) -> None:
        kernels.ages(self._last.ravel(), read_time, self._tau, self._linear, out)


def time_surface(
    events: Events,
    *,
    tau_us: float,
    at_us: int | npt.ArrayLike | None = None,
    decay: Decay = "exponential",
    polarity: PolarityMode = "separate",
    inclusive: bool = True,
    dtype: npt.DTypeLike = np.float32,
    as_torch: bool = False,
) -> Representation:
    """Return the decayed age of each pixel's last event at given times.

    The surface at time T is exp(-(T - t) / tau) or, with linear decay, max(0, 1 - (T - t) / tau), where t is the time
    of the pixel's last event. Pixels without an event are 0.

    tonic's ``ToTimesurface(dt, tau)`` equals this function at the ends of windows of length dt. A window excludes the
    events at exactly its end: ``at_us=events.t[0] + dt * np.arange(1, n + 1), inclusive=False``, with
    n = (last - first time) // dt.

    Args:
        events: the recording.
        tau_us: time constant, us; with linear decay the time after which an event is forgotten.
        at_us: one time, or (n,) times in order, us. None: the time of the last event.
        decay: ``"exponential"`` or ``"linear"``.
        polarity: ``"separate"`` or ``"ignored"``.
        inclusive: include events at exactly the time.
        dtype: float32 or float64.
        as_torch: return a torch tensor.

    Returns:
        ([n,] [2,] height, width), 0 to 1: the first axis with several times, the second with separate polarities.

    Raises:
        ModelError: an argument is invalid (the message names it), or torch is not installed.

    Source: Lagorce et al., HOTS, IEEE TPAMI 39:1346, 2017, eq. 2 (for the neighbourhood of one event); linear decay as
        in thesis appendix C, figure 87.
    """
    surface = TimeSurface(events.sensor_size, tau_us=tau_us, decay=decay, polarity=polarity)
    return array_or_tensor(read(surface, events, at_us, inclusive, dtype), as_torch)


Order = Literal["decay_first", "increment_first"]


class LeakySurface(_Decaying):
    """Leaky pixels, readable as a surface at any time, for recordings that come in parts.

    A pixel's value is decayed only when the pixel has an event or is read. The result is the same as if all pixels
    decayed at every event.

    Args:
        sensor_size: width and height, px.
        tau_us: time constant of the decay, us; see `leaky_surface`.
        decay: ``"exponential"`` or ``"linear"``.
        polarity: ``"separate"`` or ``"ignored"``.
        increment: increase of a pixel per event.
        order: ``"decay_first"`` or ``"increment_first"``; see `leaky_surface`.

    Raises:
        ModelError: an argument is invalid; the message names it.
    """

    def __init__(
        self,
        sensor_size: tuple[int, int],
        *,
        tau_us: float,
        decay: Decay = "exponential",
        polarity: PolarityMode = "separate",
        increment: float = 1.0,
        order: Order = "decay_first",
    ) -> None:
        super().__init__(sensor_size, tau_us, decay, polarity)
        self._increments_first = argument("order", order, words=("decay_first", "increment_first")) == "increment_first"
        self._increment = argument("increment", increment, above=0, infinite=True)
        self._value = np.zeros(self._shape)
        self._since = np.zeros(self._shape, np.int64)

    def _add(self, events: Events) -> None:
        previous = int(events.t[0]) if self._newest is None else self._newest
        options = (self._separate, self._linear, self._increments_first)
        values = (self._tau, self._increment)
        kernels.leak(events.t, events.x, events.y, events.p, previous, options, values, self._value, self._since)

    def _read(self, read_time: int, out: npt.NDArray[np.floating]) -> None:
        kernels.leaked(self._value.ravel(), self._since.ravel(), read_time, self._tau, self._linear, out)


def leaky_surface(
    events: Events,
    *,
    tau_us: float,
    at_us: int | npt.ArrayLike | None = None,
    decay: Decay = "exponential",
    polarity: PolarityMode = "separate",
    increment: float = 1.0,
    order: Order = "decay_first",
    inclusive: bool = True,
    dtype: npt.DTypeLike = np.float32,
    as_torch: bool = False,
) -> Representation:
    """Return the leaky sum of each pixel's events at given times.

    After dt a pixel's value u becomes u exp(-dt / tau) or, with linear decay, max(0, u - dt / tau). The lambda of the
    thesis is 1 / tau.

    Algorithm 15 of the thesis decays *after* the increment, by the time since the event before. A new event is thus
    immediately multiplied by exp(-(t_i - t_(i-1)) / tau), as if it had arrived at the time of the event before. After a
    long silence nothing of the new event remains. ``order="increment_first"`` implements the algorithm to the letter.
    The default decays first, as in the paper on the linear surface, so that a new event counts in full.

    Args:
        events: the recording.
        tau_us: time constant, us; with linear decay the time in which a value of 1 is forgotten.
        at_us: one time, or (n,) times in order, us. None: the time of the last event.
        decay: ``"exponential"`` or ``"linear"``.
        polarity: ``"separate"`` or ``"ignored"``.
        increment: increase of a pixel per event.
        order: ``"decay_first"``, or ``"increment_first"`` as in algorithm 15.
        inclusive: include events at exactly the time.
        dtype: float32 or float64.
        as_torch: return a torch tensor.

    Returns:
        ([n,] [2,] height, width): the first axis with several times, the second with separate polarities.

    Raises:
        ModelError: an argument is invalid (the message names it), or torch is not installed.

    Source: thesis appendix C, algorithm 15 and figure 87 (lines 3374-3403); Cannici et al., Asynchronous convolutional
        networks for object detection in neuromorphic cameras (YOLE), CVPR workshops 2019, section 3.
    """
    surface = LeakySurface(
        events.sensor_size, tau_us=tau_us, decay=decay, polarity=polarity, increment=increment, order=order
    )
    return array_or_tensor(read(surface, events, at_us, inclusive, dtype), as_torch)


Normalise = Literal["cell", "polarity", "none"]


class Hats:
    """Averaged time surfaces, updated event by event in bounded memory, for recordings that come in parts.

    The result does not depend on how the recording is divided into parts, to the bit.

    Args:
        sensor_size: width and height, px.
        cell, radius, window_us, tau_us, itself, normalise: see `hats`.

    Raises:
        ModelError: an argument is invalid; the message names it.
    """

    def __init__(
        self,
        sensor_size: tuple[int, int],
        *,
        cell: int = 10,
        radius: int = 3,
        window_us: int = 100_000,
        tau_us: float = 1e9,
        itself: bool = False,
        normalise: Normalise = "cell",
    ) -> None:
        cell = argument("cell", cell, kind="integer", at_least=1)
        radius = argument("radius", radius, kind="integer", at_least=0)
        window_us = argument("window_us", window_us, kind="microseconds", at_least=1)
        tau_us = argument("tau_us", tau_us, unit="us", above=0, infinite=True)
        self._by = argument("normalise", normalise, words=("cell", "polarity", "none"))
        self._constants = (cell, radius, window_us, tau_us, 1.0 if itself else 0.0)
        width, height = sensor_size
        rows, columns, size = -(-height // cell), -(-width // cell), 2 * radius + 1
        padded = cell + 2 * radius
        self._sums = np.zeros((rows, columns, 2, size, size))
        self._counts = np.zeros((rows, columns, 2), np.int64)
        self._memory = np.zeros((rows, columns, 2, padded, padded))
        self._inside = np.zeros(self._memory.shape, np.int32)
        self._queues = np.full((3, rows, columns, 2), -1, np.int64)  # oldest and newest event, reference time
        self._held: Events | None = None  # events of the window; the queues hold indices into them
        self._following = np.empty(0, np.int64)  # index of the next event in the same cell and polarity, -1: none

    def add(self, events: Events) -> None:
        """Add the next events."""
        if not len(events):
            return
        n_old, all_events = 0, events
        if (previous := self._held) is not None:  # drop events that have left the window
            state = (self._memory, self._inside, self._queues, self._following)
            first = kernels.forget(previous.t, previous.x, previous.y, self._constants, *state)
            self._following = self._following[first:]
            n_old, all_events = len(self._following), joined_parts([previous[first:], events])
        following = np.concatenate([self._following, np.empty(len(events), np.int64)])
        sums = (self._memory, self._inside, self._queues, following, self._sums, self._counts)
        kernels.histograms(all_events._columns, n_old, self._constants, *sums)
        self._held, self._following = all_events, following

    def histograms(self, dtype: npt.DTypeLike = np.float32) -> npt.NDArray[np.floating]:
        """Return the histograms of all events so far, as `hats` does.

        Args:
            dtype: float32 or float64.
        """
        counts = self._counts
        divisors = {"cell": counts.sum(2, keepdims=True), "polarity": counts, "none": np.ones_like(counts)}[self._by]
        out: npt.NDArray[np.floating] = self._sums / np.maximum(divisors, 1)[..., None, None]
        return out.astype(float_type(dtype))


def hats(
    events: Events,
    *,
    cell: int = 10,
    radius: int = 3,
    window_us: int = 100_000,
    tau_us: float = 1e9,
    itself: bool = False,
    normalise: Normalise = "cell",
    dtype: npt.DTypeLike = np.float32,
    as_torch: bool = False,
) -> Representation:
    """Average the time surfaces around events over cells of the sensor.

    The local memory time surface of event i is T_i[dy, dx], the sum of exp(-(t_i - t_j) / tau) over the earlier events
    j, at most `window_us` before, of the same polarity, in the same cell, and at (x_i + dx, y_i + dy). The histogram of
    a cell is, for each polarity, the sum of T_i over the events of the polarity, divided by the number of all events in
    the cell. Events at equal times are processed in their order.

    tonic's ``ToAveragedTimesurface(decay="exp")`` equals this function with ``itself=True, normalise="polarity"``; its
    first axis combines the first two axes here.

    Args:
        events: the recording, or the part to classify.
        cell: side of a cell, px. Cells at the right and lower edges may be smaller.
        radius: radius of the surface around an event, px; rho in the paper.
        window_us: time for which an event counts, us; Delta t in the paper.
        tau_us: time constant, us.
        itself: include the event in its own surface, which adds 1 in the middle.
        normalise: divisor of the sums: ``"cell"``, the number of events in the cell, as in the paper; ``"polarity"``,
            the number of events in the cell with the same polarity; or ``"none"``.
        dtype: float32 or float64.
        as_torch: return a torch tensor.

    Returns:
        (rows, columns, 2, 2 radius + 1, 2 radius + 1), with rows = ceil(height / cell) and columns = ceil(width /
        cell). The last three axes are polarity, dy and dx. 0 for cells without events.

    Raises:
        ModelError: an argument is invalid (the message names it), or torch is not installed.

    Source: Sironi et al., HATS, CVPR 2018, section 4 and algorithm 1; the defaults are the paper's for N-CARS.
    """
    surfaces = Hats(
        events.sensor_size,
        cell=cell,
        radius=radius,
        window_us=window_us,
        tau_us=tau_us,
        itself=itself,
        normalise=normalise,
    )
    surfaces.add(events)
    return array_or_tensor(surfaces.histograms(dtype), as_torch)
