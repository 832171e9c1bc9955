"""Pairwise learning: lazy, one synapse at a time, at the events that concern it.

Post spikes are kept in a short history per neuron. When it is full, the synapses onto that neuron are caught up
to what has been processed, and what nobody needs any more is dropped.
"""

# mypy: ignore-errors
import math

import numpy as np

from neuro_event.dispatch import advance, on_post, on_pre
from neuro_event.jit import inner
from neuro_event.tables import (
    BEGIN,
    BLOCK,
    DELAY,
    DELAY_STRIDE,
    DOPAMINE,
    DOPAMINE_DELAY,
    DOPAMINE_ONE_TO_ONE,
    END,
    FIRST_BLOCK,
    FIRST_SOURCE,
    FIRST_SYNAPSE,
    FIRST_TARGET,
    GRID_STEPS,
    HISTORY,
    HORIZON,
    INCOMING,
    LAST_BLOCK,
    LONGEST,
    MODULATED,
    PROJECTION,
    RECEPTORS,
    RELAY,
    RING,
    RING_MASK,
    RING_SIZE,
    ROW,
    RULE,
    SOURCE,
    SYNAPSE,
    TARGET,
    WAKE_ALL,
)
from neuro_event.views import net_of, plastic_of

DECAYS = 2048
"""Steps for which decays are kept in tables."""

PLUS, CONCENTRATION, MINUS = range(3)

HEAD, TAIL, FIRST_ENTRY = range(3)
"""A history is a row: one past the newest entry, the oldest kept, then a ring of pairs (step, K- just after)."""


@inner
def decayed(p, q, which, steps, h, tau):
    """What is left after some steps of a trace that decays with tau."""
    if steps < DECAYS and p.decay[q, which, 0] == 1.0:
        return p.decay[q, which, steps]
    return math.exp(-steps * h / tau)


@inner
def dopamine_at(view, q, target, step, h):
    """Concentration n of one target of a modulated projection."""
    p = plastic_of(view)
    place = p.table[q, FIRST_TARGET] + target
    if p.n[place] == 0.0:
        return 0.0
    return p.n[place] * decayed(p, q, CONCENTRATION, step - p.n_time[place], h, p.tau[q, 1])


@inner
def catch_up(view, q, z, thread, source, target, history, upto, delay, h):
    """Apply to synapse z the post spikes that arrive in its steps up to `upto`, and what flows between."""
    p = plastic_of(view)
    table = p.table[q]
    modulated, c = table[MODULATED], p.rule[q]
    place = table[FIRST_SOURCE] + source
    past = p.past[history]
    mask = (past.size - FIRST_ENTRY) // 2 - 1
    head, tail = np.int64(past[HEAD]), np.int64(past[TAIL])
    since = p.reached[z]
    i = head
    while i > tail and np.int64(past[FIRST_ENTRY + 2 * ((i - 1) & mask)]) + delay > since:
        i -= 1
    while i < head:
        arrival = np.int64(past[FIRST_ENTRY + 2 * (i & mask)]) + delay
        if arrival > upto:
            break
        if modulated >= 0:
            advance(modulated, p.y, z, c, since, arrival, dopamine_at(view, q, target, since, h), table[GRID_STEPS])
            since = arrival
        k_plus = p.k_plus[thread, place]
        if k_plus != 0.0:
            age = arrival - p.k_time[thread, place]
            on_post(table[RULE], p.y, z, c, k_plus * decayed(p, q, PLUS, age, h, p.tau[q, 0]))
        i += 1
    if modulated >= 0 and since < upto:
        advance(modulated, p.y, z, c, since, upto, dopamine_at(view, q, target, since, h), table[GRID_STEPS])
    p.reached[z] = upto


@inner
def post_trace(view, q, history, before, h, tau_minus):
    """K- of a neuron from its spikes strictly before a step."""
    p = plastic_of(view)
    past = p.past[history]
    mask = (past.size - FIRST_ENTRY) // 2 - 1
    i, tail = np.int64(past[HEAD]) - 1, np.int64(past[TAIL])
    while i >= tail:
        entry = FIRST_ENTRY + 2 * (i & mask)
        time = np.int64(past[entry])
        if time < before:
            return past[entry + 1] * decayed(p, q, MINUS, before - time, h, tau_minus)
        i -= 1
    return 0.0


