"""The lazy pass of `stdp` and `stdp_dopa` over synapses, compiled for each rule."""

# mypy: ignore-errors
import math
from collections import namedtuple
from functools import cache

import numpy as np

from neuro.kernels.address import Entry
from neuro.kernels.instructions import address, prefetch
from neuro.kernels.jit import inlined, kernel, subkernel
from neuro_event.loop import tables as t
from neuro_event.loop.histories import MINUS, PLUS, dopamine_at
from neuro_event.loop.lazy_rules import (
    AHEAD,
    APPLIED,
    CATCH_UP_WHOLE,
    ENTRIES,
    ENTRY,
    NEWEST,
    PRE_SPIKE,
    Synapse,
    decay_by_index,
    mark_all_due,
    own_row,
    shared_row,
    slot_address,
)
from neuro_event.loop.operations import with_arguments
from neuro_event.loop.tables import RULE_TYPE, net_of, plastic_of, slot_mask

Trace = namedtuple("Trace", "decay tau k last")
"""The trace K+ of a source: its value `k` just after the pre spike in step `last`, tau in ms, a table of its decay."""


@inlined
def count_arrived_since(past, since, delay):
    """Return the number of entries of a history, counted from the newest, that arrive after a step."""
    n = past[ENTRIES]
    i = 0
    # Here and in `post_trace` the search begins at the newest entry. It nearly always ends there, and histories are
    # short.
    while i < n and past[NEWEST + ENTRY * i] + delay > since:
        i += 1
    return i


@inlined
def post_trace(decay, past, traces, before, h, tau_minus, neuron):
    """Return K- of a neuron from its spikes strictly before a step."""
    for i in range(past[ENTRIES]):
        time = past[NEWEST + ENTRY * i]
        if time < before:
            return traces[NEWEST + ENTRY * i + 1] * decay_by_index(decay, before - time, h, tau_minus, neuron)
    return 0.0


def compile_repeat(model, on_post):
    """Compile the effect on a synapse of m post spikes in one step."""
    last = len(model.states)
    assert last <= 1  # the weight and the last state are then the only states

    @inlined
    def repeat(view, y, z, c, k, m):
        on_post(y, z, c, (k,), (0.0,))
        for _ in range(1, m):  # nearly always m is 1, which needs no comparison
            weight, state = y[0, z], y[last, z]
            on_post(y, z, c, (k,), (0.0,))
            # If a spike changes no state, the next spikes change none either. In a runaway network the weights are at
            # the bound, so the many spikes take no time.
            if (y[0, z] == weight and y[last, z] == state) or net_of(view).stop[0] == t.AT_ONCE:
                return

    return repeat


def _modulated(model, on_post):
    """Compile the lazy learning of a synapse with dopamine; see `_plain`."""
    advance = with_arguments(model, "advance", "y, e, c, begin, end, n, grid")
    repeat = compile_repeat(model, on_post)

    @subkernel
    def apply_post_spikes(view, q, z, trace_at, thread, target, past, upto, delay, h):
        """Apply the post spikes up to step `upto` that synapse z has not applied yet.

        Return the step in which the last of them arrived, or the step up to which the synapse had learnt.
        """
        plastic = plastic_of(view)
        # Dopamine acts equally on all synapses, so the constants are those of the projection.
        c, grid = plastic.rule[q], plastic.table[q, t.GRID_STEPS]
        k_plus, last, since = plastic.k_plus[thread, trace_at], plastic.k_time[thread, trace_at], plastic.reached[z]
        for i in range(count_arrived_since(past, since, delay) - 1, -1, -1):
            arrival = past[NEWEST + ENTRY * i] + delay
            # Entries are sorted by time, so the loop ends at the first entry that has not arrived.
            if arrival > upto:
                break
            advance(plastic.y, z, c, since, arrival, dopamine_at(view, q, target, since, h), grid)
            since = arrival
            # If the pre trace is 0, a post spike changes nothing, but dopamine is still integrated up to the spike.
            if k_plus != 0.0:
                k = k_plus * decay_by_index(plastic.decay[q, PLUS], arrival - last, h, plastic.tau[q], 0)
                repeat(view, plastic.y, z, c, k, past[NEWEST + ENTRY * i + 2])
        return since

    @inlined
    def learn(view, synapse, c, past, trace, thread, upto, whole, h):
        """Apply the post spikes up to step `upto` to a synapse, and dopamine between them.

        With `whole`, dopamine is also integrated from the last spike to `upto`. At the end of each integration the
        weight is clipped, so an integration may only end at an event or a read. A call that makes room in a history
        does not set `whole`.
        """
        plastic, (q, z, trace_at, target, _, delay) = plastic_of(view), synapse
        since = plastic.reached[z]
        # The call is only needed for a new post spike.
        if past[ENTRIES] > 0 and past[NEWEST] + delay > since:
            since = apply_post_spikes(view, q, z, trace_at, thread, target, past, upto, delay, h)
        if whole and since < upto:
            n = dopamine_at(view, q, target, since, h)
            advance(plastic.y, z, plastic.rule[q], since, upto, n, plastic.table[q, t.GRID_STEPS])
            since = upto
        # Dopamine also acts between spikes, so each synapse stores the step up to which it has been integrated.
        plastic.reached[z] = since

    @inlined
    def catch_up_one(view, synapse, c, past, thread, upto, whole, h):
        """Catch up a synapse."""
        if plastic_of(view).reached[synapse.z] < upto:
            learn(view, synapse, c, past, (), thread, upto, whole, h)

    return learn, catch_up_one


