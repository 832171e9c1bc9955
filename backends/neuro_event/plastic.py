"""Pairwise learning: lazy, one synapse at a time, at the events that concern it; what may act at once is in `eager`.

Post spikes are kept in a short history per neuron. When it is full, the synapses onto that neuron are caught up
to what has been processed, and what nobody needs any more is dropped.
"""

# mypy: ignore-errors
import math

import numpy as np

from neuro.kernels.jit import inner, kernel, merged
from neuro_event.decays import decayed
from neuro_event.own_rules import (
    APPLIED,
    BRING,
    BRING_WHOLE,
    ENTRIES,
    ENTRY,
    NEWEST,
    post_value,
)
from neuro_event.tables import (
    BEGIN,
    BLOCK,
    DOPAMINE,
    DOPAMINE_DELAY,
    DOPAMINE_ONE_TO_ONE,
    EAGER,
    END,
    FIRST_TARGET,
    HISTORY,
    HORIZON,
    LONGEST,
    NUMBER,
    OVERRUN,
    PROJECTION,
    TARGET,
)
from neuro_event.views import call_rule, net_of, plastic_of

PLUS, CONCENTRATION, MINUS = range(3)


@merged
def dopamine_at(view, q, target, step, h):
    """Concentration n of one target of a modulated projection."""
    p = plastic_of(view)
    place = p.table[q, FIRST_TARGET] + target
    if p.n[place] == 0.0:
        return 0.0
    return p.n[place] * decayed(p.decay[q, CONCENTRATION], step - p.n_time[place], h, p.tau[q], 1)


@inner
def bring_target(view, q, thread, target, step, whole, h):
    """Catch up every synapse of a projection onto one target; `whole`: up to the step, not the last spike before it.

    Whoever brings all such projections onto a target then sets its APPLIED.
    """
    table = plastic_of(view).table[q]
    call_rule(view, table, BRING_WHOLE if whole else BRING, target, step, thread, h)


@inner
def release(view, q, thread, target, step, amount, h):
    """Dopamine arrives at one target."""
    bring_target(view, q, thread, target, step, True, h)
    p = plastic_of(view)
    place = p.table[q, FIRST_TARGET] + target
    p.n[place] = dopamine_at(view, q, target, step, h) + amount
    p.n_time[place] = step


@kernel
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
    """Catch up every plastic synapse onto one neuron, see `bring_target`; return the longest of their delays."""
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


@kernel
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
