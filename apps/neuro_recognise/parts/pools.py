"""Layer C1: which responses of the filters are passed on."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from neuro.apps import Registry
from neuro_recognise.settings import Part, setting
from neuro_recognise.shown import Floats

__all__ = ["LocalMaximum", "Max", "Pool"]


@dataclass(frozen=True)
class Pool(Part):
    """Base of the pools. Of each cell of `side` x `side` px the bank gives the largest response."""

    kind = "pool"

    side: int = setting(2, "px", "of the cells", "thesis 6.2.2, line 2366", at_least=1)

    @abstractmethod
    def passed(self, responses: Floats, sizes: Sequence[int]) -> Floats:
        """Responses that are passed on, the others 0.

        Args:
            responses: (frames, scales, orientations, rows, columns) of cells.
            sizes: sides of the filters of each scale, px.
        """


@dataclass(frozen=True)
class Max(Pool):
    """The largest response of each cell."""

    source = "thesis 6.2.2, lines 2363-2370"

    def passed(self, responses: Floats, sizes: Sequence[int]) -> Floats:
        """All of them."""
        return responses


@dataclass(frozen=True)
class LocalMaximum(Pool):
    """Responses that are the largest under their filter."""

    source = "Zhao et al., IEEE TNNLS 26:1963, 2015, section III-A"

    side: int = setting(1, "px", "of the cells", "none in the paper", at_least=1)
    least: float = setting(0.2, "", "below which none is passed on", "MK-Tempotron, top_onN_MNIST.m", at_least=0)

    @classmethod
    def called(cls) -> str:
        """``local_maximum``."""
        return "local_maximum"

    def passed(self, responses: Floats, sizes: Sequence[int]) -> Floats:
        """Those at least `least` that no other of their orientation and scale exceeds, half a filter around."""
        from scipy.ndimage import maximum_filter

        highest = np.empty_like(responses)
        for scale, size in enumerate(sizes):
            around = 2 * (size // 2 // self.side) + 1
            highest[:, scale] = maximum_filter(responses[:, scale], (1, 1, around, around), mode="constant")
        return np.where((responses >= self.least) & (responses == highest), responses, 0.0)


Pool.known = Registry("pool", (Max, LocalMaximum))
