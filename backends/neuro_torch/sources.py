"""Generators on the host: spikes by the keyed numbers that all backends share, and currents along one projection."""

from __future__ import annotations

import numpy as np
import torch

from neuro.core import keyed_random
from neuro.model.neurons import Generator
from neuro.program.currents import Emission, filtered_current
from neuro.program.program import Floats, Ints, Population, Program, drawn_for
from neuro_torch.cells import TensorCells, constants_of


class TensorSource:
    """A population that emits spikes of its own: listed, Poisson, or by the `emit` of its model.

    Attributes:
        parameters: by word, as they are now.
        states: of a generator that has some, shape (states, size).
        steps, ids, numbers: listed spikes, each with its payload, or 1.

    Args:
        part: the population.
        resolution: length of a step in ms.
        seed: of the draws.
    """

    def __init__(self, part: Population, resolution: float, seed: int) -> None:
        self.part, self._h = part, resolution
        self._key = keyed_random.key(seed, drawn_for(part), part.name)
        self.parameters = {word: values.copy() for word, values in part.parameters.items()}
        self.names = [state.name for state in part.model.states]
        self.start_anew()

    def start_anew(self) -> None:
        """As at step 0; parameters stay."""
        self.states: Floats = np.zeros((len(self.names), self.part.size))
        for row, name in enumerate(self.names):
            self.states[row] = self.part.initial[name]
        self.steps, self.ids = self.part.spike_steps.copy(), self.part.spike_ids.copy()
        self.numbers: Ints = self.part.spike_payloads.copy() if self.part.model.graded else np.ones_like(self.ids)
        self.refresh()

    def put(self, name: str, values: Floats) -> None:
        """Set a state."""
        self.states[self.names.index(name)] = values

    def refresh(self) -> None:
        """Work out the constants after a change of parameters."""
        if self.part.kind == "generator":
            self._constants = constants_of(self.part, self.parameters, self._h)
            alike = bool((self._constants == self._constants[0]).all())
            self._runs = [(0, self.part.size)] if alike else [(i, i + 1) for i in range(self.part.size)]

    def emit(self, step: int) -> Ints:
        """How many spikes each neuron emits in a step, or its payload."""
        if self.part.kind == "listed":
            found: Ints = np.zeros(self.part.size, dtype=np.int64)
            due = self.steps == step
            np.add.at(found, self.ids[due], self.numbers[due])
            return found
        if not self.part.start < step <= self.part.stop:
            return np.zeros(self.part.size, dtype=np.int64)
        return self._drawn(step) if self.part.kind == "poisson" else self._emitted(step)

    def inject(self, steps: Ints, ids: Ints, now: int, payloads: Ints | None = None) -> None:
        """Add listed spikes; those up to step `now` are forgotten."""
        ahead, numbers = self.steps > now, np.ones_like(ids) if payloads is None else payloads
        self.steps, self.ids, self.numbers = (
            np.concatenate((old[ahead], new))
            for old, new in ((self.steps, steps), (self.ids, ids), (self.numbers, numbers))
        )

    def _drawn(self, step: int) -> Ints:
        numbers: Ints = np.zeros(self.part.size, dtype=np.int64)
        rate = self.parameters["rate"] if self.part.schedule is None else self.part.schedule.at(step)
        if rate.any():
            u = keyed_random.uniform(self._key, step, np.arange(self.part.size))
            means = np.broadcast_to(rate * self._h / 1000.0, self.part.size)
            for mean in np.unique(means):
                here = means == mean
                numbers[here] = np.searchsorted(keyed_random.poisson_table(float(mean)), u[here], side="right")
        return numbers

    def _emitted(self, step: int) -> Ints:
        model = self.part.model
        assert isinstance(model, Generator)
        u, out = keyed_random.uniform(self._key, step, np.arange(self.part.size)), np.zeros(self.part.size)
        for lo, hi in self._runs:
            model.arithmetic.emit(self.states, self._constants[lo], u, step, lo, hi, out)
        return out.astype(np.int64)


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
