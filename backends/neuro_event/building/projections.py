"""The tables of the projections: where their synapses, weights, delays and rings lie."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.clock import NEVER
from neuro.core.threads import mapped
from neuro.model.neurons import Neuron
from neuro.program.program import Floats, Grid, Ints, Population, Program, Projection
from neuro_event.building import joined_rows, layout
from neuro_event.building.layout import EventArrays, aligned_zeros
from neuro_event.loop import tables as t
from neuro_event.loop.arrivals import fill_runs
from neuro_event.loop.operations import NEURONS


def add_projections(a: EventArrays) -> None:
    """Lay out all projections, and the buffer of the input and the rings."""
    program = a.program
    table = np.full((len(program.projections), t.PROJECTION_COLUMNS), t.NONE, dtype=np.int64)
    rows, targets, weights, delays = [], [], [], []
    n_rows = n_runs = n_targets = n_weights = n_delays = 0
    ring = layout.receptors(program) * a.net["empty_input"].shape[1]
    at_emission = []
    for q, (p, s) in enumerate(zip(program.projections, a.synapses, strict=True)):
        target = program.populations[p.target]
        row, in_runs = table[q], layout.in_runs(program, p)
        row[t.SOURCE], row[t.TARGET], row[t.LAYOUT] = p.source, p.target, s.layout
        row[t.RECEPTOR] = t.NONE if p.receptor is None else p.receptor.index
        if q in a.joined:
            row[t.LAG], row[t.WAKE_ALL], row[t.DENSE_COUNTS] = p.delay_range(program.resolution)[1], NEVER, 0
            continue
        if s.layout == t.CSR:
            local = a.net["edges"][p.target] * t.BLOCK - a.places[p.target].begin
            targets.append(s.targets)
            row[t.SYNAPSE] = n_targets
            if in_runs:
                row[t.RUN], n_runs = n_runs, n_runs + _set_delay_columns(program, p, local, row)
            else:
                rows.append(layout.split_rows(s.row_ends, s.targets, local) + n_targets)
                row[t.ROW], n_rows = n_rows, n_rows + rows[-1].size
            n_targets += s.targets.size
        own = layout.internal_weights(program, q, s.order) if p.weight.size else np.zeros(1)
        row[t.WEIGHT], row[t.WEIGHT_STRIDE], row[t.SIGN] = (
            n_weights,
            int(own.size > 1 or p.synapse.learns == "moves"),
            _sign(p, own),
        )
        weights.append(own)
        n_weights += own.size
        delay = p.delay[s.order] if p.delay.size > 1 and s.order is not None else p.delay
        if delay.size == 0:
            delay = np.ones(1, dtype=np.int32)
        if in_runs:
            delay = delay[:0]
        elif not layout.own_delays(p):
            delay = delay[:1]
        elif delay.size != p.size:
            delay = np.broadcast_to(delay, max(1, p.size))
        row[t.DELAY], row[t.DELAY_STRIDE] = n_delays, int(layout.own_delays(p))
        delays.append(delay.astype(np.int32))
        n_delays += delay.size
        blocks = a.net["pops"][p.target, t.LAST_BLOCK] - a.net["pops"][p.target, t.FIRST_BLOCK]
        row[t.WAKE_ALL] = _wake_all(p, s, int(blocks))
        row[t.DENSE_COUNTS] = 0
        if in_runs:
            row[t.LAG] = p.delay_range(program.resolution)[1]
        elif q in a.plastic_of or row[t.DELAY_STRIDE] == 1:
            longest = p.delay_range(program.resolution)[1]
            ring = _give_ring(row, longest, target.size, a.net["pops"][p.target, t.RECEPTORS], ring, a.longest_slice)
            if q not in a.plastic_of:
                at_emission.append(q)
        else:
            row[t.LAG] = int(delay[0]) if delay.size else 1
        if p.grid is not None:
            _grid_columns(row, p.grid, a.places[p.source].inside is not None)
    a.net["projections"] = table
    a.net["set_out"][:] = t.NONE
    a.net["rows"] = _joined(rows, np.int64)
    a.net["runs"] = np.zeros(n_runs, dtype=np.uint32)
    threads = a.net["edges"].shape[1] - 1
    list(mapped(partial(_fill_runs, a), np.flatnonzero(table[:, t.RUN] >= 0).tolist(), threads))
    a.net["targets"] = _joined(targets, np.int32)
    a.net["weights"] = _joined(weights, np.float64)
    if any(p.synapse.learns in ("moves", "trials") for p in program.projections):
        own_weights(a)
    a.net["delays"] = _joined(delays, np.int32)
    if any(p.synapse.delays and p.synapse.learns == "trials" for p in program.projections):
        a.net["late"] = a.net["delays"] * program.resolution
    a.net["at_emission"] = np.array(at_emission, dtype=np.int64)
    set_buffer(a, np.full(ring, -0.0))
    list_incoming(a)


def _sign(p: Projection, own: NDArray[np.floating[Any]]) -> int:
    """Whether all weights go to one receptor, now and when they have learnt."""
    return t.MIXED if p.synapse.learns == "moves" else layout.sign(own)


def _set_delay_columns(program: Program, p: Projection, edges: Ints, row: Ints) -> int:
    """Set the columns of the delays of a projection's runs; return how many numbers say where runs begin."""
    shortest, longest = p.delay_range(program.resolution)
    row[t.SHORTEST], row[t.DELAYS] = shortest, longest - shortest + 1
    return program.populations[p.source].size * int(row[t.DELAYS]) * (edges.size - 1) + 1


