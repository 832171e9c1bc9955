"""HATS: histograms of averaged time surfaces, and a linear support vector machine."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from neuro.events import Events, representations
from neuro_recognise.methods.descriptor import Descriptor
from neuro_recognise.observers import Growing, Grows, Observer
from neuro_recognise.settings import setting
from neuro_recognise.shown import Floats


@dataclass(frozen=True)
class Hats(Descriptor):
    """Each event sees its surroundings in the last 100 ms; what events see is averaged over cells of pixels."""

    title = "histograms of averaged time surfaces"
    source = "Sironi et al., CVPR 2018, section 4"
    presets = {"poker": {"cell": 12, "tau": 10.0}}

    cell: int = setting(0, "px", "side of a cell; 0: a fifth of the larger side", "best of 5, 7, 9 on N-MNIST's 34 px")
    radius: int = setting(3, "px", "of an event's surroundings", "the paper's for N-CARS", at_least=0)
    tau: float = setting(
        100.0, "ms", "decay of what is remembered, and how long it is", "the paper's for N-CARS", above=0
    )

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

    def observer(self) -> Observer:
        """Sums and counts that grow."""
        return Growing(self, self.grown())
