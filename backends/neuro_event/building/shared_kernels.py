"""The tables of grids whose kernels learn."""

from __future__ import annotations

import numpy as np

from neuro.model.synapses import stdp_dopa
from neuro.program.program import Floats, Projection
from neuro_event.building.layout import EventArrays, zeros
from neuro_event.loop import tables as t
from neuro_event.loop.shared_kernels import STDP, STDP_DOPA


def add_shared(arrays: EventArrays) -> None:
    """Lay out all grids whose kernels learn: traces of neurons, changes of weights, eligibilities of synapses."""
    program = arrays.program
    learning = [q for q, part in enumerate(program.projections) if learns_shared(part)]
    arrays.shared_of = {q: k for k, q in enumerate(learning)}
    table = np.zeros((len(learning), t.SHARED_COLUMNS), dtype=np.int64)
    n_sources = n_targets = n_entries = n_positions = n_pairs = n_marks = 0
    for row, q in zip(table, learning, strict=True):
        part = program.projections[q]
        assert part.grid is not None
        positions = part.grid.rows * part.grid.columns
        row[t.SHARED_PROJECTION], row[t.SHARED_NUMBER] = q, arrays.shared_of[q]
        row[t.SHARED_RULE] = STDP_DOPA if isinstance(part.synapse, stdp_dopa) else STDP
        row[t.SHARED_MEAN] = int(part.grid.mean)
        row[t.SHARED_SOURCE], row[t.SHARED_TARGET], row[t.SHARED_ENTRY] = n_sources, n_targets, n_entries
        row[t.SHARED_POSITION], row[t.SHARED_PAIR], row[t.SHARED_PLACE] = n_positions, n_pairs, n_marks
        row[t.SHARED_DOPAMINE], row[t.SHARED_ONE_TO_ONE] = part.dopamine, int(part.dopamine_one_to_one)
        row[t.SHARED_LATER] = part.dopamine_delay
        n_sources += program.populations[part.source].size
        n_targets += program.populations[part.target].size
        n_entries += part.size
        n_positions += positions
        n_pairs += positions * part.size * int(part.synapse.modulated)
        n_marks += positions * part.size * int(part.grid.mean)
    sizes = {
        "shared": len(learning),
        "shared_sources": n_sources,
        "shared_targets": n_targets,
        "shared_entries": n_entries,
        "shared_positions": n_positions,
        "shared_pairs": n_pairs,
        "shared_marks": n_marks,
    }
    shared = [array for array in t.PLASTIC_ARRAYS if array.name.startswith("shared_")]
    width = max(program.projections[q].synapse.width for q in learning)
    rule = np.zeros((len(learning), width))
    arrays.plastic |= {**zeros(shared, sizes), "shared_table": table, "shared_rule": rule}
    for row, q in zip(table, learning, strict=True):
        target = program.projections[q].target
        tau_minus = program.populations[target].parameters["tau_minus"]
        decay = np.broadcast_to(np.exp(-program.resolution / tau_minus), program.populations[target].size)
        first = row[t.SHARED_TARGET]
        arrays.plastic["shared_left_minus"][first : first + decay.size] = arrays.places[target].by_place(decay)
        set_shared_rule(arrays, q, program.projections[q].synapse.vector())


def learns_shared(p: Projection) -> bool:
    """Return whether a projection is a grid whose kernels learn from spike pairs."""
    return p.synapse.learns == "pairs" and p.grid is not None


def set_shared_rule(arrays: EventArrays, projection: int, vector: Floats) -> None:
    """Write the constants and decays that follow from the numbers of a rule."""
    k, rule = arrays.shared_of[projection], arrays.program.projections[projection].synapse
    numbers = dict(zip(rule.numbers(), vector.tolist(), strict=True))
    arrays.plastic["shared_rule"][k, : rule.width] = rule.constants_of(vector, arrays.program.resolution)
    arrays.plastic["shared_left_plus"][k] = np.exp(-arrays.program.resolution / numbers["tau_plus"])
