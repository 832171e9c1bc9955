"""The neurons or generators of one population."""

from __future__ import annotations

from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from neuro.core import keyed_random
from neuro.model.neurons import Generator, Neuron
from neuro.program.program import Floats, Ints, Population, drawn_for


class ReferencePopulation:
    """States and parameters of a population, which advance step by step.

    Args:
        part: the population.
        resolution: length of a step in ms.
        seed: seed of the random draws.
    """

    saved: ClassVar[tuple[str, ...]] = ("states", "injected_steps", "injected_ids", "injected_numbers")

    def __init__(self, part: Population, resolution: float, seed: int) -> None:
        self.part, self.size, self.resolution = part, part.size, resolution
        self.parameters = {name: values.copy() for name, values in part.parameters.items()}
        self.receptors = max(2, part.model.receptors) if isinstance(part.model, Neuron) else 2
        self.names = [state.name for state in part.model.states]
        self.states: Floats = np.zeros((len(self.names), self.size))
        self.key = keyed_random.key(seed, drawn_for(part), part.name)
        self.injected_steps: Ints = part.spike_steps.copy()
        self.injected_ids: Ints = part.spike_ids.copy()
        self.injected_numbers: Ints = part.spike_payloads.copy() if part.model.graded else np.ones_like(part.spike_ids)
        self.reset(self.names)
        self.refresh()

    def reset(self, names: list[str]) -> None:
        """Set the named states to their values at step 0."""
        for name in names:
            self.states[self.names.index(name)] = self.part.initial[name]

    def start_trial(self, names: tuple[str, ...]) -> None:
        """Set the named states to their values at step 0. If V_m is among them, refractoriness ends."""
        hidden_states = [s.name for s in self.part.model.states if s.hidden] if "V_m" in names else []
        self.reset([*names, *hidden_states])

    def refresh(self) -> None:
        """Compute the constants after a change of parameters."""
        model = self.part.model
        if not isinstance(model, (Neuron, Generator)) or self.part.kind not in ("neuron", "generator"):
            return
        values = [np.broadcast_to(v, self.size) for v in self.parameters.values()]
        self.constants: Floats = np.zeros((self.size, model.width))
        for i in range(self.size):
            model.arithmetic.constants([float(v[i]) for v in values], self.resolution, self.constants[i])
        all_equal = bool((self.constants == self.constants[0]).all())
        self.runs = [(0, self.size)] if all_equal else [(i, i + 1) for i in range(self.size)]

    def update(self, x: Floats, i_0: Floats, step: int) -> NDArray[np.uint8]:
        """Step every neuron; return how often each neuron reached threshold.

        Args:
            x: input by receptor, shape (receptors, size).
            i_0: external current in pA.
            step: number of the step.
        """
        fired = np.zeros(self.size, dtype=np.uint8)
        model = self.part.model
        assert isinstance(model, Neuron)
        draws = (keyed_random.uniform(self.key, step, np.arange(self.size)),) if model.draws else ()
        for lo, hi in self.runs:
            model.arithmetic.step(self.states, self.constants[lo], x, i_0, lo, hi, fired, *draws)
        return fired

    def fire(self, ids: Ints) -> None:
        """Apply the effect of a spike, such as the reset, to the neurons that spiked."""
        model = self.part.model
        assert isinstance(model, Neuron)
        for i in ids:
            model.arithmetic.fire(self.states, self.constants[i], i)

    def generate(self, step: int) -> Ints:
        """Return the number of spikes of each generator neuron in a step, or its payload."""
        numbers: Ints = np.zeros(self.size, dtype=np.int64)
        model, is_on = self.part.model, self.part.start < step <= self.part.stop
        if self.part.kind == "poisson":
            rate = self.parameters["rate"] if self.part.schedule is None else self.part.schedule.at(step)
            if is_on and rate.any():
                u = keyed_random.uniform(self.key, step, np.arange(self.size))
                means = np.broadcast_to(rate * self.resolution / 1000.0, self.size)
                for mean in np.unique(means):
                    same_mean = means == mean
                    numbers[same_mean] = np.searchsorted(
                        keyed_random.poisson_table(float(mean)), u[same_mean], side="right"
                    )
        elif isinstance(model, Generator) and self.part.kind == "generator":
            u, out = keyed_random.uniform(self.key, step, np.arange(self.size)), np.zeros(self.size)
            for lo, hi in self.runs if is_on else ():
                model.arithmetic.emit(self.states, self.constants[lo], u, step, lo, hi, out)
            numbers = out.astype(np.int64)
        else:
            is_now = self.injected_steps == step
            np.add.at(numbers, self.injected_ids[is_now], self.injected_numbers[is_now])
        return numbers

    def drop_listed(self) -> None:
        """Drop all listed spikes."""
        self.injected_steps = self.injected_ids = self.injected_numbers = np.zeros(0, dtype=np.int64)

    def inject(self, steps: Ints, ids: Ints, now: int, payloads: Ints | None = None) -> None:
        """Add spikes of a listed population, and drop those up to step `now`."""
        numbers = np.ones_like(ids) if payloads is None else payloads
        is_later = self.injected_steps > now
        self.injected_steps = np.concatenate((self.injected_steps[is_later], steps))
        self.injected_ids = np.concatenate((self.injected_ids[is_later], ids))
        self.injected_numbers = np.concatenate((self.injected_numbers[is_later], numbers))
