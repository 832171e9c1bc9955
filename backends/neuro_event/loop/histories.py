"""Lazy pair learning: a synapse is updated when an event needs it. Eager learning is in `eager_rules`.

Each neuron has a short history of its post spikes. To catch up, a synapse applies the post spikes of the history that
were not applied yet. When a history is full, all synapses onto the neuron catch up, and entries that no synapse
needs any more are dropped. So synapses of silent sources take no memory. A read updates a copy of the states. If all
projections of an engine learn lazily, an engine that is restored from its snapshot learns lazily until a reset.
"""

# mypy: ignore-errors
import math

import numpy as np

from neuro.kernels.jit import inlined, kernel, subkernel
from neuro_event.loop import tables as t
from neuro_event.loop.lazy_rules import (
    APPLIED,
    CATCH_UP,
    CATCH_UP_WHOLE,
    ENTRIES,
    ENTRY,
    NEWEST,
    OF_NEURON,
    TAU,
    TIME,
    decay_by_index,
    post_value,
    pre_value,
)
from neuro_event.loop.tables import call_rule, net_of, plastic_of

PLUS, CONCENTRATION, MINUS = range(3)


@inlined
def dopamine_at(view, q, target, step, h):
    """Return the dopamine concentration n of one target of a modulated projection."""
    plastic = plastic_of(view)
    place = plastic.table[q, t.FIRST_TARGET] + target
    # Most targets have never received dopamine, so they need no exponential.
    if plastic.n[place] == 0.0:
        return 0.0
    return plastic.n[place] * decay_by_index(
        plastic.decay[q, CONCENTRATION], step - plastic.n_time[place], h, plastic.tau[q], 1
    )


@subkernel
def catch_up_target(view, q, thread, target, step, whole, h):
    """Catch up every synapse of a projection onto one target.

    With `whole` the synapses are updated to `step`, else to the last post spike up to `step`. The caller sets
    APPLIED of the target after all its projections have caught up.
    """
    table = plastic_of(view).table[q]
    call_rule(view, table, CATCH_UP_WHOLE if whole else CATCH_UP, target, step, thread, h)


@subkernel
def release(view, q, thread, target, step, amount, h):
    """Increase the dopamine concentration of one target."""
    # Synapses catch up first, with the old n, because the integral of n c is computed between changes of n.
    catch_up_target(view, q, thread, target, step, True, h)
    plastic = plastic_of(view)
    place = plastic.table[q, t.FIRST_TARGET] + target
    plastic.n[place] = dopamine_at(view, q, target, step, h) + amount
    plastic.n_time[place] = step


@kernel
def dopamine_arrivals(view, q, step, thread, h):
    """Apply the dopamine spikes that arrive in a step at this thread's targets."""
    net, plastic = net_of(view), plastic_of(view)
    table = plastic.table[q]
    j = step - table[t.DOPAMINE_DELAY]
    # A trial, a reset or a restored state has dropped these spikes.
    if j <= net.clock[thread, t.HORIZON]:
        return
    target_row = net.pops[net.projections[table[t.PROJECTION], t.TARGET]]
    lo = net.edges[target_row[t.NUMBER], thread] * t.BLOCK - target_row[t.BEGIN]
    hi = min(net.edges[target_row[t.NUMBER], thread + 1] * t.BLOCK, target_row[t.END]) - target_row[t.BEGIN]
    population = table[t.DOPAMINE]
    slot = j & (net.log_ends.shape[1] - 1)
    mask = net.log_ids.shape[1] - 1
    # As in NEST, a spike adds 1/tau_n to n, so that the integral over its decay is 1 for any tau_n.
    dose = 1.0 / plastic.tau[q, 1]
    total = 0.0
    for sender in range(net.edges.shape[1] - 1):
        for place in range(net.log_ends[sender, slot, population], net.log_ends[sender, slot, population + 1]):
            m = net.log_counts[sender, place & mask]
            if table[t.DOPAMINE_ONE_TO_ONE] == 1:
                target = np.int64(net.log_ids[sender, place & mask]) - net.pops[population, t.BEGIN]
                if lo <= target < hi:
                    release(view, q, thread, target, step, m * dose, h)
            else:
                # All spikes of a step are released together, because each release catches up all synapses.
                total += m
    if total > 0.0:
        for target in range(lo, hi):
            if net.stop[0] == t.AT_ONCE:
                return
            release(view, q, thread, target, step, total * dose, h)


@subkernel
def catch_up_history(view, pop, thread, target, step, whole, h):
    """Catch up every plastic synapse onto one neuron, see `catch_up_target`. Return their longest delay."""
    net, plastic = net_of(view), plastic_of(view)
    longest = 0
    for q in range(plastic.table.shape[0]):
        # Eager projections have processed every spike and read no history.
        if net.projections[plastic.table[q, t.PROJECTION], t.TARGET] == pop and plastic.table[q, t.EAGER] == 0:
            # An entry is needed until it has reached the synapse with the longest delay.
            longest = max(longest, plastic.table[q, t.LONGEST])
            catch_up_target(view, q, thread, target, step, whole, h)
    past = plastic.past[net.pops[pop, t.HISTORY] + target]
    # The neuron stores a single step for all incoming synapses, instead of a step for each synapse.
    past[APPLIED] = max(past[APPLIED], step)
    return longest


