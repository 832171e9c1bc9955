"""What a run leaves behind: spikes and counts."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from neuro.program.backend import Sent, Spikes
from neuro.program.program import Ints, Program
from neuro_reference.pairs import PairLearning


class SpikeRecord:
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


class SynapseRecords:
    """States of synapses as pre spikes leave them, by the number of the probe.

    Args:
        program: names the probes.
    """

    def __init__(self, program: Program) -> None:
        self.probes = {number: probe for number, probe in enumerate(program.synapse_probes) if not probe.every}
        self.kept: dict[int, list[tuple[int, int, float]]] = {number: [] for number in self.probes}

    def add(self, pairs: PairLearning, projection: int, source: int, step: int) -> None:
        """Keep the synapses of a source after its spike of a step has acted."""
        for number, probe in self.probes.items():
            if probe.projection == projection:
                values, row = pairs.state(probe.record), pairs.wires.row(source)
                synapses = np.arange(row.start, row.stop)
                asked = synapses if probe.synapses is None else synapses[np.isin(synapses, probe.synapses)]
                self.kept[number] += [(step, int(e), float(values[e])) for e in asked]

    def take(self, number: int) -> Sent:
        """What was kept for a probe; it is forgotten."""
        kept, self.kept[number] = self.kept[number], []
        columns = [np.array(column) for column in zip(*kept, strict=True)] or [np.zeros(0)] * 3
        return Sent(columns[0].astype(np.int64), columns[1].astype(np.int64), columns[2])
