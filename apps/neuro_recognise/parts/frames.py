"""Encoders, which turn filter responses of frames into spike times, and votes of frames for classes."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np

from neuro import ModelError
from neuro.apps import Registry, setting
from neuro.coding import Works, log_intensity_to_latency, on_numbers
from neuro_recognise.method import FrameSize, FrontEndPart, Learnt
from neuro_recognise.shown import Array, Evidence, Features, Floats, Ints

if TYPE_CHECKING:
    from neuro import TrialResults
    from neuro.coding import Work


CODE = "github BEJ97/MK-Tempotron, top_onN_MNIST.m"
ROUNDING = 1e-9
"""Responses up to this share of a filter's largest response are rounding errors, treated as 0."""
TICKS = "16, 32 or 64 ticks of a window decide equally well on N-MNIST: docs/how-to/remus.md"


@dataclass(frozen=True)
class Encoder(FrontEndPart):
    """Base of the encoders: stronger responses spike earlier.

    Evidence holds codes, which do not depend on training. Spike times are computed from codes and from what the encoder
    learnt from all training recordings.
    """

    kind = "encoder"

    window: float = setting(64.0, "ms", "length of the code", TICKS, above=0)
    resolution: float = setting(1.0, "ms", "grid of the spike times", TICKS, above=0)

    @property
    def last(self) -> int:
        """The index of the last tick of the window."""
        return int(np.ceil(self.window / self.resolution)) - 1

    @abstractmethod
    def channels(self, scales: int, orientations: int) -> int:
        """Return the number of inputs per place. Ids have the axes channels, rows and columns."""

    def bands(self, sizes: Sequence[int], orientations: Sequence[float]) -> tuple[str, ...]:
        """Return names of the channels for filters of these sizes, px, and orientations, degrees."""
        angles = [f"{angle:g}°" for angle in orientations]
        if self.channels(len(sizes), len(angles)) == len(angles):
            return tuple(angles)
        return tuple(f"{size} px {angle}" for size in sizes for angle in angles)

    @abstractmethod
    def encode(self, responses: Floats) -> tuple[Array, Ints, Ints]:
        """Return the spikes of each frame.

        Args:
            responses: (frames, scales, orientations, rows, columns) responses >= 0.

        Returns:
            (spikes,) codes; (spikes,) ids; (frames,) number of spikes of each frame. Spikes are ordered by frame, and
            by time within a frame.
        """

    def learn(self, codes: Array) -> dict[str, Array]:
        """Learn parameters of `times` from the codes of all training recordings, as arrays by name."""
        return {}

    @abstractmethod
    def times(self, codes: Array, learnt: Learnt) -> Floats:
        """Return spike times since the start of the frame, (spikes,) ms, multiples of `resolution` in [0, window)."""


