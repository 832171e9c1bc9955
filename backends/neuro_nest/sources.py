"""Spike trains of generators: what they emit in a stretch of steps, drawn from the keyed stream or listed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from neuro.core import keyed_random
from neuro.program.program import Floats, Ints, Population

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
        seed: of the Poisson draws.
    """

    def __init__(self, part: Population, parameters: dict[str, Floats], resolution: float, seed: int) -> None:
        self.part, self.parameters, self.resolution = part, parameters, resolution
        self._key = keyed_random.key(seed, "poisson", part.name)
        self._steps, self._ids = part.spike_steps, part.spike_ids

    def emit(self, after: int, to: int) -> Train:
        """What is emitted in steps after < k <= to."""
        if self.part.kind == "poisson":
            return self._draw(max(after, self.part.start), min(to, self.part.stop))
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
        size = self.part.size
        means = np.broadcast_to(self.parameters["rate"] * self.resolution / 1000.0, size)
        rows = max(1, DRAWS // size)
        pieces = [self._table(means, np.arange(k, min(k + rows, to + 1))) for k in range(after + 1, to + 1, rows)]
        if not pieces:
            return Train(NONE, NONE, NONE)
        return Train(*(np.concatenate([getattr(p, name) for p in pieces]) for name in ("steps", "ids", "multiplicity")))

    def _table(self, means: Floats, steps: Ints) -> Train:
        u = keyed_random.uniform_table(self._key, steps, self.part.size)
        numbers = np.zeros(u.shape, dtype=np.int64)
        for mean in np.unique(means):
            here = means == mean
            numbers[:, here] = np.searchsorted(keyed_random.poisson_table(float(mean)), u[:, here], side="right")
        rows, ids = np.nonzero(numbers)
        return Train(steps[rows], ids, numbers[rows, ids])
