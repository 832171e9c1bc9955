"""Pixels that hang together, and the straight cuts through them."""

from __future__ import annotations

import numpy as np

from neuro_recognise.shown import Floats, Ints

__all__ = ["Blob", "Cuts"]

FAR = 1 << 32
"""A place outside of any sensor, px; a whole number as places are, since `ufunc.at` is slow between types."""


class Blob:
    """Pixels that belong together.

    Args:
        x, y: (pixels,) columns and rows.
        weight: (pixels,) events above the background.

    Attributes:
        box: (4,) left, top, right and bottom.
        larger: side of the box, px.
    """

    def __init__(self, x: Ints, y: Ints, weight: Floats) -> None:
        self.x, self.y, self.weight = x, y, weight
        self.box = np.array([x.min(), y.min(), x.max() + 1, y.max() + 1])
        self.larger = float(max(self.box[2] - self.box[0], self.box[3] - self.box[1]))

    def with_(self, other: Blob) -> Blob:
        """Both as one."""
        x, y = np.concatenate((self.x, other.x)), np.concatenate((self.y, other.y))
        return Blob(x, y, np.concatenate((self.weight, other.weight)))

    def gap(self, other: Blob) -> float:
        """How far the boxes are apart, px; negative where they overlap."""
        return float(np.maximum(self.box[:2] - other.box[2:], other.box[:2] - self.box[2:]).max())

    def cuts(self, angle: float) -> Cuts:
        """All straight cuts across a direction."""
        along = self.x * np.cos(angle) + self.y * np.sin(angle)
        return Cuts(self, np.floor(along - along.min()).astype(np.int64))


class Cuts:
    """The cuts of a blob into its first columns of pixels, across any direction, and the others.

    Args:
        blob: is cut.
        column: (pixels,) of each pixel, from 0.

    Attributes:
        larger_before, larger_after: (cuts,) larger sides of the boxes of both pieces, px.
        share: (cuts,) the blob's events at the cut, in the columns on both sides, over all of them.
    """

    def __init__(self, blob: Blob, column: Ints) -> None:
        self._blob, self._column = blob, column
        n = int(column.max()) + 1
        low, high = np.full((2, n), FAR), np.full((2, n), -FAR)
        for axis, values in enumerate((blob.x, blob.y)):
            np.minimum.at(low[axis], column, values)
            np.maximum.at(high[axis], column, values)
        self.larger_before = _larger(low, high)[:-1]
        self.larger_after = _larger(low[:, ::-1], high[:, ::-1])[::-1][1:]
        events = np.bincount(column, blob.weight, n)
        total = max(float(events.sum()), 1e-9)
        self.share = (events[:-1] + events[1:]) / total

    def at(self, k: int) -> tuple[Blob, Blob]:
        """Both pieces of a cut."""
        before = self._column <= k
        blob = self._blob
        first, second = (Blob(blob.x[of], blob.y[of], blob.weight[of]) for of in (before, ~before))
        return first, second


def _larger(low: Ints, high: Ints) -> Ints:
    """Larger side of the box of the first columns, for each number of columns."""
    sides = np.maximum.accumulate(high, axis=1) - np.minimum.accumulate(low, axis=1) + 1
    larger: Ints = sides.max(axis=0)
    return larger
