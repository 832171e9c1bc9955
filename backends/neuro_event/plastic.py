"""Pairwise learning: lazy, one synapse at a time, at the events that concern it; what may act at once is in `eager`.

Post spikes are kept in a short history per neuron. When it is full, the synapses onto that neuron are caught up
to what has been processed, and what nobody needs any more is dropped.
"""

# mypy: ignore-errors
import math

import numpy as np

from neuro.kernels.jit import inner, merged
from neuro_event.decays import decayed
from neuro_event.dispatch import advance, on_post, on_pre
from neuro_event.noting import note
from neuro_event.own_rules import (
    AHEAD,
    APPLIED,
    ARRIVE,
    BRING,
    BRING_WHOLE,
    ENTRIES,
    ENTRY,
    NEWEST,
    PRE_SPIKE,
    due_everywhere,
    own_row,
    post_value,
    shared_row,
    slot_of_first,
)
from neuro_event.tables import (
    BEGIN,
    BLOCK,
    CONSTANTS_STRIDE,
    DELAY,
    DELAY_STRIDE,
    DOPAMINE,
    DOPAMINE_DELAY,
    DOPAMINE_ONE_TO_ONE,
    EAGER,
    END,
    FIRST_BLOCK,
    FIRST_SOURCE,
    FIRST_SYNAPSE,
    FIRST_TARGET,
    GRID_STEPS,
    HISTORY,
    HORIZON,
    INCOMING,
    LONGEST,
    MODULATED,
    NOTED,
    NUMBER,
    OVERRUN,
    PROJECTION,
    RECEPTORS,
    RELAY,
    RING,
    RING_MASK,
    RING_SIZE,
    ROW,
    RULE,
    RULE_ENTRY,
    SOURCE,
    SYNAPSE,
    TARGET,
    WAKE_ALL,
)
from neuro_event.views import address, call_rule, net_of, plastic_of, prefetch, slot_mask

PLUS, CONCENTRATION, MINUS = range(3)


@merged
def dopamine_at(view, q, target, step, h):
    """Concentration n of one target of a modulated projection."""
    p = plastic_of(view)
    place = p.table[q, FIRST_TARGET] + target
    if p.n[place] == 0.0:
        return 0.0
    return p.n[place] * decayed(p.decay[q, CONCENTRATION], step - p.n_time[place], h, p.tau[q], 1)


@merged
def arrived_since(past, since, delay):
    """How many entries of a history, the newest ones, arrive after a step."""
    n = past[ENTRIES]
    i = 0
    while i < n and past[NEWEST + ENTRY * i] + delay > since:
        i += 1
    return i


@merged
def potentiate(rule, c, y, z, decay, tau, k_plus, then, past, since, upto, delay, h):
    """Apply to synapse z, with the trace K+ of step `then`, the post spikes that arrive in since + 1 to upto."""
    if k_plus == 0.0:
        return
    for i in range(arrived_since(past, since, delay) - 1, -1, -1):
        arrival = past[NEWEST + ENTRY * i] + delay
        if arrival > upto:
            break
        k = k_plus * decayed(decay, arrival - then, h, tau, 0)
        for _ in range(past[NEWEST + ENTRY * i + 2]):
            on_post(rule, y, z, c, (k,), (0.0,))


@merged
def flow(view, q, z, own, thread, target, past, upto, whole, delay, h):
    """Let the post spikes up to step `upto` act on synapse z of a modulated projection, and what flows between them.

    With `whole` also what flows from the last of them to `upto`. To stop there clips the weight, so it is for events
    and reads only: not for making room in a history.
    """
    p = plastic_of(view)
    since = p.reached[z]
    if past[ENTRIES] > 0 and past[NEWEST] + delay > since:
        since = hear(view, q, z, own, thread, target, past, upto, delay, h)
    if whole and since < upto:
        n = dopamine_at(view, q, target, since, h)
        advance(p.table[q, MODULATED], p.y, z, p.rule[q], since, upto, n, p.table[q, GRID_STEPS])
        since = upto
    p.reached[z] = since