@subkernel
def store_others(view, pop, local, n, step, h):
    """Store the post traces that third-party rules read, with the values just before a spike of the neuron."""
    net, plastic = net_of(view), plastic_of(view)
    history, neuron = net.pops[pop, t.HISTORY] + local, net.pops[pop, t.BEGIN] + local
    others = plastic.others[history]
    for column in range(plastic.columns.shape[1]):
        q, j = plastic.columns[pop, column, 0], plastic.columns[pop, column, 1]
        # Columns are filled from the front, and -1 marks the end.
        if q < 0:
            break
        kind = plastic.kinds[q, plastic.kinds.shape[1] // 2 + j]
        value = post_value(view, q, j, kind, column - j, history, 0, neuron, step, h)
        for i in range(n, 0, -1):
            others[i, column] = others[i - 1, column]
        others[0, column] = value


@kernel
def post_spike(view, pop, thread, local, m, step, processed_step, h):
    """Add a spike of multiplicity m to a neuron's history. A full history first drops entries that are not needed."""
    net, plastic = net_of(view), plastic_of(view)
    past = plastic.past[net.pops[pop, t.HISTORY] + local]
    n = past[ENTRIES]
    # Synapses only catch up when the history is full, so synapses of silent sources cost no memory and no time.
    if NEWEST + ENTRY * (n + 1) > past.size:
        longest = catch_up_history(view, pop, thread, local, processed_step, False, h)
        while n > 1 and past[NEWEST + ENTRY * (n - 2)] + longest <= processed_step:
            n -= 1
        if NEWEST + ENTRY * (n + 1) > past.size:
            # Kernels raise no errors, so the engine reads this flag after the run. Histories are long enough for any
            # model that does not fire within its t_ref.
            net.clock[thread, t.OVERRUN] = pop + 1
            n -= 1
    traces = plastic.traces[net.pops[pop, t.HISTORY] + local]
    trace = np.float64(m)
    if n > 0:
        age = (step - past[NEWEST]) * h
        trace += traces[NEWEST + 1] * math.exp(-age / net.tau_minus[net.pops[pop, t.BEGIN] + local])
    # The stored traces must not include the spike, so the spike is added afterwards.
    if plastic.others.shape[2] > 0:
        store_others(view, pop, local, n, step, h)
    # The newest entry comes first, because synapses most often need it.
    for i in range(ENTRY * n - 1, -1, -1):
        past[NEWEST + ENTRY + i] = past[NEWEST + i]
    past[NEWEST] = step
    traces[NEWEST + 1] = trace
    past[NEWEST + 2] = m
    past[ENTRIES] = n + 1


@kernel
def catch_up(view, q, n_targets, step, h):
    """Catch up every synapse of a projection."""
    for target in range(n_targets):
        catch_up_target(view, q, 0, target, step, True, h)


@kernel
def catch_up_histories(view, pop, n_targets, step, h):
    """Catch up every plastic synapse onto a population."""
    for target in range(n_targets):
        catch_up_history(view, pop, 0, target, step, True, h)


@kernel
def update_traces(view, q, n_sources, n_targets, step, h):
    """Update pre traces and n to a step. Post traces need no update, because their time constants cannot be set."""
    plastic = plastic_of(view)
    table = plastic.table[q]
    for target in range(n_targets):
        place = table[t.FIRST_TARGET] + target
        plastic.n[place] = dopamine_at(view, q, target, step, h)
        plastic.n_time[place] = step
    for thread in range(plastic.k_plus.shape[0]):
        for source in range(n_sources):
            k_at = table[t.FIRST_SOURCE] + source * table[t.SOURCE_STRIDE]
            if table[t.RULE] >= 0:
                plastic.k_plus[thread, k_at] *= math.exp(-(step - plastic.k_time[thread, k_at]) * h / plastic.tau[q, 0])
            else:
                for j in range(table[t.SOURCE_STRIDE]):
                    if plastic.kinds[q, j, TAU] != TIME and plastic.kinds[q, j, TAU] != OF_NEURON:
                        plastic.k_plus[thread, k_at + j] = pre_value(
                            plastic, q, j, plastic.kinds[q, j], thread, k_at, step, h
                        )
            plastic.k_time[thread, k_at] = step


@kernel
def write_signal(view, q, values, step, h):
    """Catch up all synapses of a modulated projection, then set n of its targets to `values`."""
    plastic = plastic_of(view)
    for target in range(values.shape[0]):
        catch_up_target(view, q, 0, target, step, True, h)
        plastic.n[plastic.table[q, t.FIRST_TARGET] + target] = values[target]
        plastic.n_time[plastic.table[q, t.FIRST_TARGET] + target] = step


@kernel
def concentrations(view, q, out, step, h):
    """Write n of every target at a step into `out`."""
    for target in range(out.shape[0]):
        out[target] = dopamine_at(view, q, target, step, h)
