"""What pre spikes leave in the synapses that probes ask for."""

from __future__ import annotations

import numpy as np

from neuro.program.backend import Sent
from neuro.program.program import Program
from neuro_reference.pairs import Pairs


class Notes:
    """States of synapses as pre spikes leave them, by the number of the probe.

    Args:
        program: names the probes.
    """

    def __init__(self, program: Program) -> None:
        self.probes = {number: probe for number, probe in enumerate(program.synapse_probes) if not probe.every}
        self.kept: dict[int, list[tuple[int, int, float]]] = {number: [] for number in self.probes}

    def add(self, pairs: Pairs, projection: int, source: int, step: int) -> None:
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
