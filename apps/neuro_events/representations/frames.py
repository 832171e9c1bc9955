"""Representations that count events per pixel, for a recording or for each of its segments."""

from __future__ import annotations

from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro.apps import LazyModule, argument, needed
from neuro_events._events import Events

kernels = LazyModule("neuro_events._kernels")

Polarity = Literal["separate", "signed", "ignored"]
Representation = npt.NDArray[Any] | Any
"""An array, or a torch tensor with ``as_torch=True``."""


def array_or_tensor(array: npt.NDArray[Any], as_torch: bool) -> Representation:
    """Return the array, or with `as_torch` a torch tensor that shares its memory.

    Raises:
        ModelError: torch is not installed.
    """
    if not as_torch:
        return array
    return needed("torch", "torch", "as_torch=True: torch is not installed").from_numpy(array)


def float_type(dtype: npt.DTypeLike) -> np.dtype[Any]:
    """Return the dtype if it is float32 or float64.

    Raises:
        ModelError: another dtype.
    """
    kind = np.dtype(dtype)
    if kind not in (np.dtype(np.float32), np.dtype(np.float64)):
        raise ModelError(f"dtype is {kind}, expected float32 or float64")
    return kind


def span(events: Events, start_us: int | None, stop_us: int | None) -> tuple[int, int]:
    """Return the start and stop time, us: the arguments, or the times of the first and last event.

    Raises:
        ModelError: the stop is before the start.
    """
    first, last = (int(events.t[0]), int(events.t[-1])) if len(events) else (0, 0)
    start = first if start_us is None else argument("start_us", start_us, kind="microseconds")
    stop = max(start, last) if stop_us is None else argument("stop_us", stop_us, kind="microseconds")
    if stop < start:
        raise ModelError(f"stop_us is {stop} us, expected at least {start}, the start")
    return start, stop


def event_frame(
    events: Events,
    *,
    polarity: Polarity = "separate",
    segments: npt.ArrayLike | None = None,
    as_torch: bool = False,
) -> Representation:
    """Count the events of each pixel.

    Args:
        events: the events to count.
        polarity: ``"separate"``, ``"signed"`` (ON minus OFF) or ``"ignored"``.
        segments: (n + 1,) bounds, as from the functions of `neuro.events.segmentation`, or (n, 2) first and end
            (exclusive) index of events, where segments may overlap. The result has one frame per segment.
        as_torch: return a torch tensor.

    Returns:
        int32 ([n,] [2,] height, width): the first axis with `segments`, the second with separate polarities.

    Raises:
        ModelError: an argument is invalid (the message names it), or torch is not installed.
    """
    argument("polarity", polarity, words=("separate", "signed", "ignored"))
    return array_or_tensor(_event_counts(events, polarity, segments), as_torch)


def binary_frame(
    events: Events,
    *,
    polarity: Polarity = "ignored",
    segments: npt.ArrayLike | None = None,
    as_torch: bool = False,
) -> Representation:
    """Mark the pixels with at least one event.

    Args:
        events: the events.
        polarity: ``"separate"`` or ``"ignored"``.
        segments: see `event_frame`.
        as_torch: return a torch tensor.

    Returns:
        bool ([n,] [2,] height, width): the first axis with `segments`, the second with separate polarities.

    Raises:
        ModelError: an argument is invalid (the message names it), or torch is not installed.
    """
    argument("polarity", polarity, words=("separate", "ignored"))
    return array_or_tensor(_event_counts(events, polarity, segments) > 0, as_torch)


def _event_counts(events: Events, polarity: str, segments: npt.ArrayLike | None) -> npt.NDArray[np.int32]:
    """Return the array of `event_frame`."""
    ranges = np.array([[0, len(events)]]) if segments is None else _ranges(segments, len(events))
    width, height = events.sensor_size
    separate = polarity == "separate"
    out = np.zeros((len(ranges), 1 + separate, height, width), np.int32)
    kernels.count(events.x, events.y, events.p, ranges, separate, polarity == "signed", out)
    frames = out if separate else out[:, 0]
    return frames[0] if segments is None else frames