@inner
def hear(view, q, z, own, thread, target, past, upto, delay, h):
    """The post spikes of a history that synapse z has yet to hear, up to step `upto`; return when the last arrived."""
    p = plastic_of(view)
    modulated, c, grid = p.table[q, MODULATED], p.rule[q], p.table[q, GRID_STEPS]  # one rule for all, as dopamine acts
    k_plus, then, since = p.k_plus[thread, own], p.k_time[thread, own], p.reached[z]
    for i in range(arrived_since(past, since, delay) - 1, -1, -1):
        arrival = past[NEWEST + ENTRY * i] + delay
        if arrival > upto:
            break
        advance(modulated, p.y, z, c, since, arrival, dopamine_at(view, q, target, since, h), grid)
        since = arrival
        if k_plus != 0.0:
            k = k_plus * decayed(p.decay[q, PLUS], arrival - then, h, p.tau[q], 0)
            for _ in range(past[NEWEST + ENTRY * i + 2]):
                on_post(p.table[q, RULE], p.y, z, c, (k,), (0.0,))
    return since


@merged
def post_trace(decay, past, traces, before, h, tau_minus, neuron):
    """K- of a neuron from its spikes strictly before a step."""
    for i in range(past[ENTRIES]):
        time = past[NEWEST + ENTRY * i]
        if time < before:
            return traces[NEWEST + ENTRY * i + 1] * decayed(decay, before - time, h, tau_minus, neuron)
    return 0.0


def _pre_spike(row_of):
    """The pass over the synapses of a pre spike; compiled once for a shared rule, which it then need not look up."""

    @inner
    def pre_spike(view, q, source, step, thread, h):
        """A pre spike: each synapse of this thread catches up, learns and sends; then K+ grows."""
        net, p = net_of(view), plastic_of(view)
        table, number, y = p.table[q], p.table[q, RULE], p.y
        plus, minus, tau = p.decay[q, PLUS], p.decay[q, MINUS], p.tau[q]
        row = net.projections[table[PROJECTION]]
        target_row = net.pops[row[TARGET]]
        receptors, relay = target_row[RECEPTORS], target_row[RELAY]
        blocks = net.awake.shape[0]
        slots, due = slot_mask(net), net.due[thread]
        own = table[FIRST_SOURCE] + source
        k_plus, last = p.k_plus[thread, own], p.k_time[thread, own]
        place = row[ROW] + source * (net.edges.shape[1] - 1) + thread
        wide = row[WAKE_ALL] == 1 and row[DELAY_STRIDE] == 0
        end = net.rows[place + 1]
        slot = slot_of_first(net, row, receptors, step)
        histories, width = address(p.past) + 8 * p.past.shape[1] * target_row[HISTORY], 8 * p.past.shape[1]
        first, to_synapse = row[SYNAPSE], table[FIRST_SYNAPSE] - row[SYNAPSE]
        delay_at, delay_stride = row[DELAY], row[DELAY_STRIDE]
        ring_at, ring_mask, ring_size = row[RING], row[RING_MASK], row[RING_SIZE]
        history, neuron, mark = target_row[HISTORY], target_row[BEGIN], target_row[FIRST_BLOCK]
        modulated = table[MODULATED] >= 0
        for e in range(net.rows[place], end):
            # Targets are drawn at random: without this every history and place in the ring would be waited for.
            ahead = np.int64(net.targets[min(e + AHEAD, end - 1)])
            prefetch(histories + width * ahead)
            prefetch(slot + 8 * ahead)
            z = to_synapse + e
            target = np.int64(net.targets[e])
            delay = np.int64(net.delays[delay_at + (e - first) * delay_stride])
            past = p.past[history + target]
            rule = p.rule[row_of(q, table, z)]
            if modulated:
                flow(view, q, z, own, thread, target, past, step, True, delay, h)
            else:
                potentiate(number, rule, y, z, plus, tau, k_plus, last, past, max(last, past[APPLIED]), step, delay, h)
            # Post spikes that arrive in this very step have potentiated above, and are not in K-: post is before pre.
            k_minus = post_trace(
                minus,
                past,
                p.traces[history + target],
                step - delay,
                h,
                net.tau_minus,
                neuron + target,
            )
            on_pre(number, y, z, rule, (0.0,), (k_minus,))
            weight = y[0, z] + 0.0  # sent after its own update, as NEST does; -0.0 would be no input
            second = 1 if receptors == 2 and weight < 0.0 else 0
            at = step + delay
            ring = ring_at + ((at & ring_mask) * receptors + second) * ring_size
            net.buf[ring + target] += 1.0 if relay == 1 else weight
            if not wide:
                due[(at & slots) * blocks + mark + (target >> 6)] = 1
        if wide and net.rows[place] < net.rows[place + 1]:
            due_everywhere(net, target_row, step + np.int64(net.delays[row[DELAY]]), thread)
        trace = 1.0
        if k_plus != 0.0:
            trace += k_plus * math.exp(-(step - last) * h / p.tau[q, 0])
        p.k_plus[thread, own] = trace
        p.k_time[thread, own] = step
        p.spiked[thread, own] = step

    return pre_spike


