"""The synapses of a projection, and the spikes under way."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from neuro.model.neurons import Neuron
from neuro.model.synapses.base import steps_of
from neuro.program.currents import Emission, generator_of
from neuro.program.program import Floats, Ints, Program


class ReferenceProjection:
    """A projection as a list of all synapses, with the input under way.

    Attributes:
        source, target, delay: source, target and delay in steps of every synapse, sorted by source, then target. A
            learnt delay is the delay of the last spike.
        at_once: whether spikes are sent in the step in which they are emitted. True for generators, unless the synapses
            learn by pairs.
        late: delay of every synapse in ms, if a rule for trials changes delays. `set_out` rounds them.
        fewest, most: limits of the delay in steps.
        receptors: number of receptors of the target.
        slots: number of steps in the rings `due` and `heard`.
        slot: index of each synapse's weight; the synapses of a grid share weights.
        weights: all weights.
        row_ends: synapses of source i are row_ends[i] : row_ends[i + 1].
        due: ring of the input under way, (slots, receptor, target). The input of step t is in row t % slots.
        heard: ring with True where a spike arrives at a target, (slots, target).
        emission, held: the emission of a projection that carries a current, and the current that it sent last.

    Args:
        program: the whole network.
        index: index of the projection.
    """

    saved: tuple[str, ...] = ("weights", "due", "heard")

    def __init__(self, program: Program, index: int) -> None:
        self.part = part = program.projections[index]
        n_source = program.populations[part.source].size
        self.at_once = program.sends_at_once(part)
        self.n_target = program.populations[part.target].size
        self.source, self.target, self.slot = program.synapses(index)
        self.delay: Ints = np.broadcast_to(part.delay, len(self.source)).astype(np.int64)
        self.weights: Floats = np.broadcast_to(part.weight, part.size).copy()
        self.row_ends = np.searchsorted(self.source, np.arange(n_source + 1))
        self.h = program.resolution
        if part.synapse.delays and part.synapse.learns == "trials":
            self.late: Floats = self.delay.astype(np.float64) * self.h
            self.saved = (*self.saved, "late")
        self.fewest, self.most = part.delay_range(program.resolution)
        self.slots = self.most + 2
        if part.carries == "current":
            self.emission = Emission(program, index)
            self.held: Floats = np.zeros(self.emission.columns)
            self.saved = (*self.saved, *(("held",) if generator_of(program.populations[part.source]).draws else ()))
        model = program.populations[part.target].model
        assert isinstance(model, Neuron)
        self.receptors = model.receptors
        self.reset()

    def reset(self) -> None:
        """Drop all input under way."""
        self.due: Floats = np.zeros((self.slots, max(2, self.receptors), self.n_target))
        self.heard = np.zeros((self.slots, self.n_target), dtype=bool)

    def set_out(self, synapses: slice | Ints, delays: Floats) -> None:
        """Round the delays of some synapses from ms to steps, for the next spikes along the synapses."""
        self.delay[synapses] = [steps_of(delay, self.h, self.fewest, self.most) for delay in delays]

    def row(self, source: int) -> slice:
        """Return the range of synapses of one source."""
        return slice(int(self.row_ends[source]), int(self.row_ends[source + 1]))

    def send(self, source: int, multiplicity: int, step: int, weights: Floats, relay: bool) -> None:
        """Send a spike of a source.

        Args:
            source: index of the source.
            multiplicity: multiplicity of the spike.
            step: step of the emission.
            weights: weights of the synapses of the source.
            relay: whether the target repeats spikes, so that weights have no effect.
        """
        row = self.row(source)
        ring_row, targets = (step + self.delay[row]) % self.slots, self.target[row]
        amount = np.full(len(targets), float(multiplicity)) if relay else self.part.arriving(weights) * multiplicity
        # The receptor is the named receptor, or else follows from the sign of the weight.
        if self.part.receptor is not None:
            receptors = np.full(len(amount), self.part.receptor.index)
        else:
            receptors = ((amount < 0.0) & (self.receptors == 2)).astype(np.int64)
        np.add.at(self.due, (ring_row, receptors, targets), amount)
        self.heard[ring_row, targets] = True

    def send_current(self, parameters: Mapping[str, Floats], step: int) -> None:
        """Send the current emitted in `step`, if the generator is on. The current acts in the step after its arrival.

        Args:
            parameters: present parameters of the generator.
            step: step of the emission.
        """
        steps = np.array([step])
        if not self.emission.on(steps).size:
            return
        if self.emission.moments(steps)[0] == step:
            self.held = self.emission.at(steps, parameters)[0]
        amount = self.held[self.emission.column] * self.weights[self.slot]
        np.add.at(self.due[:, 0], ((step + self.delay + 1) % self.slots, self.target), amount)

    def arrive(self, step: int) -> tuple[Floats, NDArray[np.bool_]]:
        """Return and remove the input of a step, (receptor, target), and the marks of targets that receive a spike."""
        place = step % self.slots
        x, receives = self.due[place].copy(), self.heard[place].copy()
        self.due[place], self.heard[place] = 0.0, False
        return x, receives
