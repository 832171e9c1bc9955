"""Choose and lay out joined rows.

A joined row has the synapses of each source neuron of one projection, or of several projections with the same source.
Its synapses are in runs: one run for each source neuron and delay.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import groupby
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from neuro.core.errors import ModelError
from neuro.core.system import mapped
from neuro.model.neurons import Neuron
from neuro.program.compact import CompactProjection, SynapseBlock, is_single
from neuro.program.program import Floats, Ints, Program, StoredSynapses
from neuro_event.building import layout
from neuro_event.building.layout import EventArrays
from neuro_event.loop import tables as t
from neuro_event.loop.arrivals import MOST, Listed, lay_joined, list_joined

AT_ONCE = 1 << 17
"""Number of synapses that are laid out at a time, few enough for the second-level cache."""

FREED_AT_ONCE = 1 << 21
"""Number of synapses whose memory is returned to the system at a time."""

MEAN_INTERVAL = 200.0
"""Interval between two spikes of a neuron that the comparison of rows and rings assumes, ms."""

TEST_NS, LOOK_NS, ADD_NS, RING_ADD_NS, RING_READ_NS = 2.4, 9.0, 15.0, 42.0, 1.0
"""Durations of parts of a delivery in ns, measured with 20,000 sources and delays of 3 to 30 ms.