pre_spike_of_all, pre_spike_of_each = _pre_spike(shared_row), _pre_spike(own_row)


@inner
def bring_target(view, q, thread, target, step, whole, h):
    """Catch up every synapse of a projection onto one target; `whole` as in `flow`.

    A synapse without dopamine shows the weight it sent last, so that is kept aside before the first change.
    Whoever brings all such projections onto a target then sets its APPLIED.
    """
    net, p = net_of(view), plastic_of(view)
    table = p.table[q]
    if table[RULE_ENTRY] != 0:
        call_rule(view, table, BRING_WHOLE if whole else BRING, target, step, thread, h)
        return
    row = net.projections[table[PROJECTION]]
    past = p.past[net.pops[row[TARGET], HISTORY] + target]
    applied = past[APPLIED]
    begin = table[INCOMING] + target
    for i in range(p.incoming[begin], p.incoming[begin + 1]):
        z = table[FIRST_SYNAPSE] + np.int64(p.in_synapse[i])
        own = table[FIRST_SOURCE] + np.int64(p.in_source[i])
        delay = np.int64(net.delays[row[DELAY] + (z - table[FIRST_SYNAPSE]) * row[DELAY_STRIDE]])
        if table[MODULATED] >= 0:
            if p.reached[z] < step:
                flow(view, q, z, own, thread, target, past, step, whole, delay, h)
            continue
        last = p.k_time[thread, own]
        if applied <= p.spiked[thread, own]:
            p.sent[z] = p.y[0, z]
        potentiate(
            table[RULE],
            p.rule[own_row(q, table, z)],
            p.y,
            z,
            p.decay[q, PLUS],
            p.tau[q],
            p.k_plus[thread, own],
            last,
            past,
            max(last, applied),
            step,
            delay,
            h,
        )


@inner
def release(view, q, thread, target, step, amount, h):
    """Dopamine arrives at one target."""
    bring_target(view, q, thread, target, step, True, h)
    p = plastic_of(view)
    place = p.table[q, FIRST_TARGET] + target
    p.n[place] = dopamine_at(view, q, target, step, h) + amount
    p.n_time[place] = step


@inner
def dopamine_arrivals(view, q, step, thread, h):
    """The dopamine spikes that arrive in a step at this thread's targets."""
    net, p = net_of(view), plastic_of(view)
    table = p.table[q]
    j = step - table[DOPAMINE_DELAY]
    if j <= net.clock[thread, HORIZON]:
        return
    target_row = net.pops[net.projections[table[PROJECTION], TARGET]]
    lo = net.edges[target_row[NUMBER], thread] * BLOCK - target_row[BEGIN]
    hi = min(net.edges[target_row[NUMBER], thread + 1] * BLOCK, target_row[END]) - target_row[BEGIN]
    population = table[DOPAMINE]
    slot = j & (net.log_ends.shape[1] - 1)
    mask = net.log_ids.shape[1] - 1
    each = 1.0 / p.tau[q, 1]
    total = 0.0
    for t in range(net.edges.shape[1] - 1):
        for place in range(net.log_ends[t, slot, population], net.log_ends[t, slot, population + 1]):
            m = net.log_counts[t, place & mask]
            if table[DOPAMINE_ONE_TO_ONE] == 1:
                target = np.int64(net.log_ids[t, place & mask]) - net.pops[population, BEGIN]
                if lo <= target < hi:
                    release(view, q, thread, target, step, m * each, h)
            else:
                total += m
    if total > 0.0:
        for target in range(lo, hi):
            release(view, q, thread, target, step, total * each, h)


