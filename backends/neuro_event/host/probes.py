"""Probes that the engine reads by itself while it runs: states of neurons, and what pre spikes leave in synapses."""

from __future__ import annotations

import numpy as np

from neuro.program.backend import Sent
from neuro.program.program import Floats, Ints, Probe
from neuro_event.building import layout
from neuro_event.building.layout import EventArrays
from neuro_event.building.learning import make_room, probes_of
from neuro_event.loop import tables as t
from neuro_event.loop.together import notes_to_come, sample

AT_ONCE = 1 << 16
"""Numbers that are kept in one array."""


class StateProbe:
    """A probe of states that the engine reads by itself, without bringing a whole population to the present.

    Args:
        a: the arrays of the kernels.
        probe: of a state, with each neuron by itself.
    """

    def __init__(self, a: EventArrays, probe: Probe) -> None:
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


def state_probes(a: EventArrays) -> dict[int, StateProbe]:
    """The probes that ask for each value of a state of neurons, by their numbers in the program."""
    probes = {}
    for number, probe in enumerate(a.program.probes):
        part = a.program.populations[probe.population]
        states = [state.name for state in type(part.model).states]
        if probe.record in states and not probe.mean and layout.computes(part):
            probes[number] = StateProbe(a, probe)
    return probes


class PreSpikeRecords:
    """Takes notes out of the kernels' buffers before these are full.

    Args:
        a: the arrays of the kernels.
    """

    def __init__(self, a: EventArrays) -> None:
        self._a = a
        self._probes = dict(probes_of(a.program))
        self._kept: dict[int, list[Sent]] = {number: [] for number in self._probes}

    def __bool__(self) -> bool:
        return bool(self._probes)

    def make_room(self, view: int, step: int) -> bool:
        """Make room for what the spikes up to a step will leave; return whether arrays were replaced."""
        needed: int = notes_to_come(view, step)
        room: int = self._a.plastic["note_steps"].shape[1]
        if needed <= room:
            return False
        self.drain()
        if needed > room:
            make_room(self._a, 2 * needed)
        return needed > room

    def drain(self) -> None:
        """Take over what has been noted."""
        a, plastic = self._a, self._a.plastic
        for thread, n in enumerate(plastic["note_at"][:, 0].tolist()):
            if n:
                steps, places = plastic["note_steps"][thread, :n].copy(), plastic["note_synapses"][thread, :n]
                for number, probe in self._probes.items():
                    part, order = a.program.projections[probe.projection], a.synapses[probe.projection].order
                    inside = places - int(plastic["table"][a.plastic_of[probe.projection], t.FIRST_SYNAPSE])
                    here = np.flatnonzero((inside >= 0) & (inside < part.size))
                    synapses = inside[here] if order is None else order[inside[here]]
                    if probe.synapses is not None:
                        chosen = np.isin(synapses, probe.synapses)
                        here, synapses = here[chosen], synapses[chosen]
                    row = ["weight", *(s.name for s in part.synapse.states)].index(probe.record)
                    values = plastic["note_y"][thread, row, here]
                    self._kept[number].append(Sent(steps[here], synapses.astype(np.int64), values))
                plastic["note_at"][thread, 0] = 0

    def take(self, number: int) -> Sent:
        """What was noted for a probe since this was last asked; the notes of a synapse are by time."""
        self.drain()
        none = Sent(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros(0))
        parts, self._kept[number] = [none, *self._kept[number]], []
        return Sent(*(np.concatenate([getattr(part, word) for part in parts]) for word in Sent.__slots__))
