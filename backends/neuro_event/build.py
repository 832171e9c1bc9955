"""The arrays of a program at step 0, filled in table by table."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from neuro import keyed
from neuro.neurons import Neuron, poisson_generator
from neuro.program import Floats, Ints, Program
from numpy.typing import NDArray

from neuro_event import layout
from neuro_event import tables as t
from neuro_event.layout import Place, Synapses

PARAMETERS = 20
GUIDE = 1 << 10
TABLE_WIDTH = 700


@dataclass(eq=False)
class Arrays:
    """Everything the loop needs, by the names of `loop.Net`, and how a program's parts map to it."""

    program: Program
    places: list[Place]
    synapses: list[Synapses]
    plastic_of: dict[int, int]
    net: dict[str, Any]
    plastic: dict[str, NDArray[Any]]
    longest_slice: int
    reach: int


def build(program: Program, threads: int) -> Arrays:
    """Lay out a program for a number of threads."""
    where = layout.places(program)
    arranged = [layout.synapses(program, q, where) for q in range(len(program.projections))]
    learning = [q for q, p in enumerate(program.projections) if layout.learns_pairs(p)]
    slots = layout.power_of_two(2 * _longest_delay(program) + 2)
    net: dict[str, Any] = {"edges": layout.thread_edges(program, where, threads)}
    arrays = Arrays(
        program, where, arranged, {q: k for k, q in enumerate(learning)}, net, {}, max(1, program.min_delay), 0
    )
    arrays.reach = _longest_delay(program) + arrays.longest_slice
    if program.trials is not None:
        arrays.reach = max(arrays.reach, program.trials.duration + 1)
    _neurons(arrays, slots)
    _populations(arrays)
    _projections(arrays)
    _generators(arrays)
    _logs(arrays)
    _groups(arrays)
    _plastic(arrays, learning)
    return arrays


def _longest_delay(program: Program) -> int:
    delays = [int(p.delay.max()) for p in program.projections if p.delay.size]
    return max([1, *delays, *(p.dopamine_delay for p in program.projections if p.dopamine >= 0)])


