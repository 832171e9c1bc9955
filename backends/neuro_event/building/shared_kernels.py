"""The tables of grids whose kernels learn."""

from __future__ import annotations

import numpy as np

from neuro.model.synapses import stdp_dopa
from neuro.program.program import Floats, Projection
from neuro_event.building.layout import EventArrays, zeros
from neuro_event.loop import tables as t
from neuro_event.loop.shared_kernels import STDP, STDP_DOPA


def add_shared(a: EventArrays) -> None:
    """Lay out the traces of the neurons, the changes of the weights, and the eligibilities of the synapses."""
    program = a.program
    learning = [q for q, p in enumerate(program.projections) if learns_shared(p)]
    a.shared_of = {q: k for k, q in enumerate(learning)}
    table = np.zeros((len(learning), t.SHARED_COLUMNS), dtype=np.int64)
    n_sources = n_targets = n_entries = n_positions = n_pairs = n_marks = 0
    for row, q in zip(table, learning, strict=True):
        p = program.projections[q]
        assert p.grid is not None
        positions = p.grid.rows * p.grid.columns
        row[t.SHARED_PROJECTION], row[t.SHARED_NUMBER] = q, a.shared_of[q]
        row[t.SHARED_RULE] = STDP_DOPA if isinstance(p.synapse, stdp_dopa) else STDP
        row[t.SHARED_MEAN] = int(p.grid.mean)
        row[t.SHARED_SOURCE], row[t.SHARED_TARGET], row[t.SHARED_ENTRY] = n_sources, n_targets, n_entries
        row[t.SHARED_POSITION], row[t.SHARED_PAIR], row[t.SHARED_PLACE] = n_positions, n_pairs, n_marks
        row[t.SHARED_DOPAMINE], row[t.SHARED_ONE_TO_ONE] = p.dopamine, int(p.dopamine_one_to_one)
        row[t.SHARED_LATER] = p.dopamine_delay
        n_sources += program.populations[p.source].size
        n_targets += program.populations[p.target].size
        n_entries += p.size
        n_positions += positions
        n_pairs += positions * p.size * int(p.synapse.modulated)
        n_marks += positions * p.size * int(p.grid.mean)
    sizes = {
        "shared": len(learning),
        "shared_sources": n_sources,
        "shared_targets": n_targets,
        "shared_entries": n_entries,
        "shared_positions": n_positions,
        "shared_pairs": n_pairs,
        "shared_marks": n_marks,
    }
    shared = [each for each in t.PLASTIC_ARRAYS if each.name.startswith("shared_")]
    width = max(program.projections[q].synapse.width for q in learning)
    rule = np.zeros((len(learning), width))
    a.plastic |= {**zeros(shared, sizes), "shared_table": table, "shared_rule": rule}
    for row, q in zip(table, learning, strict=True):
        target = program.projections[q].target
        tau_minus = program.populations[target].parameters["tau_minus"]
        decay = np.broadcast_to(np.exp(-program.resolution / tau_minus), program.populations[target].size)
        first = row[t.SHARED_TARGET]
        a.plastic["shared_left_minus"][first : first + decay.size] = a.places[target].by_place(decay)
        set_shared_rule(a, q, program.projections[q].synapse.vector())


def learns_shared(p: Projection) -> bool:
    """Return whether a projection is a grid whose kernels learn from spike pairs."""
    return p.synapse.learns == "pairs" and p.grid is not None


def set_shared_rule(a: EventArrays, projection: int, vector: Floats) -> None:
    """Write the constants and decays that follow from the numbers of a rule."""
    k, rule = a.shared_of[projection], a.program.projections[projection].synapse
    numbers = dict(zip(rule.numbers(), vector.tolist(), strict=True))
    a.plastic["shared_rule"][k, : rule.width] = rule.constants_of(vector, a.program.resolution)
    a.plastic["shared_left_plus"][k] = np.exp(-a.program.resolution / numbers["tau_plus"])
