"""What a recogniser is shown of an object: its own events, in the middle of the recogniser's field."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from neuro.events import Events
from neuro_recognise.detection.proposals import Region
from neuro_recognise.shown import Array

__all__ = ["crop"]


def crop(regions: Sequence[Region], size: tuple[int, int], scale: float = 1.0) -> Events:
    """The events of an object in some segments, without those of others and moved into a field.

    In each segment the mean of its events comes to the middle of the field, which takes the motion from segment to
    segment out. So what is seen differs a little from a recording of an object that stays: a recogniser should learn
    from crops, too (`neuro_recognise.detection.learning`).

    Args:
        regions: of the object, in the order of time.
        size: width and height of the field, px; what lies outside is left out.
        scale: how many px of the sensor become one; of larger objects one event in scale^2 stays.
    """
    middles = np.repeat([region.centre for region in regions], [len(region.events) for region in regions], axis=0)
    parts = [region.events for region in regions]
    t, x, y, p = (np.concatenate([getattr(part, name) for part in parts]) for name in "txyp")
    x, y = _into(x - middles[:, 0], size[0], scale), _into(y - middles[:, 1], size[1], scale)
    there = np.flatnonzero((x >= 0) & (x < size[0]) & (y >= 0) & (y < size[1]))
    if scale > 1.0:
        there = there[np.floor(np.arange(0.0, len(there), scale**2)).astype(np.int64)]
    return Events(t[there], x[there], y[there], p[there], size)


def _into(places: Array, side: int, scale: float) -> Array:
    """Columns or rows, counted from the middle of a side of the field."""
    return np.rint(places / scale + (side - 1) / 2.0).astype(np.int64)
