"""What a run leaves behind: spikes and counts."""

from __future__ import annotations

import numpy as np

from neuro.program.backend import Spikes
from neuro.program.program import Ints, Program
from neuro_nest.projections import NestProjection
from neuro_nest.sources import NONE, InjectedTrain

SYNAPSES_AT_ONCE = 1 << 20


class NestRecord:
    """Spikes of one population, stretch by stretch, and its counts.

    Args:
        size: neurons.
        keeps: whether spikes are kept.

    Attributes:
        sent: step of each neuron's last spike that was sent; one of the latest step was not yet.
    """

    def __init__(self, size: int, keeps: bool) -> None:
        self.size, self.keeps = size, keeps
        self._stretches: list[InjectedTrain] = []
        self.events: Ints = np.zeros(size, dtype=np.int64)
        self.spikes: Ints = np.zeros(size, dtype=np.int64)
        self.sent: Ints = np.zeros(size, dtype=np.int64)
        self._waiting: tuple[Ints, int] = (NONE, 0)

    def add(self, spikes: InjectedTrain, to: int) -> None:
        """The spikes of a stretch that ends with step `to`."""
        ids, step = self._waiting
        self.sent[ids] = step
        gone = spikes.steps < to
        np.maximum.at(self.sent, spikes.ids[gone], spikes.steps[gone])
        self._waiting = (spikes.ids[~gone], to)
        self.events += np.bincount(spikes.ids, minlength=self.size)
        np.add.at(self.spikes, spikes.ids, spikes.multiplicity)
        if self.keeps and spikes.ids.size:
            self._stretches.append(spikes)

    def since(self, step: int) -> Spikes:
        """The spikes after a step."""
        late = [s for s in self._stretches if s.steps[-1] > step]
        steps, ids, multiplicity = (
            np.concatenate([np.zeros(0, dtype=np.int64), *(getattr(s, name) for s in late)])
            for name in ("steps", "ids", "multiplicity")
        )
        begin = int(np.searchsorted(steps, step, side="right"))
        return Spikes(steps[begin:], ids[begin:], multiplicity[begin:].astype(np.int64))

    def forget(self, before: int) -> None:
        """Drop spikes up to a step."""
        left = self.since(before)
        kept = InjectedTrain(left.steps, left.ids, left.multiplicity.astype(np.int64))
        self._stretches = [kept] if kept.ids.size else []

    @property
    def nbytes(self) -> int:
        """Memory of the spikes."""
        return sum(24 * len(s.steps) for s in self._stretches)


class Activity:
    """Counts the neuron-steps with an arrival or a spike, of the neurons of this process.

    Args:
        program: the whole network.
        wires: all projections that carry spikes.
    """

    def __init__(self, program: Program, wires: list[NestProjection]) -> None:
        self._wires, self._share = wires, program.share
        self._reach = max((w.part.delay_span[1] for w in wires if w.part.size), default=0)
        self._heard = [np.zeros((self._reach, p.size), dtype=bool) for p in program.populations]
        self.active: Ints = np.zeros(len(program.populations), dtype=np.int64)

    def add(self, trains: list[InjectedTrain], after: int, to: int) -> None:
        """The spikes of all populations in steps after < k <= to."""
        steps = to - after
        heard = [np.concatenate((h, np.zeros((steps, h.shape[1]), dtype=bool))) for h in self._heard]
        for wires in self._wires:
            spikes = trains[wires.part.source]
            at_once = max(1, SYNAPSES_AT_ONCE // wires.longest_row)
            for first in range(0, len(spikes.ids), at_once):
                synapses, number = wires.rows(spikes.ids[first : first + at_once])
                arrival = np.repeat(spikes.steps[first : first + at_once], number) + wires.delay[synapses]
                heard[wires.part.target][arrival - after - 1, wires.target[synapses]] = True
        for index, (spikes, here) in enumerate(zip(trains, heard, strict=True)):
            here[spikes.steps - after - 1, spikes.ids] = True
            first, end = self._share.of(here.shape[1])
            self.active[index] += np.count_nonzero(here[:steps, first:end])
            self._heard[index] = here[steps:]
