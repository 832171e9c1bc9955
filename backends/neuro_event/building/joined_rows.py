"""Which projections share joined rows, and how these are laid out."""

from __future__ import annotations

from functools import partial
from itertools import groupby
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.threads import mapped
from neuro.model.neurons import Neuron
from neuro.program.program import Ints, Program
from neuro_event.building import layout
from neuro_event.building.arrays import EventArrays
from neuro_event.loop import tables as t
from neuro_event.loop.arrivals import count_runs
from neuro_event.loop.joined_rows import lay_joined

SHARED = 2
"""Projections in a joined row, on average, from which on there are any."""

SHORT = 8
"""Synapses in a run of the projections by themselves, on average, below which rows are joined."""

MOST = 1 << 27
"""Synapses of all joined rows, which are a second copy: 12 bytes each."""

_RECEPTORS = 2
"""The most receptors of a target: the place of an input tells its block."""

Row = list[int]
"""The projections, all of one source, whose synapses a joined row holds."""


def choose(program: Program) -> frozenset[int]:
    """The projections in joined rows; none if these would not be shared, or gain little."""
    kept = {q for q in range(len(program.projections)) if _can_be_joined(program, q)}
    rows = _rows(program, _stretches(program, kept))
    while unfit := {q for row in rows if not _is_filled(program, row) for q in row}:
        kept -= unfit
        rows = _rows(program, _stretches(program, kept))
    joined = [q for row in rows for q in row]
    synapses = sum(program.projections[q].size for q in joined)
    short = synapses < SHORT * sum(_runs(program, [q]) for q in joined)
    return frozenset(joined if short and synapses <= MOST and len(joined) >= SHARED * len(rows) else ())


def _can_be_joined(program: Program, q: int) -> bool:
    p = program.projections[q]
    model = program.populations[p.target].model
    return p.size > 0 and layout.is_timed(p) and isinstance(model, Neuron) and model.receptors <= _RECEPTORS


def _stretches(program: Program, kept: set[int]) -> list[Row]:
    """For each target the most neighbours of `kept` among all that is added at arrival.

    Input is summed up in the order of projections, so all others come before or after those in joined rows.
    """
    arriving: dict[int, Row] = {}
    for q, p in enumerate(program.projections):
        ringed = layout.learns_pairs(p) or (layout.own_delays(p) and not layout.in_runs(program, p))
        if p.size and p.carries == "spikes" and (q in kept or not ringed):
            arriving.setdefault(p.target, []).append(q)
    found = ([list(few) for joined, few in groupby(into, kept.__contains__) if joined] for into in arriving.values())
    return [max(stretches, key=len) for stretches in found if stretches]


def _rows(program: Program, stretches: list[Row]) -> list[Row]:
    """The joined rows of what arrives at each target, in an order that keeps that of every sum."""
    rank: dict[int, int] = {}
    rows: dict[tuple[int, int], Row] = {}
    for stretch in stretches:
        layer, last = 0, -1
        for q in stretch:
            at = rank.setdefault(program.projections[q].source, len(rank))
            # Sources in another order than elsewhere, or a second time, go on in later rows.
            layer, last = layer + (at <= last), at
            rows.setdefault((layer, at), []).append(q)
    return [rows[place] for place in sorted(rows)]


def _is_filled(program: Program, row: Row) -> bool:
    """Whether most runs are not empty, or are few."""
    parts = [program.projections[q] for q in row]
    return _runs(program, row) <= sum(p.size for p in parts) or all(layout.in_runs(program, p) for p in parts)


def _runs(program: Program, row: Row) -> int:
    """Source neurons x delays."""
    spans = [program.projections[q].delay_span for q in row]
    delays = max(longest for _, longest in spans) - min(shortest for shortest, _ in spans) + 1
    return program.populations[program.projections[row[0]].source].size * delays