def _plain(model, on_post):
    """Compile the lazy learning of a synapse without dopamine, as a function for pre spikes and one for other events.

    A read returns the weight at the last pre spike. `catch_up_one` stores this weight before it is changed for the
    first time after the spike.
    """
    repeat = compile_repeat(model, on_post)

    @inlined
    def learn(view, synapse, c, past, trace, thread, upto, whole, h):
        """Apply the post spikes that have arrived since the last pre spike and were not applied."""
        # Before the first pre spike no post spike can potentiate.
        if trace.k == 0.0:
            return
        y, since = plastic_of(view).y, max(trace.last, past[APPLIED])
        for i in range(count_arrived_since(past, since, synapse.delay) - 1, -1, -1):
            arrival = past[NEWEST + ENTRY * i] + synapse.delay
            if arrival > upto:
                break
            k = trace.k * decay_by_index(trace.decay, arrival - trace.last, h, trace.tau, 0)
            repeat(view, y, synapse.z, c, k, past[NEWEST + ENTRY * i + 2])

    @inlined
    def catch_up_one(view, synapse, c, past, thread, upto, whole, h):
        """Catch up a synapse."""
        plastic, q, z, src = plastic_of(view), synapse.q, synapse.z, synapse.trace_at
        if past[APPLIED] <= plastic.spiked[thread, src]:
            plastic.sent[z] = plastic.y[0, z]
        trace = Trace(plastic.decay[q, PLUS], plastic.tau[q], plastic.k_plus[thread, src], plastic.k_time[thread, src])
        learn(view, synapse, c, past, trace, thread, upto, whole, h)

    return learn, catch_up_one


