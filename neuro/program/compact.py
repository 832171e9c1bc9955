"""Projections with few bytes per synapse. A backend with a copy of the arrays can replace the program's arrays."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.memory import discard
from neuro.program.program import Ints, Projection, StoredSynapses

_BATCH = 1 << 16
"""Weights checked in one batch. Weights that need 64 bits mostly fail in the first batch."""

_ARRAYS = ("targets", "weight", "delay")


def is_single(weights: NDArray[np.floating[Any]]) -> bool:
    """Return whether all weights can be stored in 32 bits without loss."""
    if weights.dtype == np.float32:
        return True
    pieces = (weights[k : k + _BATCH] for k in range(0, weights.size, _BATCH))
    return all(np.array_equal(piece.astype(np.float32), piece) for piece in pieces)


def _in_16_bits(targets: NDArray[np.integer[Any]]) -> NDArray[np.integer[Any]]:
    """Return targets in 16 bits, if all fit."""
    return targets.astype(np.uint16, copy=False) if targets.max(initial=0) < 1 << 16 else targets


def _single(weights: NDArray[np.floating[Any]]) -> NDArray[np.floating[Any]]:
    """Return weights in 32 bits, if there are several and all fit exactly."""
    return weights.astype(np.float32, copy=False) if weights.size > 1 and is_single(weights) else weights


@dataclass(frozen=True, slots=True, eq=False)
class SynapseBlock:
    """Synapses of a projection onto some neighbouring targets.

    Attributes:
        row_ends: source i has the synapses row_ends[i] : row_ends[i + 1], with targets ascending. If a projection has
            only one block, the block has the order of the projection.
        targets, weight, delay: as in `Projection`, in the types in which they are stored.
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
        """Return a block with the given synapses in the smallest types."""
        return cls(row_ends, _in_16_bits(targets), _single(weight), delay)


class CompactProjection(Projection):
    """A projection with targets in 16 bits and weights in 32 bits, if all values fit exactly.

    `targets`, `weight` and `delay` return a copy in the types of any other projection. A backend with a sorted copy of
    the synapses can free the arrays with `release`, and supplies the synapses on demand.
    """

    __slots__ = ("_arrays", "_blocks", "_supply", "kinds")

    _arrays: dict[str, NDArray[Any]]
    _blocks: tuple[SynapseBlock, ...]
    _supply: Callable[[], StoredSynapses] | None
    kinds: dict[str, np.dtype[Any]]
    """The types in which targets, weights and delays are stored; without "weight" if all synapses share a weight."""

    @classmethod
    def of(cls, part: Projection) -> CompactProjection:
        """Return a compact copy of a projection."""
        return cls(**{entry.name: getattr(part, entry.name) for entry in fields(part)})

    @classmethod
    def of_blocks(
        cls,
        part: Projection,
        blocks: Sequence[SynapseBlock],
        join: Callable[[Sequence[SynapseBlock]], StoredSynapses],
    ) -> CompactProjection:
        """Return a projection with synapses in blocks, which are joined when they are first read in order.

        Args:
            part: the other properties. Its targets and delays are empty. Its weights are empty, too, unless shared.
            blocks: the synapses, in the order of their targets.
            join: function that joins blocks and puts the synapses in order.
        """
        kinds = {
            name: np.result_type(*(getattr(block, name) for block in blocks))
            for name in _ARRAYS
            if getattr(part, name).size == 0
        }
        uniform = tuple(
            replace(block, **{name: getattr(block, name).astype(kind, copy=False) for name, kind in kinds.items()})
            for block in blocks
        )
        projection = cls.of(part)
        object.__setattr__(projection, "kinds", kinds)
        projection.release(partial(join, uniform))
        object.__setattr__(projection, "_blocks", uniform)
        return projection

    @property
    def has_arrays(self) -> bool:
        """True if the projection stores the synapses itself; False if a backend supplies them."""
        return self._supply is None or bool(self._blocks)

    @property
    def blocks(self) -> tuple[SynapseBlock, ...]:
        """The synapses: the blocks as drawn until the first read, afterwards one block in the projection's order."""
        return self._blocks or (SynapseBlock(self.row_ends, *self.stored()),)

    def stored(self) -> StoredSynapses:
        """Return targets, weights and delays in their stored types."""
        if self._supply is None:
            return self._arrays["targets"], self._arrays["weight"], self._arrays["delay"]
        targets, weight, delay = self._supply()
        weight = self._arrays.get("weight", weight)
        if self._blocks:
            self._set({"targets": targets, "weight": weight, "delay": delay})
        return targets, weight, delay

    def retain(self) -> None:
        """Store all arrays again, and drop the function that supplied them."""
        self._set(dict(zip(_ARRAYS, self.stored(), strict=True)))

    def release(self, supply: Callable[[], StoredSynapses]) -> None:
        """Free all arrays with a value per synapse. `supply` returns them again, in the same order and types."""
        self._set({} if "weight" in self.kinds else {"weight": self._arrays["weight"]}, supply)

    def discard(self, first: int, last: int) -> None:
        """Free the memory of the synapses of sources first:last. Call `release` after the last one."""
        for block in self.blocks if self.has_arrays else ():
            for name in self.kinds:
                discard(getattr(block, name), int(block.row_ends[first]), int(block.row_ends[last]))

    def _set(self, arrays: dict[str, NDArray[Any]], supply: Callable[[], StoredSynapses] | None = None) -> None:
        for attribute, value in (("_arrays", arrays), ("_supply", supply), ("_blocks", ())):
            object.__setattr__(self, attribute, value)

    def _store(self, name: str, values: NDArray[Any]) -> None:
        if name == "targets":  # the first of the three fields that __init__ sets
            self._set({})
            object.__setattr__(self, "kinds", {})
        self._arrays[name] = values
        if name != "weight" or values.size > 1:
            self.kinds[name] = values.dtype

    targets = property(
        lambda self: self.stored()[0].astype(np.int32), lambda self, values: self._store("targets", _in_16_bits(values))
    )
    weight = property(
        lambda self: self.stored()[1].astype(np.float64), lambda self, values: self._store("weight", _single(values))
    )
    delay = property(lambda self: self.stored()[2].copy(), lambda self, values: self._store("delay", values))


class SharedProjection(Projection):
    """Share of a projection in one of several processes. The numbers of synapses per source have the smallest type.

    A share has few synapses of each source but a row for each source. `row_ends` returns a new array of the usual type
    at each access.
    """

    __slots__ = ("_numbers",)

    _numbers: NDArray[np.unsignedinteger[Any]]

    def _store_row_ends(self, row_ends: Ints) -> None:
        numbers = np.diff(row_ends, prepend=0)
        object.__setattr__(self, "_numbers", numbers.astype(np.min_scalar_type(int(numbers.max(initial=0)))))

    row_ends = property(lambda self: np.cumsum(self._numbers, dtype=np.int64), _store_row_ends)
