"""How long ago each pixel had its last event."""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt

from neuro.core.checks import argument
from neuro.core.errors import ModelError
from neuro.events._events import Events
from neuro.events.representations._common import Representation, given, read, real

Decay = Literal["exponential", "linear"]
Which = Literal["separate", "ignored"]
NEVER = np.iinfo(np.int64).min
"""The time of a pixel's last event before it had one."""


class TimeSurface:
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
        width, height = sensor_size
        self._tau = argument("tau_us", tau_us, unit="us", above=0, infinite=True)
        self._linear = argument("decay", decay, words=("exponential", "linear")) == "linear"
        self._separate = argument("polarity", polarity, words=("separate", "ignored")) == "separate"
        self._last = np.full((1 + self._separate, height, width), NEVER)
        self._newest: int | None = None

    def add(self, events: Events) -> None:
        """Take in the next events."""
        from neuro.events.representations._kernels import mark

        if len(events):
            mark(events.t, events.x, events.y, events.p, self._separate, self._last)
            self._newest = int(events.t[-1])

    def at(self, t_us: int, dtype: npt.DTypeLike = np.float32) -> npt.NDArray[np.floating]:
        """The surface at a time.

        Args:
            t_us: when, us; not before the newest event.
            dtype: float32 or float64.

        Returns:
            ([2,] height, width): 1 where an event is just now, towards 0 where it was long ago.

        Raises:
            ModelError: the time is before the newest event.
        """
        from neuro.events.representations._kernels import ages

        when = argument("t_us", t_us, kind="microseconds")
        if self._newest is not None and when < self._newest:
            raise ModelError(f"at {when} us: events up to {self._newest} us are already in the surface")
        out = np.empty(self._last.shape, real(dtype))
        ages(self._last.ravel(), when, self._tau, self._linear, out.ravel())
        return out if self._separate else out[0]


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


class LeakySurface:
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
        width, height = sensor_size
        self._tau = argument("tau_us", tau_us, unit="us", above=0, infinite=True)
        self._linear = argument("decay", decay, words=("exponential", "linear")) == "linear"
        self._separate = argument("polarity", polarity, words=("separate", "ignored")) == "separate"
        self._late = argument("order", order, words=("decay_first", "increment_first")) == "increment_first"
        self._increment = argument("increment", increment, above=0, infinite=True)
        self._value = np.zeros((1 + self._separate, height, width))
        self._since = np.zeros(self._value.shape, np.int64)
        self._newest: int | None = None

    def add(self, events: Events) -> None:
        """Take in the next events."""
        from neuro.events.representations._kernels import leak

        if not len(events):
            return
        before = int(events.t[0]) if self._newest is None else self._newest
        options = (self._separate, self._linear, self._late)
        values = (self._tau, self._increment)
        leak(events.t, events.x, events.y, events.p, before, options, values, self._value, self._since)
        self._newest = int(events.t[-1])

    def at(self, t_us: int, dtype: npt.DTypeLike = np.float32) -> npt.NDArray[np.floating]:
        """The surface at a time.

        Args:
            t_us: when, us; not before the newest event.
            dtype: float32 or float64.

        Returns:
            ([2,] height, width), 0 or more.

        Raises:
            ModelError: the time is before the newest event.
        """
        from neuro.events.representations._kernels import leaked

        when = argument("t_us", t_us, kind="microseconds")
        if self._newest is not None and when < self._newest:
            raise ModelError(f"at {when} us: events up to {self._newest} us are already in the surface")
        out = np.empty(self._value.shape, real(dtype))
        leaked(self._value.ravel(), self._since.ravel(), when, self._tau, self._linear, out.ravel())
        return out if self._separate else out[0]


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
