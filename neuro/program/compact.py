"""Projections that take few bytes, and whose arrays a backend may have in place of the program."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.memory import discard
from neuro.program.program import Ints, Projection, StoredSynapses

_PIECE = 1 << 16
"""Weights that are looked at together: most that do not fit show it at once."""

_ARRAYS = ("targets", "weight", "delay")


def is_single(weights: NDArray[np.floating[Any]]) -> bool:
    """Whether all weights fit into 32 bits as they are."""
    if weights.dtype == np.float32:
        return True
    pieces = (weights[k : k + _PIECE] for k in range(0, weights.size, _PIECE))
    return all(np.array_equal(piece.astype(np.float32), piece) for piece in pieces)


def _short(targets: NDArray[np.integer[Any]]) -> NDArray[np.integer[Any]]:
    """Targets in 16 bits, if all fit."""
    return targets.astype(np.uint16, copy=False) if targets.max(initial=0) < 1 << 16 else targets


def _single(weights: NDArray[np.floating[Any]]) -> NDArray[np.floating[Any]]:
    """Weights in 32 bits, if these are several and all fit."""
    return weights.astype(np.float32, copy=False) if weights.size > 1 and is_single(weights) else weights


@dataclass(frozen=True, slots=True, eq=False)
class SynapseBlock:
    """Synapses of a projection onto some neighbouring targets.

    Attributes:
        row_ends: those of source i are row_ends[i] : row_ends[i + 1], targets ascending; of a projection of one block
            in its order.
        targets, weight, delay: as of `Projection`, in the types in which they are kept.
    """

    row_ends: Ints
    targets: NDArray[np.integer[Any]]
    weight: NDArray[np.floating[Any]]
    delay: NDArray[np.integer[Any]]

    @classmethod
    def of(
        cls,
        row_ends: Ints,
        targets: NDArray[np.integer[Any]],
        weight: NDArray[np.floating[Any]],
        delay: NDArray[np.integer[Any]],
    ) -> SynapseBlock:
        """The same synapses in few bytes."""
        return cls(row_ends, _short(targets), _single(weight), delay)


class CompactProjection(Projection):
    """A projection that keeps targets in 16 bits and weights in 32 where all fit, exactly.

    `targets`, `weight` and `delay` are arrays of the types of any projection, a copy at each access. `release` lets a
    backend take the arrays' place, which has the synapses in an order of its own.
    """

    __slots__ = ("_again", "_blocks", "_kept", "kinds")

    _kept: dict[str, NDArray[Any]]
    _blocks: tuple[SynapseBlock, ...]
    _again: Callable[[], StoredSynapses] | None
    kinds: dict[str, np.dtype[Any]]
    """The types in which targets, weights and delays are kept; no weights where all share one."""

    @classmethod
    def of(cls, part: Projection) -> CompactProjection:
        """The same projection in few bytes."""
        return cls(**{entry.name: getattr(part, entry.name) for entry in fields(part)})

    @classmethod
    def of_blocks(
        cls,
        part: Projection,
        blocks: Sequence[SynapseBlock],
        together: Callable[[Sequence[SynapseBlock]], StoredSynapses],
    ) -> CompactProjection:
        """A projection whose synapses stay in blocks until someone asks for them in order.

        Args:
            part: what else it has; its targets and delays are empty, and its weights if they are not shared.
            blocks: the synapses, in the order of their targets.
            together: puts the synapses of blocks in order.
        """
        kinds = {
            name: np.result_type(*(getattr(block, name) for block in blocks))
            for name in _ARRAYS
            if getattr(part, name).size == 0
        }
        alike = tuple(
            replace(block, **{name: getattr(block, name).astype(kind, copy=False) for name, kind in kinds.items()})
            for block in blocks
        )
        found = cls.of(part)
        object.__setattr__(found, "kinds", kinds)
        found.release(partial(together, alike))
        object.__setattr__(found, "_blocks", alike)
        return found

    @property
    def has_arrays(self) -> bool:
        """Whether it has arrays of its own: nobody has taken their place."""
        return self._again is None or bool(self._blocks)

    @property
    def blocks(self) -> tuple[SynapseBlock, ...]:
        """The synapses as they were drawn, or in order as one block."""
        return self._blocks or (SynapseBlock(self.row_ends, *self.stored()),)

    def stored(self) -> StoredSynapses:
        """Targets, weights and delays in the types in which they are kept."""
        if self._again is None:
            return self._kept["targets"], self._kept["weight"], self._kept["delay"]
        targets, weight, delay = self._again()
        weight = self._kept.get("weight", weight)
        if self._blocks:
            self._set({"targets": targets, "weight": weight, "delay": delay})
        return targets, weight, delay

    def retain(self) -> None:
        """Have all arrays again, in place of what makes them anew."""
        self._set(dict(zip(_ARRAYS, self.stored(), strict=True)))

    def release(self, again: Callable[[], StoredSynapses]) -> None:
        """Free all arrays with a value for each synapse; `again` makes them anew, in the same order and types."""
        self._set({} if "weight" in self.kinds else {"weight": self._kept["weight"]}, again)

    def discard(self, first: int, last: int) -> None:
        """Give back the memory of the synapses of the sources first:last, before `release` is called for all."""
        for block in self.blocks if self.has_arrays else ():
            for name in self.kinds:
                discard(getattr(block, name), int(block.row_ends[first]), int(block.row_ends[last]))

    def _set(self, kept: dict[str, NDArray[Any]], again: Callable[[], StoredSynapses] | None = None) -> None:
        for attribute, value in (("_kept", kept), ("_again", again), ("_blocks", ())):
            object.__setattr__(self, attribute, value)

    def _keep(self, name: str, values: NDArray[Any]) -> None:
        if name == "targets":  # the first of the three that is set
            self._set({})
            object.__setattr__(self, "kinds", {})
        self._kept[name] = values
        if name != "weight" or values.size > 1:
            self.kinds[name] = values.dtype

    targets = property(
        lambda self: self.stored()[0].astype(np.int32), lambda self, values: self._keep("targets", _short(values))
    )
    weight = property(
        lambda self: self.stored()[1].astype(np.float64), lambda self, values: self._keep("weight", _single(values))
    )
    delay = property(lambda self: self.stored()[2].copy(), lambda self, values: self._keep("delay", values))


class SharedProjection(Projection):
    """A projection of one of several shares: it keeps how many synapses each source has, in as few bytes as fit.

    A share has few synapses of each source, and a row for each source of every projection. `row_ends` is an array of
    the type of any projection, a new one at each access.
    """

    __slots__ = ("_numbers",)

    _numbers: NDArray[np.unsignedinteger[Any]]

    def _keep_row_ends(self, row_ends: Ints) -> None:
        numbers = np.diff(row_ends, prepend=0)
        object.__setattr__(self, "_numbers", numbers.astype(np.min_scalar_type(int(numbers.max(initial=0)))))

    row_ends = property(lambda self: np.cumsum(self._numbers, dtype=np.int64), _keep_row_ends)
