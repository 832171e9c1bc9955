"""The class of a histogram as HOTS decides: the nearest of the mean histograms of classes, by one of three distances.

Source: Lagorce et al., "HOTS: A Hierarchy of Event-Based Time-Surfaces for Pattern Recognition", IEEE TPAMI 39:1346,
2017: standard, normalised and Bhattacharyya distance.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TypeAlias

import numpy as np
import numpy.typing as npt

Floats: TypeAlias = npt.NDArray[np.float64]


def class_means(histograms: npt.ArrayLike, labels: npt.NDArray[np.int64], classes: int) -> Floats:
    """The mean histogram of each class, the paper's signature.

    Args:
        histograms: (recordings, prototypes).
        labels: (recordings,) from 0 to classes - 1.
        classes: their number.

    Returns:
        (classes, prototypes); NaN for a class without recordings.
    """
    counts = np.asarray(histograms, np.float64)
    means = np.full((classes, counts.shape[1]), np.nan)
    for label in np.unique(labels):
        means[label] = counts[labels == label].mean(axis=0)
    return means


def standard(histograms: npt.ArrayLike, means: Floats) -> Floats:
    """Euclidean distances of histograms from those of classes, (recordings, classes)."""
    counts = np.asarray(histograms, np.float64)
    found: Floats = np.sqrt(((counts[:, None] - means) ** 2).sum(axis=2))
    return found


def normalised(histograms: npt.ArrayLike, means: Floats) -> Floats:
    """Euclidean distances of histograms whose sums are brought to 1, (recordings, classes)."""
    return standard(_shares(histograms), _shares(means))


def bhattacharyya(histograms: npt.ArrayLike, means: Floats) -> Floats:
    """Bhattacharyya distances, ``-ln sum_k sqrt(h_k m_k)`` of histograms whose sums are brought to 1; 0 to infinity."""
    with np.errstate(divide="ignore"):
        found: Floats = -np.log(np.sqrt(_shares(histograms)) @ np.sqrt(_shares(means)).T)
    return found


DISTANCES: Mapping[str, Callable[[npt.ArrayLike, Floats], Floats]] = {
    "standard": standard,
    "normalised": normalised,
    "bhattacharyya": bhattacharyya,
}
"""The paper's distances by name; the class with the smallest is decided for."""


def _shares(histograms: npt.ArrayLike) -> Floats:
    """Histograms brought to a sum of 1; one of a recording without events stays 0."""
    counts = np.asarray(histograms, np.float64)
    total = counts.sum(axis=1, keepdims=True)
    found: Floats = counts / np.where(total > 0, total, 1.0)
    return found
