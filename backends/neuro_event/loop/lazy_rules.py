"""The lazy pass of pair rules other than `stdp` and `stdp_dopa`, compiled for each rule and called by its address.

The pass is like the pass of `lazy_stdp`, but for any list of traces. A synapse catches up from the history of its
target. In the history, `post_spike` stores the values of the traces just before each spike.
"""

# mypy: ignore-errors
import math
from collections import namedtuple
from functools import cache

import numpy as np

from neuro.core.keyed_random import NTH_STRIDE
from neuro.kernels.address import Entry
from neuro.kernels.draws import step_word, uniform
from neuro.kernels.instructions import address, prefetch
from neuro.kernels.jit import compiled, inlined, kernel, subkernel
from neuro.model.synapses.base import DELAY as DELAY_ROW, steps_of
from neuro_event.loop import tables as t
from neuro_event.loop.tables import RULE_TYPE, net_of, plastic_of, slot_mask

ENTRIES, APPLIED, NEWEST = range(3)
ENTRY = 3
"""Columns of a history, and the size of an entry.

A history is a row of numbers. ENTRIES is the number of entries, and APPLIED the step up to which unmodulated synapses
have applied them. The entries begin at NEWEST, the newest first. An entry has three numbers: step, K- just after the
spike, multiplicity. All are integers except K-, which is a float in the same memory.
"""

CATCH_UP, CATCH_UP_WHOLE, ARRIVE, PRE_SPIKE = range(4)
"""Operations of a compiled rule. Lazy passes have CATCH_UP and CATCH_UP_WHOLE, eager passes ARRIVE, both PRE_SPIKE.

PRE_SPIKE + k is the (k + 1)-th spike of a neuron in a step.
"""

AHEAD = 16
"""Number of synapses between the prefetch of a history, and of the target's place in the ring, and their use."""

RULE_TRACES = 3
"""Row of `decay` at which the traces of a rule begin.

They are in the same order as in `kinds`: pre traces in the first half, post traces in the second half.
"""

TAU, NEAREST, ADDS = range(3)
"""Columns of `kinds`: time constant, 1 if only the nearest spike counts, increment by a spike."""

TIME, OF_NEURON = -1.0, -2.0
"""Special time constants. TIME: the trace is the time since a spike. OF_NEURON: it decays with tau_minus."""

Synapse = namedtuple("Synapse", "q z trace_at target history delay")
"""A synapse in the tables of learning.

`q` is the number of the plastic projection, `z` the column of the states, `trace_at` the place of the source's traces,
`target` the index of the target in its population, `history` the row of the target's history. `delay` is in steps.
"""


@subkernel
def mark_all_due(net, target_row, at, thread):
    """Mark all blocks of this thread in a population, because input arrives there in a step."""
    blocks = net.awake.shape[0]
    mark = (at & slot_mask(net)) * blocks
    lo, hi = net.edges[target_row[t.NUMBER], thread], net.edges[target_row[t.NUMBER], thread + 1]
    net.due[thread, mark + lo : mark + hi] = 1


@subkernel
def slot_address(net, row, receptors, step):
    """Return the address of the slot in the ring at which a spike arrives over the first synapse of the projection."""
    if net.delays.size <= row[t.DELAY]:  # there are no synapses
        return np.int64(0)
    # The address is only prefetched. With individual delays most synapses use another slot, and a wrong prefetch costs
    # little.
    at = step + np.int64(net.delays[row[t.DELAY]])
    return address(net.buf) + 8 * (row[t.RING] + (at & row[t.RING_MASK]) * receptors * row[t.RING_SIZE])


@inlined
def shared_row(q, table, z):
    """Return the row of constants that all synapses share."""
    return q


@inlined
def own_row(q, table, z):
    """Return the row of constants of synapse z, which may be the shared row."""
    return table[t.CONSTANTS] + table[t.CONSTANTS_STRIDE] * z


@subkernel
def trace_after(kind, value, m):
    """Return a trace just after m spikes. `value` is the trace just before them."""
    if m == 0:
        return value
    return kind[ADDS] if kind[NEAREST] == 1.0 else value + kind[ADDS] * m


@inlined
def pre_value(plastic, q, j, kind, thread, trace_at, step, h):
    """Return a pre trace at a step.

    A trace of time is stored as the step of the last spike plus 1, or 0 if there was no spike.
    """
    value = plastic.k_plus[thread, trace_at + j]
    if kind[TAU] == TIME:
        return math.inf if value == 0.0 else (step - (value - 1.0)) * h
    # A source that has not fired needs no exponential.
    if value == 0.0:
        return 0.0
    return value * decay_over(
        plastic.decay[q, RULE_TRACES + j], step - plastic.k_time[thread, trace_at], h, plastic.kinds[q, j, TAU]
    )


