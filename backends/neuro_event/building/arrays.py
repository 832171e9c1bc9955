"""All arrays of a program on this backend, and where they begin in memory.

A step reads many arrays at the same index. Numbers that lie across two cache lines are read twice; and arrays that all
begin at one place of a page compete for the same few places of the caches. Either costs a large network a fifth.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.kernels.address import Entry
from neuro.program.program import Floats, Ints, Program
from neuro_event.building.layout import ArrangedSynapses, PopulationPlace
from neuro_event.loop import tables as t


@dataclass(eq=False)
class EventArrays:
    """Everything the loop needs, by the names of `loop.Net`, and how a program's parts map to it.

    Without `eager` all synapses learn lazily: tests compare the two ways. `joined` are the projections in joined rows,
    `parted` whether these are still to be laid out.
    """

    program: Program
    places: list[PopulationPlace]
    synapses: list[ArrangedSynapses]
    plastic_of: dict[int, int]
    net: dict[str, Any]
    plastic: dict[str, NDArray[Any]]
    longest_slice: int
    reach: int
    eager: bool = True
    moves_of: dict[int, int] = field(default_factory=dict)
    late: dict[int, Floats] = field(default_factory=dict)
    asked: list[tuple[Ints, int, Callable[[], Entry]]] = field(default_factory=list)
    joined: frozenset[int] = frozenset()
    parted: bool = True

    def ask(self, row: Ints, column: int, entry: Callable[[], Entry]) -> None:
        """Ask for the address of an entry in a row of a table, when all are known: they compile side by side."""
        self.asked.append((row, column, entry))


LINE = 64
PAGE = 4096


def aligned_zeros(n: int, dtype: Any, line: int = 0) -> NDArray[Any]:
    """Zeros that begin at a cache line, which is counted within its page."""
    size = n * np.dtype(dtype).itemsize
    memory = np.zeros(size + PAGE, dtype=np.uint8)
    skip = (line * LINE - memory.ctypes.data) % PAGE
    return memory[skip : skip + size].view(dtype)


def aligned_table(rows: int, columns: int) -> Ints:
    """A table of zeros whose first row begins at a cache line."""
    return aligned_zeros(rows * columns, np.int64).reshape(rows, columns)


def aligned_rows(count: int, n: int, line: int) -> Floats:
    """Rows of at least n zeros, each of which begins elsewhere in its page than the one before.

    Populations fill whole pages, so a block more in each row is enough.
    """
    return aligned_zeros(count * (n + t.BLOCK), np.float64, line).reshape(count, n + t.BLOCK)
