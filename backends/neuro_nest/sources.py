"""Spike trains of generators for a stretch of steps: listed, or drawn from keyed random numbers."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from types import FunctionType
from typing import Any

import numpy as np

from neuro.core import keyed_random
from neuro.model.neurons import Generator, noise_generator
from neuro.program.currents import Currents, Emission, generator_of
from neuro.program.program import Floats, Ints, Population, Program, drawn_for
from neuro_nest.kernel import set_nodes
from neuro_nest.tables import NestClock

DRAWS = 1 << 21
"""Number of random numbers that are held at a time."""

NONE: Ints = np.zeros(0, dtype=np.int64)


@dataclass(frozen=True, slots=True, eq=False)
class InjectedTrain:
    """Spikes sorted by step, then neuron, as arrays of shape (spikes,).

    A multiplicity above 1 stands for several spikes of a neuron in the same step.
    """

    steps: Ints
    ids: Ints
    multiplicity: Ints


def train(steps: Ints, ids: Ints, size: int) -> InjectedTrain:
    """Return a train of spikes in any order, some of which may occur several times."""
    codes, multiplicity = np.unique(steps * size + ids, return_counts=True)
    return InjectedTrain(codes // size, codes % size, multiplicity.astype(np.int64))


class TrainSource:
    """The spikes of one population of generators.

    Args:
        part: the population.
        parameters: present parameters of the population, which may change between stretches.
        resolution: length of a step in ms.
        seed: seed of the draws.
    """

    def __init__(self, part: Population, parameters: dict[str, Floats], resolution: float, seed: int) -> None:
        self.part, self.parameters, self.resolution = part, parameters, resolution
        self._key = keyed_random.key(seed, drawn_for(part), part.name)
        self._steps, self._ids = part.spike_steps, part.spike_ids
        self._states: Floats = np.zeros((len(part.model.states), part.size))
        for row, state in enumerate(part.model.states):
            self._states[row] = part.initial[state.name]

    def emit(self, after: int, to: int) -> InjectedTrain:
        """Return the spikes of the steps k with after < k <= to."""
        first, last = max(after, self.part.start), min(to, self.part.stop)
        if self.part.kind == "generator":
            return self._run_generator(first, last)
        if self.part.kind == "poisson":
            return self._draw(first, last)
        first, last = np.searchsorted(self._steps, (after, to), side="right")
        return train(self._steps[first:last], self._ids[first:last], self.part.size)

    def inject(self, steps: Ints, ids: Ints, now: int) -> None:
        """Add listed spikes, and drop those up to step `now`."""
        is_later = self._steps > now
        self._steps = np.concatenate((self._steps[is_later], steps))
        self._ids = np.concatenate((self._ids[is_later], ids))
        order = np.lexsort((self._ids, self._steps))
        self._steps, self._ids = self._steps[order], self._ids[order]

    def _draw(self, begin: int, to: int) -> InjectedTrain:
        """Return the spikes of Poisson generators in the steps k with begin < k <= to."""
        pieces: list[InjectedTrain] = []
        schedule, size = self.part.schedule, self.part.size
        while begin < to:
            end = to if schedule is None else min(to, schedule.next_change(begin))
            rate = self.parameters["rate"] if schedule is None else schedule.at(begin + 1)
            means, rows = np.broadcast_to(rate * self.resolution / 1000.0, size), max(1, DRAWS // size)
            for first in range(begin + 1, end + 1, rows):
                steps = np.arange(first, min(first + rows, end + 1))
                u = keyed_random.uniform_table(self._key, steps, size)
                numbers = np.zeros(u.shape, dtype=np.int64)
                for mean in np.unique(means):
                    same_mean = means == mean
                    table = keyed_random.poisson_table(float(mean))
                    numbers[:, same_mean] = np.searchsorted(table, u[:, same_mean], side="right")
                places, ids = np.nonzero(numbers)
                pieces.append(InjectedTrain(steps[places], ids, numbers[places, ids]))
            begin = end
        return _joined(pieces)

    def _run_generator(self, after: int, to: int) -> InjectedTrain:
        """Return the spikes of a third-party generator in the steps k with after < k <= to."""
        model, size = self.part.model, self.part.size
        assert isinstance(model, Generator)
        emit = _compiled(model.arithmetic.emit)
        columns = [np.broadcast_to(values, size) for values in self.parameters.values()]
        constants: Floats = np.zeros((size, model.width))
        for row, c in zip(np.stack(columns, axis=1), constants, strict=True):
            model.arithmetic.constants(row, self.resolution, c)
        all_equal = len(np.unique(constants, axis=0)) == 1
        pieces = []
        for step in range(after + 1, to + 1):
            u, out = keyed_random.uniform(self._key, step, np.arange(size)), np.zeros(size)
            for lo, hi in [(0, size)] if all_equal else [(i, i + 1) for i in range(size)]:
                emit(self._states, constants[lo], u, step, lo, hi, out)
            ids = np.flatnonzero(out)
            pieces.append(InjectedTrain(np.full(ids.size, step), ids, out[ids].astype(np.int64)))
        return _joined(pieces)


def _joined(pieces: list[InjectedTrain]) -> InjectedTrain:
    if not pieces:
        return InjectedTrain(NONE, NONE, NONE)
    return InjectedTrain(
        *(np.concatenate([getattr(p, name) for p in pieces]) for name in ("steps", "ids", "multiplicity"))
    )


@cache
def _compiled(emit: FunctionType) -> Any:
    """Compile the `emit` of a generator."""
    from neuro.kernels.jit import compiled, kernel

    return compiled(emit, kernel)


def is_noise(part: Population) -> bool:
    """Return whether a population is a noise generator, whose currents are drawn here."""
    return isinstance(part.model, noise_generator)


def nodes_of(program: Program, population: int) -> int:
    """Return the number of nodes of a population: one per neuron, but for individual noise a node per connection."""
    part = program.populations[population]
    if not (is_noise(part) and generator_of(part).individual):
        return part.size
    return max(1, sum(p.size for p in program.projections if p.source == population))


def first_node(program: Program, projection: int) -> int | None:
    """Return the node of the first synapse of a projection if each synapse has its own node, else None."""
    source = program.projections[projection].source
    part = program.populations[source]
    if not (is_noise(part) and generator_of(part).individual):
        return None
    return sum(p.size for p in program.projections[:projection] if p.source == source)


class Noise:
    """The currents of a noise_generator.

    Args:
        program: the whole network.
        population: index of the generator.
        currents: present parameters of the generators.
    """

    def __init__(self, program: Program, population: int, currents: Currents) -> None:
        self._population, self._currents, self._clock = population, currents, NestClock(program.resolution)
        self._stop = program.populations[population].stop
        outgoing = [q for q, p in enumerate(program.projections) if p.source == population]
        if not generator_of(program.populations[population]).individual:
            outgoing = outgoing[:1]
        self._emissions = [Emission(program, q) for q in outgoing]

    def emit(self, nest: Any, nodes: Any, after: int, to: int) -> None:
        """Pass to NEST the currents of the steps k with after < k <= to."""
        if not self._emissions:
            return
        steps = np.arange(after + 1, to + 1)
        is_change = (steps == after + 1) | (steps == self._stop)
        on_steps = self._emissions[0].on(steps)
        is_change[np.isin(steps, on_steps[self._emissions[0].moments(on_steps) == on_steps])] = True
        histories = self._currents.parameters(self._population)
        amplitudes = np.concatenate(
            [emission.during(steps, histories)[is_change] for emission in self._emissions], axis=1
        )
        times = self._clock.array_ms(steps[is_change])
        set_nodes(
            nest, nodes, [{"amplitude_times": times, "amplitude_values": values} for values in amplitudes.T.copy()]
        )
