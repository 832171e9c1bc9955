"""Groups with several winners: which neurons are silenced, and how often each map has won."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from neuro.model.parts import local_winners
from neuro.program.backend import Outcome, Wins
from neuro.program.program import Floats, Ints

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
        """No neuron has won."""
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


class TrialCourse:
    """What is followed while a trial runs.

    Args:
        maps: of the output.
        size: its neurons.
        several: whether more than one may win, so that each map has a decision of its own.
    """

    def __init__(self, maps: int, size: int, several: bool) -> None:
        self._several, self._per_map = several, size // maps
        self._undecided = np.ones(maps, dtype=bool)
        self._potential = np.zeros((maps, self._per_map))
        self._neurons: list[int] = []
        self._ticks: list[int] = []
        self._peak, self._peak_tick = np.full(size, -np.inf), np.zeros(size, dtype=np.int64)

    def take(self, tick: int, potential: Floats, won: Ints) -> None:
        """Follow one tick.

        Args:
            tick: its number.
            potential: V_m of all neurons, before spikes reset it.
            won: winners of it, in order.
        """
        self._potential[self._undecided] = potential.reshape(self._potential.shape)[self._undecided]
        if not self._neurons:
            higher = potential > self._peak
            self._peak[higher], self._peak_tick[higher] = potential[higher], tick
        self._neurons += won.tolist()
        self._ticks += [tick] * len(won)
        if len(won):
            self._undecided[won // self._per_map if self._several else slice(None)] = False

    def outcome(self, ticks: int) -> Outcome:
        """How it ended after some ticks."""
        winner, decided = (self._neurons[0], self._ticks[0]) if self._neurons else (-1, -1)
        best = self._potential.argmax(axis=1) + np.arange(len(self._potential)) * self._per_map
        if winner >= 0:
            self._peak[winner], self._peak_tick[winner] = np.inf, decided
        wins = Wins(np.array(self._neurons, dtype=np.int64), np.array(self._ticks, dtype=np.int64))
        return Outcome(
            winner, decided, self._potential.max(axis=1), best, ticks,
            self._peak, self._peak_tick, wins if self._several else None,
        )  # fmt: skip
