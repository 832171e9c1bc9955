"""The passes of `stdp` and `stdp_dopa` over synapses that learn lazily, compiled for each rule by itself."""

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
    BRING_WHOLE,
    ENTRIES,
    ENTRY,
    NEWEST,
    PRE_SPIKE,
    Synapse,
    decayed,
    due_everywhere,
    own_row,
    shared_row,
    slot_of_first,
)
from neuro_event.loop.operations import taking
from neuro_event.loop.tables import RULE_TYPE, net_of, plastic_of, slot_mask

Trace = namedtuple("Trace", "decay tau k last")
"""K+ of a source: its value `k` just after the step `last` of a pre spike, the table of its decay, and tau in ms."""


@inlined
def arrived_since(past, since, delay):
    """How many entries of a history, the newest ones, arrive after a step."""
    n = past[ENTRIES]
    i = 0
    # Two searches from the newest entry, here and below in `post_trace`: histories are short, and the newest is nearly
    # always enough.
    while i < n and past[NEWEST + ENTRY * i] + delay > since:
        i += 1
    return i


@inlined
def post_trace(decay, past, traces, before, h, tau_minus, neuron):
    """K- of a neuron from its spikes strictly before a step."""
    for i in range(past[ENTRIES]):
        time = past[NEWEST + ENTRY * i]
        if time < before:
            return traces[NEWEST + ENTRY * i + 1] * decayed(decay, before - time, h, tau_minus, neuron)
    return 0.0


def repeating(model, on_post):
    """Compile the pass of m post spikes of one step over a synapse."""
    last = len(model.states)
    assert last <= 1  # so the weight and the last state are all states

    @inlined
    def repeat(view, y, z, c, k, m):
        on_post(y, z, c, (k,), (0.0,))
        for _ in range(1, m):  # nearly always there is one spike: it costs no comparison
            weight, state = y[0, z], y[last, z]
            on_post(y, z, c, (k,), (0.0,))
            # A spike that changes no state leaves nothing for the next one to change: weights of a runaway network are
            # at their bound, and its spikes are not turns of a loop.
            if (y[0, z] == weight and y[last, z] == state) or net_of(view).stop[0] == t.AT_ONCE:
                return

    return repeat


def _modulated(model, on_post):
    """What a synapse under dopamine does with a history; see `_plain`."""
    advance = taking(model, "advance", "y, e, c, begin, end, n, grid")
    repeat = repeating(model, on_post)

    @subkernel
    def hear(view, q, z, own, thread, target, past, upto, delay, h):
        """The post spikes of a history that synapse z has yet to hear, up to `upto`; return when the last arrived."""
        p = plastic_of(view)
        c, grid = p.rule[q], p.table[q, t.GRID_STEPS]  # one rule for all, as dopamine acts
        k_plus, then, since = p.k_plus[thread, own], p.k_time[thread, own], p.reached[z]
        for i in range(arrived_since(past, since, delay) - 1, -1, -1):
            arrival = past[NEWEST + ENTRY * i] + delay
            # Entries are by time: the first that has not arrived ends the loop.
            if arrival > upto:
                break
            advance(p.y, z, c, since, arrival, dopamine_at(view, q, target, since, h), grid)
            since = arrival
            # Without a pre trace a post spike changes nothing, but the flow of dopamine has to be cut at it.
            if k_plus != 0.0:
                k = k_plus * decayed(p.decay[q, PLUS], arrival - then, h, p.tau[q], 0)
                repeat(view, p.y, z, c, k, past[NEWEST + ENTRY * i + 2])
        return since

    @inlined
    def learn(view, synapse, c, past, trace, thread, upto, whole, h):
        """Let the post spikes up to step `upto` act on a synapse, and what flows between them.

        With `whole` also what flows from the last of them to `upto`. To stop there clips the weight, so it is for
        events and reads only: not for making room in a history.
        """
        p, (q, z, own, target, _, delay) = plastic_of(view), synapse
        since = p.reached[z]
        # A synapse without a new post spike skips the call.
        if past[ENTRIES] > 0 and past[NEWEST] + delay > since:
            since = hear(view, q, z, own, thread, target, past, upto, delay, h)
        if whole and since < upto:
            n = dopamine_at(view, q, target, since, h)
            advance(p.y, z, p.rule[q], since, upto, n, p.table[q, t.GRID_STEPS])
            since = upto
        # Kept for each synapse: dopamine flows between spikes, so the time since the last stop matters, not only which
        # spikes were heard.
        p.reached[z] = since

    @inlined
    def bring_one(view, synapse, c, past, thread, upto, whole, h):
        """Let it catch up."""
        if plastic_of(view).reached[synapse.z] < upto:
            learn(view, synapse, c, past, (), thread, upto, whole, h)

    return learn, bring_one