@inlined
def newest_before(past, before):
    """Return the index of the newest entry of a history strictly before a step, or the number of entries."""
    i = 0
    # The newest entries come first, and the result is nearly always the first or the second.
    while i < past[ENTRIES] and past[NEWEST + ENTRY * i] >= before:
        i += 1
    return i


@inlined
def post_value(view, q, j, kind, column, history, i, neuron, before, h):
    """Return a post trace at a step from entry i of a history. If there is no entry i, there was no spike."""
    plastic = plastic_of(view)
    past = plastic.past[history]
    if i == past[ENTRIES]:
        return math.inf if kind[TAU] == TIME else 0.0
    row, value = plastic.kinds.shape[1] // 2 + j, plastic.others[history, i, column + j]
    n_steps = before - past[NEWEST + ENTRY * i]
    if kind[TAU] == TIME:
        return n_steps * h
    tau = net_of(view).tau_minus[neuron] if kind[TAU] == OF_NEURON else plastic.kinds[q, row, TAU]
    m = past[NEWEST + ENTRY * i + 2]
    return trace_after(kind, value, m) * decay_over(plastic.decay[q, RULE_TRACES + row], n_steps, h, tau)


@inlined
def stored_value(plastic, j, kind, column, history, k, m):
    """Return a post trace at entry k of a history, after the first m of the entry's spikes."""
    if m > 0 and kind[TAU] == TIME:
        return 0.0
    return trace_after(kind, plastic.others[history, k, column + j], m)


def tuple_of(function, traces, arguments):
    """Compile a function that returns the values of all traces as a tuple.

    The rows of `kinds` are literals in its source.

    Example: for two traces the result is `def values(p): return (pre_value(p, 0, (0.0, 0.0, 1.0)), pre_value(p, 1,
    ...),)`.
    """
    name = function.py_func.__name__
    # The source is text, because kernels make no lists. The compiler removes branches on literals.
    calls = "".join(f"{name}({arguments.format(j=j, kind=_kind(trace))}), " for j, trace in enumerate(traces))
    space = {name: function}
    exec(f"def values({arguments.replace('{j}, {kind}, ', '')}):\n    return ({calls})", space)
    return inlined(space["values"])


def _kind(trace):
    """Return the row of `kinds` for a trace, with 0 for a time constant that is a parameter."""
    tau = TIME if not trace.tau else OF_NEURON if trace.tau == "tau_minus" else 0.0
    return tau, float(trace.nearest), float(trace.adds)


def compile_on_pre(model):
    """Compile the action of a rule at a pre spike, with a random number if the rule draws one."""
    on_pre = compiled(model.arithmetic.on_pre)
    if model.draws:

        @subkernel
        def learn_pre(plastic, q, z, c, step, nth, pre, post):
            on_pre(
                plastic.y,
                z,
                c,
                pre,
                post,
                uniform(step_word(plastic.draw_keys[q], step + nth * NTH_STRIDE), plastic.drawn_as[z]),
            )

    else:

        @subkernel
        def learn_pre(plastic, q, z, c, step, nth, pre, post):
            on_pre(plastic.y, z, c, pre, post)

    return learn_pre


