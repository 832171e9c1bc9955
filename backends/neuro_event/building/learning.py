"""The tables of the plastic projections."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core import keyed_random
from neuro.model.synapses import Trace
from neuro.model.synapses.base import DELAY, common
from neuro.program.program import Floats, Ints, Program, Projection, SynapseProbe
from neuro_event.building import layout
from neuro_event.building.arrays import EventArrays, aligned_table
from neuro_event.loop import tables as t
from neuro_event.loop.eager_rules import eager_entry
from neuro_event.loop.lazy_rules import DECAYS, ENTRY, NEWEST, OF_NEURON, OWN, TAU, TIME, rule_entry
from neuro_event.loop.lazy_stdp import lazy_entry
from neuro_event.loop.operations import RULES


def add_learning(a: EventArrays, learning: list[int]) -> None:
    """Lay out the synapses, traces and histories of the projections `learning`."""
    threads = a.net["edges"].shape[1] - 1
    program, pops = a.program, a.net["pops"]
    table = np.full((len(learning), t.PLASTIC_COLUMNS), t.NONE, dtype=np.int64)
    tau = np.zeros((len(learning), 2))
    kinds = np.zeros((len(learning), 2 * _most_traces(a, learning), 3))
    decay = np.zeros((len(learning), OWN + kinds.shape[1], DECAYS))
    incoming: list[Ints] = [np.zeros(1, dtype=np.int64)]
    in_synapse: list[NDArray[np.int32]] = []
    in_source: list[NDArray[np.int32]] = []
    n_synapses = n_sources = n_targets = n_incoming = n_history = 0
    y = []
    for k, q in enumerate(learning):
        p, s = program.projections[q], a.synapses[q]
        row = table[k]
        n_source, n_target = program.populations[p.source].size, program.populations[p.target].size
        row[t.PROJECTION], row[t.RULE_NUMBER], row[t.SOURCE_STRIDE] = q, k, 1
        own_rule: Any = type(p.synapse)
        row[t.EAGER] = int(acts_at_once(a, p))
        if own_rule in RULES:
            row[t.RULE] = RULES.index(own_rule)
            if p.synapse.modulated:
                row[t.MODULATED] = 0
        else:
            row[t.SOURCE_STRIDE] = max(1, len(own_rule.pre))
        _ask_entry(a, row, own_rule, False)
        row[t.FIRST_SYNAPSE], row[t.FIRST_SOURCE], row[t.FIRST_TARGET] = n_synapses, n_sources, n_targets
        row[t.INCOMING] = n_incoming
        row[t.DOPAMINE], row[t.DOPAMINE_ONE_TO_ONE] = p.dopamine, int(p.dopamine_one_to_one)
        row[t.DOPAMINE_DELAY], row[t.LONGEST] = p.dopamine_delay, _longest_back(p)
        row[t.FEWEST], row[t.MOST] = p.delay_range(program.resolution)
        set_traces(tau[k], row, decay[k], kinds[k], common(p.synapse.vector()), p.synapse, program)
        tau_minus = program.populations[p.target].parameters["tau_minus"]
        if np.all(tau_minus == tau_minus[0]):
            decay[k, 2] = _decay(tau_minus[0], program.resolution)
            decay[k, OWN:][kinds[k, :, TAU] == OF_NEURON] = decay[k, 2]
        pre = np.repeat(np.arange(n_source, dtype=np.int32), np.diff(s.row_ends))
        order = np.argsort(s.targets, kind="stable")
        ends = np.concatenate([[0], np.cumsum(np.bincount(s.targets, minlength=n_target))]).astype(np.int64)
        incoming.append(ends + sum(i.size for i in in_synapse))
        in_synapse.append(order.astype(np.int32))
        in_source.append(pre[order])
        own = p.weight[s.order] if s.order is not None and p.weight.size > 1 else p.weight
        y.append(np.broadcast_to(own, s.targets.size))
        n_synapses, n_sources = n_synapses + s.targets.size, n_sources + n_source * int(row[t.SOURCE_STRIDE])
        n_targets, n_incoming = n_targets + n_target, n_incoming + n_target + 1
        if row[t.EAGER] == 0 and pops[p.target, t.HISTORY] < 0:
            pops[p.target, t.HISTORY] = n_history
            n_history += n_target
    states = np.zeros((max([1, *(1 + len(program.projections[q].synapse.states) for q in learning)]), n_synapses))
    states[0] = np.concatenate([np.zeros(0), *y])
    k_plus = np.zeros((threads, n_sources))
    for row, q in zip(table, learning, strict=True):
        _start(a, q, row, states, k_plus)
    modulated = any(program.projections[q].synapse.modulated for q in learning)
    a.plastic |= {
        "table": table,
        "tau": tau,
        "decay": decay,
        "y": states,
        "sent": states[0].copy(),
        "reached": np.zeros(n_synapses if modulated else 0, dtype=np.int64),
        "k_plus": k_plus,
        "k_time": np.zeros((threads, n_sources), dtype=np.int64),
        "spiked": np.zeros((threads, n_sources), dtype=np.int64),
        "n": np.zeros(n_targets),
        "n_time": np.zeros(n_targets, dtype=np.int64),
        "incoming": np.concatenate(incoming[1:] or incoming),
        "in_synapse": np.concatenate([np.zeros(0, dtype=np.int32), *in_synapse]),
        "in_source": np.concatenate([np.zeros(0, dtype=np.int32), *in_source]),
        "heard": no_spikes(a, learning, table, n_targets),
        "past": aligned_table(max(1, n_history), _history_width(a, learning)),
        "kinds": kinds,
        "columns": _columns(a, learning, table),
        "draw_keys": np.array([_draw_key(program, q) for q in learning], dtype=np.uint64),
        "drawn_as": _drawn_as(a, learning),
    }
    a.plastic["others"] = np.zeros(_others_shape(a))
    add_notes(a, learning)
    lay_constants(a, {q: program.projections[q].synapse.vector() for q in learning})


def _ask_entry(a: EventArrays, row: Ints, rule: Any, own_rows: bool) -> None:
    """Ask for the entry of a rule's passes over synapses, which share a row of constants or have their own.

    | condition | path | reason |
    | --- | --- | --- |
    | no modulator, one fixed delay, one tau_minus (or K- is not read) | `eager_rules` | no history is kept |
    | else, `stdp` and `stdp_dopa` | `lazy_stdp` | K+ and K- are two numbers that stay in registers |
    | else | `lazy_rules` | any list of traces: their values before each spike lie in the history |
    | numbers that differ between synapses | the same entry with `own_row` | looking up a row took 4 % of a network |

    Eagerly, all synapses of a neuron hear its spike in one step, so no history is searched: 12 ns an event of STDP.
    """
    entry = eager_entry if row[t.EAGER] == 1 else lazy_entry if row[t.RULE] >= 0 else rule_entry
    a.ask(row, t.RULE_ENTRY, partial(entry, rule, own_rows))


def _draw_key(program: Program, q: int) -> int:
    return keyed_random.key(program.seed, "synapse", program.projections[q].name)


def _drawn_as(a: EventArrays, learning: list[int]) -> Ints:
    """By which numbers synapses draw: none if no rule does."""
    if not any(a.program.projections[q].synapse.draws for q in learning):
        return np.zeros(0, dtype=np.int64)
    each = [(a.synapses[q].order, a.synapses[q].targets.size) for q in learning]
    return np.concatenate([np.arange(n, dtype=np.int64) if order is None else order for order, n in each])


def _start(a: EventArrays, q: int, row: Ints, states: Floats, k_plus: Floats) -> None:
    """Put the synapses' states and the sources' traces of a projection to where its rule starts."""
    p, program = a.program.projections[q], a.program
    first, of_states, order = row[t.FIRST_SYNAPSE], p.synapse.first_states(), a.synapses[q].order
    if order is not None and of_states.shape[1] > 1:
        of_states = of_states[:, order]
    states[1 : 1 + len(of_states), first : first + p.size] = of_states
    if p.synapse.delays:
        at = a.net["projections"][q, t.DELAY]
        states[DELAY, first : first + p.size] = a.net["delays"][at : at + p.size] * program.resolution
    first, stride = row[t.FIRST_SOURCE], row[t.SOURCE_STRIDE]
    end = first + program.populations[p.source].size * stride
    for j, (trace, value) in enumerate(zip(p.synapse.pre, p.synapse.first_traces(), strict=True)):
        k_plus[:, first + j : end : stride] = first_kept(trace, value) if row[t.EAGER] else value


def _longest_back(p: Projection) -> int:
    """Steps after which the last synapse hears a spike of its target."""
    if p.synapse.delays:
        return 0
    return int(p.delay.max()) if p.delay.size else 1


def _by_entry(a: EventArrays, q: int) -> bool:
    """Whether an entry has the passes over synapses."""
    p = a.program.projections[q]
    return acts_at_once(a, p) or type(p.synapse) not in RULES


def _most_traces(a: EventArrays, learning: list[int]) -> int:
    """Traces of one side that any entry reads at most."""
    rules = [a.program.projections[q].synapse for q in learning if _by_entry(a, q)]
    return max([0, *(max(len(rule.pre), len(rule.post)) for rule in rules)])


def _columns(a: EventArrays, learning: list[int], table: Ints) -> Ints:
    """The post traces that third-party rules read lazily, by population; each rule's begin at its COLUMN."""
    found: list[list[tuple[int, int]]] = [[] for _ in a.program.populations]
    for k, q in enumerate(learning):
        if table[k, t.RULE] < 0 and table[k, t.EAGER] == 0:
            part = a.program.projections[q]
            table[k, t.COLUMN] = len(found[part.target])
            found[part.target] += [(k, j) for j in range(len(part.synapse.post))]
    columns = np.full((len(found), max(map(len, found), default=0), 2), -1, dtype=np.int64)
    for population, each in enumerate(found):
        for column, pair in enumerate(each):
            columns[population, column] = pair
    return columns


