"""The synapses of a large projection: drawn block by block, side by side, and brought into one order."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.compiler.connect import Block
from neuro.compiler.connections import Connections
from neuro.compiler.memory import SynapseRoom, has_each, weight_room
from neuro.compiler.synapses import Drawing, Piece, Synapses, by_delay_in_place, placed, with_numbers
from neuro.core.memory import give_back
from neuro.core.system import mapped
from neuro.model.distributions import Distribution
from neuro.model.rules import all_to_all, one_to_one
from neuro.program.compact import SynapseBlock
from neuro.program.program import Floats, Ints, StoredSynapses

_OF_THREAD, _NOTHING = threading.local(), np.zeros(0)

LARGE = 1 << 24
"""Synapses from which on the memory in which blocks were drawn is given back: to be given it anew takes time, too."""


class Divided(Drawing):
    """Draws the synapses of a projection block by block."""

    def synapses(self, room: SynapseRoom | None) -> Synapses:
        """The synapses in order; `room` is memory that may be used for those of all targets."""
        return super().synapses(room) if self._are_alike else self._of_blocks(room)

    def _of_blocks(self, room: SynapseRoom | None) -> Synapses:
        """The synapses of several blocks."""
        needed = [block for block in self.blocks.all if self._reached(block)] or [self.blocks.all[0]]
        if self._stay:
            return self._in_blocks(tuple(mapped(self._block, needed, self.threads)))
        pieces = dict(enumerate(mapped(self._begun, needed, self.threads)))
        whole_layout, shape = self._layout, (self.ends[0].size, self.ends[1].size)
        layout = whole_layout if self.among is None else "csr"
        joint = Joint(layout, shape, needed, [piece.row_ends for piece in pieces.values()])
        targets = joint.room(np.int32, None if room is None else room.targets)
        delay = pieces[0].delay
        if has_each(self.part.delay):
            delay = joint.room(np.result_type(*(piece.delay for piece in pieces.values())))
        columns = {name: joint.room(np.float64) for name in self._parameters}
        if has_each(self.part.weight):
            columns["weight"] = joint.room(np.float64, self._room_of_weights(joint.size, room))

        def finish(k: int) -> Floats:
            piece = pieces.pop(k)  # freed when it is in its place: two copies of all would not fit
            joint.put(k, piece.some(piece.found.targets), targets)
            if has_each(self.part.delay):
                joint.put(k, piece.some(piece.delay), delay)
            values = self._columns(piece.found, piece.block, _scratch(piece.found.size))
            for name, column in columns.items():
                joint.put(k, piece.some(values[name]), column)
            return values["weight"]

        weights = list(mapped(finish, range(len(needed)), self.threads))
        if joint.size >= LARGE:
            give_back()
        found = joint.connections(targets)
        rows = [*columns.values(), *([delay] if has_each(self.part.delay) else [])]
        if found.layout == "csr" and not self.ends[1].ascends:
            pre = np.repeat(np.arange(found.row_ends.size - 1), np.diff(found.row_ends))
            order = np.lexsort((found.targets, pre))
            for column in (found.targets, *rows):
                column[:] = column[order]
        by_delay = layout == "csr" and self._sorts
        if by_delay:
            by_delay_in_place(found.row_ends, delay, targets, [*columns.values()])
        weight = columns.pop("weight", weights[0])
        return Synapses(found, delay, weight, with_numbers(self.part.synapse, columns), by_delay, whole_layout)

    @property
    def _sorts(self) -> bool:
        """Whether synapses of several blocks are sorted by delay, if these are listed one by one."""
        return (
            self.ordered and isinstance(self.part.delay, Distribution) and not isinstance(self.blocks.rule, one_to_one)
        )

    @property
    def _stay(self) -> bool:
        """Whether synapses stay in blocks: a backend that makes rows of its own reads them as they are."""
        whole = self.among is None and self._layout == "csr" and self.ends[1].ascends
        return whole and self._sorts and not self._parameters

    def _block(self, block: Block) -> SynapseBlock:
        """The synapses of a block, in few bytes."""
        found = placed(self.blocks.connect(block), *self.ends)
        delay = self._delay(found, block)
        weight = self._columns(found, block, weight_room(self.part, found.size))["weight"]
        return SynapseBlock.of(found.row_ends, found.targets, weight, delay)

    def _in_blocks(self, blocks: tuple[SynapseBlock, ...]) -> Synapses:
        row_ends = np.sum([block.row_ends for block in blocks], axis=0)
        weight = np.zeros(0) if has_each(self.part.weight) else blocks[0].weight.astype(np.float64)
        found = Connections("csr", int(row_ends[-1]), row_ends)
        return Synapses(found, np.zeros(0, dtype=np.uint8), weight, self.part.synapse, True, "csr", blocks)

    def _reached(self, block: Block) -> bool:
        """Whether some targets of a block are of the part."""
        ids = self.ends[1].ids
        if self.among is None:
            return True
        first, end = self.among
        if ids is None:
            return block.first < end and first < block.end
        some = ids[block.first : block.end]
        return bool(((some >= first) & (some < end)).any())

    def _begun(self, block: Block) -> Piece:
        """A block with its delays."""
        found = placed(self.blocks.connect(block), *self.ends)
        return Piece(block, found, self._kept(found), self._delay(found, block))

    @property
    def _are_alike(self) -> bool:
        """Whether no synapse is stored by itself: every source reaches every target, with one weight and delay."""
        each = has_each(self.part.weight) or has_each(self.part.delay) or self._parameters
        return self.among is None and self._layout != "csr" and not each

    @property
    def _layout(self) -> str:
        """The layout of the synapses of all blocks onto all targets."""
        rule, (source, target) = self.blocks.rule, self.ends
        if source.ids is not None or target.ids is not None:
            return "csr"
        if isinstance(rule, all_to_all) and (rule.autapses or self.blocks.own is None):
            return "dense"
        return "one_to_one" if isinstance(rule, one_to_one) else "csr"


class Joint:
    """The place of each synapse of some blocks among all of them.

    Args:
        layout: of all.
        shape: neurons of source and target.
        blocks: in order.
        rows: where the synapses of each source end, block by block.
    """

    def __init__(self, layout: str, shape: tuple[int, int], blocks: Sequence[Block], rows: Sequence[Ints]) -> None:
        self._layout, self._shape, self._blocks, self._rows = layout, shape, blocks, rows
        self._row_ends: Ints = np.sum(self._rows, axis=0)
        self.size = int(self._row_ends[-1])

    @cached_property
    def _starts(self) -> list[Ints]:
        """Where the synapses of each source begin, block by block."""
        starts = [self._row_ends[:-1]]
        for ends in self._rows[:-1]:
            starts.append(starts[-1] + np.diff(ends))
        return starts

    def _columns(self, k: int) -> slice:
        return slice(self._blocks[k].first, self._blocks[k].end)

    def room(self, kind: Any, given: NDArray[Any] | None = None) -> NDArray[Any]:
        """Memory for a value of each; that which is given if it fits."""
        return given if given is not None and given.size == self.size else np.empty(self.size, dtype=kind)

    def put(self, k: int, values: NDArray[Any], to: NDArray[Any]) -> None:
        """Move the values of block k to their places."""
        match self._layout:
            case "one_to_one":
                to[self._columns(k)] = values
            case "dense":
                to.reshape(self._shape)[:, self._columns(k)] = values.reshape(self._shape[0], -1)
            case _:
                from neuro.compiler.rows import put_rows

                put_rows(self._rows[k], values, self._starts[k], to)

    def connections(self, targets: NDArray[np.int32]) -> Connections:
        """All of them."""
        if self._layout == "csr":
            return Connections("csr", self.size, self._row_ends, targets)
        return Connections(self._layout, self.size)


def together(own_weights: bool, blocks: Sequence[SynapseBlock]) -> StoredSynapses:
    """Targets, weights and delays of the synapses of blocks, by source, delay, target."""
    joint = Joint("csr", (0, 0), (), [block.row_ends for block in blocks])

    def of_all(name: str) -> NDArray[Any]:
        to = joint.room(getattr(blocks[0], name).dtype)
        for k, block in enumerate(blocks):
            joint.put(k, getattr(block, name), to)
        return to

    targets, delay = of_all("targets"), of_all("delay")
    weight = of_all("weight") if own_weights else blocks[0].weight
    by_delay_in_place(joint.connections(targets).row_ends, delay, targets, [weight] if own_weights else [])
    return targets, weight, delay


def _scratch(size: int) -> Floats:
    """Memory for so many values, of this thread, which its next block uses again."""
    # Memory that is touched for the first time takes longer than to draw what lies there.
    if getattr(_OF_THREAD, "room", _NOTHING).size < size:
        _OF_THREAD.room = np.empty(size)
    room: Floats = _OF_THREAD.room[:size]
    return room
