"""Layer C1: which responses of the filters are passed on."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

from neuro.apps import Registry
from neuro_recognise.settings import Part, setting
from neuro_recognise.shown import Floats

__all__ = ["Max", "Pool"]


@dataclass(frozen=True)
class Pool(Part):
    """Base of the pools. Of each cell of `side` x `side` px the bank gives the largest response."""

    kind = "pool"

    side: int = setting(2, "px", "of the cells", "thesis 6.2.2, line 2366", at_least=1)

    @abstractmethod
    def passed(self, responses: Floats) -> Floats:
        """Responses that are passed on, the others 0; (frames, scales, orientations, rows, columns) as given."""


@dataclass(frozen=True)
class Max(Pool):
    """The largest response of each cell."""

    source = "thesis 6.2.2, lines 2363-2370"

    def passed(self, responses: Floats) -> Floats:
        """All of them."""
        return responses


Pool.known = Registry("pool", (Max,))
