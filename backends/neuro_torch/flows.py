"""Currents of generators along one projection, worked out on the host: one for all recordings of a batch."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import torch

from neuro.program.currents import Emission, filtered_current
from neuro.program.program import Floats, Program

if TYPE_CHECKING:
    from neuro_torch.cells import TensorCells


class Flow:
    """A projection that carries a current.

    Attributes:
        weights: of every synapse.
        due: what is to act, (steps modulo the longest delay + 2, neuron).
        held: what was sent last.

    Args:
        program: the network.
        index: which projection.
        parameters: of its generator, as they are now; shared by all its projections.
    """

    def __init__(self, program: Program, index: int, parameters: dict[str, Floats]) -> None:
        self.part, self._program = program.projections[index], program
        self._source = program.populations[self.part.source]
        _, self._target, self._slot = program.synapses(index)
        self._delay = np.broadcast_to(self.part.delay, len(self._target)).astype(np.int64)
        self._emission = Emission(program, index)
        self.weights: Floats = np.broadcast_to(self.part.weight, self.part.size).astype(np.float64)
        self.parameters = parameters
        self.start_anew()

    def start_anew(self) -> None:
        """Nothing is under way."""
        slots = int(self._delay.max(initial=1)) + 2
        self.due: Floats = np.zeros((slots, self._program.populations[self.part.target].size))
        self.held: Floats = np.zeros(self._emission.columns)

    def send(self, step: int) -> None:
        """Send the current emitted in a step, if any; it acts in the step after its arrival."""
        now = np.array([step])
        if not self._emission.on(now).size:
            return
        if self._emission.moments(now)[0] == step:
            self.held = self._emission.at(now, self._in_force(step))[0]
        amount = self.held[self._emission.column] * self.weights[self._slot]
        np.add.at(self.due, ((step + self._delay + 1) % len(self.due), self._target), amount)

    def _in_force(self, step: int) -> dict[str, Floats]:
        schedule = self._source.schedule
        return self.parameters if schedule is None else {"amplitude": schedule.at(step)}

    def arrive(self, step: int) -> Floats:
        """Take what acts in a step, pA for each neuron."""
        place = step % len(self.due)
        found: Floats = self.due[place].copy()
        self.due[place] = 0.0
        return found

    def charge(self, cells: TensorCells, step: int) -> None:
        """A current to a receptor adds to the state in which the receptor keeps its own."""
        if self.part.receptor is not None:
            state, share = filtered_current(self._program, self.part, cells.parameters)
            cells.states[state] = cells.states[state] + torch.from_numpy(share * self.arrive(step)).to(cells.device)
