"""The arrays of a program at step 0, filled in table by table."""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

from neuro.core import keyed_random
from neuro.core.threads import mapped
from neuro.kernels.beside import addresses
from neuro.kernels.instructions import LANES
from neuro.model.neurons import Generator, Neuron
from neuro.model.neurons.base import PAYLOAD
from neuro.model.parts import lateral_reset, local_winners, winner_take_all
from neuro.program.program import Floats, Ints, Program
from neuro_event.building import joined_rows, layout, thread_partition
from neuro_event.building.arrays import EventArrays, aligned_rows, aligned_zeros
from neuro_event.building.generators import add_generators
from neuro_event.building.learned_delays import add_delays
from neuro_event.building.learning import add_learning
from neuro_event.building.moves import add_moves
from neuro_event.building.projections import add_projections
from neuro_event.loop import stages, tables as t
from neuro_event.loop.operations import entry, generator_entry
from neuro_event.loop.stages import STAGES

LINE = 16
"""Numbers between what two threads write often, so that they share no cache line."""


def build(
    program: Program,
    threads: int,
    eager: bool = True,
    edges: Ints | None = None,
    joined: frozenset[int] | None = None,
) -> EventArrays:
    """Lay out a program for a number of threads, or cut at given edges, with given projections in joined rows."""
    where = layout.places(program)
    joined = joined_rows.choose(program) if joined is None else joined
    every = range(len(program.projections))
    arranged = list(mapped(lambda q: layout.synapses(program, q, where, joined), every, threads))
    learning = [q for q, p in enumerate(program.projections) if layout.learns_pairs(p)]
    longest = _longest_delay(program)
    slots = layout.power_of_two(2 * longest + 2)
    if edges is None:
        edges = thread_partition.thread_edges(program, where, thread_partition.parts(program, threads))
    net: dict[str, Any] = {"edges": edges, "stages": np.zeros(len(STAGES), dtype=np.int64)}
    arrays = EventArrays(
        program, where, arranged, {q: k for k, q in enumerate(learning)}, net, {}, max(1, program.min_delay), 0
    )
    arrays.eager, arrays.joined = eager, joined
    arrays.reach = longest + arrays.longest_slice + 1
    if program.trials is not None:
        arrays.reach = max(arrays.reach, program.trials.duration + 1)
    _neurons(arrays, slots)
    _populations(arrays)
    add_projections(arrays)
    add_delays(arrays)
    add_generators(arrays)
    _logs(arrays)
    _groups(arrays)
    add_learning(arrays, learning)
    add_moves(arrays)
    return arrays


def _longest_delay(program: Program) -> int:
    delays = [p.delay_range(program.resolution)[1] for p in program.projections]
    return max([1, *delays, *(p.dopamine_delay for p in program.projections if p.dopamine >= 0)])


