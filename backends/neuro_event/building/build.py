"""Build all arrays of a program at step 0, save and restore them, and compile the functions that a network calls."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core import keyed_random
from neuro.core.system import mapped
from neuro.kernels.address import Declared, Entry
from neuro.kernels.draws import GUIDE_BITS, guide_to
from neuro.kernels.instructions import LANES
from neuro.model.neurons import Neuron
from neuro.model.neurons.base import PAYLOAD
from neuro.model.parts import lateral_reset, local_winners, winner_take_all
from neuro.program.program import Floats, Ints, Program, drawn_for
from neuro_event.building import (
    joined_rows,
    layout,
    learning as pair_rules,
    move_rules,
    shared_kernels,
    thread_partition,
)
from neuro_event.building.layout import EventArrays, aligned_zeros, zeros
from neuro_event.building.projections import (
    add_projections,
    copy_shared_weights,
    leave_joined_rows,
    list_incoming,
    set_buffer,
)
from neuro_event.loop import tables as t
from neuro_event.loop.arrivals import QUEUE
from neuro_event.loop.generators import wake_emitting
from neuro_event.loop.operations import entry, generator_entry
from neuro_event.loop.tables import STAGES, stage_entry

LINE = 16
"""Distance between values that different threads write often, as a number of values.

At this distance the values are in different cache lines.
"""


def build(
    program: Program,
    threads: int,
    eager: bool = True,
    edges: Ints | None = None,
    joined: frozenset[int] | None = None,
) -> EventArrays:
    """Lay out a program for a number of threads.

    Args:
        program: the program.
        threads: number of threads.
        eager: whether synapses may learn eagerly.
        edges: first block of each thread in each population, and the end, (populations, threads + 1), from a
            snapshot; None to choose a division.
        joined: indices of the projections in joined rows, from a snapshot; None to choose them.
    """
    places = layout.places(program)
    if joined is None:
        joined = joined_rows.choose(program) if any(map(layout.is_timed, program.projections)) else frozenset()
    all_projections = range(len(program.projections))
    arranged = list(mapped(lambda q: layout.arrange(program, q, places, joined), all_projections, threads))
    learning = [q for q, part in enumerate(program.projections) if layout.learns_from_pairs(part)]
    delays = [part.delay_range(program.resolution)[1] for part in program.projections]
    longest = max([1, *delays, *(part.dopamine_delay for part in program.projections if part.dopamine >= 0)])
    if edges is None and threads == 1:
        edges = np.array([(part.begin // t.BLOCK, -(-part.end // t.BLOCK)) for part in places], dtype=np.int64).reshape(
            -1, 2
        )
    elif edges is None:
        edges = thread_partition.thread_edges(program, places, thread_partition.parts(program, threads))
    slice_ = max(1, program.min_delay)
    reach = max(longest + slice_ + 1, 0 if program.trials is None else program.trials.duration + 1)
    net = {**zeros(t.NET_ARRAYS, _sizes(program, edges, longest, slice_, reach)), "edges": edges}
    plastic_of = {q: k for k, q in enumerate(learning)}
    plastic = _nothing_learns(edges.shape[1] - 1)
    arrays = EventArrays(program, places, arranged, plastic_of, net, plastic, slice_, reach, eager, joined)
    _neurons(arrays)
    _populations(arrays)
    add_projections(arrays)
    add_generators(arrays)
    _groups(arrays)
    if learning:
        pair_rules.add_learning(arrays, learning)
    if any(part.synapse.learns == "moves" for part in program.projections):
        move_rules.add_moves(arrays)
    if any(map(shared_kernels.learns_shared, program.projections)):
        shared_kernels.add_shared(arrays)
    return arrays


def _nothing_learns(threads: int) -> dict[str, Any]:
    """Return the plastic arrays of a network in which no synapse learns."""
    shared = ("shared", *(f"shared_{key}" for key in ("sources", "targets", "entries", "positions", "pairs", "marks")))
    moves = ("moves", "move_sources", "move_marks", "move_targets")
    none = dict.fromkeys(("sources", "targets", "room", *moves, *shared), 0)
    sizes = {**none, "threads": threads, "states": 1, "move_width": 1, "move_traces": t.MOVE_TRACES}
    tables = {"table": t.PLASTIC_COLUMNS, "move_table": t.MOVE_COLUMNS, "shared_table": t.SHARED_COLUMNS}
    empty = {name: np.zeros((0, columns), dtype=np.int64) for name, columns in tables.items()}
    return {**zeros(t.PLASTIC_ARRAYS, sizes), **empty}


def _sizes(program: Program, edges: Ints, longest: int, slice_: int, reach: int) -> dict[str, int]:
    """Return the sizes of the dimensions that the declarations in `tables.NET_ARRAYS` name."""
    n, groups, trials = layout.neuron_places(program), program.groups, program.trials
    most = int((np.diff(edges, axis=1).sum(axis=0) * t.BLOCK).max())
    states = [len(type(p.model).states) for p in program.populations if layout.has_states(p)]
    return {
        "threads": edges.shape[1] - 1,
        "neurons": n,
        "row": n + t.BLOCK,  # a multiple of a page plus one block, so that rows begin at different lines of a page
        "blocks": n // t.BLOCK,
        "group": layout.WORD,
        "spots": n // LANES,
        "marks": layout.power_of_two(2 * longest + 2) * (n // t.BLOCK),
        "states": max([1, *states]),
        "receptors": layout.input_rows(program),
        "width": layout.constants_width(program),
        "populations": len(program.populations),
        "projections": len(program.projections),
        "activity": len(program.populations) + LINE,
        "ends": len(program.populations) + 1,
        "steps": layout.power_of_two(reach + 2 * slice_ + 2),
        "most": most,
        "capacity": layout.power_of_two(4 * most + most * slice_),
        "line": LINE,
        "queue": QUEUE,
        "stages": len(STAGES),
        "guides": 1 << GUIDE_BITS,
        "table": TABLE_WIDTH,
        "groups": max(1, len(groups)),
        "group_maps": max((program.populations[group.population].shape[0] for group in groups), default=1),
        "maps": trials.maps if trials else 1,
    }


def _neurons(arrays: EventArrays) -> None:
    net = arrays.net
    net["most"] = np.diff(net["edges"], axis=1).sum(axis=0) * t.BLOCK
    net["empty_input"][:] = -0.0
    net["nothing"][:] = net["tau_minus"][:] = 1.0
    if any(getattr(p.model, "draws", False) for p in arrays.program.populations):
        net["draws"] = np.zeros(net["mean"].size)
    for population, place in zip(arrays.program.populations, arrays.places, strict=True):
        net["order"][place.begin : place.end] = place.outside
        if population.kind == "neuron":
            tau = np.atleast_1d(population.parameters["tau_minus"])
            net["tau_minus"][place.begin : place.end] = place.by_place(tau) if tau.size > 1 else tau[0]
            net["awake"][place.begin // t.BLOCK : -(-place.end // t.BLOCK)] = 1
        for row, state in enumerate(type(population.model).states):
            start = np.atleast_1d(population.initial.get(state.name, np.zeros(1)))
            net["state"][row, place.begin : place.end] = place.by_place(start) if start.size > 1 else start[0]
    net["initial"] = net["state"].copy()


def _populations(arrays: EventArrays) -> None:
    pops = np.full((len(arrays.program.populations), t.POPULATION_COLUMNS), t.NONE, dtype=np.int64)
    for k, (part, place) in enumerate(zip(arrays.program.populations, arrays.places, strict=True)):
        row = pops[k]
        row[t.KIND], row[t.NUMBER] = t.KINDS.index(part.kind), k
        row[t.BEGIN], row[t.END] = place.begin, place.end
        row[t.FIRST_BLOCK], row[t.LAST_BLOCK] = place.begin // t.BLOCK, -(-place.end // t.BLOCK)
        row[t.RECORD] = int(part.records)
        row[t.START], row[t.STOP] = part.start, part.stop
        row[t.RECEPTORS], row[t.RELAY], row[t.LINEAR] = 1, 0, 0
        if layout.has_states(part):
            model_class: Any = type(part.model)
            arrays.request(row, t.ENTRY, partial(entry if part.kind == "neuron" else generator_entry, model_class))
        if isinstance(part.model, Neuron):
            model = part.model
            row[t.RECEPTORS], row[t.RELAY], row[t.LINEAR] = model.receptors, int(model.relay), int(model.linear)
            if model.graded:
                row[t.PAYLOAD] = [state.name for state in model.states].index(PAYLOAD)
    for k, group in enumerate(arrays.program.groups):
        pops[group.population, t.GROUP] = k
    pops[:, t.CARRIED] = 0
    pops[[part.target for part in arrays.program.projections if part.carries == "current"], t.CARRIED] = 1
    arrays.net["pops"] = pops
    computed = (k for k, part in enumerate(arrays.program.populations) if layout.has_states(part))
    rebuild_constants(
        arrays, {k: layout.parameter_rows(arrays.program.populations[k], arrays.places[k]) for k in computed}
    )


def rebuild_constants(arrays: EventArrays, changed: Mapping[int, Floats]) -> None:
    """Lay out the parameters of all populations, and compute their constants.

    Args:
        arrays: all arrays.
        changed: new rows of parameters, (1 or neurons, parameters), by population. The others keep their rows.
    """
    rows = [
        changed[k] if k in changed else parameters(arrays, k)
        for k, p in enumerate(arrays.program.populations)
        if layout.has_states(p)
    ]
    width = layout.constants_width(arrays.program)
    arrays.net["parameters"] = np.concatenate(
        [np.pad(values, ((0, 0), (0, width - values.shape[1]))) for values in rows] or [np.zeros((1, width))]
    )
    arrays.net["constants"] = np.zeros_like(arrays.net["parameters"])
    row_at = 0
    computed = (k for k, p in enumerate(arrays.program.populations) if layout.has_states(p))
    for k, values in zip(computed, rows, strict=True):
        arrays.net["pops"][k, t.CONSTANT], arrays.net["pops"][k, t.CONSTANT_STRIDE] = row_at, int(len(values) > 1)
        compute: Any = type(arrays.program.populations[k].model).arithmetic.constants  # type: ignore[attr-defined]
        for r in range(row_at, row_at + len(values)):
            compute(arrays.net["parameters"][r], arrays.program.resolution, arrays.net["constants"][r])
        row_at += len(values)


def parameters(arrays: EventArrays, k: int) -> Floats:
    """Return the present parameters of a population: one row for all neurons, or a row per neuron in internal order."""
    first, stride = arrays.net["pops"][k, [t.CONSTANT, t.CONSTANT_STRIDE]].tolist()
    n = arrays.program.populations[k].size if stride else 1
    rows: Floats = arrays.net["parameters"][first : first + n, : len(arrays.program.populations[k].parameters)]
    return rows


def _groups(arrays: EventArrays) -> None:
    groups, trials, net = arrays.program.groups, arrays.program.trials, arrays.net
    net["groups"][:] = net["local"][:] = t.NONE
    net["group_keys"] = np.array(
        [keyed_random.key(arrays.program.seed, "tie", g.name) for g in groups] or [0], dtype=np.uint64
    )
    net["won"] = np.zeros((1, 2), dtype=np.int64)
    for k, g in enumerate(groups):
        place, shape = arrays.places[g.population], arrays.program.populations[g.population].shape
        once = isinstance(g.choice, winner_take_all) and g.choice.first_to_fire
        net["groups"][k] = (g.population, once, 0, t.NONE, t.NONE, 0, 0)
        if isinstance(choice := g.choice, local_winners):
            # Distances of neighbouring maps and of neighbouring columns in internal places.
            next_map, _, next_place = place.steps(shape)
            net["local"][k] = (choice.radius, choice.per_map or 0, *shape, next_map, next_place)
            net["standing"][k, t.OPEN] = math.prod(shape)
        elif isinstance(choice, lateral_reset):
            # Number of neurons that compete, and the distance between two neighbours among them in internal places.
            net["groups"][k, [t.RIVALS, t.APART]] = shape[choice.axis], place.steps(shape)[choice.axis]
    most = max(1, int(net["groups"][:, t.RIVALS].max()))
    net["rivals"] = np.zeros((net["edges"].shape[1] - 1, most), dtype=np.int64)
    if trials:
        output = arrays.program.populations[trials.output]
        net["map_of"] = arrays.places[trials.output].outside // (output.size // trials.maps)
        fresh = [s.name in trials.reset or (s.hidden and "V_m" in trials.reset) for s in type(output.model).states]
        net["resets"] = np.flatnonzero(fresh).astype(np.int64)
        if groups[trials.group].choice.several:
            net["won"] = np.zeros((output.size, 2), dtype=np.int64)


def declared_in(arrays: EventArrays, *lives: str) -> Iterator[tuple[str, Declared, dict[str, Any]]]:
    """Yield the declared arrays as (name in a snapshot, declaration, dictionary that holds the array).

    Args:
        arrays: all arrays.
        lives: lifetimes of the arrays to yield; without any, all arrays are yielded.
    """
    for part, declarations, owner in (("net", t.NET_ARRAYS, arrays.net), ("plastic", t.PLASTIC_ARRAYS, arrays.plastic)):
        for array in declarations:
            if not lives or array.life in lives:
                yield f"{part}.{array.name}", array, owner


def snapshot(arrays: EventArrays) -> dict[str, NDArray[Any]]:
    """Return copies of all arrays, or of their columns, that change while a network runs."""
    settle(arrays)
    return {
        name: owner[array.name][:, t.CHANGING[array.name]] if array.life == "columns" else owner[array.name].copy()
        for name, array, owner in declared_in(arrays, "run", "columns")
    }


def restore(arrays: EventArrays, saved: Mapping[str, NDArray[Any]]) -> None:
    """Replace the arrays of step 0 by the arrays of a snapshot."""
    if not np.array_equal(saved["net.weights"], arrays.net["weights"]):
        copy_shared_weights(arrays)
    for name, array, owner in declared_in(arrays, "run", "columns"):
        if array.life == "columns":
            owner[array.name][:, t.CHANGING[array.name]] = saved[name]
        elif owner[array.name].shape == saved[name].shape:
            owner[array.name][...] = saved[name]  # keeps the alignment, see `layout.aligned_zeros`
        else:
            owner[array.name] = saved[name].copy()
    rings = [q for q in range(len(arrays.program.projections)) if arrays.net["projections"][q, t.LAG] == 0]
    for q in arrays.joined.intersection(rings):
        leave_joined_rows(arrays, q)
    set_buffer(arrays, arrays.net["buf"])
    list_incoming(arrays)
    tabulate(arrays)
    for q, p in enumerate(arrays.program.projections):
        if p.synapse.delays and p.synapse.learns == "trials":
            pair_rules.round_delays(arrays, q)


def link(arrays: EventArrays) -> None:
    """Compile all functions that a network calls by address, and write their addresses into the tables."""
    table = arrays.net["stages"]
    for name in _needed(arrays):
        number = list(STAGES).index(name)
        if table[number] == 0:
            arrays.request(table, number, partial(stage_entry, name))
    if arrays.requests:
        if arrays.program.trials is not None:
            running: tuple[str, ...] = "run_trial", "begin_trial", "end_trial"
        else:
            running = ("run",) if arrays.net["edges"].shape[1] == 2 else ("run", "share", "finish")
        runs = [partial(stage_entry, name) for name in running]
        entries: list[Callable[[], Entry]] = [*runs, *(entry for _, _, entry in arrays.requests)]
        if all(entry().is_compiled for entry in entries):
            entry_addresses = [entry().address() for entry in entries]
        else:
            from neuro.kernels.beside import addresses  # a second process is only needed to compile

            entry_addresses = addresses(entries)
        for (row, column, _), address in zip(arrays.requests, entry_addresses[len(runs) :], strict=True):
            row[column] = address
        arrays.requests.clear()


def _needed(arrays: EventArrays) -> Iterator[str]:
    """Yield the names of the stages that the network may call."""
    net, plastic = arrays.net, arrays.plastic["table"]
    arriving = net["projections"][net["incoming"]]
    counted = arriving[arriving[:, t.LAG] != 0, t.DENSE_COUNTS] == 1
    callers: dict[str, Any] = {
        "add_row": bool(arrays.joined),
        "deliver_log": len(net["at_emission"]) or ~counted,
        "add_counts": counted,
        "draw_counts": net["pops"][:, t.COUNTS] >= 0,
        "drive": len(net["lines"]),
        "charge": len(net["lines"]),
        "step_collecting": net["pops"][:, t.COLLECTS] >= 0,
        "settle": net["pops"][:, t.GROUP] >= 0,
        "post_spike": net["pops"][:, t.HISTORY] >= 0,
        "dopamine_arrivals": plastic[:, t.DOPAMINE] >= 0,
        "note": plastic[:, t.NOTED] == 1,
        "gather_moves": net["pops"][:, t.GATHERS] == 1,
        "deliver_joined": bool(arrays.joined),
        "learn_kernels": len(arrays.plastic["shared_table"]),
    }
    yield from (name for name, places in callers.items() if np.any(places))


TABLE_WIDTH = 1400
"""Number of entries of a table of the Poisson distribution. A rate whose table is longer has no table."""


def add_generators(arrays: EventArrays) -> None:
    """Set the rates of the Poisson generators, and allocate rings for the generators that keep counts of spikes."""
    pops = arrays.net["pops"]
    arrays.net["keys"] = np.array(
        [keyed_random.key(arrays.program.seed, drawn_for(part), part.name) for part in arrays.program.populations],
        dtype=np.uint64,
    )
    arrays.net["cumulative"][:] = np.inf
    size = 0
    for k, part in enumerate(arrays.program.populations):
        if part.kind == "poisson":
            if _keeps_counts(arrays, k):
                qs = [q for q, projection in enumerate(arrays.program.projections) if projection.source == k]
                arrays.net["projections"][qs, t.DENSE_COUNTS] = 1
                steps = layout.power_of_two(int(arrays.net["projections"][qs, t.LAG].max()) + arrays.longest_slice)
                pops[k, t.COUNTS], pops[k, t.COUNTS_STEPS] = size, steps
                size += steps * part.size
            set_rate(arrays, k, part.rate(1), 0)
    arrays.net["counts"] = aligned_zeros(size, np.uint16)
    arrays.net["tally"] = aligned_zeros(arrays.net["mean"].size if size else 0, np.uint32, line=24)


def settle(arrays: EventArrays) -> None:
    """Add the tallies of generators to their counts of events and spikes, and reset the tallies.

    A tally holds both numbers: spikes in its lowest `TALLY_BITS` bits, events above.
    """
    tally = arrays.net["tally"]
    arrays.net["events"][: tally.size] += tally >> t.TALLY_BITS
    arrays.net["spikes"][: tally.size] += tally & ((1 << t.TALLY_BITS) - 1)
    tally[:] = 0


def _keeps_counts(arrays: EventArrays, k: int) -> bool:
    """Return whether a generator keeps counts instead of a list of spikes.

    The generator must have only static one-to-one projections, each with a single weight, and more than 0.05 spikes a
    step.
    """
    outgoing = [q for q, p in enumerate(arrays.program.projections) if p.source == k]
    is_dopamine = any(p.dopamine == k for p in arrays.program.projections)
    return (
        bool(outgoing)
        and not is_dopamine
        and not arrays.program.populations[k].records
        and arrays.program.populations[k].largest("rate") * arrays.program.resolution > 50.0
        and all(
            arrays.synapses[q].layout == t.ONE_TO_ONE
            and not arrays.program.projections[q].synapse.learns
            and arrays.net["projections"][q, t.LAG] > 0
            and arrays.net["projections"][q, t.WEIGHT_STRIDE] == 0
            for q in outgoing
        )
    )


def set_rate(arrays: EventArrays, k: int, rate: Floats, step: int) -> None:
    """Set the rate of a poisson_generator after a step.

    Args:
        arrays: all arrays.
        k: index of the population.
        rate: rates in Hz, (1,) for all neurons or (neurons,).
        step: the last step that was run.
    """
    place, row = arrays.places[k], arrays.net["pops"][k]
    net, neurons = arrays.net, slice(place.begin, place.end)
    mean, p_silent = net["mean"][neurons], net["nothing"][neurons]
    np.multiply(rate, arrays.program.resolution * 1e-3, out=mean)
    np.exp(np.negative(mean, out=p_silent), out=p_silent)
    wake_emitting(net["mean"], net["awake"], net["busy"], row[t.FIRST_BLOCK], row[t.LAST_BLOCK], step)
    if row[t.COUNTS] >= 0:
        _tabulate(arrays, k, mean)


def tabulate(arrays: EventArrays) -> None:
    """Compute the Poisson tables of all generators that keep counts, from the present rates."""
    for k, place in enumerate(arrays.places):
        if arrays.net["pops"][k, t.COUNTS] >= 0:
            _tabulate(arrays, k, arrays.net["mean"][place.begin : place.end])


def _tabulate(arrays: EventArrays, k: int, mean: Floats) -> None:
    """Write a table of the Poisson distribution for a generator, if all its neurons have the same mean a step."""
    row = arrays.net["pops"][k]
    row[t.TABLE] = t.NONE
    if np.all(mean == mean[0]):
        table = keyed_random.poisson_table(float(mean[0]))
        if table.size < arrays.net["cumulative"].shape[1]:
            row[t.TABLE] = k
            arrays.net["cumulative"][k] = np.inf
            arrays.net["cumulative"][k, : table.size] = table
            arrays.net["guides"][k] = guide_to(table)
