"""Spikes of frames: those of stronger responses come earlier; and what speaks for each class by how frames ended."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np

from neuro import ModelError
from neuro.apps import Part, Registry, setting
from neuro.coding import log_intensity_to_latency
from neuro_recognise.method import Learnt
from neuro_recognise.shown import Array, Evidence, Features, Floats, Ints

if TYPE_CHECKING:
    from neuro import TrialResults


CODE = "github BEJ97/MK-Tempotron, top_onN_MNIST.m"
ROUNDING = 1e-9
"""Share of a filter's largest response up to which a response is a rounding error of 0."""
TICKS = "16, 32 or 64 ticks of a window decide equally well on N-MNIST: docs/how-to/remus.md"


@dataclass(frozen=True)
class Encoder(Part):
    """Base of the encoders.

    What a recording shows are codes; times follow from these and from what was learnt of all recordings.
    """

    kind = "encoder"

    window: float = setting(64.0, "ms", "length of the code", TICKS, above=0)
    resolution: float = setting(1.0, "ms", "grid of the spike times", TICKS, above=0)

    @property
    def last(self) -> int:
        """The last tick of the window."""
        return int(np.ceil(self.window / self.resolution)) - 1

    @abstractmethod
    def channels(self, scales: int, orientations: int) -> int:
        """How many spikes can come from a place: the ids' first axis; the others are rows and columns."""

    def bands(self, sizes: Sequence[int], orientations: Sequence[float]) -> tuple[str, ...]:
        """Names of the channels, of filters with these sides, px, and orientations, degrees."""
        angles = [f"{angle:g}°" for angle in orientations]
        if self.channels(len(sizes), len(angles)) == len(angles):
            return tuple(angles)
        return tuple(f"{size} px {angle}" for size in sizes for angle in angles)

    @abstractmethod
    def encode(self, responses: Floats) -> tuple[Array, Ints, Ints]:
        """The spikes of each frame.

        Args:
            responses: (frames, scales, orientations, rows, columns).

        Returns:
            (spikes,) codes; (spikes,) ids; (frames,) number of spikes of each. Those of a frame are in the order of
            their times.
        """

    def learn(self, codes: Array) -> dict[str, Array]:
        """What times depend on beside a code, by name, from the codes of all recordings to learn from."""
        return {}

    @abstractmethod
    def times(self, codes: Array, learnt: Learnt) -> Floats:
        """(spikes,) ms from the start of the frame, on the grid of `resolution` in [0, window)."""


