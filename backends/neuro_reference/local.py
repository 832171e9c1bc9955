"""Groups with several winners: who is silenced, and how often each map has won."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from neuro.model.parts import local_winners
from neuro.program.program import Ints

Bools = NDArray[np.bool_]


class LocalWinners:
    """The present state of such a group.

    Attributes:
        blocked: neurons that are silenced until the next trial or reset.
        wins: how often each map has won.
    """

    kept: ClassVar[tuple[str, ...]] = ("blocked", "wins")

    def __init__(self, choice: local_winners, shape: tuple[int, ...]) -> None:
        self._choice, self._maps = choice, shape[0]
        self._map, self._row, self._column = np.indices(shape).reshape(3, -1)
        self.open()

    def open(self) -> None:
        """Nobody has won."""
        self.blocked: Bools = np.zeros(self._map.size, dtype=bool)
        self.wins: Ints = np.zeros(self._maps, dtype=np.int64)

    def enter(self, ranked: Ints) -> Ints:
        """Those that win of some candidates, the best first; each silences what is near it."""
        return np.array([neuron for neuron in ranked.tolist() if self._win(neuron)], dtype=np.int64)

    def _win(self, neuron: int) -> bool:
        if self.blocked[neuron]:
            return False
        row, column, radius = self._row[neuron], self._column[neuron], self._choice.radius
        self.blocked |= (abs(self._row - row) <= radius) & (abs(self._column - column) <= radius)
        own = self._map[neuron]
        self.wins[own] += 1
        if self.wins[own] == self._choice.per_map:
            self.blocked |= self._map == own
        return True
