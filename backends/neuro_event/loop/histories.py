"""Pairwise learning: lazy, one synapse at a time, at the events that concern it; `eager_rules` has what acts at once.

Post spikes are kept in a short history per neuron. When it is full, the synapses onto that neuron are caught up to what
has been processed, and entries that no synapse needs any more are dropped: silent partners cost no memory. A read
catches up a copy of the states. A state saved when all projections learnt so goes on so until it is reset.
"""

# mypy: ignore-errors
import math

import numpy as np

from neuro.kernels.jit import inlined, kernel, subkernel
from neuro_event.loop import tables as t
from neuro_event.loop.lazy_rules import (
    APPLIED,
    BRING,
    BRING_WHOLE,
    ENTRIES,
    ENTRY,
    NEWEST,
    OF_NEURON,
    TAU,
    TIME,
    decayed,
    post_value,
    pre_value,
)
from neuro_event.loop.tables import call_rule, net_of, plastic_of

PLUS, CONCENTRATION, MINUS = range(3)


@inlined
def dopamine_at(view, q, target, step, h):
    """Concentration n of one target of a modulated projection."""
    p = plastic_of(view)
    place = p.table[q, t.FIRST_TARGET] + target
    # Most targets have never had dopamine: no exponential for them.
    if p.n[place] == 0.0:
        return 0.0
    return p.n[place] * decayed(p.decay[q, CONCENTRATION], step - p.n_time[place], h, p.tau[q], 1)


@subkernel
def bring_target(view, q, thread, target, step, whole, h):
    """Catch up every synapse of a projection onto one target; `whole`: up to the step, not the last spike before it.

    Whoever brings all such projections onto a target then sets its APPLIED.
    """
    table = plastic_of(view).table[q]
    call_rule(view, table, BRING_WHOLE if whole else BRING, target, step, thread, h)


@subkernel
def release(view, q, thread, target, step, amount, h):
    """Dopamine arrives at one target."""
    # Caught up with the old concentration first: the integral of n times c is worked out in pieces between changes of
    # n.
    bring_target(view, q, thread, target, step, True, h)
    p = plastic_of(view)
    place = p.table[q, t.FIRST_TARGET] + target
    p.n[place] = dopamine_at(view, q, target, step, h) + amount
    p.n_time[place] = step


@kernel
def dopamine_arrivals(view, q, step, thread, h):
    """The dopamine spikes that arrive in a step at this thread's targets."""
    net, p = net_of(view), plastic_of(view)
    table = p.table[q]
    j = step - table[t.DOPAMINE_DELAY]
    # Dropped by a trial, a reset or a restored state.
    if j <= net.clock[thread, t.HORIZON]:
        return
    target_row = net.pops[net.projections[table[t.PROJECTION], t.TARGET]]
    lo = net.edges[target_row[t.NUMBER], thread] * t.BLOCK - target_row[t.BEGIN]
    hi = min(net.edges[target_row[t.NUMBER], thread + 1] * t.BLOCK, target_row[t.END]) - target_row[t.BEGIN]
    population = table[t.DOPAMINE]
    slot = j & (net.log_ends.shape[1] - 1)
    mask = net.log_ids.shape[1] - 1
    # NEST's: a spike adds 1/tau_n, so that its integral is 1 whatever tau_n.
    each = 1.0 / p.tau[q, 1]
    total = 0.0
    for sender in range(net.edges.shape[1] - 1):
        for place in range(net.log_ends[sender, slot, population], net.log_ends[sender, slot, population + 1]):
            m = net.log_counts[sender, place & mask]
            if table[t.DOPAMINE_ONE_TO_ONE] == 1:
                target = np.int64(net.log_ids[sender, place & mask]) - net.pops[population, t.BEGIN]
                if lo <= target < hi:
                    release(view, q, thread, target, step, m * each, h)
            else:
                # All spikes of a step at once: each release would catch up all synapses once more.
                total += m
    if total > 0.0:
        for target in range(lo, hi):
            if net.stop[0] == t.AT_ONCE:
                return
            release(view, q, thread, target, step, total * each, h)


@subkernel
def bring_history(view, pop, thread, target, step, whole, h):
    """Catch up every plastic synapse onto one neuron, see `bring_target`; return the longest of their delays."""
    net, p = net_of(view), plastic_of(view)
    longest = 0
    for q in range(p.table.shape[0]):
        # Eager projections have heard every spike already and read no history.
        if net.projections[p.table[q, t.PROJECTION], t.TARGET] == pop and p.table[q, t.EAGER] == 0:
            # An entry is needed until the synapse with the longest delay has heard it.
            longest = max(longest, p.table[q, t.LONGEST])
            bring_target(view, q, thread, target, step, whole, h)
    past = p.past[net.pops[pop, t.HISTORY] + target]
    # One number for all synapses onto the neuron: without it each would need the step up to which it has heard.
    past[APPLIED] = max(past[APPLIED], step)
    return longest