@dataclass(frozen=True)
class LogLatency(Encoder):
    """Spikes of each orientation and place, of the strongest scale or of all, by the logarithms of responses."""

    known_as = "log_latency"
    source = "thesis 6.2.3, eq. 15, lines 2371-2395"

    min_response: float = setting(
        0.1, "", "share of the frame's largest response below which none spikes", "ours; thesis: r_min of a filter",
        above=0, below=1,
    )  # fmt: skip
    first: int = setting(0, "", "how many spikes of a frame are kept, the first ones; 0: all", "thesis", at_least=0)
    scales: str = setting(
        "strongest", "", "whose spikes come from a place: the strongest scale's, or those of all, merged",
        "all: thesis 6.2.3, line 2387; strongest: docs/reference/recognisers.md", words=("strongest", "all"),
    )  # fmt: skip
    ranges: str = setting(
        "frame", "", "r_min and r_max of eq. 15: min_response and the largest response of the frame, or the smallest "
        "and largest response above 0 of each filter in the frame, which needs scales=all",
        "filter: thesis line 3722", words=("frame", "filter"),
    )  # fmt: skip

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.ranges == "filter" and self.scales != "all":
            raise ModelError(
                f"{self.place()}: ranges=filter: found scales={self.scales}, which merges filters before the code",
                hint="scales=all",
            )

    def channels(self, scales: int, orientations: int) -> int:
        """The orientations."""
        return orientations

    def encode(self, responses: Floats) -> tuple[Array, Ints, Ints]:
        """Codes are ticks; equal ones are in the order of their ids."""
        seen = responses.max(axis=1, keepdims=True) if self.scales == "strongest" else responses
        latencies = self._of_filters(seen) if self.ranges == "filter" else self._of_frames(seen)
        places = int(np.prod(seen.shape[2:]))
        fused = np.moveaxis(latencies, 1, -1).reshape(len(seen), places, seen.shape[1])
        frame, ids, scale = np.nonzero(~np.isnan(fused))
        ticks = np.minimum(fused[frame, ids, scale] // self.resolution, self.last).astype(np.int64)
        order = np.argsort(frame * (self.last + 1) + ticks, kind="stable")
        lengths = np.bincount(frame, minlength=len(fused)).astype(np.int64)
        order, lengths = _first(order, lengths, self.first)
        return ticks[order].astype(np.uint16), ids[order].astype(np.int64), lengths

    def _of_frames(self, responses: Floats) -> Floats:
        """Latencies of the shape of the responses, ms; NaN without a spike."""
        peak = responses.max(axis=(1, 2, 3, 4), initial=0.0, keepdims=True)
        relative = np.divide(responses, peak, out=np.zeros_like(responses), where=peak > 0)
        relative[relative < self.min_response] = 0.0
        return log_intensity_to_latency(relative, self.min_response, 1.0, self.window)

    def _of_filters(self, responses: Floats) -> Floats:
        """Latencies of the shape of the responses, ms; NaN without a spike."""
        peak = responses.max(axis=(3, 4), initial=0.0, keepdims=True)
        spiking = responses > ROUNDING * peak
        least = responses.min(axis=(3, 4), initial=np.inf, where=spiking, keepdims=True)
        span = np.log(peak / least, where=least < peak, out=np.ones_like(peak))  # all equal: at the start
        ratio = np.divide(peak, responses, where=spiking, out=np.full_like(responses, np.nan))
        latencies: Floats = self.window * np.log(ratio) / span
        return latencies

    def times(self, codes: Array, learnt: Learnt) -> Floats:
        """Ticks of the grid."""
        return np.asarray(codes * self.resolution)


@dataclass(frozen=True)
class Latency(Encoder):
    """A spike of each scale, orientation and place, at 1 - response / largest response of all that was learnt from."""

    source = "Zhao et al., IEEE TNNLS 26:1963, 2015; MK-Tempotron, myC1respToSpk.m"

    first: int = setting(300, "", "how many spikes of a frame are kept, the first ones; 0: all", CODE, at_least=0)

    def channels(self, scales: int, orientations: int) -> int:
        """All filters."""
        return scales * orientations

    def encode(self, responses: Floats) -> tuple[Array, Ints, Ints]:
        """Codes are responses; equal ones are in the order of their ids."""
        flat = responses.reshape(len(responses), int(np.prod(responses.shape[1:])))
        frame, ids = np.nonzero(flat > 0)
        strength = flat[frame, ids]
        order = np.lexsort((ids, -strength, frame))
        lengths = np.bincount(frame, minlength=len(flat)).astype(np.int64)
        order, lengths = _first(order, lengths, self.first)
        return strength[order].astype(np.float32), ids[order].astype(np.int64), lengths

    def learn(self, codes: Array) -> dict[str, Array]:
        """The largest response."""
        return {"largest": np.array(codes.max())}

    def times(self, codes: Array, learnt: Learnt) -> Floats:
        """What is as large as the largest comes at 0."""
        weak = 1.0 - np.minimum(codes / np.asarray(learnt["largest"], float), 1.0)
        return np.asarray(np.minimum(weak * self.window // self.resolution, self.last) * self.resolution)


def _first(order: Ints, lengths: Ints, n: int) -> tuple[Ints, Ints]:
    """The first spikes of each frame, so many at most, and how many these are; all where n is 0."""
    if not n:
        return order, lengths
    rank = np.arange(len(order)) - np.repeat(np.cumsum(lengths) - lengths, lengths)
    return order[rank < n], np.minimum(lengths, n)


Encoder.known = Registry("encoder", (LogLatency, Latency))


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
        offsets = np.concatenate(([0], np.cumsum(lengths.values, dtype=np.int64)))
        return cls(codes, ids, offsets, recording)

    def __len__(self) -> int:
        """The number of frames."""
        return len(self.recording)

    def take(self, frames: Ints) -> Self:
        """Some of the frames, in the order given."""
        lengths = np.diff(self.offsets)[frames]
        offsets = np.concatenate(([0], np.cumsum(lengths, dtype=np.int64)))
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
