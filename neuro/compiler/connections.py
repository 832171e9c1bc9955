"""Synapses of a projection without values: sources and targets, sorted by source, then target."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from neuro.compiler.pairs import BLOCK, blocks
from neuro.program.program import Floats, Ints

NO_ROWS: Ints = np.zeros(0, dtype=np.int64)
NO_TARGETS: NDArray[np.int32] = np.zeros(0, dtype=np.int32)


@dataclass(frozen=True, slots=True, eq=False)
class Connections:
    """Synapses of one projection.

    Attributes:
        layout, row_ends, targets, size: as in `neuro.program.program.Projection`.
        order: index of the listed pair of each synapse, if the list was not sorted; else None.
        weight_shapes: allowed shapes of an array of weights; empty if synapses are drawn at random.
        shared: index of the draw of each synapse, if synapses share drawn weights or delays; else None.
        factors: factors of "weight" or "delay", one for each synapse in the program's order; a missing factor is 1.
    """

    layout: str
    size: int
    row_ends: Ints = field(default_factory=lambda: NO_ROWS)
    targets: NDArray[np.int32] = field(default_factory=lambda: NO_TARGETS)
    order: Ints | None = None
    weight_shapes: tuple[tuple[int, ...], ...] = ()
    shared: Ints | None = None
    factors: Mapping[str, Floats] = field(default_factory=dict)

    def ends(self, synapse: int) -> tuple[int, int]:
        """Return source and target of one synapse."""
        match self.layout:
            case "one_to_one":
                return synapse, synapse
            case "dense":
                pre, post = divmod(synapse, self.weight_shapes[0][1])
                return pre, post
        return int(np.searchsorted(self.row_ends, synapse, side="right")) - 1, int(self.targets[synapse])

    def pairs(self, n_post: int) -> Iterator[tuple[Ints, NDArray[np.integer]]]:
        """Yield source and target of all synapses, in order, in batches; not for grids."""
        for first, last in blocks(0, self.size, BLOCK):
            synapses = np.arange(first, last)
            match self.layout:
                case "one_to_one":
                    yield synapses, synapses
                case "dense":
                    yield synapses // n_post, synapses % n_post
                case _:
                    pre = np.searchsorted(self.row_ends, synapses, side="right") - 1
                    yield pre, self.targets[first:last]


def listed_one_by_one(connections: Connections, n_pre: int, n_post: int) -> Connections:
    """Return the same synapses in layout csr, with a target for each synapse."""
    match connections.layout:
        case "one_to_one":
            row_ends, targets = np.arange(n_pre + 1), np.arange(n_pre, dtype=np.int32)
        case "dense":
            row_ends, targets = np.arange(n_pre + 1) * n_post, np.tile(np.arange(n_post, dtype=np.int32), n_pre)
        case _:
            return connections
    return replace(connections, layout="csr", row_ends=row_ends, targets=targets)