def join(a: EventArrays) -> None:
    """Lay out the joined rows, with the weights of now; projections that have a ring by now are left out."""
    part(a)
    a.parted = False
    stretches = []
    for pop in a.net["pops"]:
        arriving = a.net["incoming"][pop[t.ARRIVALS] : pop[t.ARRIVALS_END]].tolist()
        places = [pop[t.ARRIVALS] + k for k, q in enumerate(arriving) if q in a.joined]
        if places:
            pop[t.JOINED], pop[t.JOINED_END] = places[0], places[-1] + 1
            stretches.append([q for q in arriving if q in a.joined])
    rows = _rows(a.program, stretches)
    table = np.full((len(rows), t.PROJECTION_COLUMNS), t.NONE, dtype=np.int64)
    runs = synapses = 0
    for columns, row in zip(table, rows, strict=True):
        columns[[t.SOURCE, t.RUN, t.SYNAPSE]] = a.program.projections[row[0]].source, runs, synapses
        spans = np.array([a.program.projections[q].delay_span for q in row])
        columns[t.SHORTEST], columns[t.DELAYS] = spans[:, 0].min(), np.ptp(spans) + 1
        runs += _runs(a.program, row) * _threads(a) + 1
        synapses += sum(a.program.projections[q].size for q in row)
    a.net["joined"] = table
    a.net["joined_runs"] = np.zeros(runs, dtype=np.uint32)
    a.net["joined_targets"] = np.empty(synapses, dtype=np.int32)
    a.net["joined_weights"] = np.empty(synapses)
    list(mapped(partial(_lay, a), list(zip(table, rows, strict=True)), _threads(a)))


def part(a: EventArrays) -> None:
    """Let there be no joined rows until they are laid out anew, as they must be before the next step."""
    a.parted = bool(a.joined)
    pops = a.net["pops"]
    pops[:, t.JOINED] = pops[:, t.JOINED_END] = pops[:, t.ARRIVALS]
    a.net["joined"] = np.zeros((0, t.PROJECTION_COLUMNS), dtype=np.int64)
    a.net["joined_runs"] = np.zeros(0, dtype=np.uint32)
    a.net["joined_targets"] = np.zeros(0, dtype=np.int32)
    a.net["joined_weights"] = np.zeros(0)


def _threads(a: EventArrays) -> int:
    return int(a.net["edges"].shape[1] - 1)


def _lay(a: EventArrays, given: tuple[Ints, Row]) -> None:
    """Lay out a joined row."""
    columns, row = given
    runs = a.net["joined_runs"][columns[t.RUN] :][: _runs(a.program, row) * _threads(a) + 1]
    places, weights = (a.net[name][columns[t.SYNAPSE] :] for name in ("joined_targets", "joined_weights"))
    span = int(columns[t.SHORTEST]), int(columns[t.DELAYS])
    for q in row:
        count_runs(*_synapses(a, q), *span, runs)
    np.cumsum(runs, out=runs)
    following = runs[:-1].copy()
    for q in row:
        first, stride = a.net["projections"][q, [t.WEIGHT, t.WEIGHT_STRIDE]].tolist()
        own = a.net["weights"][first:]
        lay_joined(*_synapses(a, q), *span, own, stride, _inputs(a, q), following, places, weights)


def _synapses(a: EventArrays, q: int) -> tuple[Ints, NDArray[np.int32], NDArray[np.integer[Any]], Ints]:
    """Ends of the rows, targets and delays of a projection, and the edges of the threads among its targets."""
    p, s = a.program.projections[q], a.synapses[q]
    delay = p.delay if s.order is None else p.delay[s.order]
    return s.row_ends, s.targets, delay, a.net["edges"][p.target] * t.BLOCK - a.places[p.target].begin


def _inputs(a: EventArrays, q: int) -> Ints:
    """Where the first target of a projection has its input of weights of either sign."""
    columns, target = a.net["projections"][q], a.program.projections[q].target
    first = max(int(columns[t.RECEPTOR]), 0)
    by_sign = columns[t.RECEPTOR] < 0 and a.net["pops"][target, t.RECEPTORS] == _RECEPTORS
    receptors = np.array([first, first + by_sign], dtype=np.int64)
    return a.places[target].begin + receptors * int(a.net["x"].shape[1])
