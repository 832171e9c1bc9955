"""How far vectors are from those of classes, by the three distances of HOTS.

Source: Lagorce et al., "HOTS: A Hierarchy of Event-Based Time-Surfaces for Pattern Recognition", IEEE TPAMI 39:1346,
2017, section 3.3: standard, normalised and Bhattacharyya distance.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

import numpy as np

from neuro_recognise.shown import Array, Floats

__all__ = ["DISTANCES", "bhattacharyya", "normalised", "standard"]


def standard(x: Array, means: Array) -> Floats:
    """Euclidean distances of vectors (recordings, values) from those of classes, (recordings, classes)."""
    return np.stack([np.sqrt(((x - mean) ** 2).sum(axis=1)) for mean in means], axis=1)


def normalised(x: Array, means: Array) -> Floats:
    """Euclidean distances of vectors whose sums are brought to 1."""
    return standard(_shares(x), _shares(means))


def bhattacharyya(x: Array, means: Array) -> Floats:
    """Bhattacharyya distances, ``-ln sum_k sqrt(x_k m_k)`` of vectors whose sums are brought to 1; 0 to infinity.

    Values must not be negative, as those of histograms.
    """
    with np.errstate(divide="ignore"):
        found: Floats = -np.log(np.sqrt(_shares(x)) @ np.sqrt(_shares(means)).T)
    return found


DISTANCES: Mapping[str, Callable[[Array, Array], Floats]] = {
    "standard": standard,
    "normalised": normalised,
    "bhattacharyya": bhattacharyya,
}
"""The distances by name."""


def _shares(x: Array) -> Floats:
    """Vectors brought to a sum of 1; one of zeros stays."""
    total = x.sum(axis=1, keepdims=True)
    found: Floats = x / np.where(total > 0, total, 1.0)
    return found
