"""What generators of spikes emit, drawn on the host by the keyed numbers that all backends share."""

from __future__ import annotations

import numpy as np

from neuro.core import keyed_random
from neuro.model.neurons import Generator
from neuro.program.program import Floats, Ints, Population, drawn_for


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


def constants_of(part: Population, parameters: dict[str, Floats], resolution: float) -> Floats:
    """The constants of every neuron, shape (size, width), or of the one that all are like, shape (1, width)."""
    model = part.model
    size = max((values.size for values in parameters.values()), default=1)
    values = [np.broadcast_to(each, size) for each in parameters.values()]
    rows, back = (
        np.unique(np.stack(values, axis=1), axis=0, return_inverse=True)
        if values
        else (np.zeros((1, 0)), np.zeros(1, int))
    )
    found: Floats = np.zeros((len(rows), model.width))
    for row, constants in zip(rows, found, strict=True):
        model.arithmetic.constants(row.tolist(), resolution, constants)  # type: ignore[attr-defined]
    every: Floats = found[back.reshape(-1)]
    return every
