"""HATS: histograms of averaged time surfaces, and a linear support vector machine."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from neuro.apps import part, setting
from neuro.events import Events, representations
from neuro_recognise.method import Course, Drawings, Growing, Grows, Learnt, Observer, Pictures, View
from neuro_recognise.methods.descriptor import Descriptor
from neuro_recognise.parts.readouts import Readout, Svm
from neuro_recognise.shown import Array, Features, Floats

VIEW_US = 10_000
"""us; from picture to picture of what is seen."""


@dataclass(frozen=True)
class Hats(Descriptor):
    """Each event sees its surroundings in the last 100 ms; what events see is averaged over cells of pixels."""

    title = "histograms of averaged time surfaces"
    source = "Sironi et al., CVPR 2018, section 4"
    presets = {"poker": {"size": [35, 35], "cell": 12, "tau": 10.0}}
    measured = {"N-MNIST": "95.1 %", "POKER-DVS": "94.6 %"}

    cell: int = setting(0, "px", "side of a cell; 0: a fifth of the field", "best of 5, 7, 9 on N-MNIST", at_least=0)
    radius: int = setting(3, "px", "of an event's surroundings", "the paper's for N-CARS", at_least=0)
    tau: float = setting(100.0, "ms", "decay and length of what is remembered", "the paper's for N-CARS", above=0)

    readout: Readout = part(Readout, Svm(C=10.0, scale="length"))

    def fitting(self, size: tuple[int, int]) -> Self:
        """Cells that follow from the field."""
        settled = super().fitting(size)
        return settled if self.cell else replace(settled, cell=max(1, round(max(settled.size) / 5)))

    def grown(self) -> Grows:
        """The histograms of all cells, (rows, columns, 2, side, side), of no events yet."""
        tau_us = round(1000.0 * self.tau)
        return representations.Hats(self.size, cell=self.cell, radius=self.radius, window_us=tau_us, tau_us=tau_us)

    def describe(self, events: Events) -> Floats:
        """The histograms of all cells in a row."""
        grown = self.grown()
        grown.add(events)
        return grown.histograms().ravel().astype(np.float64)

    def fit(self, shown: Features, course: Course) -> Learnt:
        """Teach the readout; ``averages`` (classes, values) of what recordings show are kept for pictures."""
        sums = np.zeros((len(shown.classes), len(shown.evidence[0]["vector"])))
        for label, one in zip(shown.labels.tolist(), shown.evidence, strict=True):
            sums[label] += one["vector"]
        counts = np.bincount(shown.labels, minlength=len(sums))[:, None]
        return {**super().fit(shown, course), "averages": sums / np.maximum(counts, 1)}

    def pictures(self, learnt: Learnt, classes: Sequence[str]) -> Drawings:
        """The average of each class, both polarities together."""
        from neuro_recognise.telling.pictures import images

        drawn = [_sheet(one) for one in np.asarray(learnt["averages"]).reshape(-1, *self.grown().histograms().shape)]
        about = "in each cell what its events see round them, mean of the recordings"
        return {"averages": images(np.array(drawn), classes, "The time surfaces of the classes", about)}

    def observer(self) -> Observer:
        """Sums and counts that grow."""
        return Growing(self, self.grown())

    def views(self, events: Events, learnt: Learnt, classes: Sequence[str]) -> Sequence[View]:
        """The histograms of all cells beside each other, of both polarities together, every 10 ms."""
        times = VIEW_US * np.arange(1, 1 + -(-int(events.t[-1] - events.t[0]) // VIEW_US))
        grown, images, begin = self.grown(), [], 0
        for end in np.searchsorted(events.t, events.t[0] + times, "right").tolist():
            grown.add(self.within(events[begin:end]))
            begin = end
            images.append(_sheet(grown.histograms()))
        return [Pictures("What it sees", times / 1000.0, np.array(images))] if images else []


def _sheet(histograms: Array) -> Array:
    """Histograms (rows, columns, 2, side, side) of cells beside each other, both polarities together."""
    cells = histograms.sum(axis=2)
    rows, columns, side, _ = cells.shape
    sheet: Array = cells.transpose(0, 2, 1, 3).reshape(rows * side, columns * side)
    return sheet
