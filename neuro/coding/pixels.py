"""Events of a camera as spikes of a population of pixels."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro.core.errors import ModelError

Ints = npt.NDArray[np.int64]


def check_pixels(shape: Sequence[int | str]) -> None:
    """Refuse the shape of a population that is none of pixels.

    Raises:
        ModelError: it is neither (2, rows, columns) nor (rows, columns).
    """
    if len(shape) not in (2, 3) or (len(shape) == 3 and shape[0] != 2):
        raise ModelError(f"shape {list(shape)}: expected [2, rows, columns], OFF then ON, or [rows, columns]")


def pixel_spikes(
    events: Any, shape: Sequence[int], step: float, *, steps: int | None = None, scale: int = 1, start: float = 0.0
) -> tuple[Ints, Ints]:
    """The steps and neurons of the spikes that a recording is, one for each event, in the order of the events.

    Args:
        events: `neuro.events.Events`, or what has their `t` (us), `x`, `y` (px) and `p`.
        shape: of the population: (2, rows, columns), OFF then ON, or (rows, columns) where both count as one.
        step: of the network, ms.
        steps: events from this step on are left out; all are seen if not given.
        scale: pixels in a row and in a column that are one neuron.
        start: ms from the first event to the first step; what comes before is left out.

    Returns:
        Steps from 0 on, and neurons, both (spikes,).

    Raises:
        ModelError: the shape is another, an event lies outside, or the step is no whole number of us.
    """
    check_pixels(shape)
    if abs(step * 1000.0 - round(step * 1000.0)) > 1e-6:
        raise ModelError(f"steps of {step:g} ms: expected whole microseconds, as events have them")
    rows, columns = shape[-2:]
    since = events.t - (events.t[0] if len(events.t) else 0) - round(start * 1000.0)
    at = np.floor_divide(since, round(step * 1000.0)).astype(np.int64)
    seen = (at >= 0) if steps is None else (at >= 0) & (at < steps)
    x, y = (np.asarray(each, dtype=np.int64)[seen] // scale for each in (events.x, events.y))
    for k in np.flatnonzero((x >= columns) | (y >= rows))[:1]:
        message = f"an event at x = {x[k] * scale}, y = {y[k] * scale} px"
        raise ModelError(f"{message}: expected within the shape {list(shape)} at scale {scale}")
    neuron = y * columns + x
    if len(shape) == 3:
        neuron = neuron + np.asarray(events.p, dtype=np.int64)[seen] * (rows * columns)
    return at[seen], neuron