def _plain(model, on_post):
    """What a synapse without dopamine does with a history: at a pre spike, and else.

    It shows the weight that it sent last, so that is kept aside before the first change.
    """
    repeat = repeating(model, on_post)

    @inlined
    def learn(view, synapse, c, past, trace, thread, upto, whole, h):
        """Apply the post spikes that have arrived since the last pre spike, and were not applied."""
        # No pre spike yet, so no post spike can potentiate.
        if trace.k == 0.0:
            return
        y, since = plastic_of(view).y, max(trace.last, past[APPLIED])
        for i in range(arrived_since(past, since, synapse.delay) - 1, -1, -1):
            arrival = past[NEWEST + ENTRY * i] + synapse.delay
            if arrival > upto:
                break
            k = trace.k * decayed(trace.decay, arrival - trace.last, h, trace.tau, 0)
            repeat(view, y, synapse.z, c, k, past[NEWEST + ENTRY * i + 2])

    @inlined
    def bring_one(view, synapse, c, past, thread, upto, whole, h):
        """Let it catch up."""
        p, q, z, own = plastic_of(view), synapse.q, synapse.z, synapse.own
        if past[APPLIED] <= p.spiked[thread, own]:
            p.sent[z] = p.y[0, z]
        trace = Trace(p.decay[q, PLUS], p.tau[q], p.k_plus[thread, own], p.k_time[thread, own])
        learn(view, synapse, c, past, trace, thread, upto, whole, h)

    return learn, bring_one


