"""Eager pair learning: a spike acts on synapses at once when it arrives.

A post spike acts on all synapses onto the neuron, and a pre spike on the row of the neuron. This is possible if a spike
reaches all synapses of a projection in the same step, so that no history is stored and searched. The rule must have no
modulator. The synapses must share one delay, which does not learn. The rule must not read K- of neurons that differ in
tau_minus. No value that can be set during a run changes these conditions.

A decaying trace K is stored as K e^(t / tau), where t counts from the last step that is a multiple of EPOCH. So
the stored value only changes at spikes, and one product gives K. Passes are compiled for each rule and called by their
address.
"""

# mypy: ignore-errors
from functools import cache

import numpy as np

from neuro.kernels.address import Entry
from neuro.kernels.instructions import address, prefetch
from neuro.kernels.jit import compiled, inlined, kernel, subkernel
from neuro_event.loop import tables as t
from neuro_event.loop.lazy_rules import (
    ADDS,
    AHEAD,
    NEAREST,
    PRE_SPIKE,
    RULE_TRACES,
    TAU,
    TIME,
    compile_on_pre,
    mark_all_due,
    own_row,
    shared_row,
    trace_after,
    tuple_of,
)
from neuro_event.loop.tables import RULE_TYPE, net_of, plastic_of, slot_mask

FORWARD = (1 << 62) - 1
"""A mask that changes no index. It shows the compiler that an index is not negative, so that it emits no test."""

PER_LINE = 16
"""Number of entries of a list of synapses in a cache line."""

_BLOCK_SHIFT = np.uint64(t.BLOCK_SHIFT)

MIN_TRACE = 1e-290
"""Traces below this value become 0, because arithmetic with denormal numbers is slow."""


@inlined
def pre_decay(plastic, q, j, kind, step):
    """Return the decay of a pre trace since the start of the epoch in which a step lies."""
    # An epoch has at most 1024 steps, and at most 64 times the shortest time constant, so that no digits are lost.
    return plastic.decay[q, RULE_TRACES + j, step % plastic.table[q, t.EPOCH]]


