"""What a run leaves behind: spikes and counts."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from neuro.program.backend import Spikes
from neuro.program.program import Ints


class Record:
    """Spikes of one population, in the order of their steps, and its counts.

    Args:
        size: neurons.
        keeps: whether spikes are kept.
    """

    kept: ClassVar[tuple[str, ...]] = ("steps", "ids", "multiplicity", "events", "spikes", "active")

    def __init__(self, size: int, keeps: bool) -> None:
        self.size, self.keeps = size, keeps
        self.start_anew()

    def start_anew(self) -> None:
        """Nothing happened yet."""
        self.steps: list[int] = []
        self.ids: list[int] = []
        self.multiplicity: list[int] = []
        self.events: Ints = np.zeros(self.size, dtype=np.int64)
        self.spikes: Ints = np.zeros(self.size, dtype=np.int64)
        self.active = 0

    def add(self, step: int, ids: Ints, multiplicity: Ints) -> None:
        """The spikes of one step."""
        if not len(ids):
            return
        self.events[ids] += 1
        self.spikes[ids] += multiplicity
        if self.keeps:
            self.steps += [step] * len(ids)
            self.ids += ids.tolist()
            self.multiplicity += multiplicity.tolist()

    def since(self, step: int) -> Spikes:
        """The spikes after a step."""
        first = int(np.searchsorted(self.steps, step, side="right")) if self.steps else 0
        return Spikes(
            np.array(self.steps[first:], dtype=np.int64),
            np.array(self.ids[first:], dtype=np.int64),
            np.array(self.multiplicity[first:], dtype=np.int32),
        )

    def forget(self, before: int) -> None:
        """Drop spikes up to a step."""
        left = self.since(before)
        self.steps, self.ids, self.multiplicity = left.steps.tolist(), left.ids.tolist(), left.multiplicity.tolist()
