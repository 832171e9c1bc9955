"""Probes of states that the engine reads by itself, without bringing a whole population to the present."""

from __future__ import annotations

import numpy as np

from neuro.core.clock import NEVER
from neuro.program.program import Floats, Ints, Probe
from neuro_event import layout, tables as t
from neuro_event.arrays import Arrays
from neuro_event.sampling import sample

AT_ONCE = 1 << 16
"""Numbers that are kept in one array."""


class Sampled:
    """One probe.

    Args:
        a: the arrays of the kernels.
        probe: of a state, with each neuron by itself.
    """

    def __init__(self, a: Arrays, probe: Probe) -> None:
        self._a, self.every, self._population = a, probe.every, probe.population
        part, place = a.program.populations[probe.population], a.places[probe.population]
        self._state = [s.name for s in type(part.model).states].index(probe.record)
        ids = np.arange(part.size) if probe.ids is None else probe.ids
        self._places = place.begin + (ids if place.inside is None else np.asarray(place.inside)[ids]).astype(np.int64)
        self._aside = np.zeros((a.net["state"].shape[0] + 1, t.BLOCK))
        self._rows = max(1, AT_ONCE // ids.size)
        self._steps: list[int] = []
        self._values = [np.zeros((self._rows, ids.size))]

    def read(self, view: int, step: int) -> None:
        """Keep the states as of a step."""
        row = len(self._steps) % self._rows
        if row == 0 and self._steps:
            self._values.append(np.zeros_like(self._values[0]))
        out = self._values[-1][row]
        sample(view, self._population, self._state, self._places, step, self._a.program.resolution, self._aside, out)
        self._steps.append(step)

    def take(self) -> tuple[Ints, Floats]:
        """Steps and values since this was last asked."""
        steps = np.array(self._steps, dtype=np.int64)
        values = np.concatenate(self._values)[: steps.size]
        self._steps, self._values = [], self._values[:1]
        return steps, values


class Samples:
    """All probes that the engine reads by itself, by their numbers in the program.

    Args:
        a: the arrays of the kernels.
    """

    def __init__(self, a: Arrays) -> None:
        self.probes = {
            number: Sampled(a, probe) for number, probe in enumerate(a.program.probes) if can_sample(a, probe)
        }

    def next_due(self, step: int) -> int:
        """The first step from `step` on in which one is due."""
        return min((-(-step // probe.every) * probe.every for probe in self.probes.values()), default=NEVER)

    def read(self, view: int, step: int) -> None:
        """Keep what is due in a step."""
        for probe in self.probes.values():
            if step % probe.every == 0:
                probe.read(view, step)


def can_sample(a: Arrays, probe: Probe) -> bool:
    """Whether a probe asks for each value of a state of neurons."""
    part = a.program.populations[probe.population]
    states = [s.name for s in type(part.model).states]
    return probe.record in states and not probe.mean and layout.computes(part)
