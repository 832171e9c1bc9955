"""How long ago each pixel had its last event."""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt

from neuro.core.errors import ModelError
from neuro.events._arguments import choice, moment, positive
from neuro.events._events import Events
from neuro.events.representations._common import Representation, given, real
from neuro.events.representations._surfaces import read

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
        self._tau = positive("tau_us", tau_us, "us")
        self._linear = choice("decay", decay, ("exponential", "linear")) == "linear"
        self._separate = choice("polarity", polarity, ("separate", "ignored")) == "separate"
        self._last = np.full((1 + self._separate, height, width), NEVER)
        self._newest: int | None = None

    def add(self, events: Events) -> None:
        """Take in the next events."""
        from neuro.events.representations._surface_kernel import mark

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
        from neuro.events.representations._surface_kernel import ages

        when = moment("t_us", t_us)
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
