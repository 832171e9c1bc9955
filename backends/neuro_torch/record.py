"""What a run leaves behind: spikes and counts of one population."""

from __future__ import annotations

import numpy as np

from neuro.program.backend import Spikes
from neuro.program.program import Ints


class TensorRecord:
    """Spikes in the order of their steps, and counts.

    Attributes:
        steps, ids, multiplicity: what was recorded, an array for each step that had spikes.
        events, spikes: of each neuron, a spike of multiplicity m once and m times.
        active: neuron-steps with an arrival or a spike.

    Args:
        size: neurons.
        keeps: whether spikes are kept.
    """

    def __init__(self, size: int, keeps: bool) -> None:
        self._size, self._keeps = size, keeps
        self.start_anew()

    @property
    def nbytes(self) -> int:
        """Bytes of the recorded spikes."""
        return 24 * sum(len(steps) for steps in self.steps)

    def start_anew(self) -> None:
        """Nothing happened yet."""
        self.steps: list[Ints] = []
        self.ids: list[Ints] = []
        self.multiplicity: list[Ints] = []
        self.events: Ints = np.zeros(self._size, dtype=np.int64)
        self.spikes: Ints = np.zeros(self._size, dtype=np.int64)
        self.active = 0

    def add(self, step: int, ids: Ints, multiplicity: Ints) -> None:
        """The spikes of one step."""
        self.events[ids] += 1
        self.spikes[ids] += multiplicity
        if self._keeps and len(ids):
            self.steps.append(np.full(len(ids), step, dtype=np.int64))
            self.ids.append(ids)
            self.multiplicity.append(multiplicity)

    def since(self, step: int) -> Spikes:
        """The spikes after a step."""
        first = next((k for k, steps in enumerate(self.steps) if steps[0] > step), len(self.steps))
        none = np.zeros(0, dtype=np.int64)
        columns = (np.concatenate([none, *column[first:]]) for column in (self.steps, self.ids, self.multiplicity))
        steps, ids, multiplicity = columns
        return Spikes(steps, ids, multiplicity.astype(np.int32))

    def forget(self, before: int) -> None:
        """Drop spikes up to a step."""
        self.keep(self.since(before))

    def keep(self, spikes: Spikes) -> None:
        """Have these spikes and no others; counts stay."""
        cuts = np.flatnonzero(np.diff(spikes.steps)) + 1
        some = len(spikes.steps) > 0
        self.steps = np.split(spikes.steps, cuts) if some else []
        self.ids = np.split(spikes.ids, cuts) if some else []
        self.multiplicity = np.split(spikes.multiplicity.astype(np.int64), cuts) if some else []
