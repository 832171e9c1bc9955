"""The frames of many recordings: the spikes of each, and what speaks for each class by how they ended."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np

from neuro_recognise.shown import Array, Evidence, Features, Floats, Ints

if TYPE_CHECKING:
    from neuro import TrialResults


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
    """Spikes of all frames of some recordings.

    Attributes:
        codes: (spikes,) from which an encoder computes the times.
        ids: (spikes,) of the inputs.
        offsets: (frames + 1,) frame i has the spikes ``[offsets[i], offsets[i + 1])``.
        recording: (frames,) the recording that each frame is of, ascending.
    """

    codes: Array
    ids: Array
    offsets: Ints
    recording: Ints

    @classmethod
    def of(cls, shown: Features) -> Self:
        """Those of recordings whose evidence has ``codes`` and ``ids``, and ``lengths``, the spikes of each frame."""
        lengths = shown.column("lengths")
        recording = np.repeat(np.arange(len(shown)), np.diff(lengths.offsets))
        codes, ids = (shown.column(name).values for name in ("codes", "ids"))
        return cls(codes, ids, _offsets(lengths.values), recording)

    def __len__(self) -> int:
        """The number of frames."""
        return len(self.recording)

    def take(self, frames: Ints) -> Self:
        """Some of the frames, in the order given."""
        lengths = np.diff(self.offsets)[frames]
        offsets = _offsets(lengths)
        where = np.repeat(self.offsets[frames] - offsets[:-1], lengths) + np.arange(offsets[-1])
        return type(self)(self.codes[where], self.ids[where], offsets, self.recording[frames])


def ended_by(evidence: Evidence, us: int) -> Evidence:
    """What frames have shown that were complete by a time after the first event."""
    n = int(np.searchsorted(evidence["ends"], us, "right"))
    spikes = int(evidence["lengths"][:n].sum())
    per_frame, per_spike = ("lengths", "ends"), ("codes", "ids")
    lasts = {name: np.minimum(evidence[name], us) for name in ("lasts",) if name in evidence}
    per_frame_parts = {name: evidence[name][:n] for name in per_frame}
    return per_frame_parts | {name: evidence[name][:spikes] for name in per_spike} | lasts


def _offsets(lengths: Array) -> Ints:
    return np.concatenate(([0], np.cumsum(lengths, dtype=np.int64))).astype(np.int64)


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
    """The frames that each class has won, and a share of one by which equals are ordered.

    Args:
        wins: (recordings, classes) frames.
        sums: (recordings, classes) by which classes with equally many are ordered; of equals the first leads.

    Returns:
        (recordings, classes) where no class has won any frame NaN.
    """
    behind = np.argsort(np.argsort(-sums, axis=1, kind="stable"), axis=1)
    votes = wins + 1.0 - (behind + 1.0) / sums.shape[1]
    return np.where(wins.any(axis=1, keepdims=True), votes, np.nan)


def potentials(sums: Floats) -> Floats:
    """Over the frames, the sum of the potentials of a class' maps at the decision, mV.

    Args:
        sums: (recordings, classes).

    Returns:
        The same; NaN where no map of any class was reached.
    """
    return np.where(sums.any(axis=1, keepdims=True), sums, np.nan)
