"""How long ago events were: time surfaces, leaky surfaces, and their averages over cells (HATS)."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Literal

import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro.apps import LazyModule, argument
from neuro_events._events import Events
from neuro_events.parts import together
from neuro_events.representations.frames import Representation, given, real

kernels = LazyModule("neuro_events._kernels")

Decay = Literal["exponential", "linear"]
Which = Literal["separate", "ignored"]
NEVER = np.iinfo(np.int64).min
"""The time of a pixel's last event before it had one."""


class _Decaying(ABC):
    """A surface that events decay on, and that can be read at any time after them."""

    def __init__(self, sensor_size: tuple[int, int], tau_us: float, decay: Decay, polarity: Which) -> None:
        self._tau = argument("tau_us", tau_us, unit="us", above=0, infinite=True)
        self._linear = argument("decay", decay, words=("exponential", "linear")) == "linear"
        self._separate = argument("polarity", polarity, words=("separate", "ignored")) == "separate"
        self._shape = 1 + self._separate, sensor_size[1], sensor_size[0]
        self._newest: int | None = None

    def add(self, events: Events) -> None:
        """Take in the next events."""
        if len(events):
            self._add(events)
            self._newest = int(events.t[-1])

    def at(self, t_us: int, dtype: npt.DTypeLike = np.float32) -> npt.NDArray[np.floating]:
        """Return the surface at a time.

        Args:
            t_us: when, us; not before the newest event.
            dtype: float32 or float64.

        Returns:
            ([2,] height, width), 0 or more; of a `TimeSurface` 1 where an event is just now, towards 0 where it was
            long ago.

        Raises:
            ModelError: the time is before the newest event.
        """
        when: int = argument("t_us", t_us, kind="microseconds")
        if self._newest is not None and when < self._newest:
            raise ModelError(f"at {when} us: events up to {self._newest} us are already in the surface")
        out = np.empty(self._shape, real(dtype))
        self._read(when, out.ravel())
        return out if self._separate else out[0]

    @abstractmethod
    def _add(self, events: Events) -> None:
        """Take in events, at least one."""

    @abstractmethod
    def _read(self, when: int, out: npt.NDArray[np.floating]) -> None:
        """Fill in the value of each pixel at a time."""


