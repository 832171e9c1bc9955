"""The event spike tensor: what events measure, kept apart by polarity, time and place."""

from __future__ import annotations

from typing import Literal

import numpy as np
import numpy.typing as npt

from neuro.events._arguments import choice, whole
from neuro.events._events import Events
from neuro.events.representations._common import Representation, given, real, span

Measurement = Literal["time", "polarity", "count"]


def event_spike_tensor(
    events: Events,
    bins: int = 9,
    *,
    measurement: Measurement = "time",
    start_us: int | None = None,
    stop_us: int | None = None,
    dtype: npt.DTypeLike = np.float32,
    as_torch: bool = False,
) -> Representation:
    """Convolve what events measure with a triangle in time, and read it at regular times.

    S[p, b, y, x] is the sum over the pixel's events of polarity p of f max(0, 1 - |b - t*|), where f is the
    measurement and t* = (bins - 1) (t - start) / (stop - start), as for `voxel_grid`. The kernel is fixed; the paper
    also learns it, starting from this one.

    Args:
        events: what to convolve.
        bins: number of times at which it is read; 9 is the paper's.
        measurement: ``"time"``, from 0 at the start to 1 at the stop (the paper's best); ``"polarity"``, 1 or -1; or
            ``"count"``, always 1, so that ON minus OFF is the voxel grid.
        start_us: where bin 0 is, us; None: at the first event. Events before it are left out.
        stop_us: where the last bin is, us; None: at the last event. Events after it are left out.
        dtype: float32 or float64.
        as_torch: give a torch tensor.

    Returns:
        (2, bins, height, width), 0 = OFF. The authors' program gives its first two axes as one of 2 bins.

    Raises:
        ModelError: an argument is wrong, or torch is missing; the message says which.

    Source: Gehrig et al., End-to-end learning of representations for asynchronous event-based data, ICCV 2019,
        sections 3.2-3.4; thesis section 3.4.
    """
    from neuro.events.representations._spread_kernel import spread

    choice("measurement", measurement, ("time", "polarity", "count"))
    start, stop = span(events, start_us, stop_us)
    width, height = events.sensor_size
    out = np.zeros((2, whole("bins", bins), height, width), real(dtype))
    signed, timed = measurement == "polarity", measurement == "time"
    spread(events.t, events.x, events.y, events.p, start, stop, True, signed, timed, out)
    return given(out, as_torch)
