"""The tables of plastic projections, which learn from spike pairs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core import keyed_random
from neuro.model.synapses import Trace
from neuro.model.synapses.base import DELAY, common, steps_of
from neuro.program.program import Floats, Ints, Program, Projection, SynapseProbe
from neuro_event.building import layout
from neuro_event.building.layout import EventArrays, aligned_table, zeros
from neuro_event.loop import tables as t
from neuro_event.loop.eager_rules import eager_entry
from neuro_event.loop.lazy_rules import APPLIED, DECAYS, ENTRY, NEWEST, OF_NEURON, RULE_TRACES, TAU, TIME, rule_entry
from neuro_event.loop.lazy_stdp import lazy_entry
from neuro_event.loop.operations import RULES


def add_learning(arrays: EventArrays, learning: list[int]) -> None:
    """Lay out the synapses, traces and histories of the plastic projections.

    Args:
        arrays: all arrays.
        learning: indices of the projections.
    """
    program, pops, threads = arrays.program, arrays.net["pops"], arrays.net["edges"].shape[1] - 1
    parts, arranged = [program.projections[q] for q in learning], [arrays.synapses[q] for q in learning]
    eager = [learns_eagerly(arrays, part) for part in parts]
    # Lazy `stdp` and `stdp_dopa` only use K+ and K-, so their traces need no rows in `kinds`.
    read = [
        part.synapse for part, at_once in zip(parts, eager, strict=True) if at_once or type(part.synapse) not in RULES
    ]
    most = max([0, *(max(len(rule.pre), len(rule.post)) for rule in read)])
    table = np.full((len(learning), t.PLASTIC_COLUMNS), t.NONE, dtype=np.int64)
    tau, kinds = np.zeros((len(learning), 2)), np.zeros((len(learning), 2 * most, 3))
    decay = np.zeros((len(learning), RULE_TRACES + kinds.shape[1], DECAYS))
    strides = [1 if type(part.synapse) in RULES else max(1, len(part.synapse.pre)) for part in parts]
    synapses, sources, targets = (
        np.array(sizes, dtype=np.int64)
        for sizes in (
            [csr.targets.size for csr in arranged],
            [program.populations[part.source].size * stride for part, stride in zip(parts, strides, strict=True)],
            [program.populations[part.target].size for part in parts],
        )
    )
    firsts = ((t.FIRST_SYNAPSE, synapses), (t.FIRST_SOURCE, sources), (t.FIRST_TARGET, targets))
    for column, sizes in (*firsts, (t.INCOMING, targets + 1)):
        table[:, column] = np.cumsum(sizes) - sizes
    table[:, t.SOURCE_STRIDE], table[:, t.EAGER] = strides, eager
    states = np.zeros((max([1, *(1 + len(part.synapse.states) for part in parts)]), synapses.sum()))
    k_plus = np.zeros((threads, sources.sum()))
    incoming: list[Ints] = [np.zeros(0, dtype=np.int64)]
    in_synapse, in_source = [np.zeros(0, dtype=np.int32)], [np.zeros(0, dtype=np.int32)]
    n_history = 0
    for k, (q, part, csr, row) in enumerate(zip(learning, parts, arranged, table, strict=True)):
        rule, target = part.synapse, program.populations[part.target]
        row[t.PROJECTION], row[t.RULE_NUMBER] = q, k
        if type(rule) in RULES:
            row[t.RULE] = RULES.index(type(rule))
            row[t.MODULATED] = 0 if rule.modulated else t.NONE
        _request_entry(arrays, row, type(rule), False)
        row[t.DOPAMINE], row[t.DOPAMINE_ONE_TO_ONE] = part.dopamine, int(part.dopamine_one_to_one)
        row[t.DOPAMINE_DELAY] = part.dopamine_delay
        # Longest delay in steps. After it, a spike of a target has reached all synapses of the target.
        row[t.LONGEST] = 0 if rule.delays else part.delay.max(initial=1)
        row[t.FEWEST], row[t.MOST] = part.delay_range(program.resolution)
        set_traces(tau[k], row, decay[k], kinds[k], common(rule.vector()), rule, program)
        tau_minus = target.parameters["tau_minus"]
        if np.all(tau_minus == tau_minus[0]):
            decay[k, 2] = _decay(tau_minus[0], program.resolution)
            decay[k, RULE_TRACES:][kinds[k, :, TAU] == OF_NEURON] = decay[k, 2]
        pre = np.repeat(np.arange(program.populations[part.source].size, dtype=np.int32), np.diff(csr.row_ends))
        order = np.argsort(csr.targets, kind="stable")
        ends = np.cumsum(np.bincount(csr.targets, minlength=target.size), dtype=np.int64)
        incoming.append(np.concatenate([[0], ends]) + row[t.FIRST_SYNAPSE])
        in_synapse.append(order.astype(np.int32))
        in_source.append(pre[order])
        if row[t.EAGER] == 0 and pops[part.target, t.HISTORY] < 0:
            pops[part.target, t.HISTORY] = n_history
            n_history += target.size
        own = slice(row[t.FIRST_SYNAPSE], row[t.FIRST_SYNAPSE] + csr.targets.size)
        states[0, own] = part.weight[csr.order] if csr.order is not None and part.weight.size > 1 else part.weight
        initial = rule.first_states()
        in_order = initial[:, csr.order] if csr.order is not None and initial.shape[1] > 1 else initial
        states[1 : 1 + len(initial), own] = in_order
        if rule.delays:
            states[DELAY, own] = arrays.net["delays"][delay_slice(arrays, q)] * program.resolution
        for trace, value, each in zip(rule.pre, rule.first_traces(), source_traces(arrays, row, k_plus), strict=False):
            each[:] = first_stored(trace, value) if row[t.EAGER] else value
    t_refs = [program.populations[part.target].parameters.get("t_ref", 0.0) for part in parts]
    t_ref_of = {q: float(np.min(t_ref)) for q, t_ref in zip(learning, t_refs, strict=True)}
    draws = any(part.synapse.draws for part in parts)
    numbers = [np.arange(csr.targets.size) if csr.order is None else csr.order for csr in arranged if draws]
    modulated = any(part.synapse.modulated for part in parts)
    arrays.plastic |= {
        **zeros(t.PLASTIC_ARRAYS, {"threads": threads, "sources": sources.sum(), "targets": targets.sum()}),
        "table": table,
        "tau": tau,
        "decay": decay,
        "y": states,
        "sent": states[0].copy(),
        "reached": np.zeros(synapses.sum() if modulated else 0, dtype=np.int64),
        "k_plus": k_plus,
        "incoming": np.concatenate(incoming) if learning else np.zeros(1, dtype=np.int64),
        "in_synapse": np.concatenate(in_synapse),
        "in_source": np.concatenate(in_source),
        "heard": initial_post_traces(arrays, learning, table, int(targets.sum())),
        "past": aligned_table(max(1, n_history), _history_width(arrays, t_ref_of)),
        "kinds": kinds,
        "columns": _columns(arrays, learning, table),
        "draw_keys": np.array(
            [keyed_random.key(program.seed, "synapse", part.name) for part in parts], dtype=np.uint64
        ),
        "drawn_as": np.concatenate([np.zeros(0, dtype=np.int64), *numbers]),
    }
    arrays.plastic["others"] = np.zeros(_others_shape(arrays))
    mark_recorded_synapses(arrays, learning)
    write_constants(arrays, {q: program.projections[q].synapse.vector() for q in learning})


def reset_states(arrays: EventArrays, step: int) -> None:
    """Reset all neurons, traces, eligibilities and dopamine to their values at step 0. The weights stay.

    The weights must have been updated to `step`, the last step that was run.
    """
    net, plastic = arrays.net, arrays.plastic
    net["state"][:] = net["initial"]
    for population, place in zip(arrays.program.populations, arrays.places, strict=True):
        if population.kind == "neuron":
            blocks = slice(place.begin // t.BLOCK, -(-place.end // t.BLOCK))
            net["awake"][blocks], net["busy"][blocks] = 1, step
    for name in ("k_plus", "n", "past"):
        plastic[name][:] = 0
    for name in ("k_time", "spiked", "n_time", "reached"):
        plastic[name][:] = step
    plastic["past"][:, APPLIED] = step
    plastic["y"][1:] = 0.0
    plastic["sent"][:] = plastic["y"][0]


def source_traces(arrays: EventArrays, row: Ints, traces: Floats) -> list[Floats]:
    """Return each pre trace of a plastic projection as a view of shape (threads, sources)."""
    first, stride = row[t.FIRST_SOURCE], row[t.SOURCE_STRIDE]
    end = first + arrays.program.populations[arrays.program.projections[row[t.PROJECTION]].source].size * stride
    return [traces[:, first + j : end : stride] for j in range(stride)]


def _request_entry(arrays: EventArrays, row: Ints, rule: Any, own_rows: bool) -> None:
    """Request the compiled pass of a rule, with one row of constants for all synapses or with a row for each synapse.

    | condition | path | reason |
    | --- | --- | --- |
    | no modulator, one fixed delay, one tau_minus (or K- is not read) | `eager_rules` | no history is needed |
    | otherwise `stdp` and `stdp_dopa` | `lazy_stdp` | K+ and K- are two numbers that stay in registers |
    | any other rule | `lazy_rules` | a rule may have any traces; the history stores the traces before each spike |
    | constants differ between synapses | the same pass with `own_row` | looking up rows took 4 % of the time |

    In an eager projection a spike of a neuron reaches all synapses of the neuron in one step, so no history is
    searched. An event of STDP then takes 12 ns.
    """
    entry = eager_entry if row[t.EAGER] == 1 else lazy_entry if row[t.RULE] >= 0 else rule_entry
    arrays.request(row, t.RULE_ENTRY, partial(entry, rule, own_rows))


def _columns(arrays: EventArrays, learning: list[int], table: Ints) -> Ints:
    """Return the post traces that lazy third-party rules read, shape (populations, traces, 2).

    An entry is (row of the plastic projection, number of the trace).
    The traces of a rule begin at the entry COLUMN of its
    projection. Unused entries are -1.
    """
    traces: list[list[tuple[int, int]]] = [[] for _ in arrays.program.populations]
    for k, q in enumerate(learning):
        if table[k, t.RULE] < 0 and table[k, t.EAGER] == 0:
            part = arrays.program.projections[q]
            table[k, t.COLUMN] = len(traces[part.target])
            traces[part.target] += [(k, j) for j in range(len(part.synapse.post))]
    columns = np.full((len(traces), max(map(len, traces), default=0), 2), -1, dtype=np.int64)
    for row, column_row in zip(columns, traces, strict=True):
        row[: len(column_row)] = np.reshape(column_row, (-1, 2))
    return columns


def _others_shape(arrays: EventArrays) -> tuple[int, int, int]:
    histories, width = arrays.plastic["past"].shape
    columns = arrays.plastic["columns"].shape[1]
    return (histories, (width - NEWEST) // ENTRY, columns) if columns else (1, 1, 0)


def widen_histories(arrays: EventArrays, population: int, t_ref: float) -> None:
    """Enlarge the histories of a population whose shortest refractory period is now `t_ref` ms."""
    past, parts = arrays.plastic["past"], arrays.program.projections
    width = _history_width(arrays, {q: t_ref for q in arrays.plastic_of if parts[q].target == population})
    if width > past.shape[1]:
        wider = aligned_table(past.shape[0], width)
        wider[:, : past.shape[1]] = past
        arrays.plastic["past"] = wider
        others = arrays.plastic["others"]
        arrays.plastic["others"] = np.zeros(_others_shape(arrays))
        arrays.plastic["others"][:, : others.shape[1]] = others


def _history_width(arrays: EventArrays, t_ref_of: Mapping[int, float]) -> int:
    """Return the width of a history, which is an odd number of cache lines.

    An odd number spreads the newest entries of the histories over the cache. A history has entries for the spikes that
    can be under way to a synapse, and a few more. Eager projections read no history.

    Args:
        arrays: all arrays.
        t_ref_of: shortest refractory period of the targets in ms, by projection.
    """
    entries, trials = [7], arrays.program.trials
    for q, t_ref in t_ref_of.items():
        p = arrays.program.projections[q]
        if p.delay.size and not learns_eagerly(arrays, p):
            released = trials is not None and p.target == trials.output and "V_m" in trials.reset
            entries.append(int(2 * p.delay.max() / (1 if released else int(t_ref / arrays.program.resolution) + 1)) + 4)
    lines = -(-(NEWEST + ENTRY * max(entries)) // 8)
    return 8 * (lines + 1 - lines % 2)


def write_constants(arrays: EventArrays, rules: Mapping[int, Floats]) -> None:
    """Lay out the constants of all rules.

    The table has a row per projection, then a row per synapse of each rule whose parameters differ between synapses.

    Args:
        arrays: all arrays.
        rules: the parameters by projection, in the form of `Synapse.vector`.
    """
    width = max([1, *(arrays.program.projections[q].synapse.width for q in arrays.plastic_of)])
    arrays.plastic["rule"] = np.zeros((len(arrays.plastic_of), width))
    for q, k in arrays.plastic_of.items():
        row = arrays.plastic["table"][k]
        row[t.CONSTANTS], row[t.CONSTANTS_STRIDE] = k, 0
        set_constants(arrays, q, rules[q])
        row[t.EPOCH] = epoch_length(arrays.plastic["decay"][k, RULE_TRACES:])


def set_constants(arrays: EventArrays, projection: int, vector: Floats) -> bool:
    """Write the constants of a projection. Return whether the table was replaced by a longer table.

    Synapse z reads the row CONSTANTS + z * CONSTANTS_STRIDE. A synapse that has a row of its own keeps the row, even
    if all rows are equal.
    """
    part, order, k = (
        arrays.program.projections[projection],
        arrays.synapses[projection].order,
        arrays.plastic_of[projection],
    )
    row, table = arrays.plastic["table"][k], arrays.plastic["rule"]
    constants = part.synapse.constants_of(vector, arrays.program.resolution)
    grows = constants.ndim == 2 and row[t.CONSTANTS_STRIDE] == 0
    if grows:
        row[t.CONSTANTS], row[t.CONSTANTS_STRIDE] = len(table) - row[t.FIRST_SYNAPSE], 1
        arrays.plastic["rule"] = np.concatenate([table, np.zeros((part.size, table.shape[1]))])
        _request_entry(arrays, row, type(part.synapse), True)
    first, n = (row[t.CONSTANTS] + row[t.FIRST_SYNAPSE], part.size) if row[t.CONSTANTS_STRIDE] else (k, 1)
    in_order = constants[order] if constants.ndim == 2 and order is not None else constants
    arrays.plastic["rule"][first : first + n, : part.synapse.width] = in_order
    return bool(grows)


def set_numbers(arrays: EventArrays, projection: int, vector: Floats, step: int) -> bool:
    """Write the constants, decays and kinds of traces that follow from the parameters of a projection.

    The traces of the projection must be values, as after `reading.catch_up_all`. Eager traces are stored again.

    Returns:
        True if an array was replaced.
    """
    k, p = arrays.plastic_of[projection], arrays.program.projections[projection]
    table, tau, decay, kinds = (arrays.plastic[name][k] for name in ("table", "tau", "decay", "kinds"))
    replaced = set_constants(arrays, projection, vector)
    set_traces(tau, table, decay, kinds, common(vector), p.synapse, arrays.program)
    if table[t.EAGER]:
        to_stored(arrays, k, step)
    return replaced


def set_traces(
    tau: Floats, row: Ints, decay: Floats, kinds: Floats, vector: Floats, synapse: Any, program: Program
) -> None:
    """Write the time constants and kinds of the traces of a plastic projection from the parameters of its rule."""
    words = dict(zip(synapse.numbers(), vector, strict=True))
    tau[0] = words.get("tau_plus", 1.0)
    tau[1] = words.get("tau_n", math.inf)  # without tau_n, n is constant
    for k in range(2):
        decay[k] = _decay(tau[k], program.resolution)
    for first, traces in ((0, synapse.pre), (len(kinds) // 2, synapse.post)):
        for j, trace in enumerate(traces[: len(kinds) // 2]):
            kinds[first + j] = words.get(trace.tau, OF_NEURON) if trace.tau else TIME, trace.nearest, trace.adds
            if words.get(trace.tau, 0.0) > 0.0:
                decay[RULE_TRACES + first + j] = _decay(words[trace.tau], program.resolution)
    row[t.GRID_STEPS] = int(words.get("deliver_interval", 1)) * program.min_delay


def _decay(tau: float, h: float) -> Floats:
    """Return the decay of a trace after 0, 1, ... steps."""
    decays: Floats = np.exp(-np.arange(DECAYS) * h / tau)
    return decays


FIRST_RECORDS = 1 << 14
"""Initial number of records of pre spikes for which a buffer has room."""


def mark_recorded_synapses(arrays: EventArrays, learning: list[int]) -> None:
    """Mark the plastic projections and synapses that probes record at pre spikes."""
    probes = probes_of(arrays.program)
    marked = {probe.projection for _, probe in probes}
    arrays.plastic["table"][:, t.NOTED] = [int(q in marked) for q in learning]
    arrays.plastic["note_this"] = np.zeros(arrays.plastic["sent"].size if marked else 0, dtype=np.uint8)
    for _, probe in probes:
        first = arrays.plastic["table"][learning.index(probe.projection), t.FIRST_SYNAPSE]
        marks = arrays.plastic["note_this"][first : first + arrays.program.projections[probe.projection].size]
        order = arrays.synapses[probe.projection].order
        inside = np.arange(marks.size) if order is None else np.argsort(order)
        marks[inside if probe.synapses is None else inside[probe.synapses]] = 1
    make_record_buffers(arrays, FIRST_RECORDS if marked else 0)


def probes_of(program: Program) -> list[tuple[int, SynapseProbe]]:
    """Return the probes that record at pre spikes of plastic projections, with their numbers."""
    return [
        (number, probe)
        for number, probe in enumerate(program.synapse_probes)
        if not probe.every and program.projections[probe.projection].synapse.learns == "pairs"
    ]


def make_record_buffers(arrays: EventArrays, room: int) -> None:
    """Allocate buffers for `room` records of pre spikes for each thread."""
    buffers = [array for array in t.PLASTIC_ARRAYS if array.name.startswith("note_") and array.shape[0] == "threads"]
    sizes = {"threads": arrays.net["edges"].shape[1] - 1, "room": room, "states": len(arrays.plastic["y"])}
    arrays.plastic |= zeros(buffers, sizes)


MAX_EPOCH = 1024
"""Largest number of steps of an epoch."""

MIN_DECAY = math.exp(-64.0)
"""Smallest decay of a trace over an epoch. With a smaller decay, stored traces would lose digits."""


def learns_eagerly(arrays: EventArrays, p: Projection) -> bool:
    """Return whether a plastic projection learns eagerly: no modulator, equal delays, equal tau_minus."""
    tau_minus = np.ravel(arrays.program.populations[p.target].parameters["tau_minus"])
    same_tau = bool(np.all(tau_minus == tau_minus[0])) or all(trace.tau != "tau_minus" for trace in p.synapse.post)
    return arrays.eager and same_tau and not p.synapse.modulated and not layout.has_own_delays(p)


def first_stored(trace: Trace, value: float) -> float:
    """Return the stored value of a trace at step 0.

    A decaying trace is stored as its value. A trace of time is stored as the step of the last spike, here -inf.
    """
    return value if trace.tau else -math.inf


def epoch_length(decays: Floats) -> int:
    """Return the number of steps of an epoch.

    Args:
        decays: decay of each trace after 0, 1, ... steps, (traces, steps). Rows of other traces begin with 0.
    """
    used = decays[decays[:, 0] == 1.0, : MAX_EPOCH + 1]
    return max(1, int(np.min((used > MIN_DECAY).sum(axis=1), initial=MAX_EPOCH + 1)) - 1)


def initial_post_traces(arrays: EventArrays, learning: list[int], table: NDArray[np.int64], n_targets: int) -> Floats:
    """Return the stored post traces of eager projections at step 0, (targets, traces)."""
    eager = [(row, arrays.program.projections[q]) for row, q in zip(table, learning, strict=True) if row[t.EAGER]]
    traces = np.zeros((n_targets if eager else 0, max((len(p.synapse.post) for _, p in eager), default=0)))
    for row, p in eager:
        first, size = row[t.FIRST_TARGET], arrays.program.populations[p.target].size
        for j, trace in enumerate(p.synapse.post):
            traces[first : first + size, j] = first_stored(trace, 0.0)
    return traces


def first_trace(arrays: EventArrays, k: int, step: int) -> Floats:
    """Return the values of the first pre trace of plastic projection k at a step, (sources,)."""
    row = arrays.plastic["table"][k]
    stored = source_traces(arrays, row, arrays.plastic["k_plus"])[0][0]
    values: Floats = stored * arrays.plastic["decay"][k, RULE_TRACES, step % row[t.EPOCH]]
    decays = arrays.program.projections[row[t.PROJECTION]].synapse.pre[0].tau
    return values if decays else (step - stored) * arrays.program.resolution


def to_values(arrays: EventArrays, k: int, step: int) -> None:
    """Replace the stored traces of plastic projection k by their values at a step."""
    for stored, decay in _traces(arrays, k, step):
        stored *= decay


def to_stored(arrays: EventArrays, k: int, step: int) -> None:
    """Replace the values at a step by stored traces, with the present time constants."""
    arrays.plastic["table"][k, t.EPOCH] = epoch_length(arrays.plastic["decay"][k, RULE_TRACES:])
    for stored, decay in _traces(arrays, k, step):
        stored *= 1.0 / decay if decay > 0.0 else 0.0


def _traces(arrays: EventArrays, k: int, step: int) -> Iterator[tuple[Floats, float]]:
    """Yield the stored values of each decaying trace of a projection, and its decay since the start of the epoch.

    Eager traces are stored divided by their decay since the start of the epoch. Example: a trace that has the value 0.5
    when the decay is 0.8 is stored as 0.625, and so need not be changed at each step.
    """
    row, half = arrays.plastic["table"][k], arrays.plastic["kinds"].shape[1] // 2
    p = arrays.program.projections[row[t.PROJECTION]]
    decays = arrays.plastic["decay"][k, RULE_TRACES:, step % row[t.EPOCH]]
    for j, each in enumerate(source_traces(arrays, row, arrays.plastic["k_plus"])[: len(p.synapse.pre)]):
        if p.synapse.pre[j].tau:
            yield each, decays[j]
    first, size = row[t.FIRST_TARGET], arrays.program.populations[p.target].size
    for j, trace in enumerate(p.synapse.post):
        if trace.tau:
            yield arrays.plastic["heard"][first : first + size, j], decays[half + j]


def delay_slice(arrays: EventArrays, q: int) -> slice:
    """Return the range of the synapses of a projection in `delays` (steps) and in `late` (ms).

    Delays that spike pairs change are a row of the states of the synapses. Delays that rules for trials change are in
    `late`. Each change of `late` is also written to `delays`, which the delivery of spikes reads.
    """
    first = int(arrays.net["projections"][q, t.DELAY])
    return slice(first, first + arrays.program.projections[q].size)


def write_delays(arrays: EventArrays, q: int, delays: Floats) -> None:
    """Replace the delays of a projection by `delays` in ms, in the order of the weights of the program."""
    order = arrays.synapses[q].order
    inner = delays if order is None else delays[order]
    if q in arrays.plastic_of:
        first = arrays.plastic["table"][arrays.plastic_of[q], t.FIRST_SYNAPSE]
        arrays.plastic["y"][DELAY, first : first + delays.size] = inner
    else:
        arrays.net["late"][delay_slice(arrays, q)] = inner
        round_delays(arrays, q)


def round_delays(arrays: EventArrays, q: int) -> None:
    """Round the delays of a rule for trials, and write them to the table of delays in steps."""
    h, span = arrays.program.resolution, delay_slice(arrays, q)
    fewest, most = arrays.program.projections[q].delay_range(h)
    arrays.net["delays"][span] = [steps_of(delay, h, fewest, most) for delay in arrays.net["late"][span].tolist()]