def _neurons(a: Arrays, slots: int) -> None:
    n = layout.total(a.program)
    blocks = n // t.BLOCK
    states = [len(type(p.model).states) for p in a.program.populations if isinstance(p.model, Neuron)]
    a.net |= {
        "state": np.zeros((max([1, *states]), n)),
        "calm": np.full((2, n), -0.0),
        "current": np.zeros(n),
        "fired": np.zeros(n, dtype=np.uint8),
        "muted": np.zeros(n, dtype=np.uint8),
        "events": np.zeros(n, dtype=np.int64),
        "spikes": np.zeros(n, dtype=np.int64),
        "active": np.zeros((a.net["edges"].size - 1, len(a.program.populations)), dtype=np.int64),
        "awake": np.zeros(blocks, dtype=np.uint8),
        "due": np.zeros(slots * blocks, dtype=np.uint8),
        "slept": np.zeros(blocks, dtype=np.int64),
        "busy": np.zeros(blocks, dtype=np.int64),
        "mean": np.zeros(n),
        "nothing": np.ones(n),
        "tau_minus": np.ones(n),
        "order": np.zeros(n, dtype=np.int64),
    }
    for population, place in zip(a.program.populations, a.places, strict=True):
        a.net["order"][place.begin : place.end] = place.outside
        if isinstance(population.model, Neuron):
            tau = np.atleast_1d(population.parameters["tau_minus"])
            a.net["tau_minus"][place.begin : place.end] = place.taken(tau) if tau.size > 1 else tau[0]
            a.net["awake"][place.begin // t.BLOCK : -(-place.end // t.BLOCK)] = 1
            for row, state in enumerate(type(population.model).states):
                start = np.atleast_1d(population.initial.get(state.name, np.zeros(1)))
                a.net["state"][row, place.begin : place.end] = place.taken(start) if start.size > 1 else start[0]
    a.net["initial"] = a.net["state"].copy()


def _populations(a: Arrays) -> None:
    pops = np.full((len(a.program.populations), t.POPULATION_COLUMNS), t.NONE, dtype=np.int64)
    for k, (p, place) in enumerate(zip(a.program.populations, a.places, strict=True)):
        row = pops[k]
        row[t.KIND] = layout.kind(p)
        row[t.BEGIN], row[t.END] = place.begin, place.end
        row[t.FIRST_BLOCK], row[t.LAST_BLOCK] = place.begin // t.BLOCK, -(-place.end // t.BLOCK)
        row[t.RECORD] = int(p.records)
        row[t.START], row[t.STOP] = p.start, p.stop
        row[t.RECEPTORS], row[t.RELAY], row[t.LINEAR] = 1, 0, 0
        if isinstance(p.model, Neuron):
            model = type(p.model)
            row[t.MODEL] = layout.model_number(p)
            row[t.RECEPTORS], row[t.RELAY], row[t.LINEAR] = model.receptors, int(model.relay), int(model.linear)
    for k, group in enumerate(a.program.groups):
        pops[group.population, t.GROUP] = k
    a.net["pops"] = pops
    rebuild_constants(a, {})


def rebuild_constants(a: Arrays, changed: dict[int, Floats]) -> None:
    """Compute the constants of all populations; `changed` holds the parameter rows that differ from the program's."""
    parameters: list[Floats] = []
    at = 0
    for k, (p, place) in enumerate(zip(a.program.populations, a.places, strict=True)):
        a.net["pops"][k, t.CONSTANT], a.net["pops"][k, t.CONSTANT_STRIDE] = 0, 0
        if not isinstance(p.model, Neuron):
            continue
        rows = changed[k] if k in changed else layout.parameter_rows(p, place)
        a.net["pops"][k, t.CONSTANT], a.net["pops"][k, t.CONSTANT_STRIDE] = at, int(rows.shape[0] > 1)
        parameters.append(np.pad(rows, ((0, 0), (0, PARAMETERS - rows.shape[1]))))
        at += rows.shape[0]
    a.net["parameters"] = np.concatenate(parameters) if parameters else np.zeros((1, PARAMETERS))
    a.net["constants"] = np.zeros((a.net["parameters"].shape[0], t.CONSTANTS))
    for k, p in enumerate(a.program.populations):
        if isinstance(p.model, Neuron):
            first = a.net["pops"][k, t.CONSTANT]
            n = (a.places[k].end - a.places[k].begin) if a.net["pops"][k, t.CONSTANT_STRIDE] else 1
            compute = type(p.model).arithmetic.constants
            for r in range(first, first + n):
                compute(a.net["parameters"][r], a.program.resolution, a.net["constants"][r])


def _projections(a: Arrays) -> None:
    program, threads = a.program, a.net["edges"].size - 1
    table = np.full((len(program.projections), t.PROJECTION_COLUMNS), t.NONE, dtype=np.int64)
    rows, targets, weights, delays = [], [], [], []
    n_rows = n_targets = n_weights = n_delays = 0
    ring = 2 * a.net["state"].shape[1]
    at_emission = []
    for q, (p, s) in enumerate(zip(program.projections, a.synapses, strict=True)):
        target = program.populations[p.target]
        row = table[q]
        row[t.SOURCE], row[t.TARGET], row[t.LAYOUT] = p.source, p.target, s.layout
        if s.layout == t.CSR:
            local = a.net["edges"] * t.BLOCK - a.places[p.target].begin
            rows.append(layout.split_rows(s.row_ends, s.targets, local) + n_targets)
            targets.append(s.targets)
            row[t.ROW], row[t.SYNAPSE] = n_rows, n_targets
            n_rows, n_targets = n_rows + rows[-1].size, n_targets + s.targets.size
        own = internal_weights(a, q) if p.weight.size else np.zeros(1)
        row[t.WEIGHT], row[t.WEIGHT_STRIDE], row[t.SIGN] = n_weights, int(own.size > 1), layout.sign(own)
        weights.append(own)
        n_weights += own.size
        delay = p.delay[s.order] if p.delay.size > 1 and s.order is not None else p.delay
        if delay.size == 0:
            delay = np.ones(1, dtype=np.int32)
        if not layout.own_delays(p):
            delay = delay[:1]
        row[t.DELAY], row[t.DELAY_STRIDE] = n_delays, int(delay.size > 1)
        delays.append(delay.astype(np.int32))
        n_delays += delay.size
        blocks = a.net["pops"][p.target, t.LAST_BLOCK] - a.net["pops"][p.target, t.FIRST_BLOCK]
        fan_out = s.targets.size / max(1, s.row_ends.size - 1)
        row[t.WAKE_ALL] = int(s.layout in (t.DENSE, t.GRID) or (s.layout == t.CSR and fan_out > 2 * blocks))
        row[t.DENSE_COUNTS] = 0
        if q in a.plastic_of or row[t.DELAY_STRIDE] == 1:
            ring = _give_ring(row, delay, target.size, a.net["pops"][p.target, t.RECEPTORS], ring, a.longest_slice)
            if q not in a.plastic_of:
                at_emission.append(q)
        else:
            row[t.LAG] = int(delay[0]) if delay.size else 1
        if p.grid is not None:
            _grid_columns(row, p.grid, a.places[p.target].inside is not None)
    a.net["projections"] = table
    a.net["rows"] = _joined(rows, np.int64)
    a.net["targets"] = _joined(targets, np.int32)
    a.net["weights"] = np.concatenate([np.zeros(0), *weights])
    a.net["delays"] = _joined(delays, np.int32)
    a.net["at_emission"] = np.array(at_emission, dtype=np.int64)
    set_buffer(a, np.full(ring, -0.0))
    list_incoming(a)


def internal_weights(a: Arrays, q: int) -> Floats:
    """The weights that a static delivery adds: those of the program, in internal order; 1 for a relay."""
    p = a.program.projections[q]
    if not a.net["pops"][p.source, t.KIND] == t.CURRENT and a.net["pops"][p.target, t.RELAY] == 1:
        return np.ones(1)
    order = a.synapses[q].order
    own = p.weight[order] if order is not None and p.weight.size > 1 else p.weight
    if own.size == 1 and (p.grid is not None or p.synapse.learns == "trials"):
        own = np.repeat(own, p.size)
    return own


def _give_ring(row: Ints, delay: NDArray[np.int32], n: int, receptors: int, at: int, slice_: int) -> int:
    slots = layout.power_of_two(int(delay.max()) + slice_ + 1)
    row[t.LAG] = 0
    row[t.RING], row[t.RING_MASK], row[t.RING_SIZE] = at, slots - 1, n
    return int(at + slots * n * receptors)


def give_ring(a: Arrays, q: int) -> None:
    """Let a projection deliver at emission from now on, into a new ring."""
    p = a.program.projections[q]
    row = a.net["projections"][q]
    receptors = a.net["pops"][p.target, t.RECEPTORS]
    end = _give_ring(row, p.delay if p.delay.size else np.ones(1, np.int32), a.program.populations[p.target].size, receptors, a.net["buf"].size, a.longest_slice)
    set_buffer(a, np.concatenate([a.net["buf"], np.full(end - a.net["buf"].size, -0.0)]))
    a.net["at_emission"] = np.append(a.net["at_emission"], q)
    list_incoming(a)


def set_buffer(a: Arrays, buf: Floats) -> None:
    """Use `buf` for the input and the rings."""
    n = a.net["state"].shape[1]
    a.net["buf"] = buf
    a.net["x"] = buf[: 2 * n].reshape(2, n)
    a.net["bits"] = buf[: 2 * n].view(np.int64).reshape(2, n)


def _grid_columns(row: Ints, g: Any, permuted: bool) -> None:
    row[t.CHANNEL_HEIGHT], row[t.CHANNEL_WIDTH] = g.height, g.width
    row[t.MAPS], row[t.ROWS], row[t.COLUMNS] = g.maps, g.rows, g.columns
    row[t.KERNEL_HEIGHT], row[t.KERNEL_WIDTH] = g.kernel_height, g.kernel_width
    row[t.STRIDE], row[t.PADDING] = g.stride, g.padding
    row[t.MAP_STEP], row[t.PLACE_STEP] = (1, g.maps) if permuted else (g.rows * g.columns, 1)


def _joined(parts: list[NDArray[Any]], dtype: Any) -> NDArray[Any]:
    if len(parts) == 1 and parts[0].dtype == dtype and parts[0].flags.c_contiguous and not parts[0].size == 1:
        return parts[0]
    return np.concatenate([np.zeros(0, dtype=dtype), *parts]).astype(dtype, copy=False)


def list_incoming(a: Arrays) -> None:
    """For each population: the projections delivered on arrival, and those that fill a ring (currents in neither)."""
    incoming: list[int] = []
    for k in range(len(a.program.populations)):
        into = [
            q
            for q, p in enumerate(a.program.projections)
            if p.target == k and a.net["pops"][p.source, t.KIND] != t.CURRENT
        ]
        for first, last, ringed in ((t.ARRIVALS, t.ARRIVALS_END, False), (t.RINGS, t.RINGS_END, True)):
            a.net["pops"][k, first] = len(incoming)
            incoming += [q for q in into if (a.net["projections"][q, t.LAG] == 0) == ringed]
            a.net["pops"][k, last] = len(incoming)
    a.net["incoming"] = np.array(incoming, dtype=np.int64)


def _generators(a: Arrays) -> None:
    pops = a.net["pops"]
    a.net["keys"] = np.array(
        [keyed.key(a.program.seed, "poisson", p.name) for p in a.program.populations], dtype=np.uint64
    )
    a.net["guides"] = np.zeros((len(a.program.populations), GUIDE), dtype=np.uint16)
    a.net["cumulative"] = np.full((len(a.program.populations), 2 * TABLE_WIDTH), np.inf)
    size = 0
    for k, p in enumerate(a.program.populations):
        if isinstance(p.model, poisson_generator):
            if _keeps_counts(a, k):
                steps = layout.power_of_two(2 * _longest_delay(a.program) + 1)
                pops[k, t.COUNTS], pops[k, t.COUNTS_STEPS] = size, steps
                size += steps * p.size
                for q, projection in enumerate(a.program.projections):
                    if projection.source == k:
                        a.net["projections"][q, t.DENSE_COUNTS] = 1
            set_rate(a, k, p.parameters["rate"])
    a.net["counts"] = np.zeros(size, dtype=np.uint16)


def _keeps_counts(a: Arrays, k: int) -> bool:
    """Whether a generator's spikes are wanted only as one-to-one input, so that no list of them is needed."""
    outgoing = [q for q, p in enumerate(a.program.projections) if p.source == k]
    others = any(p.dopamine == k for p in a.program.projections)
    return (
        bool(outgoing)
        and not others
        and not a.program.populations[k].records
        and float(a.program.populations[k].parameters["rate"].max()) * a.program.resolution > 50.0
        and all(
            a.synapses[q].layout == t.ONE_TO_ONE
            and not a.program.projections[q].synapse.learns
            and a.net["projections"][q, t.LAG] > 0
            and a.net["projections"][q, t.WEIGHT_STRIDE] == 0
            for q in outgoing
        )
    )


def set_rate(a: Arrays, k: int, rate: Floats) -> None:
    """Set the rate in Hz of a poisson_generator, one value or one per neuron."""
    place, row = a.places[k], a.net["pops"][k]
    mean = rate * (a.program.resolution * 1e-3)
    here = slice(place.begin, place.end)
    a.net["mean"][here] = mean
    a.net["nothing"][here] = np.exp(-mean)
    first, last = row[t.FIRST_BLOCK], row[t.LAST_BLOCK]
    padded = np.zeros((last - first) * t.BLOCK, dtype=bool)
    padded[: place.end - place.begin] = a.net["mean"][here] > 0.0
    a.net["awake"][first:last] = padded.reshape(-1, t.BLOCK).any(axis=1)
    row[t.TABLE] = t.NONE
    if row[t.COUNTS] >= 0 and np.all(mean == mean[0]):
        table = keyed.poisson_table(float(mean[0]))
        if table.size < a.net["cumulative"].shape[1]:
            row[t.TABLE] = k
            a.net["cumulative"][k] = np.inf
            a.net["cumulative"][k, : table.size] = table
            a.net["guides"][k] = np.searchsorted(table, np.arange(GUIDE) / GUIDE, side="right")


def _logs(a: Arrays) -> None:
    threads = a.net["edges"].size - 1
    n = int(np.diff(a.net["edges"]).max()) * t.BLOCK
    steps = layout.power_of_two(a.reach + 2 * a.longest_slice + 2)
    capacity = layout.power_of_two(4 * n + n * a.longest_slice)
    a.net |= {
        "log_ids": np.zeros((threads, capacity), dtype=np.int32),
        "log_counts": np.zeros((threads, capacity), dtype=np.int32),
        "log_ends": np.zeros((threads, steps, len(a.program.populations) + 1), dtype=np.int64),
        "log_at": np.zeros(threads, dtype=np.int64),
        "rec_steps": np.zeros((threads, capacity), dtype=np.int64),
        "rec_ids": np.zeros((threads, capacity), dtype=np.int32),
        "rec_counts": np.zeros((threads, capacity), dtype=np.int32),
        "rec_at": np.zeros(threads, dtype=np.int64),
        "found": np.zeros((threads, n), dtype=np.int64),
        "found_arrived": np.zeros((threads, n), dtype=np.uint8),
        "clock": np.zeros((threads, 3), dtype=np.int64),
        "scratch": np.zeros((threads, t.CONSTANTS)),
    }


def _groups(a: Arrays) -> None:
    groups = a.program.groups
    a.net["groups"] = np.full((max(1, len(groups)), 5), t.NONE, dtype=np.int64)
    a.net["closed"] = np.zeros(max(1, len(groups)), dtype=np.uint8)
    a.net["group_keys"] = np.array([keyed.key(a.program.seed, "tie", g.name) for g in groups] or [0], dtype=np.uint64)
    for k, g in enumerate(groups):
        a.net["groups"][k] = (g.population, int(g.first_to_fire), 0, -1, -1)
    trials = a.program.trials
    maps = trials.maps if trials else 1
    a.net["potential"] = np.zeros(maps)
    a.net["best"] = np.zeros(maps, dtype=np.int64)
    a.net["map_of"] = np.zeros(1, dtype=np.int64)
    a.net["resets"] = np.zeros(0, dtype=np.int64)
    if trials:
        output = a.program.populations[trials.output]
        a.net["map_of"] = a.places[trials.output].outside // (output.size // maps)
        names = [s.name for s in type(output.model).states]
        wanted = {*trials.reset, *(["refractory", "held_input"] if "V_m" in trials.reset else [])}
        a.net["resets"] = np.array([k for k, name in enumerate(names) if name in wanted], dtype=np.int64)


def _plastic(a: Arrays, learning: list[int]) -> None:
    threads = a.net["edges"].size - 1
    program, pops = a.program, a.net["pops"]
    from neuro_event.dispatch import MODULATED_RULES, RULES

    table = np.full((len(learning), t.PLASTIC_COLUMNS), t.NONE, dtype=np.int64)
    rules, tau = np.zeros((len(learning), t.CONSTANTS)), np.zeros((len(learning), 2))
    incoming: list[Ints] = [np.zeros(1, dtype=np.int64)]
    in_synapse: list[Ints] = []
    in_source: list[NDArray[np.int32]] = []
    n_synapses = n_sources = n_targets = n_incoming = n_history = 0
    y = []
    for k, q in enumerate(learning):
        p, s = program.projections[q], a.synapses[q]
        row = table[k]
        n_source, n_target = program.populations[p.source].size, program.populations[p.target].size
        row[t.PROJECTION], row[t.RULE] = q, RULES.index(type(p.synapse))
        if p.synapse.modulated:
            row[t.MODULATED] = MODULATED_RULES.index(type(p.synapse))
        row[t.FIRST_SYNAPSE], row[t.FIRST_SOURCE], row[t.FIRST_TARGET] = n_synapses, n_sources, n_targets
        row[t.INCOMING] = n_incoming
        row[t.DOPAMINE], row[t.DOPAMINE_ONE_TO_ONE] = p.dopamine, int(p.dopamine_one_to_one)
        row[t.DOPAMINE_DELAY], row[t.LONGEST] = p.dopamine_delay, int(p.delay.max()) if p.delay.size else 1
        set_rule_constants(rules[k], tau[k], row, p.synapse.vector(), p.synapse, program)
        pre = np.repeat(np.arange(n_source, dtype=np.int32), np.diff(s.row_ends))
        order = np.argsort(s.targets, kind="stable")
        ends = np.concatenate([[0], np.cumsum(np.bincount(s.targets, minlength=n_target))]).astype(np.int64)
        incoming.append(ends + sum(i.size for i in in_synapse))
        in_synapse.append(order + n_synapses)
        in_source.append(pre[order])
        own = p.weight[s.order] if s.order is not None and p.weight.size > 1 else p.weight
        y.append(np.broadcast_to(own, s.targets.size))
        n_synapses, n_sources, n_targets = n_synapses + s.targets.size, n_sources + n_source, n_targets + n_target
        n_incoming += n_target + 1
        if pops[p.target, t.HISTORY] < 0:
            pops[p.target, t.HISTORY] = n_history
            n_history += n_target
    modulated = any(program.projections[q].synapse.modulated for q in learning)
    states = np.zeros((2 if modulated else 1, n_synapses))
    states[0] = np.concatenate([np.zeros(0), *y])
    a.plastic |= {
        "table": table,
        "rule": rules,
        "tau": tau,
        "y": states,
        "sent": states[0].copy(),
        "reached": np.zeros(n_synapses, dtype=np.int64),
        "k_plus": np.zeros((threads, n_sources)),
        "k_time": np.zeros((threads, n_sources), dtype=np.int64),
        "n": np.zeros(n_targets),
        "n_time": np.zeros(n_targets, dtype=np.int64),
        "incoming": np.concatenate(incoming[1:] or incoming),
        "in_synapse": np.concatenate([np.zeros(0, dtype=np.int64), *in_synapse]),
        "in_source": np.concatenate([np.zeros(0, dtype=np.int32), *in_source]),
        "past": np.zeros((max(1, n_history), 2 + 2 * _history_capacity(program, learning))),
    }


def _history_capacity(program: Program, learning: list[int]) -> int:
    """Entries that a history needs: all post spikes that can be under way to a synapse, and a few more."""
    capacity = 16
    for q in learning:
        p = program.projections[q]
        hold = np.min(program.populations[p.target].parameters.get("t_ref", np.zeros(1))) / program.resolution
        capacity = max(capacity, int(2 * p.delay.max() / (int(hold) + 1)) + 4 if p.delay.size else 0)
    return layout.power_of_two(capacity)


def set_rule_constants(rule: Floats, tau: Floats, row: Ints, vector: Floats, synapse: Any, program: Program) -> None:
    """Fill the constants of one plastic projection from the rule's parameters."""
    words = dict(zip(synapse.numbers(), vector, strict=True))
    synapse.arithmetic.constants(vector, program.resolution, rule)
    tau[0] = words["tau_plus"]
    tau[1] = words.get("tau_n", 1.0)
    row[t.GRID_STEPS] = int(words.get("deliver_interval", 1)) * program.min_delay