@inlined
def post_decay(plastic, q, j, kind, step):
    """Return the decay of a post trace since the start of the epoch in which a step lies."""
    return plastic.decay[q, RULE_TRACES + plastic.kinds.shape[1] // 2 + j, step % plastic.table[q, t.EPOCH]]


@inlined
def pre_value(plastic, j, kind, thread, trace_at, decay, step, h):
    """Return a pre trace at a step. A trace of time is stored as the step of the last spike."""
    stored = plastic.k_plus[thread, trace_at + j]
    return (step - stored) * h if kind[TAU] == TIME else stored * decay[j]


@inlined
def post_value(plastic, j, kind, place, decay, step, h):
    """Return a post trace at a step, which includes the spikes that arrived before the step."""
    stored = plastic.heard[place, j]
    return (step - stored) * h if kind[TAU] == TIME else stored * decay[j]


@inlined
def value_after(j, kind, values, m):
    """Return post trace j after m spikes. `values` has all post traces before the spikes."""
    return 0.0 if m > 0 and kind[TAU] == TIME else trace_after(kind, values[j], m)


@inlined
def stored_after(kind, stored, decay, step, m):
    """Return the stored value of a trace after m spikes in a step."""
    if kind[TAU] == TIME:
        return np.float64(step)
    # The trace vanishes at once, and a division by `decay` would give infinity.
    if decay == 0.0:
        return 0.0
    return kind[ADDS] / decay if kind[NEAREST] == 1.0 else stored + kind[ADDS] * m / decay


@inlined
def grow_pre(plastic, j, kind, thread, trace_at, decay, step):
    """Increase a pre trace by a spike."""
    stored = stored_after(kind, plastic.k_plus[thread, trace_at + j], decay[j], step, 1)
    plastic.k_plus[thread, trace_at + j] = stored
    return stored


@inlined
def grow_post(plastic, j, kind, place, decay, step, m):
    """Increase a post trace by m spikes."""
    stored = stored_after(kind, plastic.heard[place, j], decay[j], step, m)
    plastic.heard[place, j] = stored
    return stored


@inlined
def rescale(traces, first, last, stride, decay):
    """Rescale some traces for a new epoch."""
    for place in range(first, last, stride):
        # Traces change here once per epoch, and else only at spikes.
        value = traces[place] * decay
        traces[place] = value if abs(value) > MIN_TRACE else 0.0


@subkernel
def enter_epoch(view, q, thread):
    """Rescale all traces of a thread for a new epoch."""
    net, plastic = net_of(view), plastic_of(view)
    table, row = plastic.table[q], net.projections[plastic.table[q, t.PROJECTION]]
    source, target = net.pops[row[t.SOURCE]], net.pops[row[t.TARGET]]
    half, stride = plastic.kinds.shape[1] // 2, table[t.SOURCE_STRIDE]
    first, last = table[t.FIRST_SOURCE], table[t.FIRST_SOURCE] + (source[t.END] - source[t.BEGIN]) * stride
    for j in range(stride):
        if plastic.kinds[q, j, TAU] != TIME:
            rescale(plastic.k_plus[thread], first + j, last, stride, plastic.decay[q, RULE_TRACES + j, table[t.EPOCH]])
    lo = net.edges[target[t.NUMBER], thread] * t.BLOCK - target[t.BEGIN] + table[t.FIRST_TARGET]
    hi = min(net.edges[target[t.NUMBER], thread + 1] * t.BLOCK, target[t.END]) - target[t.BEGIN] + table[t.FIRST_TARGET]
    for j in range(plastic.heard.shape[1]):
        if plastic.kinds[q, half + j, TAU] != TIME:
            rescale(plastic.heard[:, j], lo, hi, 1, plastic.decay[q, RULE_TRACES + half + j, table[t.EPOCH]])


@subkernel
def arrived_range(view, q, step, thread):
    """Return the range in a thread's log of the post spikes that reach their synapses in a step."""
    net, plastic = net_of(view), plastic_of(view)
    row = net.projections[plastic.table[q, t.PROJECTION]]
    emitted = step - np.int64(net.delays[row[t.DELAY]])
    if emitted < 1:
        # No spike is emitted before step 1.
        return np.int64(0), np.int64(0)
    ends = net.log_ends[thread, emitted & (net.log_ends.shape[1] - 1)]
    return ends[row[t.TARGET]], ends[row[t.TARGET] + 1]


@subkernel
def prefetch_list(view, q, target):
    """Prefetch the list of the synapses onto a neuron."""
    plastic = plastic_of(view)
    begin = plastic.table[q, t.INCOMING] + target
    synapses, sources = address(plastic.in_synapse), address(plastic.in_source)
    for i in range(plastic.incoming[begin], plastic.incoming[begin + 1], PER_LINE):
        prefetch(synapses + 4 * i)
        prefetch(sources + 4 * i)


@cache
def eager_entry(model, own_rows):
    """Compile the eager pass of a rule, with a row of constants for all synapses or for each synapse."""
    row_of = own_row if own_rows else shared_row
    arithmetic = model.arithmetic
    learn_pre, on_post, sent_weight = compile_on_pre(model), compiled(arithmetic.on_post), compiled(model.sends())
    pre_decays = tuple_of(pre_decay, model.pre, "plastic, q, {j}, {kind}, step")
    post_decays = tuple_of(post_decay, model.post, "plastic, q, {j}, {kind}, step")
    pre_values = tuple_of(pre_value, model.pre, "plastic, {j}, {kind}, thread, trace_at, decay, step, h")
    post_values = tuple_of(post_value, model.post, "plastic, {j}, {kind}, place, decay, step, h")
    values_after = tuple_of(value_after, model.post, "{j}, {kind}, values, m")
    grow_pres = tuple_of(grow_pre, model.pre, "plastic, {j}, {kind}, thread, trace_at, decay, step")
    grow_posts = tuple_of(grow_post, model.post, "plastic, {j}, {kind}, place, decay, step, m")

    stride = max(1, len(model.pre))

    @subkernel
    def post_spike(view, q, target, next_target, m, step, thread, h):
        """Apply m spikes of a neuron that reach its synapses in a step, and prefetch weights of `next_target`."""
        plastic = plastic_of(view)
        table = plastic.table[q]
        first, decay = table[t.FIRST_SYNAPSE], pre_decays(plastic, q, step)
        # Computed once per spike, because the spike reaches all synapses of an eager projection in this step.
        before = post_values(plastic, table[t.FIRST_TARGET] + target, post_decays(plastic, q, step), step, h)
        sources = table[t.FIRST_SOURCE]
        begin, end = plastic.incoming[table[t.INCOMING] + target], plastic.incoming[table[t.INCOMING] + target + 1]
        # While the k-th synapse of this neuron learns, the k-th synapse of the next neuron is prefetched.
        next_offset, last = plastic.incoming[table[t.INCOMING] + next_target] - begin, plastic.in_synapse.shape[0] - 1
        weights, stop = address(plastic.y) + 8 * first, net_of(view).stop
        for k in range(m):
            if stop[0] == t.AT_ONCE:
                return
            # As in NEST, a spike of multiplicity m acts as m spikes one after the other.
            post = values_after(before, k)
            for i in range(np.uint64(begin), np.uint64(end)):
                # Incoming weights are in rows by source, so each is on another cache line and must be prefetched.
                prefetch(weights + 8 * np.int64(plastic.in_synapse[min(i + np.uint64(next_offset), np.uint64(last))]))
                z = (first + np.int64(plastic.in_synapse[i])) & FORWARD
                trace_at = (sources + np.int64(plastic.in_source[i]) * stride) & FORWARD
                on_post(
                    plastic.y,
                    z,
                    plastic.rule[row_of(q, table, z)],
                    pre_values(plastic, thread, trace_at, decay, step, h),
                    post,
                )

    @subkernel
    def arrivals(view, q, step, thread, h):
        """Process the post spikes that reach this thread's synapses in a step. Traces grow in the next step."""
        net, plastic = net_of(view), plastic_of(view)
        table, mask = plastic.table[q], net.log_ids.shape[1] - 1
        begins = net.pops[net.projections[table[t.PROJECTION], t.TARGET], t.BEGIN]
        # The spikes of the last step are added to the traces now. Post acts before pre, so a spike counts in K- from
        # the step after its arrival.
        first, last = arrived_range(view, q, step - 1, thread)
        for place in range(first, last):
            target = np.int64(net.log_ids[thread, place & mask]) - begins
            m = np.int64(net.log_counts[thread, place & mask])
            grow_posts(plastic, table[t.FIRST_TARGET] + target, post_decays(plastic, q, step - 1), step - 1, m)
        # Epochs begin at multiples of EPOCH. Slices do not matter, so a run in several parts gives the same bits.
        if step % table[t.EPOCH] == 0:
            enter_epoch(view, q, thread)
        first, last = arrived_range(view, q, step, thread)
        for place in range(first, last):
            target = np.int64(net.log_ids[thread, place & mask]) - begins
            next_target = np.int64(net.log_ids[thread, min(place + 1, last - 1) & mask]) - begins
            prefetch_list(view, q, np.int64(net.log_ids[thread, min(place + 2, last - 1) & mask]) - begins)
            post_spike(view, q, target, next_target, np.int64(net.log_counts[thread, place & mask]), step, thread, h)

    @subkernel
    def pre_spike(view, q, source, step, nth, thread, h):
        """Process a pre spike: each synapse of this thread learns and sends. Then the traces of the source grow."""
        net, plastic = net_of(view), plastic_of(view)
        table = plastic.table[q]
        row = net.projections[table[t.PROJECTION]]
        target_row = net.pops[row[t.TARGET]]
        receptors, relay = target_row[t.RECEPTORS], target_row[t.RELAY]
        trace_at, decay = table[t.FIRST_SOURCE] + source * table[t.SOURCE_STRIDE], post_decays(plastic, q, step)
        pre = pre_values(plastic, thread, trace_at, pre_decays(plastic, q, step), step, h)
        line = row[t.ROW] + source * (net.edges.shape[1] - 1) + thread
        first, end = net.rows[line], net.rows[line + 1]
        at = step + np.int64(net.delays[row[t.DELAY]])
        ring = row[t.RING] + (at & row[t.RING_MASK]) * receptors * row[t.RING_SIZE]
        traces, width = (
            address(plastic.heard) + 8 * plastic.heard.shape[1] * table[t.FIRST_TARGET],
            8 * plastic.heard.shape[1],
        )
        slot = address(net.buf) + 8 * ring
        to_synapse, to_target, size = table[t.FIRST_SYNAPSE] - row[t.SYNAPSE], table[t.FIRST_TARGET], row[t.RING_SIZE]
        weights, sent_weights = address(plastic.y) + 8 * to_synapse, address(plastic.sent) + 8 * to_synapse
        # The whole row is prefetched before its first synapse learns, eight weights per line.
        for e in range(first, end, 8):
            prefetch(weights + 8 * e)
            prefetch(sent_weights + 8 * e)
        for e in range(first, end):
            next_target = np.int64(net.targets[min(e + AHEAD, end - 1) & FORWARD])
            prefetch(slot + 8 * next_target)
            prefetch(traces + width * next_target)
            z = (to_synapse + e) & FORWARD
            target, c = np.int64(net.targets[e & FORWARD]), plastic.rule[row_of(q, table, z)]
            learn_pre(
                plastic, q, z, c, step, nth, pre, post_values(plastic, (to_target + target) & FORWARD, decay, step, h)
            )
            # As in NEST, a read between spikes shows the last weight that was sent.
            plastic.sent[z] = plastic.y[0, z]
            weight = sent_weight(plastic.y, z, c) + 0.0  # -0.0 would be no input
            second = size if receptors == 2 and weight < 0.0 else 0
            net.buf[(ring + second + target) & FORWARD] += 1.0 if relay == 1 else weight
        if row[t.WAKE_ALL] == 1 and first < end:
            mark_all_due(net, target_row, at, thread)
        elif row[t.WAKE_ALL] > 1:
            blocks = net.awake.shape[0]
            mark = (at & slot_mask(net)) * blocks + target_row[t.FIRST_BLOCK]
            due, place = net.due[thread], np.uint64(mark)
            for e in range(np.uint64(first), np.uint64(end)):
                due[place + (np.uint64(net.targets[e]) >> _BLOCK_SHIFT)] = 1
        # Updated after all synapses, because a pre spike does not count in its own trace.
        grow_pres(plastic, thread, trace_at, pre_decays(plastic, q, step), step)

    @kernel
    def run(view, q, operation, index, step, thread, h):
        if operation >= PRE_SPIKE:
            pre_spike(view, q, index, step, operation - PRE_SPIKE, thread, h)
        else:
            arrivals(view, q, step, thread, h)
        return 0

    return Entry(run, RULE_TYPE, model)