@inner
def pre_spike(view, q, source, m, step, thread, h):
    """A pre spike: each synapse of this thread catches up, learns and sends; then K+ grows."""
    net, p = net_of(view), plastic_of(view)
    table = p.table[q]
    row = net.projections[table[PROJECTION]]
    target_row = net.pops[row[TARGET]]
    receptors = target_row[RECEPTORS]
    blocks = net.awake.shape[0]
    slots = net.due.shape[0] // blocks - 1
    place = row[ROW] + source * (net.edges.shape[0] - 1) + thread
    wide = row[WAKE_ALL] == 1 and row[DELAY_STRIDE] == 0
    for e in range(net.rows[place], net.rows[place + 1]):
        s = e - row[SYNAPSE]
        z = table[FIRST_SYNAPSE] + s
        target = np.int64(net.targets[e])
        delay = np.int64(net.delays[row[DELAY] + s * row[DELAY_STRIDE]])
        history = target_row[HISTORY] + target
        catch_up(view, q, z, thread, source, target, history, step, delay, h)
        k_minus = post_trace(view, q, history, step - delay, h, net.tau_minus[target_row[BEGIN] + target])
        on_pre(table[RULE], p.y, z, p.rule[q], k_minus)
        weight = p.y[0, z]
        p.sent[z] = weight
        value = m if target_row[RELAY] == 1 else weight * m
        second = 1 if receptors == 2 and weight < 0.0 else 0
        at = step + delay
        net.buf[row[RING] + ((at & row[RING_MASK]) * receptors + second) * row[RING_SIZE] + target] += value
        if not wide:
            net.due[(at & slots) * blocks + target_row[FIRST_BLOCK] + (target >> 6)] = 1
    if wide and net.rows[place] < net.rows[place + 1]:
        mark = ((step + np.int64(net.delays[row[DELAY]])) & slots) * blocks
        lo, hi = max(target_row[FIRST_BLOCK], net.edges[thread]), min(target_row[LAST_BLOCK], net.edges[thread + 1])
        net.due[mark + lo : mark + hi] = 1
    own = table[FIRST_SOURCE] + source
    trace = 1.0
    if p.k_plus[thread, own] != 0.0:
        trace += p.k_plus[thread, own] * math.exp(-(step - p.k_time[thread, own]) * h / p.tau[q, 0])
    p.k_plus[thread, own] = trace
    p.k_time[thread, own] = step


@inner
def bring_target(view, q, thread, target, step, h):
    """Catch up every synapse of a projection onto one target."""
    net, p = net_of(view), plastic_of(view)
    table = p.table[q]
    row = net.projections[table[PROJECTION]]
    history = net.pops[row[TARGET], HISTORY] + target
    begin = table[INCOMING] + target
    for i in range(p.incoming[begin], p.incoming[begin + 1]):
        z = p.in_synapse[i]
        if p.reached[z] < step:
            delay = np.int64(net.delays[row[DELAY] + (z - table[FIRST_SYNAPSE]) * row[DELAY_STRIDE]])
            catch_up(view, q, z, thread, np.int64(p.in_source[i]), target, history, step, delay, h)


@inner
def release(view, q, thread, target, step, amount, h):
    """Dopamine arrives at one target."""
    bring_target(view, q, thread, target, step, h)
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
    lo = max(net.edges[thread] * BLOCK - target_row[BEGIN], 0)
    hi = min(net.edges[thread + 1] * BLOCK, target_row[END]) - target_row[BEGIN]
    population = table[DOPAMINE]
    slot = j & (net.log_ends.shape[1] - 1)
    mask = net.log_ids.shape[1] - 1
    each = 1.0 / p.tau[q, 1]
    total = 0.0
    for t in range(net.edges.shape[0] - 1):
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
def flush(view, pop, thread, local, history, done, h):
    """The history of one neuron is full: let its synapses use it, and drop what none needs any more."""
    net, p = net_of(view), plastic_of(view)
    longest = 0
    for q in range(p.table.shape[0]):
        if net.projections[p.table[q, PROJECTION], TARGET] == pop:
            longest = max(longest, p.table[q, LONGEST])
            bring_target(view, q, thread, local, done, h)
    past = p.past[history]
    mask = (past.size - FIRST_ENTRY) // 2 - 1
    head, tail = np.int64(past[HEAD]), np.int64(past[TAIL])
    while tail < head - 1 and past[FIRST_ENTRY + 2 * ((tail + 1) & mask)] + longest <= done:
        tail += 1
    past[TAIL] = tail


@inner
def post_spike(view, pop, thread, local, step, done, h):
    """Enter a spike of a neuron into its history."""
    net, p = net_of(view), plastic_of(view)
    history = net.pops[pop, HISTORY] + local
    past = p.past[history]
    mask = (past.size - FIRST_ENTRY) // 2 - 1
    if past[HEAD] - past[TAIL] == mask + 1:
        flush(view, pop, thread, local, history, done, h)
    head = np.int64(past[HEAD])
    trace = 1.0
    if past[HEAD] > past[TAIL]:
        last = FIRST_ENTRY + 2 * ((head - 1) & mask)
        age = (step - past[last]) * h
        trace += past[last + 1] * math.exp(-age / net.tau_minus[net.pops[pop, BEGIN] + local])
    entry = FIRST_ENTRY + 2 * (head & mask)
    past[entry] = step
    past[entry + 1] = trace
    past[HEAD] = head + 1


@inner
def learn_step(view, step, done_dopamine, thread, h, dopamine_only):
    """All pairwise learning of one step: dopamine that arrives in it, then the pre spikes emitted in it."""
    net, p = net_of(view), plastic_of(view)
    for q in range(p.table.shape[0]):
        if p.table[q, DOPAMINE] >= 0 and step > done_dopamine:
            dopamine_arrivals(view, q, step, thread, h)
        if dopamine_only:
            continue
        source = net.projections[p.table[q, PROJECTION], SOURCE]
        slot = step & (net.log_ends.shape[1] - 1)
        mask = net.log_ids.shape[1] - 1
        for t in range(net.edges.shape[0] - 1):
            for place in range(net.log_ends[t, slot, source], net.log_ends[t, slot, source + 1]):
                local = np.int64(net.log_ids[t, place & mask]) - net.pops[source, BEGIN]
                pre_spike(view, q, local, np.float64(net.log_counts[t, place & mask]), step, thread, h)