@cache
def lazy_entry(model, own_rows):
    """The passes of one rule, whose synapses have rows of constants of their own or share one, which costs less."""
    row_of = own_row if own_rows else shared_row
    on_pre, on_post = (taking(model, name, "y, e, c, pre, post") for name in ("on_pre", "on_post"))
    learn, bring_one = (_modulated if model.modulated else _plain)(model, on_post)

    @subkernel
    def pre_spike(view, q, source, step, thread, h):
        """A pre spike: each synapse of this thread catches up, learns and sends; then K+ grows."""
        net, p = net_of(view), plastic_of(view)
        table, y = p.table[q], p.y
        # K+ and K- are two numbers that stay in registers: read from memory for each synapse, as third-party traces
        # are, they would cost more than what this pass shares with `lazy_rules`.
        minus = p.decay[q, MINUS]
        row = net.projections[table[t.PROJECTION]]
        target_row = net.pops[row[t.TARGET]]
        receptors, relay = target_row[t.RECEPTORS], target_row[t.RELAY]
        blocks = net.awake.shape[0]
        slots, due = slot_mask(net), net.due[thread]
        own = table[t.FIRST_SOURCE] + source
        k_plus, last = p.k_plus[thread, own], p.k_time[thread, own]
        pre_trace = Trace(p.decay[q, PLUS], p.tau[q], k_plus, last)
        place = row[t.ROW] + source * (net.edges.shape[1] - 1) + thread
        wide = row[t.WAKE_ALL] == 1 and row[t.DELAY_STRIDE] == 0
        end = net.rows[place + 1]
        slot = slot_of_first(net, row, receptors, step)
        histories, width = address(p.past) + 8 * p.past.shape[1] * target_row[t.HISTORY], 8 * p.past.shape[1]
        # Read once a spike: a store into `buf` could change the tables, as far as the compiler knows, so it would read
        # them again for each synapse.
        first, to_synapse = row[t.SYNAPSE], table[t.FIRST_SYNAPSE] - row[t.SYNAPSE]
        delay_at, delay_stride = row[t.DELAY], row[t.DELAY_STRIDE]
        ring_at, ring_mask, ring_size = row[t.RING], row[t.RING_MASK], row[t.RING_SIZE]
        history, neuron, mark = target_row[t.HISTORY], target_row[t.BEGIN], target_row[t.FIRST_BLOCK]
        for e in range(net.rows[place], end):
            # Targets are drawn at random: without this every history and place in the ring would be waited for.
            ahead = np.int64(net.targets[min(e + AHEAD, end - 1)])
            prefetch(histories + width * ahead)
            prefetch(slot + 8 * ahead)
            z = to_synapse + e
            target = np.int64(net.targets[e])
            delay = np.int64(net.delays[delay_at + (e - first) * delay_stride])
            synapse = Synapse(q, z, own, target, history + target, delay)
            past, traces = p.past[synapse.history], p.traces[synapse.history]
            rule = p.rule[row_of(q, table, z)]
            learn(view, synapse, rule, past, pre_trace, thread, step, True, h)
            # Post spikes that arrive in this very step have potentiated above, and are not in K-: post is before pre.
            k_minus = post_trace(minus, past, traces, step - delay, h, net.tau_minus, neuron + target)
            on_pre(y, z, rule, (0.0,), (k_minus,))
            weight = y[0, z] + 0.0  # sent after its own update, as NEST does; -0.0 would be no input
            second = 1 if receptors == 2 and weight < 0.0 else 0
            at = step + delay
            ring = ring_at + ((at & ring_mask) * receptors + second) * ring_size
            net.buf[ring + target] += 1.0 if relay == 1 else weight
            if not wide:
                due[(at & slots) * blocks + mark + (target >> 6)] = 1
        # Marks once a spike, and none where this thread has no target of the source.
        if wide and net.rows[place] < net.rows[place + 1]:
            due_everywhere(net, target_row, step + np.int64(net.delays[row[t.DELAY]]), thread)
        trace = 1.0
        if k_plus != 0.0:
            trace += k_plus * math.exp(-(step - last) * h / p.tau[q, 0])
        p.k_plus[thread, own] = trace
        p.k_time[thread, own] = step
        p.spiked[thread, own] = step

    @subkernel
    def bring(view, q, target, step, thread, whole, h):
        """Catch up every synapse onto one target; `bring_history`, which does so for all projections, sets APPLIED."""
        net, p = net_of(view), plastic_of(view)
        table = p.table[q]
        row = net.projections[table[t.PROJECTION]]
        history = net.pops[row[t.TARGET], t.HISTORY] + target
        past = p.past[history]
        begin = table[t.INCOMING] + target
        for i in range(p.incoming[begin], p.incoming[begin + 1]):
            z = table[t.FIRST_SYNAPSE] + np.int64(p.in_synapse[i])
            own = table[t.FIRST_SOURCE] + np.int64(p.in_source[i])
            delay = np.int64(net.delays[row[t.DELAY] + (z - table[t.FIRST_SYNAPSE]) * row[t.DELAY_STRIDE]])
            c = p.rule[own_row(q, table, z)]
            bring_one(view, Synapse(q, z, own, target, history, delay), c, past, thread, step, whole, h)

    @kernel
    def run(view, q, operation, index, step, thread, h):
        if operation >= PRE_SPIKE:
            pre_spike(view, q, index, step, thread, h)
        else:
            bring(view, q, index, step, thread, operation == BRING_WHOLE, h)
        return 0

    return Entry(run, RULE_TYPE, model)
