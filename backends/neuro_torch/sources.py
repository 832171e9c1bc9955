"""Generators on the host: spikes from the keyed random numbers that all backends share, and currents by projection."""

from __future__ import annotations

import numpy as np
import torch

from neuro.core import keyed_random
from neuro.model.neurons import Generator
from neuro.program.currents import Emission, filtered_current
from neuro.program.program import Floats, Ints, Population, Program, drawn_for
from neuro_torch.cells import TensorCells, constants_of


class TensorSource:
    """A population that emits spikes of its own: listed, Poisson, or from the `emit` of its model.

    Attributes:
        parameters: current values by name.
        states: states of a generator, shape (states, size).
        steps, ids, numbers: listed spikes, each with its payload, or 1.

    Args:
        part: the population.
        resolution: length of a step in ms.
        seed: seed of the draws.
    """

    def __init__(self, part: Population, resolution: float, seed: int) -> None:
        self.part, self._h = part, resolution
        self._key = keyed_random.key(seed, drawn_for(part), part.name)
        self.parameters = {word: values.copy() for word, values in part.parameters.items()}
        self.names = [state.name for state in part.model.states]
        self.start_anew()

    def start_anew(self) -> None:
        """Return to step 0; parameters stay."""
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
        """Compute the constants after a change of parameters."""
        if self.part.kind == "generator":
            self._constants = constants_of(self.part, self.parameters, self._h)
            is_uniform = bool((self._constants == self._constants[0]).all())
            self._runs = [(0, self.part.size)] if is_uniform else [(i, i + 1) for i in range(self.part.size)]

    def emit(self, step: int) -> Ints:
        """Return the number of spikes of each neuron in a step, or its payload."""
        if self.part.kind == "listed":
            emitted: Ints = np.zeros(self.part.size, dtype=np.int64)
            is_due = self.steps == step
            np.add.at(emitted, self.ids[is_due], self.numbers[is_due])
            return emitted
        if not self.part.start < step <= self.part.stop:
            return np.zeros(self.part.size, dtype=np.int64)
        return self._poisson(step) if self.part.kind == "poisson" else self._by_model(step)

    def inject(self, steps: Ints, ids: Ints, now: int, payloads: Ints | None = None) -> None:
        """Add listed spikes; spikes up to step `now` are dropped."""
        is_later, new_numbers = self.steps > now, np.ones_like(ids) if payloads is None else payloads
        self.steps, self.ids, self.numbers = (
            np.concatenate((old[is_later], new))
            for old, new in ((self.steps, steps), (self.ids, ids), (self.numbers, new_numbers))
        )

    def _poisson(self, step: int) -> Ints:
        counts: Ints = np.zeros(self.part.size, dtype=np.int64)
        rate = self.parameters["rate"] if self.part.schedule is None else self.part.schedule.at(step)
        if rate.any():
            u = keyed_random.uniform(self._key, step, np.arange(self.part.size))
            means = np.broadcast_to(rate * self._h / 1000.0, self.part.size)
            for mean in np.unique(means):
                same_mean = means == mean
                counts[same_mean] = np.searchsorted(keyed_random.poisson_table(float(mean)), u[same_mean], side="right")
        return counts

    def _by_model(self, step: int) -> Ints:
        model = self.part.model
        assert isinstance(model, Generator)
        u, out = keyed_random.uniform(self._key, step, np.arange(self.part.size)), np.zeros(self.part.size)
        for lo, hi in self._runs:
            model.arithmetic.emit(self.states, self._constants[lo], u, step, lo, hi, out)
        return out.astype(np.int64)


class Flow:
    """A projection that carries a current.

    Attributes:
        weights: weight of every synapse.
        due: current in pA that acts in later steps, (step modulo (longest delay + 2), neuron).
        held: the last emitted currents in pA, which flow until the next change.

    Args:
        program: the network.
        index: index of the projection.
        parameters: current parameters of its generator, shared by all its projections.
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
        """Drop all currents that have not acted."""
        slots = int(self._delay.max(initial=1)) + 2
        self.due: Floats = np.zeros((slots, self._program.populations[self.part.target].size))
        self.held: Floats = np.zeros(self._emission.columns)

    def send(self, step: int) -> None:
        """Send the current emitted in a step, if any; a current acts in the step after its arrival."""
        moment = np.array([step])
        if not self._emission.on(moment).size:
            return
        if self._emission.moments(moment)[0] == step:
            self.held = self._emission.at(moment, self._parameters_at(step))[0]
        amount = self.held[self._emission.column] * self.weights[self._slot]
        np.add.at(self.due, ((step + self._delay + 1) % len(self.due), self._target), amount)

    def _parameters_at(self, step: int) -> dict[str, Floats]:
        schedule = self._source.schedule
        return self.parameters if schedule is None else {"amplitude": schedule.at(step)}

    def arrive(self, step: int) -> Floats:
        """Remove and return the current that acts in a step, pA for each neuron."""
        place = step % len(self.due)
        current: Floats = self.due[place].copy()
        self.due[place] = 0.0
        return current

    def charge(self, cells: TensorCells, step: int) -> None:
        """Add a current onto a receptor to the neuron state that holds this receptor's current."""
        if self.part.receptor is not None:
            state, share = filtered_current(self._program, self.part, cells.parameters)
            cells.states[state] = cells.states[state] + torch.from_numpy(share * self.arrive(step)).to(cells.device)
