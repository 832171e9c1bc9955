"""Synapses of a large projection, drawn block by block in parallel, and joined in one order."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.compiler.connect import Block
from neuro.compiler.connections import Connections
from neuro.compiler.memory import SynapseBuffers, has_each, weight_buffer
from neuro.compiler.synapses import Drawing, Piece, Synapses, by_delay_in_place, in_populations, with_numbers
from neuro.core.memory import give_back
from neuro.core.system import mapped
from neuro.model.distributions import Distribution
from neuro.model.rules import all_to_all, one_to_one
from neuro.program.compact import SynapseBlock
from neuro.program.program import Floats, Ints, StoredSynapses

_OF_THREAD, _NOTHING = threading.local(), np.zeros(0)

MIN_FREED = 1 << 24
"""Smallest number of synapses at which the memory of blocks is freed. For fewer, allocating again costs more."""


class Divided(Drawing):
    """Draws the synapses of a projection block by block."""

    def synapses(self, buffer: SynapseBuffers | None) -> Synapses:
        """Return the synapses in order; `buffer` is memory that may be used for the targets of all synapses."""
        return super().synapses(buffer) if self._is_uniform else self._join_blocks(buffer)

    def _join_blocks(self, buffer: SynapseBuffers | None) -> Synapses:
        """Return the joined synapses of several blocks."""
        needed_blocks = [block for block in self.blocks.all if self._is_needed(block)] or [self.blocks.all[0]]
        if self._stay_in_blocks:
            return self._in_blocks(tuple(mapped(self._block, needed_blocks, self.threads)))
        pieces = dict(enumerate(mapped(self._draw_delays, needed_blocks, self.threads)))
        whole_layout, shape = self._layout, (self.ends[0].size, self.ends[1].size)
        layout = whole_layout if self.target_range is None else "csr"
        joint = Joint(layout, shape, needed_blocks, [piece.row_ends for piece in pieces.values()])
        targets = joint.buffer(np.int32, None if buffer is None else buffer.targets)
        delay = pieces[0].delay
        if has_each(self.part.delay):
            delay = joint.buffer(np.result_type(*(piece.delay for piece in pieces.values())))
        columns = {name: joint.buffer(np.float64) for name in self._parameters}
        if has_each(self.part.weight):
            columns["weight"] = joint.buffer(np.float64, self._weight_buffer(joint.size, buffer))

        def finish(k: int) -> Floats:
            piece = pieces.pop(k)  # freed after the copy: memory has no room for two copies of all pieces
            joint.put(k, piece.select(piece.connections.targets), targets)
            if has_each(self.part.delay):
                joint.put(k, piece.select(piece.delay), delay)
            values = self._columns(piece.connections, piece.block, _scratch(piece.connections.size))
            for name, column in columns.items():
                joint.put(k, piece.select(values[name]), column)
            return values["weight"]

        weights = list(mapped(finish, range(len(needed_blocks)), self.threads))
        if joint.size >= MIN_FREED:
            give_back()
        connections = joint.connections(targets)
        rows = [*columns.values(), *([delay] if has_each(self.part.delay) else [])]
        if connections.layout == "csr" and not self.ends[1].ascends:
            pre = np.repeat(np.arange(connections.row_ends.size - 1), np.diff(connections.row_ends))
            order = np.lexsort((connections.targets, pre))
            for column in (connections.targets, *rows):
                column[:] = column[order]
        by_delay = layout == "csr" and self._sorts
        if by_delay:
            by_delay_in_place(connections.row_ends, delay, targets, [*columns.values()])
        weight = columns.pop("weight", weights[0])
        return Synapses(connections, delay, weight, with_numbers(self.part.synapse, columns), by_delay, whole_layout)

    @property
    def _sorts(self) -> bool:
        """True if synapses in layout csr of several blocks are sorted by delay."""
        return (
            self.ordered and isinstance(self.part.delay, Distribution) and not isinstance(self.blocks.rule, one_to_one)
        )

    @property
    def _stay_in_blocks(self) -> bool:
        """True if synapses stay in blocks, for backends that sort synapses themselves."""
        is_whole = self.target_range is None and self._layout == "csr" and self.ends[1].ascends
        return is_whole and self._sorts and not self._parameters

    def _block(self, block: Block) -> SynapseBlock:
        """Return the synapses of a block in the smallest types."""
        connections = in_populations(self.blocks.connect(block), *self.ends)
        delay = self._delay(connections, block)
        weight = self._columns(connections, block, weight_buffer(self.part, connections.size))["weight"]
        return SynapseBlock.of(connections.row_ends, connections.targets, weight, delay)

    def _in_blocks(self, blocks: tuple[SynapseBlock, ...]) -> Synapses:
        row_ends = np.sum([block.row_ends for block in blocks], axis=0)
        weight = np.zeros(0) if has_each(self.part.weight) else blocks[0].weight.astype(np.float64)
        connections = Connections("csr", int(row_ends[-1]), row_ends)
        return Synapses(connections, np.zeros(0, dtype=np.uint8), weight, self.part.synapse, True, "csr", blocks)

    def _is_needed(self, block: Block) -> bool:
        """Return whether a block has targets in the share."""
        ids = self.ends[1].ids
        if self.target_range is None:
            return True
        first, end = self.target_range
        if ids is None:
            return block.first < end and first < block.end
        ids_of_block = ids[block.first : block.end]
        return bool(((ids_of_block >= first) & (ids_of_block < end)).any())

    def _draw_delays(self, block: Block) -> Piece:
        """Return a block with its delays."""
        connections = in_populations(self.blocks.connect(block), *self.ends)
        return Piece(block, connections, self._mask(connections), self._delay(connections, block))

    @property
    def _is_uniform(self) -> bool:
        """True if no values per synapse are stored: all-to-all with one weight and one delay."""
        each = has_each(self.part.weight) or has_each(self.part.delay) or self._parameters
        return self.target_range is None and self._layout != "csr" and not each

    @property
    def _layout(self) -> str:
        """The layout of the synapses of all blocks onto all targets."""
        rule, (source, target) = self.blocks.rule, self.ends
        if source.ids is not None or target.ids is not None:
            return "csr"
        if isinstance(rule, all_to_all) and (rule.autapses or self.blocks.target_index is None):
            return "dense"
        return "one_to_one" if isinstance(rule, one_to_one) else "csr"


class Joint:
    """Index of the synapses of each block among the synapses of all blocks.

    Args:
        layout: layout of all synapses.
        shape: numbers of source and target neurons.
        blocks: the blocks in order.
        rows: row ends of each block.
    """

    def __init__(self, layout: str, shape: tuple[int, int], blocks: Sequence[Block], rows: Sequence[Ints]) -> None:
        self._layout, self._shape, self._blocks, self._rows = layout, shape, blocks, rows
        self._row_ends: Ints = np.sum(self._rows, axis=0)
        self.size = int(self._row_ends[-1])

    @cached_property
    def _starts(self) -> list[Ints]:
        """Index of the first synapse of each source, for each block."""
        starts = [self._row_ends[:-1]]
        for ends in self._rows[:-1]:
            starts.append(starts[-1] + np.diff(ends))
        return starts

    def _columns(self, k: int) -> slice:
        return slice(self._blocks[k].first, self._blocks[k].end)

    def buffer(self, kind: Any, existing: NDArray[Any] | None = None) -> NDArray[Any]:
        """Return memory for one value per synapse: `existing` if it fits, else new memory."""
        return existing if existing is not None and existing.size == self.size else np.empty(self.size, dtype=kind)

    def put(self, k: int, values: NDArray[Any], output: NDArray[Any]) -> None:
        """Copy the values of block k to their places in `output`."""
        match self._layout:
            case "one_to_one":
                output[self._columns(k)] = values
            case "dense":
                output.reshape(self._shape)[:, self._columns(k)] = values.reshape(self._shape[0], -1)
            case _:
                from neuro.compiler.rows import put_rows

                put_rows(self._rows[k], values, self._starts[k], output)

    def connections(self, targets: NDArray[np.int32]) -> Connections:
        """Return all synapses."""
        if self._layout == "csr":
            return Connections("csr", self.size, self._row_ends, targets)
        return Connections(self._layout, self.size)


def join_blocks(has_weights: bool, blocks: Sequence[SynapseBlock]) -> StoredSynapses:
    """Return targets, weights and delays of the synapses of blocks, by source, delay, target."""
    joint = Joint("csr", (0, 0), (), [block.row_ends for block in blocks])

    def of_all(name: str) -> NDArray[Any]:
        output = joint.buffer(getattr(blocks[0], name).dtype)
        for k, block in enumerate(blocks):
            joint.put(k, getattr(block, name), output)
        return output

    targets, delay = of_all("targets"), of_all("delay")
    weight = of_all("weight") if has_weights else blocks[0].weight
    by_delay_in_place(joint.connections(targets).row_ends, delay, targets, [weight] if has_weights else [])
    return targets, weight, delay


def _scratch(size: int) -> Floats:
    """Return memory for `size` values. The next block of this thread reuses it."""
    # The first access to new memory takes longer than drawing the values in it.
    if getattr(_OF_THREAD, "buffer", _NOTHING).size < size:
        _OF_THREAD.buffer = np.empty(size)
    buffer: Floats = _OF_THREAD.buffer[:size]
    return buffer
