"""The frames of many recordings: the spikes of each, one after the other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Self

import numpy as np

from neuro_recognise.shown import Array, Evidence, Features, Ints

__all__ = ["Frames", "ended_by"]


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
    """Spikes of all frames of some recordings.

    Attributes:
        codes: (spikes,) from which an encoder tells the times.
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
    return {name: evidence[name][:n] for name in per_frame} | {name: evidence[name][:spikes] for name in per_spike}


def _offsets(lengths: Array) -> Ints:
    return np.concatenate(([0], np.cumsum(lengths, dtype=np.int64))).astype(np.int64)
