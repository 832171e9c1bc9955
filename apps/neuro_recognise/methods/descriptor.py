"""Methods that describe a recording or its segments by a vector, and classify the vector: HATS, TAR-HATS and BOE.

None of the methods has a network. Only the readout learns.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from neuro.apps import kernel, part, setting
from neuro_events import Events, representations
from neuro_recognise.method import Answer, Course, Drawings, Growing, Grows, Learnt, Method, Observer, Pictures, View
from neuro_recognise.parts.readouts import Readout, Svm
from neuro_recognise.parts.segmenters import Cleaner, Msd, Plain, Segmenter, Tar
from neuro_recognise.shown import Array, Evidence, Features, Floats, Ints

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix


@dataclass(frozen=True)
class Descriptor(Method):
    """Base of the methods that describe a recording by a vector.

    Attributes:
        readout: classifier of the vectors.
    """

    needs = "recognise"
    by_moment = True
    unobserved = ("readout",)

    readout: Readout = part(Readout, Svm())

    @abstractmethod
    def describe(self, events: Events) -> Floats:
        """Return the vector of a recording inside the field, (values,)."""

    def observe(self, events: Events) -> Evidence:
        """Return the vector."""
        return {"vector": self.describe(self.inside(events)).astype(np.float32)}

    def fit(self, features: Features, course: Course) -> Learnt:
        """Train the readout."""
        return self.readout.fit(
            features.stacked("vector").astype(np.float64), features.labels, len(features.classes), course
        )

    def answer(self, learnt: Learnt, features: Features, backend: str = "event") -> Answer:
        """Compute the scores of the readout. A recording without events is silent."""
        x = features.stacked("vector").astype(np.float64)
        return Answer(np.where(x.any(axis=1, keepdims=True), self.readout.scores(learnt, x), np.nan))


VIEW_US = 10_000
"""Time between images of `Hats.views`, us."""


@dataclass(frozen=True)
class Hats(Descriptor):
    """Histograms of averaged time surfaces (HATS): surfaces of the last 100 ms, averaged over cells."""

    title = "histograms of averaged time surfaces"
    source = "Sironi et al., CVPR 2018, section 4"
    presets = {"poker": {"size": [35, 35], "cell": 12, "tau": 10.0}}
    measured = {"N-MNIST": "95.1 %", "POKER-DVS": "94.6 %"}

    cell: int = setting(0, "px", "side of a cell; 0: a fifth of the field", "best of 5, 7, 9 on N-MNIST", at_least=0)
    radius: int = setting(3, "px", "radius of a time surface", "the paper's for N-CARS", at_least=0)
    tau: float = setting(
        100.0, "ms", "time constant of the decay, and length of the memory", "the paper's for N-CARS", above=0
    )

    readout: Readout = part(Readout, Svm(C=10.0, scale="length"))

    def fitting(self, size: tuple[int, int]) -> Self:
        """Fill in the cell size that follows from the field."""
        settled = super().fitting(size)
        return settled if self.cell else replace(settled, cell=max(1, round(max(settled.size) / 5)))

    def grown(self) -> Grows:
        """Return an empty description, with histograms of all cells (rows, columns, 2, side, side)."""
        tau_us = round(1000.0 * self.tau)
        return representations.Hats(self.size, cell=self.cell, radius=self.radius, window_us=tau_us, tau_us=tau_us)

    def describe(self, events: Events) -> Floats:
        """Return the histograms of all cells as one vector."""
        description = self.grown()
        description.add(events)
        return description.histograms().ravel().astype(np.float64)

    def fit(self, features: Features, course: Course) -> Learnt:
        """Train the readout, and store the ``averages`` (classes, values) of the vectors for pictures."""
        sums = np.zeros((len(features.classes), len(features.evidence[0]["vector"])))
        for label, item in zip(features.labels.tolist(), features.evidence, strict=True):
            sums[label] += item["vector"]
        counts = np.bincount(features.labels, minlength=len(sums))[:, None]
        return {**super().fit(features, course), "averages": sums / np.maximum(counts, 1)}

    def pictures(self, learnt: Learnt, classes: Sequence[str]) -> Drawings:
        """Draw the average of each class, summed over polarities."""
        from neuro_recognise.telling.pictures import images

        sheets = [_sheet(mean) for mean in np.asarray(learnt["averages"]).reshape(-1, *self.grown().histograms().shape)]
        caption = "average time surface of the events in each cell, mean over recordings"
        return {"averages": images(np.array(sheets), classes, "The time surfaces of the classes", caption)}

    def observer(self) -> Observer:
        """Return an observer that updates sums and counts."""
        return Growing(self, self.grown())

    def views(self, events: Events, learnt: Learnt, classes: Sequence[str]) -> Sequence[View]:
        """Return the histograms of all cells, summed over polarities, every 10 ms."""
        times = VIEW_US * np.arange(1, 1 + -(-int(events.t[-1] - events.t[0]) // VIEW_US))
        description, images, begin = self.grown(), [], 0
        for end in np.searchsorted(events.t, events.t[0] + times, "right").tolist():
            description.add(self.within(events[begin:end]))
            begin = end
            images.append(_sheet(description.histograms()))
        return [Pictures("What it sees", times / 1000.0, np.array(images))] if images else []


def _sheet(histograms: Array) -> Array:
    """Arrange histograms (rows, columns, 2, side, side) of cells as one image, summed over polarities."""
    cells = histograms.sum(axis=2)
    rows, columns, side, _ = cells.shape
    return np.asarray(cells.transpose(0, 2, 1, 3).reshape(rows * side, columns * side))


NEVER = -(1 << 53)
"""Time of the last event of a pixel without events, us; its decayed value is 0."""


@dataclass(frozen=True)
class TarHats(Hats):
    """HATS behind the filter TAR, with surfaces of the last event at each pixel and no memory of earlier events."""

    known_as = "tar_hats"
    title = "HATS without memory behind the filter TAR"
    source = "thesis B.4; Sironi et al., CVPR 2018; the thesis does not say what replaces the memory"
    measured = {"N-MNIST": "95.2 %", "POKER-DVS": "97.7 %"}

    cleaner: Cleaner = part(Cleaner, Tar())

    def grown(self) -> Grows:
        """Return an empty description, with histograms of all cells (rows, columns, 2, side, side)."""
        return _LastSurfaces(self)


class _LastSurfaces:
    """Time surfaces of the last events, averaged over cells and updated event by event."""

    def __init__(self, method: TarHats) -> None:
        (width, height), cell, side = method.size, method.cell, 2 * method.radius + 1
        rows, columns = -(-height // cell), -(-width // cell)
        self._cell, self._tau_us, self._sieve = cell, 1000.0 * method.tau, method.cleaner.new_filter(method.size)
        self._last = np.full((2, height + side - 1, width + side - 1), NEVER)
        self._sums, self._counts = np.zeros((rows, columns, 2, side, side)), np.zeros((rows, columns), np.int64)

    def add(self, events: Events) -> None:
        """Add the next events after filtering."""
        filtered = self._sieve(events)
        state = (self._last, self._sums, self._counts)
        last_surfaces(filtered.t, filtered.x, filtered.y, filtered.p, self._cell, self._tau_us, *state)

    def histograms(self) -> Floats:
        """Return means over the events of each cell."""
        return np.asarray(self._sums / np.maximum(self._counts, 1)[:, :, None, None, None])


@kernel
def last_surfaces(
    t: Ints, x: Array, y: Array, p: Array, cell: int, tau_us: float, last: Ints, sums: Floats, counts: Ints
) -> None:
    """Add the time surface of each event to its cell.

    The surface is exp(-age / tau) of the last event of the same polarity at each pixel around the event.

    t: int64[n]; x, y: uint16[n]; p: uint8[n]; last: int64[2, height + 2 radius, width + 2 radius], time of the last
    event, or `NEVER`; sums: float64[rows, columns, 2, side, side]; counts: int64[rows, columns]. The surface of an
    event includes the event itself.
    """
    side = sums.shape[3]
    radius = side // 2
    for k in range(len(t)):
        last[p[k], y[k] + radius, x[k] + radius] = t[k]
        total = sums[y[k] // cell, x[k] // cell, p[k]]
        counts[y[k] // cell, x[k] // cell] += 1
        for i in range(side):
            for j in range(side):
                age = t[k] - last[p[k], y[k] + i, x[k] + j]
                total[i, j] += math.exp(-age / tau_us)


@dataclass(frozen=True)
class Boe(Method):
    """Segments as bags of events, and a linear support vector machine. Scores are averaged over a recording's segments.

    Attributes:
        cleaner: filter of events.
        segmenter: rule that cuts a recording into segments.
        readout: classifier of segments.
    """

    title = "bags of events"
    source = "Peng et al., IEEE TNNLS 28:791, 2017; thesis 6.1.3, eqs 117-118 (the printed sign of w is turned)"
    needs = "recognise"
    unobserved = ("readout",)
    presets = {"tar": {"cleaner": "tar"}, "poker": {"size": [35, 35]}}
    measured = {"N-MNIST": "79.8 %", "POKER-DVS": "87.4 %"}

    cleaner: Cleaner = part(Cleaner, Plain())
    segmenter: Segmenter = part(Segmenter, Msd())
    readout: Readout = part(Readout, Svm(C=1.0, scale="none"))

    def observe(self, events: Events) -> Evidence:
        """Return the pixel of each event and the number of events per segment.

        A recording without a complete segment is a single segment.
        """
        filtered, bounds = self._cut(events)
        pixels = (filtered.y.astype(np.int64) * self.size[0] + filtered.x)[bounds[0] : bounds[-1]]
        return {"pixels": pixels.astype(np.uint32), "lengths": np.diff(bounds)}

    def fit(self, features: Features, course: Course) -> Learnt:
        """Weight each pixel more if fewer segments have events there, and train the readout on segments."""
        shares, recording = self._shares(features)
        n = shares.shape[0]
        special = np.log(n / np.maximum(np.bincount(shares.indices, minlength=shares.shape[1]), 1))
        special /= np.sqrt(shares.multiply(special).power(2).sum() / n) or 1.0  # C assumes a mean squared length of 1
        trained = self.readout.fit(
            self._weighed(shares, special), features.labels[recording], len(features.classes), course
        )
        return {"speciality": special, **trained}

    def answer(self, learnt: Learnt, features: Features, backend: str = "event") -> Answer:
        """Average the readout's scores over the segments."""
        shares, recording = self._shares(features)
        segment_scores = self.readout.scores(learnt, self._weighed(shares, learnt["speciality"]))
        sums: Floats = np.zeros((len(features), len(features.classes)))
        np.add.at(sums, recording, segment_scores)
        segments = np.bincount(recording, minlength=len(features))[:, None]
        return Answer(np.divide(sums, segments, out=np.full_like(sums, np.nan), where=segments > 0))

    def views(self, events: Events, learnt: Learnt, classes: Sequence[str]) -> Sequence[View]:
        """Return the events of each segment, shown from its end on."""
        (filtered, bounds), (width, height) = self._cut(events), self.size
        images = np.zeros((len(bounds) - 1, height, width), np.int64)
        for image, begin, end in zip(images, bounds[:-1], bounds[1:], strict=True):
            np.add.at(image, (filtered.y[begin:end], filtered.x[begin:end]), 1)
        end_ms = (filtered.t[bounds[1:] - 1] - events.t[0]) / 1000.0
        return [Pictures("Segments", end_ms, images)]

    def _weighed(self, shares: csr_matrix, special: Any) -> Any:
        """Return the weighted shares, as a sparse matrix if the readout supports it."""
        weighed = shares.multiply(special).tocsr()
        return weighed if self.readout.takes_sparse else weighed.toarray()

    def _cut(self, events: Events) -> tuple[Events, Ints]:
        """Filter a recording, and return its events and the bounds of its segments.

        A recording without a complete segment is a single segment.
        """
        filtered = self.cleaner.clean(self.inside(events))
        bounds = self.segmenter.bounds(filtered.t)
        return filtered, np.array([0, len(filtered)]) if len(bounds) == 1 and len(filtered) else bounds

    def _shares(self, features: Features) -> tuple[csr_matrix, Any]:
        """Return the share of each segment's events per pixel, (segments, pixels), and each segment's recording."""
        from scipy.sparse import csr_matrix

        pixels, lengths = features.column("pixels"), features.column("lengths")
        recording = np.repeat(np.arange(len(features)), np.diff(lengths.offsets))
        starts = np.concatenate(([0], np.cumsum(lengths.values))).astype(np.int64)
        share = np.repeat(1.0 / np.maximum(lengths.values, 1), lengths.values)
        wide = (len(lengths.values), self.size[0] * self.size[1])
        shares = csr_matrix((share, pixels.values.astype(np.int64), starts), shape=wide)
        shares.sum_duplicates()
        return shares, recording
