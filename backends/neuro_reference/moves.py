"""Learning by moves of one projection: eligibility is gathered step by step, and a signal teaches it at once."""

from __future__ import annotations

from typing import ClassVar

import numpy as np

from neuro.model.synapses.base import common
from neuro.model.synapses.moves import MoveRule
from neuro.program.program import Floats, Ints, Program
from neuro_reference.projections import ReferenceProjection


class MoveLearning:
    """States of the synapses of one projection that learn by moves.

    Attributes:
        rule: the numbers of the synapse model.
        y: weight and states of every synapse.
        x: the pre traces of each source, (traces, sources).
        came: spikes of each source that arrive in the present step.
        gate: of each target.
    """

    kept: ClassVar[tuple[str, ...]] = ("rule", "y", "x", "came", "gate")

    def __init__(self, program: Program, wires: ReferenceProjection) -> None:
        part = wires.part
        assert isinstance(part.synapse, MoveRule)
        self.wires, self.part, self.h, self.model = wires, part, program.resolution, part.synapse
        states = [state.name for state in program.populations[part.target].model.states]
        self.seen_row = states.index(self.model.sees) if self.model.sees else -1
        self.y: Floats = np.zeros((1 + len(part.synapse.states), len(wires.target)))
        self.y[0], self.y[1:] = wires.weights, part.synapse.first_states()
        n_source = program.populations[part.source].size
        self.x: Floats = np.zeros((len(part.synapse.pre), n_source))
        self.came: Ints = np.zeros(n_source, dtype=np.int64)
        self.gate: Floats = np.ones(wires.n_target)
        self.rule = part.synapse.vector()
        self.refresh()

    def refresh(self) -> None:
        """Work out the constants after a change of the rule."""
        self.c: Floats = self.part.synapse.constants_of(self.rule, self.h)
        numbers = dict(zip(self.part.synapse.numbers(), common(self.rule).tolist(), strict=True))
        self.left: Floats = np.exp([[-self.h / numbers[trace.tau]] for trace in self.part.synapse.pre])
        self.adds: Floats = np.array([[trace.adds] for trace in self.part.synapse.pre])
        self.x_min = numbers["x_min"]

    def gather(self, ids: Ints, multiplicity: Ints, states: Floats) -> None:
        """Let a step of the target, in which some of its neurons spiked, add to the eligibility.

        Args:
            ids: the neurons that spiked.
            multiplicity: how often each.
            states: of all neurons, as the step has left them.
        """
        self.x *= self.left
        self.x[:, np.all(np.abs(self.x) < self.x_min, axis=0)] = 0.0
        self.x += self.adds * self.came
        self.came[:] = 0
        spikes: Ints = np.zeros(self.wires.n_target, dtype=np.int64)
        spikes[ids] = multiplicity
        seen = states[self.seen_row] if self.model.sees else np.zeros(self.wires.n_target)
        sources, targets = np.flatnonzero(self.x.any(axis=0)), np.flatnonzero((spikes != 0) | (seen != 0.0))
        concerned = np.isin(self.wires.source, sources) & np.isin(self.wires.target, targets)
        for e in np.flatnonzero(concerned).tolist():
            i, pre = self.wires.target[e], tuple(self.x[:, self.wires.source[e]].tolist())
            self.model.arithmetic.gather(self.y, e, self.c, pre, float(spikes[i]), float(seen[i]), float(self.gate[i]))

    def teach(self, values: Floats) -> None:
        """Let a signal act that is set at the end of a step."""
        for e in np.flatnonzero(self.y[1:].any(axis=0)).tolist():
            self.model.arithmetic.teach(self.y, e, self.c, float(values[self.wires.target[e]]))
        self.wires.weights[:] = self.y[0]

    def state(self, name: str) -> Floats:
        """The row of the weight or of a state of every synapse."""
        row = 0 if name == "weight" else 1 + [s.name for s in self.part.synapse.states].index(name)
        values: Floats = self.y[row]
        return values
