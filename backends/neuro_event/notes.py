"""The notes of what pre spikes leave: room for them, and from the kernels' buffers to those who ask."""

from __future__ import annotations

import numpy as np

from neuro.program.backend import Sent
from neuro.program.program import Ints, Program, SynapseProbe
from neuro_event import tables as t
from neuro_event.arrays import Arrays
from neuro_event.noting import notes_to_come

ROOM = 1 << 14
"""Notes for which there is room at first."""


def add_notes(a: Arrays, learning: list[int]) -> None:
    """Mark the plastic projections and synapses that probes at pre spikes ask for."""
    probes = probes_of(a.program)
    marked = {probe.projection for _, probe in probes}
    a.plastic["table"][:, t.NOTED] = [int(q in marked) for q in learning]
    a.plastic["note_this"] = np.zeros(a.plastic["sent"].size if marked else 0, dtype=np.uint8)
    for _, probe in probes:
        first = a.plastic["table"][learning.index(probe.projection), t.FIRST_SYNAPSE]
        here = a.plastic["note_this"][first : first + a.program.projections[probe.projection].size]
        order = a.synapses[probe.projection].order
        inside = np.arange(here.size) if order is None else np.argsort(order)
        here[inside if probe.synapses is None else inside[probe.synapses]] = 1
    _make_room(a, ROOM if marked else 0)


def probes_of(program: Program) -> list[tuple[int, SynapseProbe]]:
    """The probes at pre spikes of projections that learn from spike pairs, with their numbers."""
    return [
        (number, probe)
        for number, probe in enumerate(program.synapse_probes)
        if not probe.every and program.projections[probe.projection].synapse.learns == "pairs"
    ]


def _make_room(a: Arrays, room: int) -> None:
    threads = a.net["edges"].shape[1] - 1
    a.plastic["note_at"] = np.zeros((threads, 8), dtype=np.int64)
    a.plastic["note_steps"] = np.zeros((threads, room), dtype=np.int64)
    a.plastic["note_synapses"] = np.zeros((threads, room), dtype=np.int64)
    a.plastic["note_y"] = np.zeros((threads, a.plastic["y"].shape[0], room))


class Notes:
    """Takes notes out of the kernels' buffers before these are full.

    Args:
        a: the arrays of the kernels.
    """

    def __init__(self, a: Arrays) -> None:
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
            _make_room(self._a, 2 * needed)
        return needed > room

    def drain(self) -> None:
        """Take over what has been noted."""
        plastic = self._a.plastic
        for thread, n in enumerate(plastic["note_at"][:, 0].tolist()):
            if n:
                steps, places = plastic["note_steps"][thread, :n].copy(), plastic["note_synapses"][thread, :n]
                for number, probe in self._probes.items():
                    self._keep(number, probe, steps, places, plastic["note_y"][thread])
                plastic["note_at"][thread, 0] = 0

    def _keep(self, number: int, probe: SynapseProbe, steps: Ints, places: Ints, y: np.ndarray) -> None:
        a, part = self._a, self._a.program.projections[probe.projection]
        first = int(a.plastic["table"][a.plastic_of[probe.projection], t.FIRST_SYNAPSE])
        inside = places - first
        order = a.synapses[probe.projection].order
        here = (inside >= 0) & (inside < part.size)
        synapses = inside[here] if order is None else order[inside[here]]
        row = ["weight", *(s.name for s in part.synapse.states)].index(probe.record)
        found = Sent(steps[here], synapses.astype(np.int64), y[row, : places.size][here])
        if probe.synapses is not None:
            asked = np.isin(found.synapses, probe.synapses)
            found = Sent(found.steps[asked], found.synapses[asked], found.values[asked])
        self._kept[number].append(found)

    def take(self, number: int) -> Sent:
        """What was noted for a probe since this was last asked; the notes of a synapse are by time."""
        self.drain()
        none = Sent(np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros(0))
        parts, self._kept[number] = [none, *self._kept[number]], []
        return Sent(*(np.concatenate([getattr(part, word) for part in parts]) for word in Sent.__slots__))