def _fill_runs(a: EventArrays, q: int) -> None:
    """Tell where the runs of a projection begin."""
    p, s, row = a.program.projections[q], a.synapses[q], a.net["projections"][q]
    local = a.net["edges"][p.target] * t.BLOCK - a.places[p.target].begin
    runs = a.net["runs"][row[t.RUN] : row[t.RUN] + _set_delay_columns(a.program, p, local, row)]
    delay = p.delay if s.order is None else p.delay[s.order]
    fill_runs(s.row_ends, s.targets, delay, local, int(row[t.SHORTEST]), int(row[t.DELAYS]), runs)


def _wake_all(p: Projection, s: layout.ArrangedSynapses, blocks: int) -> int:
    """How many spikes of a step reach about all blocks of the target, so that these need not be marked one by one."""
    if s.layout == t.DENSE:
        return 1
    if p.grid is not None:  # what several spikes reach may be the same blocks
        rows, columns = (-(-n // p.grid.stride) for n in (p.grid.kernel_height, p.grid.kernel_width))
        marks = min(rows, p.grid.rows) * (1 + min(columns, p.grid.columns) * p.grid.maps / t.BLOCK)
        return 1 if marks > blocks else NEVER
    return 1 + 2 * blocks * (s.row_ends.size - 1) // s.targets.size if s.targets.size else NEVER


def own_weights(a: EventArrays) -> bool:
    """Take a copy of the weights before they change, if they are the program's; return whether that was needed."""
    shared = any(
        np.may_share_memory(a.net["weights"], p.weight)
        for q, p in enumerate(a.program.projections)
        if q not in a.joined
    )
    if shared:
        a.net["weights"] = a.net["weights"].copy()
    return shared


def _give_ring(row: Ints, longest: int, n: int, receptors: int, at: int, slice_: int) -> int:
    slots = layout.power_of_two(longest + slice_ + 1)
    row[t.LAG] = 0
    row[t.RING], row[t.RING_MASK], row[t.RING_SIZE] = at, slots - 1, n
    return int(at + slots * n * receptors)


def give_ring(a: EventArrays, q: int) -> None:
    """Let a projection deliver at emission from now on, into a new ring."""
    p = a.program.projections[q]
    row = a.net["projections"][q]
    receptors = a.net["pops"][p.target, t.RECEPTORS]
    if q in a.joined:
        lay_out(a, q)
    end = _give_ring(
        row,
        p.delay_range(a.program.resolution)[1],
        a.program.populations[p.target].size,
        receptors,
        a.net["buf"].size,
        a.longest_slice,
    )
    set_buffer(a, np.concatenate([a.net["buf"], np.full(end - a.net["buf"].size, -0.0)]))
    a.net["at_emission"] = np.append(a.net["at_emission"], q)
    list_incoming(a)


def lay_out(a: EventArrays, q: int) -> None:
    """Lay out a projection of joined rows by itself, as it needs who has a ring."""
    row, net = a.net["projections"][q], a.net
    if row[t.WEIGHT] < 0:
        own = joined_rows.weights(a, q)
        row[t.WEIGHT], row[t.WEIGHT_STRIDE], row[t.SIGN] = net["weights"].size, int(own.size > 1), layout.sign(own)
        net["weights"] = np.concatenate([net["weights"], own])
    row_ends, targets, delay, local = joined_rows.synapses(a, q)
    rows = layout.split_rows(row_ends, targets, local) + net["targets"].size
    for name, column, values in (("rows", t.ROW, rows), ("targets", t.SYNAPSE, targets), ("delays", t.DELAY, delay)):
        row[column] = net[name].size
        net[name] = np.concatenate([net[name], values], dtype=net[name].dtype)
    row[t.DELAY_STRIDE] = 1


def set_buffer(a: EventArrays, buf: Floats) -> None:
    """Use `buf` for the input and the rings."""
    rows, n = a.net["empty_input"].shape
    a.net["buf"] = aligned_zeros(buf.size, np.float64)
    a.net["buf"][:] = buf
    a.net["x"] = a.net["buf"][: rows * n].reshape(rows, n)


def _grid_columns(row: Ints, g: Grid, source_permuted: bool) -> None:
    row[t.CHANNEL_HEIGHT], row[t.CHANNEL_WIDTH] = g.height, g.width
    row[t.MAPS], row[t.ROWS], row[t.COLUMNS] = g.maps, g.rows, g.columns
    row[t.DEPTH], row[t.KERNEL_HEIGHT], row[t.KERNEL_WIDTH] = g.kernels[1:]
    row[t.STRIDE], row[t.TOP], row[t.LEFT], row[t.REACH] = g.stride, g.top, g.left, g.reach
    row[t.CHANNELS_INSIDE] = g.channels if source_permuted else 0


def _joined(parts: list[NDArray[Any]], dtype: Any) -> NDArray[Any]:
    """All parts in one array; not copied where they already are neighbouring views of one."""
    kept = [p for p in parts if p.size]
    whole = kept[0] if len(kept) == 1 else (kept[0].base if kept else None)
    if whole is not None and whole.dtype == dtype and whole.size == sum(p.size for p in kept):
        places = [p.ctypes.data for p in kept]
        expected = whole.ctypes.data + np.cumsum([0, *(p.nbytes for p in kept[:-1])])
        if whole.flags.c_contiguous and np.array_equal(places, expected):
            return whole
    return np.concatenate([np.zeros(0, dtype=dtype), *parts]).astype(dtype, copy=False)


def list_incoming(a: EventArrays) -> None:
    """For each population: projections read from the spike log on arrival, then those with a ring; no currents."""
    incoming: list[int] = []
    for k, population in enumerate(a.program.populations):
        into = [
            q
            for q, p in enumerate(a.program.projections)
            if p.target == k and a.net["pops"][p.source, t.KIND] != t.CURRENT
        ]
        for first, last, ringed in ((t.ARRIVALS, t.ARRIVALS_END, False), (t.RINGS, t.RINGS_END, True)):
            a.net["pops"][k, first] = len(incoming)
            incoming += [q for q in into if (a.net["projections"][q, t.LAG] == 0) == ringed]
            a.net["pops"][k, last] = len(incoming)
        a.net["pops"][k, t.COLLECTS] = _first_collected(a, k, population) if _all_marked(a, into) else t.NONE
    a.net["incoming"] = np.array(incoming, dtype=np.int64)
    joined_rows.part(a)


def _first_collected(a: EventArrays, k: int, population: Population) -> int:
    """The first state to which the loop itself adds the population's input after a step; NONE if it must not."""
    row, model = a.net["pops"][k], population.model
    if not isinstance(model, Neuron) or not model.collects:
        return t.NONE
    if type(model) not in NEURONS or row[t.GROUP] >= 0 or row[t.CARRIED] == 1:
        return t.NONE
    return [state.name for state in type(model).states].index(model.collects[0])


def _all_marked(a: EventArrays, into: list[int]) -> bool:
    """Whether deliveries over all of some projections mark where input arrives, and reach few."""
    return a.joined.isdisjoint(into) and all(
        row[t.LAYOUT] == t.CSR and row[t.LAG] > 0 and row[t.RUN] < 0 and row[t.WAKE_ALL] > 1
        for row in a.net["projections"][into]
    )