@inner
def bring_history(view, pop, thread, target, step, whole, h):
    """Catch up every plastic synapse onto one neuron, `whole` as in `flow`; return the longest of their delays."""
    net, p = net_of(view), plastic_of(view)
    longest = 0
    for q in range(p.table.shape[0]):
        if net.projections[p.table[q, PROJECTION], TARGET] == pop and p.table[q, EAGER] == 0:
            longest = max(longest, p.table[q, LONGEST])
            bring_target(view, q, thread, target, step, whole, h)
    past = p.past[net.pops[pop, HISTORY] + target]
    past[APPLIED] = max(past[APPLIED], step)
    return longest


@inner
def keep_others(net, p, pop, local, n, step, h):
    """Keep the traces that rules of strangers read of a neuron, as they are just before its spike."""
    history, neuron = net.pops[pop, HISTORY] + local, net.pops[pop, BEGIN] + local
    others = p.others[history]
    for column in range(p.columns.shape[1]):
        q, j = p.columns[pop, column, 0], p.columns[pop, column, 1]
        if q < 0:
            break
        kind = p.kinds[q, p.kinds.shape[1] // 2 + j]
        value = post_value(net, p, q, j, kind, column - j, history, 0, neuron, step, h)
        for i in range(n, 0, -1):
            others[i, column] = others[i - 1, column]
        others[0, column] = value


@inner
def post_spike(view, pop, thread, local, m, step, done, h):
    """Enter a spike of multiplicity m into a neuron's history; first drop what nobody needs if that is full."""
    net, p = net_of(view), plastic_of(view)
    past = p.past[net.pops[pop, HISTORY] + local]
    n = past[ENTRIES]
    if NEWEST + ENTRY * (n + 1) > past.size:
        longest = bring_history(view, pop, thread, local, done, False, h)
        while n > 1 and past[NEWEST + ENTRY * (n - 2)] + longest <= done:
            n -= 1
        if NEWEST + ENTRY * (n + 1) > past.size:
            net.clock[thread, OVERRUN] = pop + 1
            n -= 1
    traces = p.traces[net.pops[pop, HISTORY] + local]
    trace = np.float64(m)
    if n > 0:
        age = (step - past[NEWEST]) * h
        trace += traces[NEWEST + 1] * math.exp(-age / net.tau_minus[net.pops[pop, BEGIN] + local])
    if p.others.shape[2] > 0:
        keep_others(net, p, pop, local, n, step, h)
    for i in range(ENTRY * n - 1, -1, -1):
        past[NEWEST + ENTRY + i] = past[NEWEST + i]
    past[NEWEST] = step
    traces[NEWEST + 1] = trace
    past[NEWEST + 2] = m
    past[ENTRIES] = n + 1


@inner
def learn_step(view, step, done_arrivals, thread, h, arrivals_only):
    """All pairwise learning of one step: what arrives in it, then the pre spikes emitted in it."""
    net, p = net_of(view), plastic_of(view)
    for q in range(p.table.shape[0]):
        if step > done_arrivals:
            if p.table[q, DOPAMINE] >= 0:
                dopamine_arrivals(view, q, step, thread, h)
            elif p.table[q, EAGER] == 1:
                call_rule(view, p.table[q], ARRIVE, 0, step, thread, h)
        if arrivals_only:
            continue
        source = net.projections[p.table[q, PROJECTION], SOURCE]
        slot = step & (net.log_ends.shape[1] - 1)
        mask = net.log_ids.shape[1] - 1
        for t in range(net.edges.shape[1] - 1):
            for place in range(net.log_ends[t, slot, source], net.log_ends[t, slot, source + 1]):
                local = np.int64(net.log_ids[t, place & mask]) - net.pops[source, BEGIN]
                for nth in range(net.log_counts[t, place & mask]):
                    if p.table[q, RULE_ENTRY] != 0:
                        call_rule(view, p.table[q], PRE_SPIKE + nth, local, step, thread, h)
                    elif p.table[q, CONSTANTS_STRIDE] == 0:
                        pre_spike_of_all(view, q, local, step, thread, h)
                    else:
                        pre_spike_of_each(view, q, local, step, thread, h)
                    if p.table[q, NOTED] == 1:
                        note(view, q, local, step, thread)