def read(
    surface: _Decaying, events: Events, at_us: int | npt.ArrayLike | None, inclusive: bool, dtype: npt.DTypeLike
) -> npt.NDArray[np.floating]:
    """Return the surface at each time, in one pass over the events.

    Args:
        surface: a fresh one.
        events: the recording.
        at_us: one time, (n,) times, or None for the last event's.
        inclusive: whether events at the very time count.
        dtype: float32 or float64.

    Returns:
        one surface, or (n, ...) of them.

    Raises:
        ModelError: times are not whole or run back, or the type is wrong.
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
    for when, stop in zip(times.tolist(), stops.tolist(), strict=True):
        surface.add(events[begin:stop])
        frames.append(surface.at(when, dtype))
        begin = stop
    if np.ndim(at_us) == 0:
        return frames[0]
    return np.stack(frames) if frames else np.zeros((0, *surface.at(0).shape), real(dtype))


class TimeSurface(_Decaying):
    """The times of the last events, read as a surface whenever wanted; for recordings that come in parts.

    Args:
        sensor_size: width and height, px.
        tau_us: how fast events are forgotten, us; see `time_surface`.
        decay: ``"exponential"`` or ``"linear"``.
        polarity: ``"separate"`` or ``"ignored"``.

    Raises:
        ModelError: an argument is wrong; the message says which.
    """

    def __init__(
        self, sensor_size: tuple[int, int], *, tau_us: float, decay: Decay = "exponential", polarity: Which = "separate"
    ) -> None:
        super().__init__(sensor_size, tau_us, decay, polarity)
        self._last = np.full(self._shape, NEVER)

    def _add(self, events: Events) -> None:
        kernels.mark(events.t, events.x, events.y, events.p, self._separate, self._last)

    def _read(self, when: int, out: npt.NDArray[np.floating]) -> None:
        kernels.ages(self._last.ravel(), when, self._tau, self._linear, out)


def time_surface(
    events: Events,
    *,
    tau_us: float,
    at_us: int | npt.ArrayLike | None = None,
    decay: Decay = "exponential",
    polarity: Which = "separate",
    inclusive: bool = True,
    dtype: npt.DTypeLike = np.float32,
    as_torch: bool = False,
) -> Representation:
    """How long ago each pixel had its last event, at given times.

    The surface at time T is exp(-(T - t) / tau) or, with linear decay, max(0, 1 - (T - t) / tau), where t is the time
    of the pixel's last event; 0 where there was none.

    tonic's ``ToTimesurface(dt, tau)`` is this at the ends of windows of dt, which do not hold the events at their very
    ends: ``at_us=events.t[0] + dt * np.arange(1, n + 1), inclusive=False``, with n = (last - first time) // dt.

    Args:
        events: the recording.
        tau_us: time constant, or with linear decay the time after which an event is forgotten, us.
        at_us: when, us: one time, or (n,) in order; None: at the last event.
        decay: ``"exponential"`` or ``"linear"``.
        polarity: ``"separate"`` or ``"ignored"``.
        inclusive: whether events at the very time count.
        dtype: float32 or float64.
        as_torch: give a torch tensor.

    Returns:
        ([n,] [2,] height, width), 0 to 1: the first axis with several times, the second with separate polarities.

    Raises:
        ModelError: an argument is wrong, or torch is missing; the message says which.

    Source: Lagorce et al., HOTS, IEEE TPAMI 39:1346, 2017, eq. 2 (there of the neighbourhood of one event); linear
        decay as in thesis appendix C, figure 87.
    """
    surface = TimeSurface(events.sensor_size, tau_us=tau_us, decay=decay, polarity=polarity)
    return given(read(surface, events, at_us, inclusive, dtype), as_torch)


Order = Literal["decay_first", "increment_first"]


class LeakySurface(_Decaying):
    """Leaky pixels, read as a surface whenever wanted; for recordings that come in parts.

    Each pixel is caught up when it has an event or is read, which is the same as decaying all at every event.

    Args:
        sensor_size: width and height, px.
        tau_us: how fast events are forgotten, us; see `leaky_surface`.
        decay: ``"exponential"`` or ``"linear"``.
        polarity: ``"separate"`` or ``"ignored"``.
        increment: what an event adds.
        order: ``"decay_first"`` or ``"increment_first"``; see `leaky_surface`.

    Raises:
        ModelError: an argument is wrong; the message says which.
    """

    def __init__(
        self,
        sensor_size: tuple[int, int],
        *,
        tau_us: float,
        decay: Decay = "exponential",
        polarity: Which = "separate",
        increment: float = 1.0,
        order: Order = "decay_first",
    ) -> None:
        super().__init__(sensor_size, tau_us, decay, polarity)
        self._late = argument("order", order, words=("decay_first", "increment_first")) == "increment_first"
        self._increment = argument("increment", increment, above=0, infinite=True)
        self._value = np.zeros(self._shape)
        self._since = np.zeros(self._shape, np.int64)

    def _add(self, events: Events) -> None:
        before = int(events.t[0]) if self._newest is None else self._newest
        options = (self._separate, self._linear, self._late)
        values = (self._tau, self._increment)
        kernels.leak(events.t, events.x, events.y, events.p, before, options, values, self._value, self._since)

    def _read(self, when: int, out: npt.NDArray[np.floating]) -> None:
        kernels.leaked(self._value.ravel(), self._since.ravel(), when, self._tau, self._linear, out)


def leaky_surface(
    events: Events,
    *,
    tau_us: float,
    at_us: int | npt.ArrayLike | None = None,
    decay: Decay = "exponential",
    polarity: Which = "separate",
    increment: float = 1.0,
    order: Order = "decay_first",
    inclusive: bool = True,
    dtype: npt.DTypeLike = np.float32,
    as_torch: bool = False,
) -> Representation:
    """Add up the events of each pixel, all of which leak, at given times.

    A pixel's value u becomes u exp(-dt / tau) or, with linear decay, max(0, u - dt / tau) after dt, so that lambda of
    the thesis is 1 / tau.

    Algorithm 15 of the thesis decays *after* the increment, by the time since the event before: an event has lost
    exp(-(t_i - t_(i-1)) / tau) the moment that it arrives, or all of itself if the sensor was silent for long, as if
    it had come with the event before it. ``order="increment_first"`` does so to the letter; the default decays first,
    as the linear surface's own paper does, so that an event that has just come counts in full.

    Args:
        events: the recording.
        tau_us: time constant, or with linear decay the time in which a value of 1 is forgotten, us.
        at_us: when, us: one time, or (n,) in order; None: at the last event.
        decay: ``"exponential"`` or ``"linear"``.
        polarity: ``"separate"`` or ``"ignored"``.
        increment: what an event adds.
        order: ``"decay_first"``, or ``"increment_first"`` as algorithm 15 is printed.
        inclusive: whether events at the very time count.
        dtype: float32 or float64.
        as_torch: give a torch tensor.

    Returns:
        ([n,] [2,] height, width): the first axis with several times, the second with separate polarities.

    Raises:
        ModelError: an argument is wrong, or torch is missing; the message says which.

    Source: thesis appendix C, algorithm 15 and figure 87 (lines 3374-3403); Cannici et al., Asynchronous convolutional
        networks for object detection in neuromorphic cameras (YOLE), CVPR workshops 2019, section 3.
    """
    surface = LeakySurface(
        events.sensor_size, tau_us=tau_us, decay=decay, polarity=polarity, increment=increment, order=order
    )
    return given(read(surface, events, at_us, inclusive, dtype), as_torch)


Normalise = Literal["cell", "polarity", "none"]


class Hats:
    """Averaged time surfaces that grow event by event, in bounded memory; for recordings that come in parts.

    Parts, cut anywhere, give to the bit what the whole gives.

    Args:
        sensor_size: width and height, px.
        cell, radius, window_us, tau_us, itself, normalise: see `hats`.

    Raises:
        ModelError: an argument is wrong; the message says which.
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
        self._held: Events | None = None  # those of the window, whose numbers the queues tell
        self._following = np.empty(0, np.int64)

    def add(self, events: Events) -> None:
        """Take in the next events."""
        if not len(events):
            return
        old, seen = 0, events
        if (held := self._held) is not None:  # drop what has left the window
            state = (self._memory, self._inside, self._queues, self._following)
            first = kernels.forget(held.t, held.x, held.y, self._constants, *state)
            self._following = self._following[first:]
            old, seen = len(self._following), together([held[first:], events])
        following = np.concatenate([self._following, np.empty(len(events), np.int64)])
        sums = (self._memory, self._inside, self._queues, following, self._sums, self._counts)
        kernels.histograms(seen._columns, old, self._constants, *sums)
        self._held, self._following = seen, following

    def histograms(self, dtype: npt.DTypeLike = np.float32) -> npt.NDArray[np.floating]:
        """What `hats` gives of all events so far.

        Args:
            dtype: float32 or float64.
        """
        counts = self._counts
        by = {"cell": counts.sum(2, keepdims=True), "polarity": counts, "none": np.ones_like(counts)}[self._by]
        out: npt.NDArray[np.floating] = self._sums / np.maximum(by, 1)[..., None, None]
        return out.astype(real(dtype))


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
    """Average the surroundings of events over cells of the sensor.

    The local memory time surface of event i is T_i[dy, dx], the sum of exp(-(t_i - t_j) / tau) over the events j that
    came before it, at most `window_us` ago, with its polarity, in its cell, and at (x_i + dx, y_i + dy). A cell's
    histogram is the sum of T_i over its events, by polarity, divided by the number of its events.
    Events of one time count as having come in their order.

    tonic's ``ToAveragedTimesurface(decay="exp")`` is this with ``itself=True, normalise="polarity"``, its first axis
    being our first two.

    Args:
        events: the recording, or the part of one that is to be classified.
        cell: side of a cell, px; cells at the right and at the bottom may be smaller.
        radius: of the surroundings, px; rho of the paper.
        window_us: how long an event is remembered, us; the paper's Delta t.
        tau_us: time constant, us.
        itself: whether an event is part of its own surroundings, which adds 1 in the middle.
        normalise: by the events of the ``"cell"`` as in the paper, of the cell and ``"polarity"``, or ``"none"``.
        dtype: float32 or float64.
        as_torch: give a torch tensor.

    Returns:
        (rows, columns, 2, 2 radius + 1, 2 radius + 1), rows = ceil(height / cell) and columns likewise; the last axes
        are polarity, dy and dx. 0 for a cell without events.

    Raises:
        ModelError: an argument is wrong, or torch is missing; the message says which.

    Source: Sironi et al., HATS, CVPR 2018, section 4 and algorithm 1; the defaults are theirs for N-CARS.
    """
    grown = Hats(
        events.sensor_size,
        cell=cell,
        radius=radius,
        window_us=window_us,
        tau_us=tau_us,
        itself=itself,
        normalise=normalise,
    )
    grown.add(events)
    return given(grown.histograms(dtype), as_torch)