`TEST_NS`: test whether a population spiked in a step. `LOOK_NS`: find the run of a spike. `ADD_NS`: add an event of a
run. `RING_ADD_NS`: add an event of a ring. `RING_READ_NS`: read a place of a ring in a step.
"""

Row = list[int]
"""Indices of the projections in a joined row, which all have one source population."""


def choose(program: Program) -> frozenset[int]:
    """Choose projections with several delays for joined rows, so that each target adds its inputs in the same order.

    Projections whose rows have mostly empty runs get rings, unless rings take longer in total. Rings may take longer,
    because only projections that are neighbours in the sum of a target share a row, and a projection with a ring
    separates its neighbours.
    """
    candidates = {q for q, p in enumerate(program.projections) if p.size and layout.is_timed(p)}
    alone = {q for q in candidates if _in_runs(program, q)}
    attempts = [_group_rows(program, _series(program, candidates))]
    while unfit := {q for row in attempts[-1] if _is_sparse(program, row) for q in row if not _in_runs(program, q)}:
        candidates -= unfit
        attempts.append(_group_rows(program, _series(program, candidates)))
    best = attempts[0] if len(attempts) == 1 else min(attempts, key=partial(_expected_ns, program))
    return frozenset(q for row in best for q in row) | alone


def _expected_ns(program: Program, rows: list[Row]) -> float:
    """Estimate the time of all deliveries between two spikes of a neuron, if all neurons fire at the same rate."""
    steps = MEAN_INTERVAL / program.resolution
    joined = {q for row in rows for q in row}
    separate = [q for q, p in enumerate(program.projections) if p.size and layout.is_timed(p) and q not in joined]
    looks = adds = 0.0
    for row in [*rows, *([q] for q in separate if _in_runs(program, q))]:
        neurons = program.populations[program.projections[row[0]].source].size
        looks += _n_runs(program, row) * (LOOK_NS + TEST_NS * steps / neurons)
        adds += ADD_NS * sum(program.projections[q].size for q in row)
    for q in separate:
        if not _in_runs(program, q):
            target = program.populations[program.projections[q].target]
            receptors = target.model.receptors if isinstance(target.model, Neuron) else 0
            adds += RING_ADD_NS * program.projections[q].size + RING_READ_NS * target.size * receptors * steps
    return looks + adds


def _series(program: Program, candidates: set[int]) -> list[Row]:
    """Return the longest series of candidates of each target population, see `_longest_series`."""
    arriving: dict[int, Row] = {}
    for q, p in enumerate(program.projections):
        ringed = layout.learns_from_pairs(p) or (layout.has_own_delays(p) and not layout.in_runs(program, p))
        if p.size and p.carries == "spikes" and (q in candidates or not ringed):
            arriving.setdefault(p.target, []).append(q)
    return [series for arriving_at in arriving.values() if (series := _longest_series(arriving_at, candidates))]


def _longest_series(arriving: Row, candidates: Collection[int]) -> Row:
    """Return the longest series of candidates that are neighbours in the order of a target's sum.

    A target adds its inputs in the order of the projections. The projections of a joined row are added together, so no
    other projection may lie between them. Example: of the arriving 0 1 2 4 5 with the candidates 1 2 5, return 1 2.
    """
    series = (list(few) for joined, few in groupby(arriving, candidates.__contains__) if joined)
    return max(series, key=len, default=[])


def _group_rows(program: Program, series: list[Row]) -> list[Row]:
    """Group the series of all targets into joined rows, and order the rows as the sums of the targets require."""
    rank: dict[tuple[int, bool], int] = {}
    rows: dict[tuple[int, int], Row] = {}
    for neighbours in series:
        layer, last = 0, -1
        for q in neighbours:
            at = rank.setdefault((program.projections[q].source, _by_sign(program, q)), len(rank))
            # A source that occurs twice, or in another order than at other targets, continues in a later row.
            layer, last = layer + (at <= last), at
            rows.setdefault((layer, at), []).append(q)
    return [rows[place] for place in sorted(rows)]


def _by_sign(program: Program, q: int) -> bool:
    """Return whether the negative weights of a projection arrive at a second receptor."""
    p = program.projections[q]
    model = program.populations[p.target].model
    return p.receptor is None and isinstance(model, Neuron) and model.receptors == 2


def _is_sparse(program: Program, row: Row) -> bool:
    """Return whether most runs of a row are empty."""
    return _n_runs(program, row) > sum(program.projections[q].size for q in row)


def _in_runs(program: Program, q: int) -> bool:
    return layout.in_runs(program, program.projections[q])


def _n_runs(program: Program, row: Row) -> int:
    """Return the number of runs of a row, which is source neurons x delays."""
    spans = [program.projections[q].delay_span for q in row]
    delays = max(longest for _, longest in spans) - min(shortest for shortest, _ in spans) + 1
    return program.populations[program.projections[row[0]].source].size * delays


def join(arrays: EventArrays) -> None:
    """Lay out the joined rows with the present weights. Projections that now have a ring are left out.

    A compact program has too many synapses for two copies: its own arrays are freed row by row, so the joined rows
    become the only copy.
    """
    layout.clear_joined_rows(arrays)
    series: list[Row] = []
    alone: Row = []
    for pop in arrays.net["pops"]:
        incoming = arrays.net["incoming"][pop[t.ARRIVALS] : pop[t.ARRIVALS_END]].tolist()
        arriving = [q for q in incoming if arrays.program.projections[q].size]
        if neighbours := _longest_series(arriving, arrays.joined):
            pop[t.JOINED] = pop[t.ARRIVALS] + incoming.index(neighbours[0])
            pop[t.JOINED_END] = pop[t.ARRIVALS] + incoming.index(neighbours[-1]) + 1
            series.append(neighbours)
        alone += [q for q in arriving if q in arrays.joined and q not in neighbours]
    shared_rows = _group_rows(arrays.program, series)
    arrays.net["projections"][alone, t.JOINED_ROW] = np.arange(len(alone)) + len(shared_rows)
    rows = [*shared_rows, *([q] for q in alone)]
    shared = _SHARED_ROWS.get(arrays.program)
    unchanged = as_described(arrays).issuperset(q for row in rows for q in row)
    if shared is not None and unchanged and shared.rows == rows and np.array_equal(shared.edges, arrays.net["edges"]):
        arrays.net |= shared.net
        return
    table = np.full((len(rows), t.PROJECTION_COLUMNS), t.NONE, dtype=np.int64)
    bases = np.zeros((len(rows), _threads(arrays)), dtype=np.int64)
    reach = np.zeros((len(rows), len(arrays.program.populations)), dtype=np.uint8)
    n_runs = 0
    for k, (columns, row) in enumerate(zip(table, rows, strict=True)):
        parts = [arrays.program.projections[q] for q in row]
        spans = np.array([part.delay_span for part in parts])
        columns[[t.ROW, t.SOURCE, t.RUN]] = k, parts[0].source, n_runs
        columns[t.TARGET] = t.NONE if k < len(shared_rows) else parts[0].target
        columns[t.SHORTEST], columns[t.DELAYS] = spans[:, 0].min(), np.ptp(spans) + 1
        own = [block.weight for q in row for block in synapse_blocks(arrays, q)]
        columns[t.SINGLE] = all(map(is_single, own))
        # A row whose synapses share a weight stores the weight once.
        columns[t.WEIGHT_STRIDE] = int(any(each.size > 1 for each in own) or len({each.tobytes() for each in own}) > 1)
        signs = {layout.sign(each) for each in own if each.size} if _by_sign(arrays.program, row[0]) else {t.POSITIVE}
        del own
        columns[t.SIGN] = signs.pop() if len(signs) == 1 else t.MIXED
        targets = arrays.net["pops"][[part.target for part in parts]]
        blocks = (targets[:, t.LAST_BLOCK] - targets[:, t.FIRST_BLOCK]).sum()
        # With two synapses per block nearly all blocks are marked, so marking all is cheaper.
        columns[t.WAKE_ALL] = 1 + 2 * blocks * _n_runs(arrays.program, row) // sum(part.size for part in parts)
        reach[k, [part.target for part in parts]] = 1
        n_runs += _n_runs(arrays.program, row) * _threads(arrays) + 1
    arrays.net |= {"joined": table, "joined_bases": bases, "joined_reach": reach}
    arrays.net["joined_runs"] = np.zeros(n_runs, dtype=np.uint32)
    sizes = np.array(
        [_lay_runs(arrays, columns, row) for columns, row in zip(table, rows, strict=True)], dtype=np.int64
    )
    table[:, t.SYNAPSE] = np.cumsum(sizes) - sizes
    for single, name, kind in ((1, "joined_singles", np.float32), (0, "joined_weights", np.float64)):
        own = np.where(table[:, t.WEIGHT_STRIDE] == 1, sizes, 1) * (table[:, t.SINGLE] == single)
        table[table[:, t.SINGLE] == single, t.WEIGHT] = (np.cumsum(own) - own)[table[:, t.SINGLE] == single]
        arrays.net[name] = np.empty(own.sum(), dtype=kind)
    arrays.net["joined_steps"] = np.empty(sizes.sum(), dtype=np.uint16)
    # Each row frees the arrays that it replaces, since two copies of a large network would not fit into memory.
    for columns, row in zip(table, rows, strict=True):
        _lay_row(arrays, columns, row)
    _discard_rows(arrays, rows)
    if unchanged and any(isinstance(part, CompactProjection) for part in arrays.program.projections):
        names = (*layout.JOINED_ARRAYS, *layout.JOINED_TABLES)
        _SHARED_ROWS[arrays.program] = LaidRows(rows, arrays.net["edges"], {name: arrays.net[name] for name in names})


def as_described(arrays: EventArrays) -> frozenset[int]:
    """Return the projections in joined rows that still have the weights of the program."""
    return frozenset(q for q in arrays.joined if arrays.net["projections"][q, t.WEIGHT] < 0)


def weights(arrays: EventArrays, q: int) -> NDArray[np.floating[Any]]:
    """Return the weights that a projection in joined rows adds, in internal order.

    Values that were set in this run replace the weights of the program.
    """
    first, stride = arrays.net["projections"][q, [t.WEIGHT, t.WEIGHT_STRIDE]].tolist()
    if first < 0:
        return layout.internal_weights(arrays.program, q, arrays.synapses[q].order)
    new_weights: Floats = arrays.net["weights"][first : first + (arrays.program.projections[q].size if stride else 1)]
    return new_weights


def _threads(arrays: EventArrays) -> int:
    return int(arrays.net["edges"].shape[1] - 1)


def _first_place(arrays: EventArrays, q: int) -> int:
    """Return the place of the first target of a projection in the flat input, where each receptor has its own row."""
    receptor = max(int(arrays.net["projections"][q, t.RECEPTOR]), 0)
    return arrays.places[arrays.program.projections[q].target].begin + receptor * int(arrays.net["x"].shape[1])


def _row_runs(arrays: EventArrays, columns: Ints) -> NDArray[np.uint32]:
    n = arrays.program.populations[int(columns[t.SOURCE])].size * int(columns[t.DELAYS]) * _threads(arrays)
    row_runs: NDArray[np.uint32] = arrays.net["joined_runs"][columns[t.RUN] :][: n + 1]
    return row_runs


def _lay_runs(arrays: EventArrays, columns: Ints, row: Row) -> int:
    """Compute the ends of the runs of a joined row.

    Return the number of entries. Some entries have no synapse, because they only bridge a long distance.
    """
    runs = _row_runs(arrays, columns)
    # The first place of each thread among the targets of the row.
    bases = np.full(_threads(arrays), np.iinfo(np.int64).max)
    for q in row:
        edges = layout.edges_of(arrays, q)
        bases = np.minimum(bases, np.where(edges[1:] > edges[:-1], _first_place(arrays, q) + edges[:-1], bases))
    arrays.net["joined_bases"][columns[t.ROW]] = np.where(bases == np.iinfo(np.int64).max, 0, bases)
    _lay_synapses(arrays, columns, row, runs[1:], np.zeros(0, dtype=np.uint16), np.zeros(0))
    if (size := int(runs.sum(dtype=np.int64))) > MOST:
        name = arrays.program.populations[int(columns[t.SOURCE])].name
        message = f"population '{name}' has {size:,} synapses that are delivered together: expected at most {MOST:,}"
        raise ModelError(message, hint="two populations of half the neurons have half the synapses each")
    np.cumsum(runs, out=runs)
    return int(runs[-1])


def _lay_row(arrays: EventArrays, columns: Ints, row: Row) -> None:
    """Lay out a joined row. The row replaces the arrays of compact projections."""
    weights_of = "joined_singles" if columns[t.SINGLE] else "joined_weights"
    steps, row_weights = arrays.net["joined_steps"][columns[t.SYNAPSE] :], arrays.net[weights_of][columns[t.WEIGHT] :]
    row_weights = row_weights if columns[t.WEIGHT_STRIDE] else row_weights[:1]
    following, replaced = _row_runs(arrays, columns)[:-1].copy(), _replaced_projections(arrays, row)
    try:
        _lay_synapses(arrays, columns, row, following, steps, row_weights, [*replaced.values()])
    except BaseException:
        for p in replaced.values():
            if p.has_arrays:
                p.release(partial(_refuse, p.name))
        raise
    net = {name: arrays.net[name] for name in layout.JOINED_ARRAYS}
    for q, p in replaced.items():
        n, negated = arrays.program.populations[p.target].size, p.receptor is not None and p.receptor.negated
        p.release(partial(_restored_synapses, p.row_ends, p.kinds, net, columns, _first_place(arrays, q), n, negated))


def _discard_rows(arrays: EventArrays, rows: list[Row]) -> None:
    """Discard earlier joined rows of this program. Compact projections outside the new rows get their arrays again."""
    replaced = {q for row in rows for q in _replaced_projections(arrays, row)}
    for q, p in enumerate(arrays.program.projections):
        if isinstance(p, CompactProjection) and not p.has_arrays and q not in replaced:
            p.retain()
    _SHARED_ROWS.pop(arrays.program, None)


def _refuse(name: str) -> StoredSynapses:
    raise ModelError(
        f"projection '{name}': its synapses are lost, because the run was interrupted while they were sorted: "
        "compile the network again"
    )


def _replaced_projections(arrays: EventArrays, row: Row) -> dict[int, CompactProjection]:
    """Return the compact projections whose arrays a joined row replaces, by index."""
    parts = {q: p for q in row if isinstance(p := arrays.program.projections[q], CompactProjection)}
    return {q: p for q, p in parts.items() if _is_as_listed(arrays, q)}


def _is_as_listed(arrays: EventArrays, q: int) -> bool:
    """Return whether a projection in joined rows has the weights and the order of the program."""
    p = arrays.program.projections[q]
    as_listed = p.by_delay and arrays.synapses[q].order is None and arrays.net["projections"][q, t.WEIGHT] < 0
    # A relay needs no weight, so its rows have none.
    return bool(as_listed and arrays.net["pops"][p.target, t.RELAY] == 0)


def _lay_synapses(
    arrays: EventArrays,
    columns: Ints,
    row: Row,
    following: NDArray[np.uint32],
    steps: NDArray[np.uint16],
    laid: NDArray[np.floating[Any]],
    replaced: Sequence[CompactProjection] = (),
) -> None:
    """Lay out the synapses of a joined row, sorted by place within each run, and free the arrays that the row replaces.

    Args:
        arrays: all arrays.
        columns: the joined row in its table.
        row: indices of the projections.
        following: next free entry of each run, (runs,). If `steps` and `laid` are empty, the entries of each run are
            counted into it instead.
        steps: receives the distance of each place from the place before, (entries,).
        laid: receives the weights, (entries,) or (1,) if all synapses have one weight.
        replaced: projections whose arrays are freed.
    """
    span = int(columns[t.SHORTEST]), int(columns[t.DELAYS])
    at = np.tile(arrays.net["joined_bases"][columns[t.ROW]], following.size // _threads(arrays))
    parts = []
    for q in sorted(row, key=partial(_first_place, arrays)):
        edges, begin = layout.edges_of(arrays, q), _first_place(arrays, q)
        for block in synapse_blocks(arrays, q):
            synapse_arrays = block.row_ends, block.targets, block.delay, edges, *span, block.weight
            parts.append(Listed(*synapse_arrays, int(block.weight.size > 1), begin))
    n = arrays.program.populations[int(columns[t.SOURCE])].size
    per_source = sum(arrays.program.projections[q].size for q in row) / n
    # A few sources at a time, so that the synapses of all projections stay in the cache.
    n_laid, n_freed = max(1, int(AT_ONCE / per_source)), max(1, int(FREED_AT_ONCE / per_source))

    def lay(first: int) -> tuple[int, int]:
        end = min(first + n_freed, n)
        for few in range(first, end, n_laid):
            for part in parts:
                lay_joined(few, min(few + n_laid, end), part, at, following, steps, laid)
        return first, end

    for sources in mapped(lay, range(0, n, n_freed), _threads(arrays)):
        for p in replaced:
            p.discard(*sources)


def synapses(arrays: EventArrays, q: int) -> tuple[Ints, NDArray[np.integer[Any]], NDArray[np.integer[Any]], Ints]:
    """Return row ends, targets and delays in steps of a projection, and the first target of each thread and the end."""
    p, s = arrays.program.projections[q], arrays.synapses[q]
    targets, _, delay = p.stored()
    if s.order is not None:
        return s.row_ends, s.targets, delay[s.order], layout.edges_of(arrays, q)
    return s.row_ends, targets if p.layout == "csr" else s.targets, delay, layout.edges_of(arrays, q)


def synapse_blocks(arrays: EventArrays, q: int) -> Iterator[SynapseBlock]:
    """Yield the synapses of a projection in joined rows in blocks, in target order, with the weights that are added."""
    p = arrays.program.projections[q]
    if isinstance(p, CompactProjection) and _is_as_listed(arrays, q):
        for block in p.blocks:
            yield replace(block, weight=p.arriving(block.weight))
        return
    row_ends, targets, delay, _ = synapses(arrays, q)
    yield SynapseBlock(row_ends, targets, weights(arrays, q), delay)


@dataclass(frozen=True, eq=False)
class LaidRows:
    """Joined rows that replace a program's arrays. All engines with the same rows and threads share them.

    Attributes:
        rows: the projections of each row.
        edges: first block of each thread in each population, and the end.
        net: the arrays of the rows, by name.
    """

    rows: list[Row]
    edges: Ints
    net: dict[str, NDArray[Any]]


_SHARED_ROWS: WeakKeyDictionary[Program, LaidRows] = WeakKeyDictionary()


def _restored_synapses(
    row_ends: Ints,
    kinds: Mapping[str, np.dtype[Any]],
    net: Mapping[str, NDArray[Any]],
    columns: Ints,
    begin: int,
    n_targets: int,
    negated: bool,
) -> StoredSynapses:
    """Return targets, weights and delays of a projection, restored from its joined row.

    The arguments do not include the projection: it keeps a reference to this function, which would make a cycle.
    """
    size = int(row_ends[-1])
    targets, delay = np.empty(size, dtype=kinds["targets"]), np.empty(size, dtype=kinds["delay"])
    weight: NDArray[Any] = np.empty(size if "weight" in kinds else 0, dtype=kinds.get("weight"))
    laid = net["joined_singles" if columns[t.SINGLE] else "joined_weights"][columns[t.WEIGHT] :]
    runs, steps = net["joined_runs"][columns[t.RUN] :], net["joined_steps"][columns[t.SYNAPSE] :]
    span, bases = (int(columns[t.SHORTEST]), int(columns[t.DELAYS])), net["joined_bases"][columns[t.ROW]]
    part = Listed(row_ends, targets, delay, bases, *span, weight, 1, begin)
    list_joined(part, begin + n_targets, bases, runs, steps, laid)
    return targets, 0.0 - weight if negated else weight, delay