def _neurons(a: EventArrays, slots: int) -> None:
    n = layout.total(a.program)
    blocks, threads = n // t.BLOCK, a.net["edges"].shape[1] - 1
    states = [len(type(p.model).states) for p in a.program.populations if layout.computes(p)]
    a.net |= {
        "state": aligned_rows(max([1, *states]), n, line=4),
        "empty_input": np.full((layout.receptors(a.program), n), -0.0),
        "current": aligned_zeros(n, np.float64, line=8),
        "none": aligned_zeros(t.BLOCK * t.GROUPED, np.float64, line=8),
        "fired": aligned_zeros(n, np.uint8, line=16),
        "spots": aligned_zeros(n // LANES, np.uint8),
        "muted": np.zeros(n, dtype=np.uint8),
        "events": aligned_zeros(n, np.int64, line=24),
        "spikes": aligned_zeros(n, np.int64, line=32),
        "active": np.zeros((threads, len(a.program.populations) + LINE), dtype=np.int64),
        "awake": np.zeros(blocks, dtype=np.uint8),
        "due": aligned_zeros(threads * slots * blocks, np.uint8).reshape(threads, slots * blocks),
        "slept": aligned_zeros(blocks, np.int64),
        "busy": aligned_zeros(blocks, np.int64),
        "mean": np.zeros(n),
        "nothing": np.ones(n),
        "tau_minus": np.ones(n),
        "order": np.zeros(n, dtype=np.int64),
        "draws": np.zeros(n if any(getattr(p.model, "draws", False) for p in a.program.populations) else 0),
    }
    for population, place in zip(a.program.populations, a.places, strict=True):
        a.net["order"][place.begin : place.end] = place.outside
        if population.kind == "neuron":
            tau = np.atleast_1d(population.parameters["tau_minus"])
            a.net["tau_minus"][place.begin : place.end] = place.by_place(tau) if tau.size > 1 else tau[0]
            a.net["awake"][place.begin // t.BLOCK : -(-place.end // t.BLOCK)] = 1
        for row, state in enumerate(type(population.model).states):
            start = np.atleast_1d(population.initial.get(state.name, np.zeros(1)))
            a.net["state"][row, place.begin : place.end] = place.by_place(start) if start.size > 1 else start[0]
    a.net["initial"] = a.net["state"].copy()


def _populations(a: EventArrays) -> None:
    pops = np.full((len(a.program.populations), t.POPULATION_COLUMNS), t.NONE, dtype=np.int64)
    for k, (p, place) in enumerate(zip(a.program.populations, a.places, strict=True)):
        row = pops[k]
        row[t.KIND], row[t.NUMBER] = layout.kind(p), k
        row[t.BEGIN], row[t.END] = place.begin, place.end
        row[t.FIRST_BLOCK], row[t.LAST_BLOCK] = place.begin // t.BLOCK, -(-place.end // t.BLOCK)
        row[t.RECORD] = int(p.records)
        row[t.START], row[t.STOP] = p.start, p.stop
        row[t.RECEPTORS], row[t.RELAY], row[t.LINEAR] = 1, 0, 0
        if layout.computes(p):
            own: Any = type(p.model)
            a.ask(row, t.ENTRY, partial(entry if p.kind == "neuron" else generator_entry, own))
        if isinstance(p.model, Neuron):
            model = p.model
            row[t.RECEPTORS], row[t.RELAY], row[t.LINEAR] = model.receptors, int(model.relay), int(model.linear)
            if model.graded:
                row[t.PAYLOAD] = [state.name for state in model.states].index(PAYLOAD)
    for k, group in enumerate(a.program.groups):
        pops[group.population, t.GROUP] = k
    pops[:, t.CARRIED] = 0
    pops[[p.target for p in a.program.projections if p.carries == "current"], t.CARRIED] = 1
    a.net["pops"] = pops
    rebuild_constants(a, {})


def rebuild_constants(a: EventArrays, changed: dict[int, Floats]) -> None:
    """Compute the constants of all populations; `changed` holds the parameter rows that differ from the program's."""
    parameters: list[Floats] = []
    width = layout.width(a.program)
    at = 0
    for k, (p, place) in enumerate(zip(a.program.populations, a.places, strict=True)):
        a.net["pops"][k, t.CONSTANT], a.net["pops"][k, t.CONSTANT_STRIDE] = 0, 0
        if not layout.computes(p):
            continue
        rows = changed[k] if k in changed else layout.parameter_rows(p, place)
        a.net["pops"][k, t.CONSTANT], a.net["pops"][k, t.CONSTANT_STRIDE] = at, int(rows.shape[0] > 1)
        parameters.append(np.pad(rows, ((0, 0), (0, width - rows.shape[1]))))
        at += rows.shape[0]
    a.net["parameters"] = np.concatenate(parameters) if parameters else np.zeros((1, width))
    a.net["constants"] = np.zeros_like(a.net["parameters"])
    for k, p in enumerate(a.program.populations):
        if isinstance(p.model, (Neuron, Generator)) and layout.computes(p):
            first = a.net["pops"][k, t.CONSTANT]
            n = (a.places[k].end - a.places[k].begin) if a.net["pops"][k, t.CONSTANT_STRIDE] else 1
            compute = type(p.model).arithmetic.constants
            for r in range(first, first + n):
                compute(a.net["parameters"][r], a.program.resolution, a.net["constants"][r])


def _logs(a: EventArrays) -> None:
    threads = a.net["edges"].shape[1] - 1
    most = np.diff(a.net["edges"], axis=1).sum(axis=0) * t.BLOCK
    n = int(most.max())
    steps = layout.power_of_two(a.reach + 2 * a.longest_slice + 2)
    capacity = layout.power_of_two(4 * n + n * a.longest_slice)
    a.net |= {
        "most": most,
        "log_ids": np.zeros((threads, capacity), dtype=np.int32),
        "log_counts": np.zeros((threads, capacity), dtype=np.int64),
        "log_ends": np.zeros((threads, steps, len(a.program.populations) + 1), dtype=np.int64),
        "log_at": np.zeros((threads, LINE), dtype=np.int64),
        "rec_steps": np.zeros((threads, capacity), dtype=np.int64),
        "rec_ids": np.zeros((threads, capacity), dtype=np.int32),
        "rec_counts": np.zeros((threads, capacity), dtype=np.int64),
        "rec_at": np.zeros((threads, LINE), dtype=np.int64),
        "found": np.zeros((threads, n), dtype=np.int64),
        "found_arrived": np.zeros((threads, n), dtype=np.uint8),
        "clock": np.zeros((threads, LINE), dtype=np.int64),
        "stop": np.zeros(1, dtype=np.int64),
        "reached": np.zeros(1, dtype=np.int64),
        "scratch": np.zeros((threads, layout.width(a.program))),
        "words": aligned_zeros(threads * layout.WORD, np.uint64).reshape(threads, layout.WORD),
    }


def _groups(a: EventArrays) -> None:
    groups = a.program.groups
    a.net["groups"] = np.full((max(1, len(groups)), t.GROUP_COLUMNS), t.NONE, dtype=np.int64)
    a.net["closed"] = np.zeros(max(1, len(groups)), dtype=np.uint8)
    a.net["group_keys"] = np.array(
        [keyed_random.key(a.program.seed, "tie", g.name) for g in groups] or [0], dtype=np.uint64
    )
    for k, g in enumerate(groups):
        once = isinstance(g.choice, winner_take_all) and g.choice.first_to_fire
        a.net["groups"][k] = (g.population, once, 0, t.NONE, t.NONE, 0, 0)
    _local_winners(a)
    _rivals(a)
    trials = a.program.trials
    maps = trials.maps if trials else 1
    a.net["potential"] = np.zeros(maps)
    a.net["best"] = np.zeros(maps, dtype=np.int64)
    a.net["map_of"] = np.zeros(1, dtype=np.int64)
    a.net["resets"] = np.zeros(0, dtype=np.int64)
    if trials:
        output = a.program.populations[trials.output]
        a.net["map_of"] = a.places[trials.output].outside // (output.size // maps)
        fresh = [s.name in trials.reset or (s.hidden and "V_m" in trials.reset) for s in type(output.model).states]
        a.net["resets"] = np.flatnonzero(fresh).astype(np.int64)


def _local_winners(a: EventArrays) -> None:
    """Where the maps, rows and columns of groups with several winners lie among the internal places."""
    groups = a.program.groups
    rows = max(1, len(groups))
    a.net["local"] = np.full((rows, t.LOCAL_ENTRIES), t.NONE, dtype=np.int64)
    a.net["standing"] = np.zeros((rows, 2), dtype=np.int64)
    maps = max((a.program.populations[group.population].shape[0] for group in groups), default=1)
    a.net["map_wins"] = np.zeros((rows, maps), dtype=np.int64)
    a.net["won"] = np.zeros((1, 2), dtype=np.int64)
    for k, group in enumerate(groups):
        if not isinstance(choice := group.choice, local_winners):
            continue
        place, shape = a.places[group.population], a.program.populations[group.population].shape
        next_map, _, next_place = place.steps(shape)
        a.net["local"][k] = (choice.radius, choice.per_map or 0, *shape, next_map, next_place)
        a.net["standing"][k, t.OPEN] = math.prod(shape)
    trials = a.program.trials
    if trials and groups[trials.group].choice.several:
        a.net["won"] = np.zeros((a.program.populations[trials.output].size, 2), dtype=np.int64)


def _rivals(a: EventArrays) -> None:
    """How many neurons compete in groups in which a spike resets others, how far apart they lie, and room for them."""
    for k, group in enumerate(a.program.groups):
        if isinstance(choice := group.choice, lateral_reset):
            place, shape = a.places[group.population], a.program.populations[group.population].shape
            a.net["groups"][k, [t.RIVALS, t.APART]] = shape[choice.axis], place.steps(shape)[choice.axis]
    most = max(1, int(a.net["groups"][:, t.RIVALS].max()))
    a.net["rivals"] = np.zeros((a.net["edges"].shape[1] - 1, most), dtype=np.int64)


def link(a: EventArrays) -> None:
    """Compile all that a network calls by address, and write the addresses to where they are asked for."""
    table = a.net["stages"]
    for name in _needed(a):
        number = list(STAGES).index(name)
        if table[number] == 0:
            a.ask(table, number, partial(stages.entry, name))
    if a.asked:
        runs = [partial(stages.entry, name) for name in _running(a)]
        found = addresses([*runs, *(each for _, _, each in a.asked)])[len(runs) :]
        for (row, column, _), address in zip(a.asked, found, strict=True):
            row[column] = address
        a.asked.clear()


def _running(a: EventArrays) -> tuple[str, ...]:
    """What runs a network."""
    if a.program.trials is not None:
        return "run_trial", "begin_trial", "end_trial"
    return ("run",) if a.net["edges"].shape[1] == 2 else ("run", "share", "finish")


def _needed(a: EventArrays) -> Iterator[str]:
    """The stages that may be called."""
    net, plastic = a.net, a.plastic["table"]
    into, at_emission = (net["projections"][net[name]] for name in ("incoming", "at_emission"))
    on_arrival = into[into[:, t.LAG] != 0]
    counted = on_arrival[:, t.DENSE_COUNTS] == 1
    may: dict[str, Any] = {
        "arrive": on_arrival[:, t.RUN] >= 0,
        "at_emission": len(at_emission),
        "deliver_log": np.append(on_arrival[~counted, t.RUN], at_emission[:, t.RUN]) < 0,
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
        "deliver_joined": len(net["joined"]),
    }
    yield from (name for name, places in may.items() if np.any(places))
