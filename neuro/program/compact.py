"""Projections whose synapses take few bytes, and whose arrays a backend may have in place of the program."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import fields
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.memory import discard
from neuro.program.program import Floats, Projection, StoredSynapses

_PIECE = 1 << 16
"""Weights that are looked at together: most that do not fit show it at once."""


def is_single(weights: NDArray[np.floating[Any]]) -> bool:
    """Whether all weights fit into 32 bits as they are."""
    if weights.dtype == np.float32:
        return True
    pieces = (weights[k : k + _PIECE] for k in range(0, weights.size, _PIECE))
    return all(np.array_equal(piece.astype(np.float32), piece) for piece in pieces)


class CompactProjection(Projection):
    """A projection that keeps targets in 16 bits and weights in 32 where all fit, exactly.

    `targets`, `weight` and `delay` are arrays of the types of any projection, a copy at each access. `release` lets a
    backend take the arrays' place, which has the synapses in an order of its own.
    """

    __slots__ = ("_again", "_kept", "kinds")

    _kept: dict[str, NDArray[Any]]
    _again: Callable[[], StoredSynapses] | None
    kinds: dict[str, np.dtype[Any]]
    """The types in which targets, weights and delays are kept; no weights where all share one."""

    @classmethod
    def of(cls, part: Projection) -> CompactProjection:
        """The same projection in few bytes."""
        return cls(**{entry.name: getattr(part, entry.name) for entry in fields(part)})

    @property
    def has_arrays(self) -> bool:
        """Whether it has arrays of its own: nobody has taken their place."""
        return self._again is None

    def stored(self) -> StoredSynapses:
        """Targets, weights and delays in the types in which they are kept."""
        if self._again is None:
            return self._kept["targets"], self._kept["weight"], self._kept["delay"]
        targets, weight, delay = self._again()
        return targets, self._kept.get("weight", weight), delay

    def release(self, again: Callable[[], StoredSynapses]) -> None:
        """Free all arrays with a value for each synapse; `again` makes them anew, in the same order and types."""
        shared = {} if "weight" in self.kinds else {"weight": self._kept["weight"]}
        object.__setattr__(self, "_kept", shared)
        object.__setattr__(self, "_again", again)

    def discard(self, first: int, last: int) -> None:
        """Give back the memory of the synapses of the sources first:last, before `release` is called for all."""
        for name in self.kinds if self.has_arrays else ():
            discard(self._kept[name], int(self.row_ends[first]), int(self.row_ends[last]))

    def _keep(self, name: str, values: NDArray[Any]) -> None:
        if name == "targets":  # the first of the three that is set
            for attribute, empty in (("_kept", {}), ("kinds", {}), ("_again", None)):
                object.__setattr__(self, attribute, empty)
        self._kept[name] = values
        if name != "weight" or values.size > 1:
            self.kinds[name] = values.dtype

    def _keep_targets(self, values: NDArray[np.int32]) -> None:
        self._keep("targets", values.astype(np.uint16) if values.max(initial=0) < 1 << 16 else values)

    def _keep_weight(self, values: Floats) -> None:
        self._keep("weight", values.astype(np.float32, copy=False) if values.size > 1 and is_single(values) else values)

    targets = property(lambda self: self.stored()[0].astype(np.int32), _keep_targets)
    weight = property(lambda self: self.stored()[1].astype(np.float64), _keep_weight)
    delay = property(lambda self: self.stored()[2].copy(), lambda self, values: self._keep("delay", values))
