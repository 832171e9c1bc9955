"""All arrays of a program on this backend."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from numpy.typing import NDArray

from neuro.kernels.address import Entry
from neuro.program.program import Floats, Ints, Program
from neuro_event.layout import Place, Synapses


@dataclass(eq=False)
class Arrays:
    """Everything the loop needs, by the names of `loop.Net`, and how a program's parts map to it.

    Without `eager` all synapses learn lazily: as in states that earlier versions have saved.
    """

    program: Program
    places: list[Place]
    synapses: list[Synapses]
    plastic_of: dict[int, int]
    net: dict[str, Any]
    plastic: dict[str, NDArray[Any]]
    longest_slice: int
    longest_delay: int
    reach: int
    eager: bool = True
    late: dict[int, Floats] = field(default_factory=dict)
    asked: list[tuple[Ints, int, Callable[[], Entry]]] = field(default_factory=list)

    def ask(self, row: Ints, column: int, entry: Callable[[], Entry]) -> None:
        """Ask for the address of an entry in a row of a table, when all are known: they compile side by side."""
        self.asked.append((row, column, entry))