def _others_shape(a: EventArrays) -> tuple[int, int, int]:
    histories, width = a.plastic["past"].shape
    columns = a.plastic["columns"].shape[1]
    return (histories, (width - NEWEST) // ENTRY, columns) if columns else (1, 1, 0)


def widen_histories(a: EventArrays, population: int, t_ref: float) -> None:
    """Make room for the spikes of a population whose shortest refractory period is now `t_ref` ms."""
    past = a.plastic["past"]
    onto = [q for q in _lazy(a, a.plastic_of) if a.program.projections[q].target == population]
    width = _width(max(_entries(a.program, q, t_ref) for q in onto))
    if width > past.shape[1]:
        wider = aligned_table(past.shape[0], width)
        wider[:, : past.shape[1]] = past
        a.plastic["past"] = wider
        others = a.plastic["others"]
        a.plastic["others"] = np.zeros(_others_shape(a))
        a.plastic["others"][:, : others.shape[1]] = others


def _history_width(a: EventArrays, learning: list[int]) -> int:
    """Numbers in a history of any neuron, with the parameters of step 0."""
    lazy, program = _lazy(a, learning), a.program
    targets = [program.populations[program.projections[q].target] for q in lazy]
    held = [float(np.min(target.parameters.get("t_ref", 0.0))) for target in targets]
    return _width(max([7, *(_entries(program, q, t_ref) for q, t_ref in zip(lazy, held, strict=True))]))


def _lazy(a: EventArrays, learning: Iterable[int]) -> list[int]:
    """Those projections whose synapses read histories."""
    return [q for q in learning if not acts_at_once(a, a.program.projections[q])]


def _entries(program: Program, q: int, t_ref: float) -> int:
    """Post spikes that can be under way to a synapse of a projection, and a few more."""
    p, trials = program.projections[q], program.trials
    if not p.delay.size:
        return 0
    released = trials is not None and p.target == trials.output and "V_m" in trials.reset
    held = 0 if released else int(t_ref / program.resolution)
    return int(2 * p.delay.max() / (held + 1)) + 4


def _width(entries: int) -> int:
    """Numbers in a history: an odd number of cache lines, so that the newest entries of many neurons spread over it."""
    lines = -(-(NEWEST + ENTRY * entries) // 8)
    return 8 * (lines + 1 - lines % 2)


def lay_constants(a: EventArrays, rules: Mapping[int, Floats]) -> None:
    """Lay out the constants of all rules: a row for each projection, then rows of synapses that have their own.

    Args:
        a: all arrays.
        rules: the parameters, in the form of `Synapse.vector`, by projection.
    """
    width = max([1, *(a.program.projections[q].synapse.width for q in a.plastic_of)])
    a.plastic["rule"] = np.zeros((len(a.plastic_of), width))
    for q, k in a.plastic_of.items():
        row = a.plastic["table"][k]
        row[t.CONSTANTS], row[t.CONSTANTS_STRIDE] = k, 0
        set_constants(a, q, rules[q])
        row[t.EPOCH] = length(a.plastic["decay"][k, OWN:])


def set_constants(a: EventArrays, projection: int, vector: Floats) -> bool:
    """Fill the constants of a projection; return whether the table was replaced by a longer one.

    Synapse z reads row CONSTANTS + z CONSTANTS_STRIDE. Rows that synapses have got they keep, though all be the same.
    """
    p, order, k = a.program.projections[projection], a.synapses[projection].order, a.plastic_of[projection]
    row, kept = a.plastic["table"][k], a.plastic["rule"]
    given = p.synapse.constants_of(vector, a.program.resolution)
    grows = given.ndim == 2 and row[t.CONSTANTS_STRIDE] == 0
    if grows:
        row[t.CONSTANTS], row[t.CONSTANTS_STRIDE] = len(kept) - row[t.FIRST_SYNAPSE], 1
        a.plastic["rule"] = np.concatenate([kept, np.zeros((p.size, kept.shape[1]))])
        _ask_entry(a, row, type(p.synapse), True)
    first, n = (row[t.CONSTANTS] + row[t.FIRST_SYNAPSE], p.size) if row[t.CONSTANTS_STRIDE] else (k, 1)
    in_order = given[order] if given.ndim == 2 and order is not None else given
    a.plastic["rule"][first : first + n, : p.synapse.width] = in_order
    return bool(grows)


def set_numbers(a: EventArrays, projection: int, vector: Floats, step: int) -> bool:
    """Fill all that follows from the parameters of a projection whose traces are values, see `reading.bring_all`.

    Returns:
        whether an array was replaced.
    """
    k, p = a.plastic_of[projection], a.program.projections[projection]
    table, tau, decay, kinds = (a.plastic[name][k] for name in ("table", "tau", "decay", "kinds"))
    replaced = set_constants(a, projection, vector)
    set_traces(tau, table, decay, kinds, common(vector), p.synapse, a.program)
    if table[t.EAGER]:
        pack(a, k, step)
    return replaced


def set_traces(
    tau: Floats, row: Ints, decay: Floats, kinds: Floats, vector: Floats, synapse: Any, program: Program
) -> None:
    """Fill what the traces and the dopamine of one plastic projection take from the rule's parameters."""
    words = dict(zip(synapse.numbers(), vector, strict=True))
    tau[0] = words.get("tau_plus", 1.0)
    tau[1] = words.get("tau_n", math.inf)  # n is held
    for k in range(2):
        decay[k] = _decay(tau[k], program.resolution)
    for first, traces in ((0, synapse.pre), (len(kinds) // 2, synapse.post)):
        for j, each in enumerate(traces[: len(kinds) // 2]):
            kinds[first + j] = words.get(each.tau, OF_NEURON) if each.tau else TIME, each.nearest, each.adds
            if words.get(each.tau, 0.0) > 0.0:
                decay[OWN + first + j] = _decay(words[each.tau], program.resolution)
    row[t.GRID_STEPS] = int(words.get("deliver_interval", 1)) * program.min_delay


def _decay(tau: float, h: float) -> Floats:
    """What is left of a trace after 0, 1, ... steps."""
    decays: Floats = np.exp(-np.arange(DECAYS) * h / tau)
    return decays


ROOM = 1 << 14
"""PreSpikeRecords for which there is room at first."""


def add_notes(a: EventArrays, learning: list[int]) -> None:
    """Mark the plastic projections and synapses that probes at pre spikes ask for."""
    probes = probes_of(a.program)
    marked = {probe.projection for _, probe in probes}
    a.plastic["table"][:, t.NOTED] = [int(q in marked) for q in learning]
    a.plastic["note_this"] = np.zeros(a.plastic["sent"].size if marked else 0, dtype=np.uint8)
    for _, probe in probes:
        first = a.plastic["table"][learning.index(probe.projection), t.FIRST_SYNAPSE]
        here = a.plastic["note_this"][first : first + a.program.projections[probe.projection].size]
        order = a.synapses[probe.projection].order
        inside = np.arange(here.size) if order is None else np.argsort(order)
        here[inside if probe.synapses is None else inside[probe.synapses]] = 1
    make_room(a, ROOM if marked else 0)


def probes_of(program: Program) -> list[tuple[int, SynapseProbe]]:
    """The probes at pre spikes of projections that learn from spike pairs, with their numbers."""
    return [
        (number, probe)
        for number, probe in enumerate(program.synapse_probes)
        if not probe.every and program.projections[probe.projection].synapse.learns == "pairs"
    ]


def make_room(a: EventArrays, room: int) -> None:
    """Make buffers for the records of pre spikes, `room` of them for each thread."""
    threads = a.net["edges"].shape[1] - 1
    a.plastic["note_at"] = np.zeros((threads, 8), dtype=np.int64)
    a.plastic["note_steps"] = np.zeros((threads, room), dtype=np.int64)
    a.plastic["note_synapses"] = np.zeros((threads, room), dtype=np.int64)
    a.plastic["note_y"] = np.zeros((threads, a.plastic["y"].shape[0], room))


LONGEST = 1024
"""Steps of an epoch at most."""

LEAST = math.exp(-64.0)
"""What is left of a trace at the end of an epoch at least: less would cost digits."""


def acts_at_once(a: EventArrays, p: Projection) -> bool:
    """Whether a plastic projection learns eagerly: it has no modulator, and its synapses share delay and tau_minus."""
    tau_minus = np.ravel(a.program.populations[p.target].parameters["tau_minus"])
    alike = bool(np.all(tau_minus == tau_minus[0])) or all(trace.tau != "tau_minus" for trace in p.synapse.post)
    return a.eager and alike and not p.synapse.modulated and not layout.own_delays(p)


def first_kept(trace: Trace, value: float) -> float:
    """As what a trace is kept at step 0."""
    return value if trace.tau else -math.inf


def length(decays: Floats) -> int:
    """Steps of an epoch, from what is left of each trace after 0, 1, ... steps."""
    used = decays[decays[:, 0] == 1.0, : LONGEST + 1]
    return max(1, int(np.min((used > LEAST).sum(axis=1), initial=LONGEST + 1)) - 1)


def no_spikes(a: EventArrays, learning: list[int], table: NDArray[np.int64], n_targets: int) -> Floats:
    """The traces of the post spikes that synapses have heard at step 0, a row for each target of a projection."""
    eager = [(row, a.program.projections[q]) for row, q in zip(table, learning, strict=True) if row[t.EAGER]]
    heard = np.zeros((n_targets if eager else 0, max((len(p.synapse.post) for _, p in eager), default=0)))
    for row, p in eager:
        first, size = row[t.FIRST_TARGET], a.program.populations[p.target].size
        for j, trace in enumerate(p.synapse.post):
            heard[first : first + size, j] = first_kept(trace, 0.0)
    return heard


def first_trace(a: EventArrays, k: int, step: int) -> Floats:
    """The values at a step of the first pre trace of the plastic projection number k."""
    row = a.plastic["table"][k]
    p, stride = a.program.projections[row[t.PROJECTION]], row[t.SOURCE_STRIDE]
    first = row[t.FIRST_SOURCE]
    kept = a.plastic["k_plus"][0, first : first + a.program.populations[p.source].size * stride : stride]
    values: Floats = kept * a.plastic["decay"][k, OWN, step % row[t.EPOCH]]
    return values if p.synapse.pre[0].tau else (step - kept) * a.program.resolution


def unpack(a: EventArrays, k: int, step: int) -> None:
    """Put the values at a step in the place of how the traces of projection number k are kept."""
    for kept, left in _traces(a, k, step):
        kept *= left


def pack(a: EventArrays, k: int, step: int) -> None:
    """Keep traces from their values at a step, with the time constants of now."""
    a.plastic["table"][k, t.EPOCH] = length(a.plastic["decay"][k, OWN:])
    for kept, left in _traces(a, k, step):
        kept *= 1.0 / left if left > 0.0 else 0.0


def _traces(a: EventArrays, k: int, step: int) -> Iterator[tuple[Floats, float]]:
    """As what the decaying traces of a projection are kept, and what is left since the epoch of a step began."""
    row, half = a.plastic["table"][k], a.plastic["kinds"].shape[1] // 2
    p = a.program.projections[row[t.PROJECTION]]
    left = a.plastic["decay"][k, OWN:, step % row[t.EPOCH]]
    first, stride = row[t.FIRST_SOURCE], row[t.SOURCE_STRIDE]
    end = first + a.program.populations[p.source].size * stride
    for j, trace in enumerate(p.synapse.pre):
        if trace.tau:
            yield a.plastic["k_plus"][:, first + j : end : stride], left[j]
    first, size = row[t.FIRST_TARGET], a.program.populations[p.target].size
    for j, trace in enumerate(p.synapse.post):
        if trace.tau:
            yield a.plastic["heard"][first : first + size, j], left[half + j]
