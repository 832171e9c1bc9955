"""From how the frames of a recording ended to what speaks for each class."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from neuro_recognise.shown import Floats, Ints

if TYPE_CHECKING:
    from neuro import TrialResults

__all__ = ["VOTES", "majority", "potentials", "votes"]

VOTES = ("majority", "potentials")


def votes(
    results: TrialResults, recording: Ints, recordings: int, classes: int, together: bool = False
) -> dict[str, Floats]:
    """What speaks for each class, by each of `VOTES`.

    Args:
        results: of all frames.
        recording: (frames,) the recording that each is of.
        recordings: their number; one may have no frames.
        classes: their number; each has equally many maps, one after the other.
        together: whether the maps of a class speak by the mean of their potentials, not by the largest.

    Returns:
        (recordings, classes) each; a recording of which no frame says anything has NaN.
    """
    decided = results.label >= 0
    wins = np.zeros((recordings, classes))
    np.add.at(wins, (recording[decided], results.label[decided]), 1.0)
    sums = np.zeros((recordings, classes))
    per_class = results.potential.shape[1] // classes
    of_classes = results.potential.reshape(-1, classes, per_class)
    np.add.at(sums, recording, of_classes.mean(axis=2) if together else of_classes.max(axis=2))
    return {"majority": majority(wins, sums), "potentials": potentials(sums)}


def majority(wins: Floats, sums: Floats) -> Floats:
    """The frames that each class has won, and a share of one by which equals are told apart.

    Args:
        wins: (recordings, classes) frames.
        sums: (recordings, classes) by which classes with equally many are told apart; of equals the first leads.

    Returns:
        (recordings, classes) where no class has won any frame NaN.
    """
    behind = np.argsort(np.argsort(-sums, axis=1, kind="stable"), axis=1)
    told = wins + 1.0 - (behind + 1.0) / sums.shape[1]
    return np.where(wins.any(axis=1, keepdims=True), told, np.nan)


def potentials(sums: Floats) -> Floats:
    """Over the frames, the sum of the potentials of a class' maps at the decision, mV.

    Args:
        sums: (recordings, classes).

    Returns:
        The same; NaN where no map of any class was reached.
    """
    return np.where(sums.any(axis=1, keepdims=True), sums, np.nan)