@subkernel
def keep_others(view, pop, local, n, step, h):
    """Keep the traces that third-party rules read of a neuron, as they are just before its spike."""
    net, p = net_of(view), plastic_of(view)
    history, neuron = net.pops[pop, t.HISTORY] + local, net.pops[pop, t.BEGIN] + local
    others = p.others[history]
    for column in range(p.columns.shape[1]):
        q, j = p.columns[pop, column, 0], p.columns[pop, column, 1]
        # Columns are filled from the front, -1 ends them.
        if q < 0:
            break
        kind = p.kinds[q, p.kinds.shape[1] // 2 + j]
        value = post_value(view, q, j, kind, column - j, history, 0, neuron, step, h)
        for i in range(n, 0, -1):
            others[i, column] = others[i - 1, column]
        others[0, column] = value


@kernel
def post_spike(view, pop, thread, local, m, step, done, h):
    """Enter a spike of multiplicity m into a neuron's history; first drop what is not needed if that is full."""
    net, p = net_of(view), plastic_of(view)
    past = p.past[net.pops[pop, t.HISTORY] + local]
    n = past[ENTRIES]
    # Only a full history brings its synapses up to date, so silent partners cost no memory and no pass.
    if NEWEST + ENTRY * (n + 1) > past.size:
        longest = bring_history(view, pop, thread, local, done, False, h)
        while n > 1 and past[NEWEST + ENTRY * (n - 2)] + longest <= done:
            n -= 1
        if NEWEST + ENTRY * (n + 1) > past.size:
            # No kernel raises: the engine reads this after the run and reports it. Histories are as long as t_ref lets
            # them grow, so only a model that fires within its own t_ref comes here.
            net.clock[thread, t.OVERRUN] = pop + 1
            n -= 1
    traces = p.traces[net.pops[pop, t.HISTORY] + local]
    trace = np.float64(m)
    if n > 0:
        age = (step - past[NEWEST]) * h
        trace += traces[NEWEST + 1] * math.exp(-age / net.tau_minus[net.pops[pop, t.BEGIN] + local])
    # Before the entry is made: the values are those just before the spike.
    if p.others.shape[2] > 0:
        keep_others(view, pop, local, n, step, h)
    # The newest goes in front: a search begins with what a synapse most likely needs.
    for i in range(ENTRY * n - 1, -1, -1):
        past[NEWEST + ENTRY + i] = past[NEWEST + i]
    past[NEWEST] = step
    traces[NEWEST + 1] = trace
    past[NEWEST + 2] = m
    past[ENTRIES] = n + 1


@kernel
def bring(view, q, n_targets, step, h):
    """Catch up every synapse of a projection."""
    for target in range(n_targets):
        bring_target(view, q, 0, target, step, True, h)


@kernel
def bring_histories(view, pop, n_targets, step, h):
    """Catch up every plastic synapse onto a population."""
    for target in range(n_targets):
        bring_history(view, pop, 0, target, step, True, h)


@kernel
def bring_traces(view, q, n_sources, n_targets, step, h):
    """Let pre traces and n decay to the present; the time constants of post traces cannot be set."""
    p = plastic_of(view)
    table = p.table[q]
    for target in range(n_targets):
        place = table[t.FIRST_TARGET] + target
        p.n[place] = dopamine_at(view, q, target, step, h)
        p.n_time[place] = step
    for thread in range(p.k_plus.shape[0]):
        for source in range(n_sources):
            own = table[t.FIRST_SOURCE] + source * table[t.SOURCE_STRIDE]
            if table[t.RULE] >= 0:
                p.k_plus[thread, own] *= math.exp(-(step - p.k_time[thread, own]) * h / p.tau[q, 0])
            else:
                for j in range(table[t.SOURCE_STRIDE]):
                    if p.kinds[q, j, TAU] != TIME and p.kinds[q, j, TAU] != OF_NEURON:
                        p.k_plus[thread, own + j] = pre_value(p, q, j, p.kinds[q, j], thread, own, step, h)
            p.k_time[thread, own] = step


@kernel
def write_signal(view, q, values, step, h):
    """Catch up a modulated projection, then set n."""
    p = plastic_of(view)
    for target in range(values.shape[0]):
        bring_target(view, q, 0, target, step, True, h)
        p.n[p.table[q, t.FIRST_TARGET] + target] = values[target]
        p.n_time[p.table[q, t.FIRST_TARGET] + target] = step


@kernel
def concentrations(view, q, out, step, h):
    """Fill `out` with n of every target at a step."""
    for target in range(out.shape[0]):
        out[target] = dopamine_at(view, q, target, step, h)