@cache
def lazy_entry(model, own_rows):
    """Compile the lazy pass of a rule, with a row of constants for each synapse or, which is faster, for all."""
    row_of = own_row if own_rows else shared_row
    on_pre, on_post = (with_arguments(model, name, "y, e, c, pre, post") for name in ("on_pre", "on_post"))
    learn, catch_up_one = (_modulated if model.modulated else _plain)(model, on_post)

    @subkernel
    def pre_spike(view, q, source, step, thread, h):
        """Process a pre spike: each synapse of this thread catches up, learns and sends. Then K+ grows."""
        net, plastic = net_of(view), plastic_of(view)
        table, y = plastic.table[q], plastic.y
        # K+ and K- are two numbers that stay in registers. `lazy_rules` reads the traces of third-party rules from
        # memory for each synapse, which is slower, so this pass is separate.
        minus = plastic.decay[q, MINUS]
        row = net.projections[table[t.PROJECTION]]
        target_row = net.pops[row[t.TARGET]]
        receptors, relay = target_row[t.RECEPTORS], target_row[t.RELAY]
        blocks = net.awake.shape[0]
        slots, due = slot_mask(net), net.due[thread]
        trace_at = table[t.FIRST_SOURCE] + source
        k_plus, last = plastic.k_plus[thread, trace_at], plastic.k_time[thread, trace_at]
        pre_trace = Trace(plastic.decay[q, PLUS], plastic.tau[q], k_plus, last)
        place = row[t.ROW] + source * (net.edges.shape[1] - 1) + thread
        marks_all = row[t.WAKE_ALL] == 1 and row[t.DELAY_STRIDE] == 0
        end = net.rows[place + 1]
        slot = slot_address(net, row, receptors, step)
        histories, width = (
            address(plastic.past) + 8 * plastic.past.shape[1] * target_row[t.HISTORY],
            8 * plastic.past.shape[1],
        )
        # The columns are loaded into locals, because the compiler must assume that a store into `buf` may change them.
        first, to_synapse = row[t.SYNAPSE], table[t.FIRST_SYNAPSE] - row[t.SYNAPSE]
        delay_at, delay_stride = row[t.DELAY], row[t.DELAY_STRIDE]
        ring_at, ring_mask, ring_size = row[t.RING], row[t.RING_MASK], row[t.RING_SIZE]
        history, neuron, mark = target_row[t.HISTORY], target_row[t.BEGIN], target_row[t.FIRST_BLOCK]
        for e in range(net.rows[place], end):
            # Targets are scattered, so without a prefetch each history and place in the ring would be a cache miss.
            next_target = np.int64(net.targets[min(e + AHEAD, end - 1)])
            prefetch(histories + width * next_target)
            prefetch(slot + 8 * next_target)
            z = to_synapse + e
            target = np.int64(net.targets[e])
            delay = np.int64(net.delays[delay_at + (e - first) * delay_stride])
            synapse = Synapse(q, z, trace_at, target, history + target, delay)
            past, traces = plastic.past[synapse.history], plastic.traces[synapse.history]
            rule = plastic.rule[row_of(q, table, z)]
            learn(view, synapse, rule, past, pre_trace, thread, step, True, h)
            # Post acts before pre: post spikes that arrive in this step have acted in `learn`, and are not part of K-.
            k_minus = post_trace(minus, past, traces, step - delay, h, net.tau_minus, neuron + target)
            on_pre(y, z, rule, (0.0,), (k_minus,))
            # As in NEST, a weight is sent after its update by this spike. The added 0.0 turns -0.0, which means no
            # input, into 0.0.
            weight = y[0, z] + 0.0
            second = 1 if receptors == 2 and weight < 0.0 else 0
            at = step + delay
            ring = ring_at + ((at & ring_mask) * receptors + second) * ring_size
            net.buf[ring + target] += 1.0 if relay == 1 else weight
            if not marks_all:
                due[(at & slots) * blocks + mark + (target >> 6)] = 1
        # All blocks are marked once per spike, if the source has any target on this thread.
        if marks_all and net.rows[place] < net.rows[place + 1]:
            mark_all_due(net, target_row, step + np.int64(net.delays[row[t.DELAY]]), thread)
        trace = 1.0
        if k_plus != 0.0:
            trace += k_plus * math.exp(-(step - last) * h / plastic.tau[q, 0])
        plastic.k_plus[thread, trace_at] = trace
        plastic.k_time[thread, trace_at] = step
        plastic.spiked[thread, trace_at] = step

    @subkernel
    def catch_up(view, q, target, step, thread, whole, h):
        """Catch up every synapse of this projection onto one target. `catch_up_history` sets APPLIED afterwards."""
        net, plastic = net_of(view), plastic_of(view)
        table = plastic.table[q]
        row = net.projections[table[t.PROJECTION]]
        history = net.pops[row[t.TARGET], t.HISTORY] + target
        past = plastic.past[history]
        begin = table[t.INCOMING] + target
        for i in range(plastic.incoming[begin], plastic.incoming[begin + 1]):
            z = table[t.FIRST_SYNAPSE] + np.int64(plastic.in_synapse[i])
            trace_at = table[t.FIRST_SOURCE] + np.int64(plastic.in_source[i])
            delay = np.int64(net.delays[row[t.DELAY] + (z - table[t.FIRST_SYNAPSE]) * row[t.DELAY_STRIDE]])
            c = plastic.rule[own_row(q, table, z)]
            catch_up_one(view, Synapse(q, z, trace_at, target, history, delay), c, past, thread, step, whole, h)

    @kernel
    def run(view, q, operation, index, step, thread, h):
        if operation >= PRE_SPIKE:
            pre_spike(view, q, index, step, thread, h)
        else:
            catch_up(view, q, index, step, thread, operation == CATCH_UP_WHOLE, h)
        return 0

    return Entry(run, RULE_TYPE, model)
