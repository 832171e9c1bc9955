"""Spike trains of generators: what they emit in a stretch of steps, drawn from the keyed stream or listed."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache
from types import FunctionType
from typing import Any

import numpy as np

from neuro.core import keyed_random
from neuro.model.neurons import Generator
from neuro.program.program import Floats, Ints, Population, drawn_for

DRAWS = 1 << 21
"""Draws that are held at a time."""

NONE: Ints = np.zeros(0, dtype=np.int64)


@dataclass(frozen=True, slots=True, eq=False)
class Train:
    """Spikes by step, then neuron; a multiplicity is several spikes of one neuron in one step."""

    steps: Ints
    ids: Ints
    multiplicity: Ints


def train(steps: Ints, ids: Ints, size: int) -> Train:
    """Spikes in any order, some of them several times, as a train."""
    codes, multiplicity = np.unique(steps * size + ids, return_counts=True)
    return Train(codes // size, codes % size, multiplicity.astype(np.int64))


class Source:
    """One population of generators.

    Args:
        part: the population.
        parameters: its present parameters; they may change between stretches.
        resolution: length of a step in ms.
        seed: of the draws.
    """

    def __init__(self, part: Population, parameters: dict[str, Floats], resolution: float, seed: int) -> None:
        self.part, self.parameters, self.resolution = part, parameters, resolution
        self._key = keyed_random.key(seed, drawn_for(part), part.name)
        self._steps, self._ids = part.spike_steps, part.spike_ids
        self._states: Floats = np.zeros((len(part.model.states), part.size))
        for row, state in enumerate(part.model.states):
            self._states[row] = part.initial[state.name]

    def emit(self, after: int, to: int) -> Train:
        """What is emitted in steps after < k <= to."""
        first, last = max(after, self.part.start), min(to, self.part.stop)
        if self.part.kind == "generator":
            return self._let_emit(first, last)
        if self.part.kind == "poisson":
            return self._draw(first, last)
        first, last = np.searchsorted(self._steps, (after, to), side="right")
        return train(self._steps[first:last], self._ids[first:last], self.part.size)

    def inject(self, steps: Ints, ids: Ints, now: int) -> None:
        """Add listed spikes; those up to step `now` are forgotten."""
        ahead = self._steps > now
        self._steps = np.concatenate((self._steps[ahead], steps))
        self._ids = np.concatenate((self._ids[ahead], ids))
        order = np.lexsort((self._ids, self._steps))
        self._steps, self._ids = self._steps[order], self._ids[order]

    def _draw(self, after: int, to: int) -> Train:
        pieces: list[Train] = []
        listed = self.part.schedule
        while after < to:
            end = to if listed is None else min(to, listed.next_change(after))
            rate = self.parameters["rate"] if listed is None else listed.at(after + 1)
            pieces += self._steady(rate, after, end)
            after = end
        return _joined(pieces)

    def _steady(self, rate: Floats, after: int, to: int) -> list[Train]:
        """What is emitted in steps after < k <= to at one rate."""
        size = self.part.size
        means = np.broadcast_to(rate * self.resolution / 1000.0, size)
        rows = max(1, DRAWS // size)
        return [self._table(means, np.arange(k, min(k + rows, to + 1))) for k in range(after + 1, to + 1, rows)]

    def _let_emit(self, after: int, to: int) -> Train:
        """What a generator with an `emit` of its own gives in steps after < k <= to."""
        model, size = self.part.model, self.part.size
        assert isinstance(model, Generator)
        emit, constants = _compiled(model.arithmetic.emit), self._constants(model)
        alike = len(np.unique(constants, axis=0)) == 1
        pieces = []
        for step in range(after + 1, to + 1):
            u, out = keyed_random.uniform(self._key, step, np.arange(size)), np.zeros(size)
            for lo, hi in [(0, size)] if alike else [(i, i + 1) for i in range(size)]:
                emit(self._states, constants[lo], u, step, lo, hi, out)
            ids = np.flatnonzero(out)
            pieces.append(Train(np.full(ids.size, step), ids, out[ids].astype(np.int64)))
        return _joined(pieces)

    def _constants(self, model: Generator) -> Floats:
        """Of each neuron, for its present parameters."""
        columns = [np.broadcast_to(values, self.part.size) for values in self.parameters.values()]
        found: Floats = np.zeros((self.part.size, model.width))
        for row, c in zip(np.stack(columns, axis=1), found, strict=True):
            model.arithmetic.constants(row, self.resolution, c)
        return found

    def _table(self, means: Floats, steps: Ints) -> Train:
        u = keyed_random.uniform_table(self._key, steps, self.part.size)
        numbers = np.zeros(u.shape, dtype=np.int64)
        for mean in np.unique(means):
            here = means == mean
            numbers[:, here] = np.searchsorted(keyed_random.poisson_table(float(mean)), u[:, here], side="right")
        rows, ids = np.nonzero(numbers)
        return Train(steps[rows], ids, numbers[rows, ids])


def _joined(pieces: list[Train]) -> Train:
    if not pieces:
        return Train(NONE, NONE, NONE)
    return Train(*(np.concatenate([getattr(p, name) for p in pieces]) for name in ("steps", "ids", "multiplicity")))


@cache
def _compiled(emit: FunctionType) -> Any:
    """A generator's `emit` as machine code."""
    from neuro.kernels.jit import compiled, kernel

    return compiled(emit, kernel)