@dataclass(frozen=True)
class LogLatency(Encoder):
    """Latencies from the logarithms of responses, one spike per orientation and place, optionally for each scale."""

    known_as = "log_latency"
    source = "thesis 6.2.3, eq. 15, lines 2371-2395"

    min_response: float = setting(
        0.1, "", "smallest response that spikes, as a share of the frame's largest", "ours; thesis: r_min of a filter",
        above=0, below=1,
    )  # fmt: skip
    first: int = setting(0, "", "largest number of spikes per frame, the earliest; 0: all", "thesis", at_least=0)
    scales: str = setting(
        "strongest", "", "scales whose responses spike: the strongest at each place, or all, merged into one input",
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
        """Return the number of orientations."""
        return orientations

    def encode(self, responses: Floats) -> tuple[Array, Ints, Ints]:
        """Return ticks as codes. Spikes with equal ticks are ordered by id."""
        selected = responses.max(axis=1, keepdims=True) if self.scales == "strongest" else responses
        latencies = (
            self._latencies_by_filter(selected) if self.ranges == "filter" else self._latencies_by_frame(selected)
        )
        places = int(np.prod(selected.shape[2:]))
        fused = np.moveaxis(latencies, 1, -1).reshape(len(selected), places, selected.shape[1])
        frame, ids, scale = np.nonzero(~np.isnan(fused))
        ticks = np.minimum(fused[frame, ids, scale] // self.resolution, self.last).astype(np.int64)
        order = np.argsort(frame * (self.last + 1) + ticks, kind="stable")
        lengths = np.bincount(frame, minlength=len(fused)).astype(np.int64)
        order, lengths = _first(order, lengths, self.first)
        return ticks[order].astype(np.uint16), ids[order].astype(np.int64), lengths

    def _latencies_by_frame(self, responses: Floats) -> Floats:
        """Return latencies scaled to the frame's largest response, ms, shaped like the responses; NaN for no spike."""
        peak = responses.max(axis=(1, 2, 3, 4), initial=0.0, keepdims=True)
        relative = np.divide(responses, peak, out=np.zeros_like(responses), where=peak > 0)
        relative[relative < self.min_response] = 0.0
        return log_intensity_to_latency(relative, self.min_response, 1.0, self.window)

    def _latencies_by_filter(self, responses: Floats) -> Floats:
        """Return latencies scaled to each filter's range, ms, shaped like the responses; NaN for no spike."""
        peak = responses.max(axis=(3, 4), initial=0.0, keepdims=True)
        spiking = responses > ROUNDING * peak
        smallest = responses.min(axis=(3, 4), initial=np.inf, where=spiking, keepdims=True)
        span = np.log(peak / smallest, where=smallest < peak, out=np.ones_like(peak))  # equal responses spike at 0
        ratio = np.divide(peak, responses, where=spiking, out=np.full_like(responses, np.nan))
        latencies: Floats = self.window * np.log(ratio) / span
        return latencies

    def times(self, codes: Array, learnt: Learnt) -> Floats:
        """Convert ticks to ms."""
        return np.asarray(codes * self.resolution)

    def work(self, size: FrameSize) -> Works:
        """Return the operations of a frame.

        To find the strongest scale takes a comparison for each response. A value takes 10 operations: the peak, the
        share, the least share, log, a difference, a factor, the span, and a tick's division, rounding and limit. Then
        the values are sorted.
        """
        values = size.responses if self.scales == "all" else size.orientations * size.cells
        return {"frame": _coded(size.responses - values + 10 * values, 1, values, self.first, size)}


@dataclass(frozen=True)
class Latency(Encoder):
    """Latencies 1 - response / largest training response, with one spike per scale, orientation and place."""

    source = "Zhao et al., IEEE TNNLS 26:1963, 2015; MK-Tempotron, myC1respToSpk.m"

    first: int = setting(300, "", "largest number of spikes per frame, the earliest; 0: all", CODE, at_least=0)

    def channels(self, scales: int, orientations: int) -> int:
        """Return the number of filters."""
        return scales * orientations

    def encode(self, responses: Floats) -> tuple[Array, Ints, Ints]:
        """Return responses as codes. Spikes with equal responses are ordered by id."""
        flat = responses.reshape(len(responses), int(np.prod(responses.shape[1:])))
        frame, ids = np.nonzero(flat > 0)
        strength = flat[frame, ids]
        order = np.lexsort((ids, -strength, frame))
        lengths = np.bincount(frame, minlength=len(flat)).astype(np.int64)
        order, lengths = _first(order, lengths, self.first)
        return strength[order].astype(np.float32), ids[order].astype(np.int64), lengths

    def learn(self, codes: Array) -> dict[str, Array]:
        """Return the largest response."""
        return {"largest": np.array(codes.max())}

    def times(self, codes: Array, learnt: Learnt) -> Floats:
        """Convert responses to ms. Responses at or above the largest training response spike at 0 ms."""
        weak = 1.0 - np.minimum(codes / np.asarray(learnt["largest"], float), 1.0)
        return np.asarray(np.minimum(weak * self.window // self.resolution, self.last) * self.resolution)

    def work(self, size: FrameSize) -> Works:
        """Return a comparison for each response and the sort, and for each spike 8 operations.

        A spike takes a division, a limit, a difference, a factor, a tick's division, rounding and limit, and a factor.
        """
        return {"frame": _coded(size.responses, 8, size.responses, self.first, size)}


def _coded(macs: float, per_value: float, values: int, first: int, size: FrameSize) -> Work:
    """Return the work of an encoder: `macs`, a sort of the values, and `per_value` for each of the `first` spikes."""
    spikes = min(values, first or values)
    sort = values * math.ceil(math.log2(max(1, values)))
    return on_numbers(macs + sort + per_value * spikes, size.responses + 2 * spikes)


def _first(order: Ints, lengths: Ints, n: int) -> tuple[Ints, Ints]:
    """Return `order` and `lengths` limited to the first `n` spikes of each frame; 0 for no limit."""
    if not n:
        return order, lengths
    rank = np.arange(len(order)) - np.repeat(np.cumsum(lengths) - lengths, lengths)
    return order[rank < n], np.minimum(lengths, n)


Encoder.known = Registry("encoder", (LogLatency, Latency))


@dataclass(frozen=True, slots=True, eq=False)
class Frames:
    """Spikes of all frames of some recordings.

    Attributes:
        codes: (spikes,) codes, from which an encoder computes the times.
        ids: (spikes,) indices of the inputs.
        offsets: (frames + 1,) indices; frame i has the spikes ``[offsets[i], offsets[i + 1])``.
        recording: (frames,) index of the recording of each frame, ascending.
    """

    codes: Array
    ids: Array
    offsets: Ints
    recording: Ints

    @classmethod
    def of(cls, features: Features) -> Self:
        """Collect the frames from evidence with ``codes``, ``ids`` and ``lengths``, the number of spikes per frame."""
        lengths = features.column("lengths")
        recording = np.repeat(np.arange(len(features)), np.diff(lengths.offsets))
        codes, ids = (features.column(name).values for name in ("codes", "ids"))
        offsets = np.concatenate(([0], np.cumsum(lengths.values, dtype=np.int64)))
        return cls(codes, ids, offsets, recording)

    def __len__(self) -> int:
        """The number of frames."""
        return len(self.recording)

    def take(self, frames: Ints) -> Self:
        """Return some of the frames, in the given order."""
        lengths = np.diff(self.offsets)[frames]
        offsets = np.concatenate(([0], np.cumsum(lengths, dtype=np.int64)))
        indices = np.repeat(self.offsets[frames] - offsets[:-1], lengths) + np.arange(offsets[-1])
        return type(self)(self.codes[indices], self.ids[indices], offsets, self.recording[frames])


def ended_by(evidence: Evidence, us: int) -> Evidence:
    """Return the evidence of frames that were complete `us` after the first event."""
    n = int(np.searchsorted(evidence["ends"], us, "right"))
    spikes = int(evidence["lengths"][:n].sum())
    per_frame, per_spike = ("lengths", "ends", "pixels"), ("codes", "ids")
    last_events = {name: np.minimum(evidence[name], us) for name in ("lasts",) if name in evidence}
    per_frame_parts = {name: evidence[name][:n] for name in per_frame if name in evidence}
    return per_frame_parts | {name: evidence[name][:spikes] for name in per_spike} | last_events


VOTES = ("majority", "potentials")


def votes(
    results: TrialResults, recording: Ints, recordings: int, classes: int, mean_over_maps: bool = False
) -> dict[str, Floats]:
    """Compute scores of recordings from their frames, by each rule of `VOTES`.

    Args:
        results: trials of all frames.
        recording: (frames,) index of the recording of each frame.
        recordings: number of recordings; some may have no frames.
        classes: number of classes. Each class has equally many maps (neurons that share a kernel). The maps of a class
            are stored one after the other.
        mean_over_maps: whether the potential of a class is the mean over its maps instead of the largest.

    Returns:
        (recordings, classes) scores by the name of the rule. A row is NaN if no frame supports any class.
    """
    decided = results.label >= 0
    wins = np.zeros((recordings, classes))
    np.add.at(wins, (recording[decided], results.label[decided]), 1.0)
    sums = np.zeros((recordings, classes))
    per_class = results.potential.shape[1] // classes
    class_potentials = results.potential.reshape(-1, classes, per_class)
    np.add.at(sums, recording, class_potentials.mean(axis=2) if mean_over_maps else class_potentials.max(axis=2))
    return {"majority": majority(wins, sums), "potentials": potentials(sums)}


def majority(wins: Floats, sums: Floats) -> Floats:
    """Return the number of frames that each class won, plus a fraction below 1 that breaks ties.

    Args:
        wins: (recordings, classes) number of frames.
        sums: (recordings, classes) values that break ties; with equal sums the first class leads.

    Returns:
        (recordings, classes); a row is NaN if no class won a frame. E.g. wins [2, 2, 1] and sums [1, 3, 2] give
        [2, 2.67, 1.33].
    """
    ranks = np.argsort(np.argsort(-sums, axis=1, kind="stable"), axis=1)
    votes = wins + 1.0 - (ranks + 1.0) / sums.shape[1]
    return np.where(wins.any(axis=1, keepdims=True), votes, np.nan)


def potentials(sums: Floats) -> Floats:
    """Return the sums as scores, with rows of zeros replaced by NaN.

    Args:
        sums: (recordings, classes) potential of a class at the decision, summed over the frames, mV.

    Returns:
        (recordings, classes); a row is NaN if no map of any class received a spike.
    """
    return np.where(sums.any(axis=1, keepdims=True), sums, np.nan)
