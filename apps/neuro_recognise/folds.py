"""Folds: every recording is tested once, by what was learnt from the others."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from neuro import ModelError
from neuro_recognise.shown import Ints

__all__ = ["folds", "stratified"]


def stratified(labels: Ints, n: int, seed: int) -> Ints:
    """A fold for each recording, each class spread evenly.

    Args:
        labels: (recordings,).
        n: folds, at least 2.
        seed: of the draw.

    Raises:
        ModelError: there are fewer recordings than folds, or fewer than two folds.
    """
    if not 2 <= n <= len(labels):
        raise ModelError(f"folds = {n!r}: expected 2 to {len(labels)}, the number of recordings")
    rng = np.random.default_rng([seed, 7])
    order = np.concatenate([rng.permutation(np.flatnonzero(labels == label)) for label in np.unique(labels)])
    fold = np.empty(len(labels), np.int64)
    fold[order] = np.arange(len(labels)) % n
    return fold


def folds(labels: Ints, n: int, seed: int) -> Iterator[tuple[Ints, Ints]]:
    """For each fold the recordings to learn from and those to test, ascending; arguments and errors as `stratified`."""
    fold = stratified(labels, n, seed)
    for k in range(n):
        yield np.flatnonzero(fold != k), np.flatnonzero(fold == k)
