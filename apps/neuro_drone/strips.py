"""A line of some width on the ground, as strips that meet at its corners."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

__all__ = ["strips"]

APART = 1e-6
"""Ends that are not farther from each other than this are one corner, m."""
SHARPEST = 0.25
"""Strips are mitred where 1 + cos(turn) is more than this (a turn of 138 degrees); else their ends are cut square."""


def strips(line: npt.NDArray[np.float64], width: float) -> npt.NDArray[np.float64]:
    """Outlines of a line's segments; where one begins at the end of the one before, the two share a mitred edge.

    Args:
        line: (n, 4), segments from x, y to x, y, m; the last may end where the first begins.
        width: of the line, m.

    Returns:
        (n, 4, 2), corners of the strips, m. Strips of segments without a length are empty.
    """
    start, end = line[:, :2], line[:, 2:]
    along = end - start
    length = np.hypot(along[:, 0], along[:, 1])[:, None]
    along = np.divide(along, length, out=np.zeros_like(along), where=length > 0.0)
    side = 0.5 * width * np.stack([-along[:, 1], along[:, 0]], axis=1)
    cosine = (along * np.roll(along, 1, axis=0)).sum(1)
    met = (np.abs(start - np.roll(end, 1, axis=0)) <= APART).all(1)
    met &= (1.0 + cosine > SHARPEST) & (length[:, 0] > 0.0)
    mitre = (side + np.roll(side, 1, axis=0)) / np.where(met, 1.0 + cosine, 1.0)[:, None]
    first = np.where(met[:, None], mitre, side)
    joined = np.roll(met, -1)
    last = np.where(joined[:, None], np.roll(mitre, -1, axis=0), side)
    return np.ascontiguousarray(np.stack([start + first, end + last, end - last, start - first], axis=1))