def _ranges(segments: npt.ArrayLike, n: int) -> npt.NDArray[np.int64]:
    """Convert bounds or ranges to (segments, 2): the first event and the end (exclusive) of each segment."""
    bounds: npt.NDArray[Any] = np.asarray(segments)
    are_pairs = bounds.ndim == 2 and bounds.shape[1] == 2
    if bounds.dtype.kind not in "iu" or not (are_pairs or (bounds.ndim == 1 and bounds.size)):
        raise ModelError(
            f"segments is {bounds.dtype} of shape {bounds.shape}, expected whole numbers (n + 1,) or (n, 2)",
            hint="bounds = msd_segments(events.t), or another function of neuro.events.segmentation",
        )
    ranges = (bounds if are_pairs else np.stack([bounds[:-1], bounds[1:]], axis=1)).astype(np.int64)
    is_bad = (ranges[:, 0] < 0) | (ranges[:, 1] < ranges[:, 0]) | (ranges[:, 1] > n)
    if is_bad.any():
        k = int(is_bad.argmax())
        first, last = ranges[k]
        raise ModelError(f"segment {k} is events {first} to before {last}, expected 0 <= first <= last <= {n}")
    return np.ascontiguousarray(ranges)


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
    """Distribute each event over the two nearest time bins by linear interpolation.

    V[b, y, x] is the sum over the pixel's events of s max(0, 1 - |b - t*|), where s is the sign and
    t* = (bins - 1) (t - start) / (stop - start). Bin 0 is at the start and the last bin is at the stop.
    Events at the start and at the stop are counted. The two weights of an event add up to 1. With one bin, or if all
    times are equal, t* = 0.
    Example: with 3 bins from 0 to 100 us, an ON event at 60 us adds 0.8 to bin 1 and 0.2 to bin 2.

    tonic's ``ToVoxelGrid(n)`` puts the stop one bin later and drops the contributions to that bin, which equals
    ``voxel_grid(events, n + 1)[:-1]``.

    Args:
        events: the events.
        bins: number of time bins.
        start_us: time of bin 0, us. None: the first event. Earlier events are dropped.
        stop_us: time of the last bin, us. None: the last event. Later events are dropped.
        polarity: ``"signed"`` as in the paper, ``"separate"`` or ``"ignored"``.
        dtype: float32 or float64.
        as_torch: return a torch tensor.

    Returns:
        ([2,] bins, height, width): the first axis with separate polarities.

    Raises:
        ModelError: an argument is invalid (the message names it), or torch is not installed.

    Source: Zhu et al., Unsupervised event-based learning of optical flow, depth, and egomotion, CVPR 2019, eqs 1-3.
    """
    argument("polarity", polarity, words=("separate", "signed", "ignored"))
    separate = polarity == "separate"
    start, stop = span(events, start_us, stop_us)
    width, height = events.sensor_size
    out = np.zeros((1 + separate, argument("bins", bins, kind="integer", at_least=1), height, width), float_type(dtype))
    kernels.spread(events.t, events.x, events.y, events.p, start, stop, separate, polarity == "signed", False, out)
    return array_or_tensor(out if separate else out[0], as_torch)


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
    """Convolve a measurement of the events with a triangular kernel in time, and sample the result at equal distances.

    S[p, b, y, x] is the sum over the pixel's events of polarity p of f max(0, 1 - |b - t*|), where f is the
    measurement and t* = (bins - 1) (t - start) / (stop - start), as for `voxel_grid`. The kernel is fixed; in the
    paper the triangle is the initial value of a kernel that is learnt.

    Args:
        events: the events.
        bins: number of sampling times; the paper uses 9.
        measurement: ``"time"``, from 0 at the start to 1 at the stop (the paper's best); ``"polarity"``, 1 or -1; or
            ``"count"``, always 1, so that ON minus OFF is the voxel grid.
        start_us: time of bin 0, us. None: the first event. Earlier events are dropped.
        stop_us: time of the last bin, us. None: the last event. Later events are dropped.
        dtype: float32 or float64.
        as_torch: return a torch tensor.

    Returns:
        (2, bins, height, width), 0 = OFF. The authors' program flattens the first two axes to one axis of length
        2 * bins.

    Raises:
        ModelError: an argument is invalid (the message names it), or torch is not installed.

    Source: Gehrig et al., End-to-end learning of representations for asynchronous event-based data, ICCV 2019,
        sections 3.2-3.4; thesis section 3.4.
    """
    argument("measurement", measurement, words=("time", "polarity", "count"))
    start, stop = span(events, start_us, stop_us)
    width, height = events.sensor_size
    out = np.zeros((2, argument("bins", bins, kind="integer", at_least=1), height, width), float_type(dtype))
    signed, timed = measurement == "polarity", measurement == "time"
    kernels.spread(events.t, events.x, events.y, events.p, start, stop, True, signed, timed, out)
    return array_or_tensor(out, as_torch)