@cache
def rule_entry(model, own_rows):
    """Compile the lazy pass of a rule, with a row of constants for all synapses or for each synapse."""
    # Each case is compiled, because a test of the stride at each synapse took 4 % of the time of a learning network.
    row_of = own_row if own_rows else shared_row
    arithmetic, modulated = model.arithmetic, model.modulated
    learn_pre, on_post = compile_on_pre(model), compiled(arithmetic.on_post)
    nearest = compiled(steps_of)
    advance, sent_weight = compiled(arithmetic.advance) if modulated else None, compiled(model.sends())
    n_pre = len(model.pre)
    pre_values = tuple_of(pre_value, model.pre, "plastic, q, {j}, {kind}, thread, trace_at, step, h")
    post_values = tuple_of(post_value, model.post, "view, q, {j}, {kind}, column, history, i, neuron, before, h")
    stored_values = tuple_of(stored_value, model.post, "plastic, {j}, {kind}, column, history, k, m")

    if modulated:

        @subkernel
        def applied_until(plastic, z, thread, trace_at, past):
            return plastic.reached[z]

        @subkernel
        def pass_time(view, q, z, target, since, upto, h):
            plastic = plastic_of(view)
            place = plastic.table[q, t.FIRST_TARGET] + target
            # n is stored with the value at its last change. `release` and `write_signal` catch up all synapses before
            # they change n, so n only decays from `since` to `upto`.
            n = (
                plastic.n[place] * math.exp(-(since - plastic.n_time[place]) * h / plastic.tau[q, 1])
                if plastic.n[place] != 0.0
                else 0.0
            )
            advance(plastic.y, z, plastic.rule[q], since, upto, n, plastic.table[q, t.GRID_STEPS])
            plastic.reached[z] = upto

    else:

        @subkernel
        def applied_until(plastic, z, thread, trace_at, past):
            return max(plastic.k_time[thread, trace_at], past[APPLIED])

        @subkernel
        def pass_time(view, q, z, target, since, upto, h):
            pass

    if model.delays:

        @subkernel
        # A delay that learns is the delay of pre spikes. Post spikes act on the synapse without delay.
        def post_delay(net, row, s):
            return 0

        @subkernel
        def delivery_delay(plastic, q, z, delay, h):
            return nearest(plastic.y[DELAY_ROW, z], h, plastic.table[q, t.FEWEST], plastic.table[q, t.MOST])

    else:

        @subkernel
        def post_delay(net, row, s):
            return np.int64(net.delays[row[t.DELAY] + s * row[t.DELAY_STRIDE]])

        @subkernel
        def delivery_delay(plastic, q, z, delay, h):
            return delay

    @inlined
    def apply_post_spikes(view, synapse, thread, upto, whole, h):
        """Apply the post spikes up to step `upto` to a synapse. With `whole`, also advance its states to `upto`."""
        net, plastic = net_of(view), plastic_of(view)
        q, z, trace_at, target, history, delay = synapse
        # A synapse reads the history of its target at the next pre spike, so 10,000 synapses onto a neuron take no time
        # while their sources are silent.
        past, column = plastic.past[history], plastic.table[q, t.COLUMN]
        since = applied_until(plastic, z, thread, trace_at, past)
        i = 0
        # The newest entries come first, so the search ends at the first entry that was applied before.
        while i < past[ENTRIES] and past[NEWEST + ENTRY * i] + delay > since:
            i += 1
        for k in range(i - 1, -1, -1):
            time = past[NEWEST + ENTRY * k]
            # Entries that arrive after `upto` are left for the next pre spike.
            if time + delay > upto:
                break
            pass_time(view, q, z, target, since, time + delay, h)
            since = time + delay
            pre = pre_values(plastic, q, thread, trace_at, since, h)
            for m in range(past[NEWEST + ENTRY * k + 2]):
                if net.stop[0] == t.AT_ONCE:
                    return
                on_post(
                    plastic.y,
                    z,
                    plastic.rule[row_of(q, plastic.table[q], z)],
                    pre,
                    stored_values(plastic, column, history, k, m),
                )
        if whole and since < upto:
            pass_time(view, q, z, target, since, upto, h)

    @subkernel
    def pre_spike(view, q, source, step, nth, thread, h):
        net, plastic = net_of(view), plastic_of(view)
        table, column = plastic.table[q], plastic.table[q, t.COLUMN]
        row = net.projections[table[t.PROJECTION]]
        target_row = net.pops[row[t.TARGET]]
        receptors, relay = target_row[t.RECEPTORS], target_row[t.RELAY]
        blocks = net.awake.shape[0]
        slots, due = slot_mask(net), net.due[thread]
        trace_at = table[t.FIRST_SOURCE] + source * table[t.SOURCE_STRIDE]
        pre = pre_values(plastic, q, thread, trace_at, step, h)
        place = row[t.ROW] + source * (net.edges.shape[1] - 1) + thread
        end = net.rows[place + 1]
        # A row that reaches nearly all blocks marks all blocks at once, unless delays differ.
        marks_all = row[t.WAKE_ALL] == 1 and row[t.DELAY_STRIDE] == 0
        past_width, others_width = 8 * plastic.past.shape[1], 8 * plastic.others.shape[1] * plastic.others.shape[2]
        slot = slot_address(net, row, receptors, step)
        pasts, others = address(plastic.past), address(plastic.others)
        for e in range(net.rows[place], end):
            next_target = np.int64(net.targets[min(e + AHEAD, end - 1)])
            prefetch(slot + 8 * next_target)
            prefetch(pasts + past_width * (target_row[t.HISTORY] + next_target))
            prefetch(others + others_width * (target_row[t.HISTORY] + next_target))
            s = e - row[t.SYNAPSE]
            z = table[t.FIRST_SYNAPSE] + s
            target = np.int64(net.targets[e])
            delay = post_delay(net, row, s)
            history = target_row[t.HISTORY] + target
            # Post acts before pre within a step: a post spike that arrives now acts first, and is not part of the
            # traces that are read below.
            apply_post_spikes(view, Synapse(q, z, trace_at, target, history, delay), thread, step, True, h)
            neuron = target_row[t.BEGIN] + target
            newest = newest_before(plastic.past[history], step - delay)
            post = post_values(view, q, column, history, newest, neuron, step - delay, h)
            c = plastic.rule[row_of(q, plastic.table[q], z)]
            learn_pre(plastic, q, z, c, step, nth, pre, post)
            weight = sent_weight(plastic.y, z, c) + 0.0  # -0.0 would be no input
            second = 1 if receptors == 2 and weight < 0.0 else 0
            at = step + delivery_delay(plastic, q, z, delay, h)
            ring = row[t.RING] + ((at & row[t.RING_MASK]) * receptors + second) * row[t.RING_SIZE]
            net.buf[ring + target] += 1.0 if relay == 1 else weight
            if not marks_all:
                due[(at & slots) * blocks + target_row[t.FIRST_BLOCK] + (target >> t.BLOCK_SHIFT)] = 1
        if marks_all and net.rows[place] < end:
            # With a single delay all spikes arrive in the same step, so blocks are marked in a single pass.
            mark_all_due(net, target_row, step + np.int64(net.delays[row[t.DELAY]]), thread)
        # Updated after all synapses, because a pre spike does not count in the trace that its synapses read.
        for j in range(n_pre):
            kind = plastic.kinds[q, j]
            if kind[TAU] == TIME:
                plastic.k_plus[thread, trace_at + j] = step + 1.0
            else:
                plastic.k_plus[thread, trace_at + j] = trace_after(
                    kind, pre_value(plastic, q, j, kind, thread, trace_at, step, h), 1
                )
        plastic.k_time[thread, trace_at] = step
        plastic.spiked[thread, trace_at] = step

    @subkernel
    def catch_up(view, q, target, step, thread, whole, h):
        net, plastic = net_of(view), plastic_of(view)
        table = plastic.table[q]
        row = net.projections[table[t.PROJECTION]]
        history = net.pops[row[t.TARGET], t.HISTORY] + target
        begin = table[t.INCOMING] + target
        for i in range(plastic.incoming[begin], plastic.incoming[begin + 1]):
            z = table[t.FIRST_SYNAPSE] + np.int64(plastic.in_synapse[i])
            trace_at = table[t.FIRST_SOURCE] + np.int64(plastic.in_source[i]) * table[t.SOURCE_STRIDE]
            if not modulated and plastic.past[history, APPLIED] <= plastic.spiked[thread, trace_at]:
                # As in NEST, a read shows the weight at the last pre spike, so this weight is stored before post spikes
                # change it (see `lazy_stdp`).
                plastic.sent[z] = plastic.y[0, z]
            delay = post_delay(net, row, z - table[t.FIRST_SYNAPSE])
            apply_post_spikes(view, Synapse(q, z, trace_at, target, history, delay), thread, step, whole, h)

    @kernel
    def run(view, q, operation, index, step, thread, h):
        if operation >= PRE_SPIKE:
            pre_spike(view, q, index, step, operation - PRE_SPIKE, thread, h)
        else:
            catch_up(view, q, index, step, thread, operation == CATCH_UP_WHOLE, h)
        return 0

    return Entry(run, RULE_TYPE, model)


DECAYS = 2048
"""Number of steps for which tables have the decay of a trace."""


@inlined
def decay_by_index(table, steps, h, tau, k):
    """Return the decay with tau[k] over a number of steps. `table` has the decay over the first `DECAYS` steps."""
    # The table replaces exp. If it does not begin with 1, time constants differ between neurons and there is no table.
    if steps < DECAYS and table[0] == 1.0:
        return table[steps]
    return math.exp(-steps * h / tau[k])


@inlined
def decay_over(table, steps, h, tau):
    """Return the decay with tau over a number of steps, or 0 if tau is 0."""
    if steps < DECAYS and table[0] == 1.0:
        return table[steps]
    return math.exp(-steps * h / tau) if tau > 0.0 else 0.0
