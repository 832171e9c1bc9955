"""Events counted per pixel, of a whole recording or of each of its segments."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from neuro.core.errors import ModelError
from neuro.events._arguments import choice
from neuro.events._events import Events
from neuro.events.representations._common import Polarity, Representation, given


def event_frame(
    events: Events,
    *,
    polarity: Polarity = "separate",
    segments: npt.ArrayLike | None = None,
    as_torch: bool = False,
) -> Representation:
    """Count the events of each pixel.

    Args:
        events: what to count.
        polarity: ``"separate"``, ``"signed"`` (ON minus OFF) or ``"ignored"``.
        segments: (n + 1,) bounds, as the functions of `neuro.events.segmentation` give them, or (n, 2) ranges of
            events, which may overlap; one frame each.
        as_torch: give a torch tensor.

    Returns:
        int32 ([n,] [2,] height, width): the first axis with `segments`, the second with separate polarities.

    Raises:
        ModelError: an argument is wrong, or torch is missing; the message says which.
    """
    choice("polarity", polarity, ("separate", "signed", "ignored"))
    return given(_counted(events, polarity, segments), as_torch)


def binary_frame(
    events: Events,
    *,
    polarity: Polarity = "ignored",
    segments: npt.ArrayLike | None = None,
    as_torch: bool = False,
) -> Representation:
    """Say of each pixel whether it had an event.

    Args:
        events: where to look.
        polarity: ``"separate"`` or ``"ignored"``.
        segments: as for `event_frame`.
        as_torch: give a torch tensor.

    Returns:
        bool ([n,] [2,] height, width): the first axis with `segments`, the second with separate polarities.

    Raises:
        ModelError: an argument is wrong, or torch is missing; the message says which.
    """
    choice("polarity", polarity, ("separate", "ignored"))
    return given(_counted(events, polarity, segments) > 0, as_torch)


def _counted(events: Events, polarity: str, segments: npt.ArrayLike | None) -> npt.NDArray[np.int32]:
    from neuro.events.representations._frames_kernel import count

    ranges = np.array([[0, len(events)]]) if segments is None else _ranges(segments, len(events))
    width, height = events.sensor_size
    separate = polarity == "separate"
    out = np.zeros((len(ranges), 1 + separate, height, width), np.int32)
    count(events.x, events.y, events.p, ranges, separate, polarity == "signed", out)
    frames = out if separate else out[:, 0]
    return frames[0] if segments is None else frames


def _ranges(segments: npt.ArrayLike, n: int) -> npt.NDArray[np.int64]:
    """(segments, 2) first event and the one after the last."""
    given: npt.NDArray[Any] = np.asarray(segments)
    pairs = given.ndim == 2 and given.shape[1] == 2
    if given.dtype.kind not in "iu" or not (pairs or (given.ndim == 1 and given.size)):
        raise ModelError(
            f"segments is {given.dtype} of shape {given.shape}, expected whole numbers (n + 1,) or (n, 2)",
            hint="bounds = msd_segments(events.t), or another function of neuro.events.segmentation",
        )
    ranges = (given if pairs else np.stack([given[:-1], given[1:]], axis=1)).astype(np.int64)
    bad = (ranges[:, 0] < 0) | (ranges[:, 1] < ranges[:, 0]) | (ranges[:, 1] > n)
    if bad.any():
        k = int(bad.argmax())
        first, last = ranges[k]
        raise ModelError(f"segment {k} is events {first} to before {last}, expected 0 <= first <= last <= {n}")
    return np.ascontiguousarray(ranges)
