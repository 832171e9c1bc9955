"""TAR-HATS: HATS after the filter TAR, which stands in for its memory of all events."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from neuro.events import Events
from neuro_recognise.cleaners import Cleaner, Tar
from neuro_recognise.methods.hats import Hats
from neuro_recognise.settings import part
from neuro_recognise.shown import Floats

NEVER = -(1 << 53)
"""us; so long ago that nothing is left of it."""


@dataclass(frozen=True)
class TarHats(Hats):
    """Each event sees when the last event came at each pixel round it; what events see is averaged over cells."""

    title = "HATS without memory behind the filter TAR"
    source = "thesis B.4; Sironi et al., CVPR 2018; the thesis leaves open what is in place of the memory"

    cleaner: Cleaner = part(Cleaner, Tar())

    @classmethod
    def called(cls) -> str:
        """``tar_hats``."""
        return "tar_hats"

    def describe(self, events: Events) -> Floats:
        """The histograms of all cells, (rows, columns, 2, side, side), in a row."""
        from neuro_recognise.methods._surface_kernels import last_surfaces

        left = self.cleaner.clean(events)
        (width, height), side = self.size, 2 * self.radius + 1
        rows, columns = -(-height // self.cell), -(-width // self.cell)
        sums, counts = np.zeros((rows, columns, 2, side, side)), np.zeros((rows, columns), np.int64)
        last = np.full((2, height + side - 1, width + side - 1), NEVER)
        last_surfaces(left.t, left.x, left.y, left.p, self.cell, 1000.0 * self.tau, last, sums, counts)
        found: Floats = (sums / np.maximum(counts, 1)[:, :, None, None, None]).ravel()
        return found
