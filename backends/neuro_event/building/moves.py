"""The tables of the projections that learn by moves."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from neuro.model.synapses import MoveRule
from neuro.program.program import Floats
from neuro_event.building.arrays import EventArrays
from neuro_event.loop import tables as t
from neuro_event.loop.moves import move_entry


def add_moves(a: EventArrays) -> None:
    """Lay out the states of the synapses, the traces of the sources and the lists of those that are active."""
    program, threads = a.program, a.net["edges"].shape[1] - 1
    learning = [q for q, p in enumerate(program.projections) if isinstance(p.synapse, MoveRule)]
    a.moves_of = {q: k for k, q in enumerate(learning)}
    rules = [program.projections[q].synapse for q in learning]
    table = np.full((len(learning), t.MOVE_COLUMNS), t.NONE, dtype=np.int64)
    n_synapses = n_sources = n_targets = 0
    for row, q, rule in zip(table, learning, rules, strict=True):
        p = program.projections[q]
        row[t.MOVE_PROJECTION] = q
        row[t.MOVE_SYNAPSE], row[t.MOVE_SOURCE], row[t.MOVE_TARGET] = n_synapses, n_sources, n_targets
        states = [state.name for state in program.populations[p.target].model.states]
        assert isinstance(rule, MoveRule)
        row[t.MOVE_SEEN] = states.index(rule.sees) if rule.sees else t.NONE
        a.net["pops"][p.target, t.GATHERS] = 1
        own: Any = type(rule)
        a.ask(row, t.MOVE_ENTRY, partial(move_entry, own))
        n_synapses += p.size
        n_sources += program.populations[p.source].size
        n_targets += program.populations[p.target].size
    y = np.zeros((max([1, *(1 + len(rule.states) for rule in rules)]), n_synapses))
    for row, q, rule in zip(table, learning, rules, strict=True):
        p, order = program.projections[q], a.synapses[q].order
        here = slice(row[t.MOVE_SYNAPSE], row[t.MOVE_SYNAPSE] + p.size)
        y[0, here] = p.weight[order] if order is not None and p.weight.size > 1 else p.weight
        y[1 : 1 + len(rule.states), here] = rule.first_states()
    a.plastic |= {
        "move_table": table,
        "move_rule": np.zeros((len(learning), max([1, *(rule.width for rule in rules)]))),
        "move_left": np.zeros((len(learning), t.MOVE_TRACES)),
        "move_adds": np.zeros((len(learning), t.MOVE_TRACES)),
        "move_x_min": np.zeros(len(learning)),
        "move_sign": np.array([_sign(program.projections[q]) for q in learning]),
        "move_y": y,
        "move_x": np.zeros((threads, n_sources * t.MOVE_TRACES)),
        "move_lists": np.zeros((threads, 2, n_sources), dtype=np.int64),
        "move_count": np.zeros((threads, len(learning), 2), dtype=np.int64),
        "move_is_lit": np.zeros((threads, n_sources), dtype=np.uint8),
        "move_is_live": np.zeros((threads, n_sources), dtype=np.uint8),
        "move_gate": np.ones(n_targets),
        "move_signal": np.zeros(n_targets),
        "move_spikes": np.zeros(n_targets),
        "move_seen": np.zeros(n_targets),
        "move_concerned": np.zeros(n_targets, dtype=np.int64),
    }
    for q, rule in zip(learning, rules, strict=True):
        set_move_rule(a, q, rule.vector())


def set_move_rule(a: EventArrays, projection: int, vector: Floats) -> None:
    """Fill what follows from the numbers of a rule."""
    k, rule = a.moves_of[projection], a.program.projections[projection].synapse
    numbers = dict(zip(rule.numbers(), vector.tolist(), strict=True))
    a.plastic["move_rule"][k, : rule.width] = rule.constants_of(vector, a.program.resolution)
    a.plastic["move_x_min"][k] = numbers["x_min"]
    for j, trace in enumerate(rule.pre):
        a.plastic["move_left"][k, j] = np.exp(-a.program.resolution / numbers[trace.tau])
        a.plastic["move_adds"][k, j] = trace.adds


def _sign(p: Any) -> float:
    """What a weight is multiplied with before it arrives."""
    return -1.0 if p.receptor is not None and p.receptor.negated else 1.0
