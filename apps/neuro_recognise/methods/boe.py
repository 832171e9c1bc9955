"""BOE, bag of events: each segment of a recording is described by the share of its events at each pixel."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from neuro.apps import part
from neuro.events import Events
from neuro_recognise.method import Answer, Course, Learnt, Method, Pictures, View
from neuro_recognise.parts.cleaners import Cleaner, Plain
from neuro_recognise.parts.readouts import Readout, Svm
from neuro_recognise.parts.segmenters import Msd, Segmenter
from neuro_recognise.shown import Evidence, Features, Floats, Ints

if TYPE_CHECKING:
    from scipy.sparse import csr_matrix


@dataclass(frozen=True)
class Boe(Method):
    """Segments as bags of events and a linear support vector machine, whose values are summed over a recording.

    Attributes:
        cleaner: what is done to events first.
        segmenter: cuts a recording.
        readout: decides each segment.
    """

    title = "bags of events"
    source = "Peng et al., IEEE TNNLS 28:791, 2017; thesis 6.1.3, eqs 117-118 (the printed sign of w is turned)"
    needs = "recognise"
    presets = {"tar": {"cleaner": "tar"}, "poker": {"size": [35, 35]}}
    measured = {"N-MNIST": "79.8 %", "POKER-DVS": "87.4 %"}

    cleaner: Cleaner = part(Cleaner, Plain())
    segmenter: Segmenter = part(Segmenter, Msd())
    readout: Readout = part(Readout, Svm(C=1.0, scale="none"))

    def observing(self) -> Mapping[str, Any]:
        """All but the readout."""
        return {name: value for name, value in self.as_words().items() if name != "readout"}

    def observe(self, events: Events) -> Evidence:
        """The pixel of each event, and how many events each segment has; a recording too short for one is one."""
        seen, bounds = self._cut(events)
        pixels = (seen.y.astype(np.int64) * self.size[0] + seen.x)[bounds[0] : bounds[-1]]
        return {"pixels": pixels.astype(np.uint32), "lengths": np.diff(bounds)}

    def fit(self, shown: Features, course: Course) -> Learnt:
        """Weigh pixels by how few segments they have events in, and teach the readout segment by segment."""
        shares, recording = self._shares(shown)
        n = shares.shape[0]
        special = np.log(n / np.maximum(np.bincount(shares.indices, minlength=shares.shape[1]), 1))
        special /= np.sqrt(shares.multiply(special).power(2).sum() / n) or 1.0  # segments of length 1: C is of these
        taught = self.readout.fit(self._weighed(shares, special), shown.labels[recording], len(shown.classes), course)
        return {"speciality": special, **taught}

    def answer(self, learnt: Learnt, shown: Features, backend: str = "event") -> Answer:
        """The mean of what the readout says of the segments."""
        shares, recording = self._shares(shown)
        of_segments = self.readout.scores(learnt, self._weighed(shares, learnt["speciality"]))
        sums: Floats = np.zeros((len(shown), len(shown.classes)))
        np.add.at(sums, recording, of_segments)
        segments = np.bincount(recording, minlength=len(shown))[:, None]
        return Answer(np.divide(sums, segments, out=np.full_like(sums, np.nan), where=segments > 0))

    def views(self, events: Events, learnt: Learnt, classes: Sequence[str]) -> Sequence[View]:
        """The events of each segment, from its end on."""
        (seen, bounds), (width, height) = self._cut(events), self.size
        images = np.zeros((len(bounds) - 1, height, width), np.int64)
        for image, begin, end in zip(images, bounds[:-1], bounds[1:], strict=True):
            np.add.at(image, (seen.y[begin:end], seen.x[begin:end]), 1)
        at_ms = (seen.t[bounds[1:] - 1] - events.t[0]) / 1000.0
        return [Pictures("Segments", at_ms, images)]

    def _weighed(self, shares: csr_matrix, special: Any) -> Any:
        """What the readout is given: sparse where it can be."""
        weighed = shares.multiply(special).tocsr()
        return weighed if self.readout.takes_sparse else weighed.toarray()

    def _cut(self, events: Events) -> tuple[Events, Ints]:
        """The events that are left of a recording, and the bounds of its segments; one too short for one is one."""
        seen = self.cleaner.clean(self.inside(events))
        bounds = self.segmenter.bounds(seen.t)
        return seen, np.array([0, len(seen)]) if len(bounds) == 1 and len(seen) else bounds

    def _shares(self, shown: Features) -> tuple[csr_matrix, Any]:
        """(segments, pixels) share of each segment's events; and (segments,) the recording of each."""
        from scipy.sparse import csr_matrix

        pixels, lengths = shown.column("pixels"), shown.column("lengths")
        recording = np.repeat(np.arange(len(shown)), np.diff(lengths.offsets))
        starts = np.concatenate(([0], np.cumsum(lengths.values))).astype(np.int64)
        share = np.repeat(1.0 / np.maximum(lengths.values, 1), lengths.values)
        wide = (len(lengths.values), self.size[0] * self.size[1])
        found = csr_matrix((share, pixels.values.astype(np.int64), starts), shape=wide)
        found.sum_duplicates()
        return found, recording
