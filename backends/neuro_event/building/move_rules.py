"""The tables of projections that learn by moves."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from neuro.model.synapses import MoveRule
from neuro.program.program import Floats
from neuro_event.building.layout import EventArrays, zeros
from neuro_event.loop import tables as t
from neuro_event.loop.moves import move_entry


def add_moves(arrays: EventArrays) -> None:
    """Lay out all projections that learn by moves: states of synapses, traces of sources, lists of active sources."""
    program, threads = arrays.program, arrays.net["edges"].shape[1] - 1
    learning = [q for q, part in enumerate(program.projections) if isinstance(part.synapse, MoveRule)]
    arrays.moves_of = {q: k for k, q in enumerate(learning)}
    rules = [program.projections[q].synapse for q in learning]
    table = np.full((len(learning), t.MOVE_COLUMNS), t.NONE, dtype=np.int64)
    n_synapses = n_sources = n_targets = 0
    for row, q, rule in zip(table, learning, rules, strict=True):
        part = program.projections[q]
        row[t.MOVE_PROJECTION] = q
        row[t.MOVE_SYNAPSE], row[t.MOVE_SOURCE], row[t.MOVE_TARGET] = n_synapses, n_sources, n_targets
        states = [state.name for state in program.populations[part.target].model.states]
        assert isinstance(rule, MoveRule)
        row[t.MOVE_SEEN] = states.index(rule.sees) if rule.sees else t.NONE
        arrays.net["pops"][part.target, t.GATHERS] = 1
        rule_class: Any = type(rule)
        arrays.request(row, t.MOVE_ENTRY, partial(move_entry, rule_class))
        n_synapses += part.size
        n_sources += program.populations[part.source].size
        n_targets += program.populations[part.target].size
    y = np.zeros((max([1, *(1 + len(rule.states) for rule in rules)]), n_synapses))
    for row, q, rule in zip(table, learning, rules, strict=True):
        part, order = program.projections[q], arrays.synapses[q].order
        synapses = slice(row[t.MOVE_SYNAPSE], row[t.MOVE_SYNAPSE] + part.size)
        y[0, synapses] = part.weight[order] if order is not None and part.weight.size > 1 else part.weight
        y[1 : 1 + len(rule.states), synapses] = rule.first_states()
    sizes = {
        "moves": len(learning),
        "move_width": max([1, *(rule.width for rule in rules)]),
        "move_traces": t.MOVE_TRACES,
        "move_sources": n_sources,
        "move_marks": n_sources * t.MOVE_TRACES,
        "move_targets": n_targets,
        "threads": threads,
    }
    moves = [each for each in t.PLASTIC_ARRAYS if each.name.startswith("move_")]
    arrays.plastic |= {**zeros(moves, sizes), "move_table": table, "move_y": y}
    arrays.plastic["move_gate"][:] = 1.0
    receptors = [program.projections[q].receptor for q in learning]
    arrays.plastic["move_sign"] = np.array([-1.0 if each is not None and each.negated else 1.0 for each in receptors])
    for q, rule in zip(learning, rules, strict=True):
        set_move_rule(arrays, q, rule.vector())


def set_move_rule(arrays: EventArrays, projection: int, vector: Floats) -> None:
    """Write the constants, decays and increments that follow from the numbers of a rule."""
    k, rule = arrays.moves_of[projection], arrays.program.projections[projection].synapse
    parameters = dict(zip(rule.numbers(), vector.tolist(), strict=True))
    arrays.plastic["move_rule"][k, : rule.width] = rule.constants_of(vector, arrays.program.resolution)
    arrays.plastic["move_x_min"][k] = parameters["x_min"]
    for j, trace in enumerate(rule.pre):
        arrays.plastic["move_left"][k, j] = np.exp(-arrays.program.resolution / parameters[trace.tau])
        arrays.plastic["move_adds"][k, j] = trace.adds
