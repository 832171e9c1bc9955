"""Probes that the engine reads while it runs: states of neurons, and states of plastic synapses at pre spikes."""

from __future__ import annotations

import numpy as np

from neuro.program.backend import Sent
from neuro.program.program import Floats, Ints, Probe
from neuro_event.building import layout
from neuro_event.building.layout import EventArrays
from neuro_event.building.learning import make_record_buffers, probes_of
from neuro_event.loop import tables as t
from neuro_event.loop.together import notes_to_come, sample

ARRAY_SIZE, ARRAY_ROWS = 1 << 16, 1 << 10
"""Largest numbers of values and of steps in an array of a probe. The second keeps probes of few neurons small."""


class StateProbe:
    """A probe of a state of neurons, which the engine reads without updating the whole population.

    Args:
        arrays: the arrays of the kernels.
        probe: a probe that records a state of each neuron, not a mean.
    """

    def __init__(self, arrays: EventArrays, probe: Probe) -> None:
        self._arrays, self.every, self._population = arrays, probe.every, probe.population
        part, place = arrays.program.populations[probe.population], arrays.places[probe.population]
        self._state = [s.name for s in type(part.model).states].index(probe.record)
        ids = np.arange(part.size) if probe.ids is None else probe.ids
        self._places = place.begin + (ids if place.inside is None else np.asarray(place.inside)[ids]).astype(np.int64)
        self._block = np.zeros((arrays.net["state"].shape[0] + 1, t.BLOCK))  # a copy of a sleeping block, to update
        self._rows = max(1, min(ARRAY_ROWS, ARRAY_SIZE // ids.size))
        self._steps: list[int] = []
        self._values = [np.zeros((self._rows, ids.size))]

    def read(self, view: int, step: int) -> None:
        """Record the states at a step."""
        row = len(self._steps) % self._rows
        if row == 0 and self._steps:
            self._values.append(np.zeros_like(self._values[0]))
        out = self._values[-1][row]
        sample(
            view, self._population, self._state, self._places, step, self._arrays.program.resolution, self._block, out
        )
        self._steps.append(step)

    def take(self) -> tuple[Ints, Floats]:
        """Return the steps and values since the last call, and discard them."""
        steps = np.array(self._steps, dtype=np.int64)
        # Only filled rows are copied. An unfilled row of `zeros` takes no memory, but a copy of the row does.
        filled = steps.size - self._rows * (len(self._values) - 1)
        values = np.concatenate([*self._values[:-1], self._values[-1][:filled]])
        self._steps, self._values = [], self._values[:1]
        return steps, values


def state_probes(arrays: EventArrays) -> dict[int, StateProbe]:
    """Return the probes that record a state of single neurons, by their number in the program."""
    probes = {}
    for number, probe in enumerate(arrays.program.probes):
        part = arrays.program.populations[probe.population]
        states = [state.name for state in type(part.model).states]
        if probe.record in states and not probe.mean and layout.has_states(part):
            probes[number] = StateProbe(arrays, probe)
    return probes


class PreSpikeRecords:
    """The states of plastic synapses at pre spikes, taken from the buffers of the kernels before these are full.

    Args:
        arrays: the arrays of the kernels.
    """

    def __init__(self, arrays: EventArrays) -> None:
        self._arrays = arrays
        self._probes = dict(probes_of(arrays.program))
        self._records: dict[int, list[Sent]] = {number: [] for number in self._probes}

    def __bool__(self) -> bool:
        return bool(self._probes)

    def make_room(self, view: int, step: int) -> bool:
        """Make room in the buffers for the records of the spikes up to a step. Return whether arrays were replaced."""
        n_records: int = notes_to_come(view, step)
        capacity: int = self._arrays.plastic["note_steps"].shape[1]
        if n_records <= capacity:
            return False
        self.drain()
        if n_records > capacity:
            make_record_buffers(self._arrays, 2 * n_records)
        return n_records > capacity

    def drain(self) -> None:
        """Move the records from the buffers of all threads to the probes."""
        arrays, plastic = self._arrays, self._arrays.plastic
        for thread, n in enumerate(plastic["note_at"][:, 0].tolist()):
            if n:
                steps, places = plastic["note_steps"][thread, :n].copy(), plastic["note_synapses"][thread, :n]
                for number, probe in self._probes.items():
                    part, order = arrays.program.projections[probe.projection], arrays.synapses[probe.projection].order
                    inside = places - int(plastic["table"][arrays.plastic_of[probe.projection], t.FIRST_SYNAPSE])
                    rows = np.flatnonzero((inside >= 0) & (inside < part.size))
                    synapses = inside[rows] if order is None else order[inside[rows]]
                    if probe.synapses is not None:
                        chosen = np.isin(synapses, probe.synapses)
                        rows, synapses = rows[chosen], synapses[chosen]
                    row = ["weight", *(s.name for s in part.synapse.states)].index(probe.record)
                    values = plastic["note_y"][thread, row, rows]
                    self._records[number].append(Sent(steps[rows], synapses.astype(np.int64), values))
                plastic["note_at"][thread, 0] = 0

    def take(self, number: int) -> Sent:
        """Return the records of a probe since the last call. The records of a synapse are in the order of time."""
        self.drain()
        none = Sent(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros(0))
        parts, self._records[number] = [none, *self._records[number]], []
        return Sent(*(np.concatenate([getattr(part, word) for part in parts]) for word in Sent.__slots__))
