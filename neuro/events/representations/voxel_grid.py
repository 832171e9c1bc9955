"""Events spread over place and time."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from neuro.events._arguments import choice, whole
from neuro.events._events import Events
from neuro.events.representations._common import Polarity, Representation, given, real, span


def voxel_grid(
    events: Events,
    bins: int,
    *,
    start_us: int | None = None,
    stop_us: int | None = None,
    polarity: Polarity = "signed",
    dtype: npt.DTypeLike = np.float32,
    as_torch: bool = False,
) -> Representation:
    """Spread each event over the two bins that are next in time, the nearer one getting more.

    V[b, y, x] is the sum over the pixel's events of s max(0, 1 - |b - t*|), where s is the sign and
    t* = (bins - 1) (t - start) / (stop - start). So bin 0 is at the start and the last bin is at the stop, both
    included, and no part of an event between them is lost. With one bin, or where all times are equal, t* = 0.

    tonic's ``ToVoxelGrid(n)`` puts the stop one bin later and leaves out what falls there: it equals
    ``voxel_grid(events, n + 1)[:-1]``.

    Args:
        events: what to spread.
        bins: number of them.
        start_us: where bin 0 is, us; None: at the first event. Events before it are left out.
        stop_us: where the last bin is, us; None: at the last event. Events after it are left out.
        polarity: ``"signed"`` as in the paper, ``"separate"`` or ``"ignored"``.
        dtype: float32 or float64.
        as_torch: give a torch tensor.

    Returns:
        ([2,] bins, height, width): the first axis with separate polarities.

    Raises:
        ModelError: an argument is wrong, or torch is missing; the message says which.

    Source: Zhu et al., Unsupervised event-based learning of optical flow, depth, and egomotion, CVPR 2019, eqs 1-3.
    """
    from neuro.events.representations._spread_kernel import spread

    choice("polarity", polarity, ("separate", "signed", "ignored"))
    separate = polarity == "separate"
    start, stop = span(events, start_us, stop_us)
    width, height = events.sensor_size
    out = np.zeros((1 + separate, whole("bins", bins), height, width), real(dtype))
    spread(events.t, events.x, events.y, events.p, start, stop, separate, polarity == "signed", False, out)
    return given(out if separate else out[0], as_torch)
