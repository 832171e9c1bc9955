"""Pairwise rules at once: a post spike acts on all synapses onto its neuron as it reaches them, a pre spike on its row.

That is possible where all synapses of a projection hear a spike in the same step: no history is kept, none searched.
So the rule has no modulator, the synapses share one delay, which does not learn, and the rule reads no K- of neurons
that differ in tau_minus. Nothing that can be set changes the path.
A trace that decays is kept as K e^(t / tau), t from the last step that is a multiple of EPOCH: so it changes at spikes
only, and one product gives it back. Passes are compiled for each rule by itself and called by their address.
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
    OWN,
    PRE_SPIKE,
    TAU,
    TIME,
    drawing,
    due_everywhere,
    grown,
    own_row,
    shared_row,
    tuple_of,
)
from neuro_event.loop.tables import RULE_TYPE, net_of, plastic_of, slot_mask

FORWARD = (1 << 62) - 1
"""A place and this is the place: so the compiler knows that it is not one from the end, and tests none."""

PER_LINE = 16
"""Entries of a list in a cache line."""

_BLOCK_SHIFT = np.uint64(t.BLOCK_SHIFT)

NOTHING = 1e-290
"""A trace below this is 0: numbers that are slow to compute with are never reached."""


@inlined
def pre_left(p, q, j, kind, step):
    """What is left of a pre trace of 1 since the epoch of a step began."""
    # A trace is kept as K e^(t / tau), t counted from the step in which an epoch began: it changes at spikes only, and
    # one product gives its value. An epoch is at most 1024 steps and at most 64 of the shortest time constant, so that
    # no digit is lost.
    return p.decay[q, OWN + j, step % p.table[q, t.EPOCH]]


@inlined
def post_left(p, q, j, kind, step):
    """Likewise of a post trace."""
    return p.decay[q, OWN + p.kinds.shape[1] // 2 + j, step % p.table[q, t.EPOCH]]


@inlined
def pre_value(p, j, kind, thread, own, left, step, h):
    """A pre trace at a step; a time trace is kept as the step of the last spike."""
    kept = p.k_plus[thread, own + j]
    return (step - kept) * h if kind[TAU] == TIME else kept * left[j]


@inlined
def post_value(p, j, kind, place, left, step, h):
    """A post trace at a step, of the spikes that were heard before."""
    kept = p.heard[place, j]
    return (step - kept) * h if kind[TAU] == TIME else kept * left[j]


@inlined
def value_after(j, kind, values, m):
    """A post trace after m spikes, from the values before them."""
    return 0.0 if m > 0 and kind[TAU] == TIME else grown(kind, values[j], m)


@inlined
def kept_after(kind, kept, left, step, m):
    """As what a trace is kept after m spikes in a step."""
    if kind[TAU] == TIME:
        return np.float64(step)
    # Nothing would be left at once; to divide by it would give infinity.
    if left == 0.0:
        return 0.0
    return kind[ADDS] / left if kind[NEAREST] == 1.0 else kept + kind[ADDS] * m / left


@inlined
def keep_pre(p, j, kind, thread, own, left, step):
    """Let a pre trace grow by a spike."""
    kept = kept_after(kind, p.k_plus[thread, own + j], left[j], step, 1)
    p.k_plus[thread, own + j] = kept
    return kept


@inlined
def keep_post(p, j, kind, place, left, step, m):
    """Let a post trace grow by m spikes."""
    kept = kept_after(kind, p.heard[place, j], left[j], step, m)
    p.heard[place, j] = kept
    return kept


@inlined
def lessen(traces, first, last, stride, left):
    """Let some traces enter a new epoch."""
    for place in range(first, last, stride):
        # Once in an epoch of at most 1024 steps: between spikes nothing else touches a trace.
        value = traces[place] * left
        traces[place] = value if abs(value) > NOTHING else 0.0


@subkernel
def enter_epoch(view, q, thread):
    """Let all traces of a thread enter a new epoch."""
    net, p = net_of(view), plastic_of(view)
    table, row = p.table[q], net.projections[p.table[q, t.PROJECTION]]
    source, target = net.pops[row[t.SOURCE]], net.pops[row[t.TARGET]]
    half, stride = p.kinds.shape[1] // 2, table[t.SOURCE_STRIDE]
    first, last = table[t.FIRST_SOURCE], table[t.FIRST_SOURCE] + (source[t.END] - source[t.BEGIN]) * stride
    for j in range(stride):
        if p.kinds[q, j, TAU] != TIME:
            lessen(p.k_plus[thread], first + j, last, stride, p.decay[q, OWN + j, table[t.EPOCH]])
    lo = net.edges[target[t.NUMBER], thread] * t.BLOCK - target[t.BEGIN] + table[t.FIRST_TARGET]
    hi = min(net.edges[target[t.NUMBER], thread + 1] * t.BLOCK, target[t.END]) - target[t.BEGIN] + table[t.FIRST_TARGET]
    for j in range(p.heard.shape[1]):
        if p.kinds[q, half + j, TAU] != TIME:
            lessen(p.heard[:, j], lo, hi, 1, p.decay[q, OWN + half + j, table[t.EPOCH]])


@subkernel
def heard_in(view, q, step, thread):
    """Which places of a thread's log hold the post spikes that synapses hear in a step: the first, and the end."""
    net, p = net_of(view), plastic_of(view)
    row = net.projections[p.table[q, t.PROJECTION]]
    emitted = step - np.int64(net.delays[row[t.DELAY]])
    if emitted < 1:
        # Step 0 is the start: nothing was emitted before it.
        return np.int64(0), np.int64(0)
    ends = net.log_ends[thread, emitted & (net.log_ends.shape[1] - 1)]
    return ends[row[t.TARGET]], ends[row[t.TARGET] + 1]


@subkernel
def ask_for_list(view, q, target):
    """Ask for the list of the synapses onto a neuron."""
    p = plastic_of(view)
    begin = p.table[q, t.INCOMING] + target
    synapses, sources = address(p.in_synapse), address(p.in_source)
    for i in range(p.incoming[begin], p.incoming[begin + 1], PER_LINE):
        prefetch(synapses + 4 * i)
        prefetch(sources + 4 * i)


@cache
def eager_entry(model, own_rows):
    """The passes of one rule, whose synapses share a row of constants or have their own."""
    row_of = own_row if own_rows else shared_row
    arithmetic = model.arithmetic
    learn_pre, on_post, sent = drawing(model), compiled(arithmetic.on_post), compiled(model.sends())
    pre_lefts = tuple_of(pre_left, model.pre, "p, q, {j}, {kind}, step")
    post_lefts = tuple_of(post_left, model.post, "p, q, {j}, {kind}, step")
    pre_values = tuple_of(pre_value, model.pre, "p, {j}, {kind}, thread, own, left, step, h")
    post_values = tuple_of(post_value, model.post, "p, {j}, {kind}, place, left, step, h")
    values_after = tuple_of(value_after, model.post, "{j}, {kind}, values, m")
    keep_pres = tuple_of(keep_pre, model.pre, "p, {j}, {kind}, thread, own, left, step")
    keep_posts = tuple_of(keep_post, model.post, "p, {j}, {kind}, place, left, step, m")

    stride = max(1, len(model.pre))

    @subkernel
    def post_spike(view, q, target, ahead, m, step, thread, h):
        """The m spikes of a neuron that its synapses hear in a step; the weights of neuron `ahead` are asked for."""
        p = plastic_of(view)
        table = p.table[q]
        first, left = table[t.FIRST_SYNAPSE], pre_lefts(p, q, step)
        # Once a spike, not once a synapse: all synapses of the projection hear it in this step, which is what makes a
        # projection eager.
        before = post_values(p, table[t.FIRST_TARGET] + target, post_lefts(p, q, step), step, h)
        sources = table[t.FIRST_SOURCE]
        begin, end = p.incoming[table[t.INCOMING] + target], p.incoming[table[t.INCOMING] + target + 1]
        # The k-th synapse of the next neuron's list while the k-th of this one's learns: requests spread over the whole
        # pass.
        on, last = p.incoming[table[t.INCOMING] + ahead] - begin, p.in_synapse.shape[0] - 1
        weights, stop = address(p.y) + 8 * first, net_of(view).stop
        for k in range(m):
            if stop[0] == t.AT_ONCE:
                return
            # A spike of multiplicity m acts as m spikes one after the other, as in NEST.
            post = values_after(before, k)
            for i in range(np.uint64(begin), np.uint64(end)):
                # Incoming weights lie in rows of their sources, a line each: the next neuron's are asked for now.
                prefetch(weights + 8 * np.int64(p.in_synapse[min(i + np.uint64(on), np.uint64(last))]))
                z = (first + np.int64(p.in_synapse[i])) & FORWARD
                own = (sources + np.int64(p.in_source[i]) * stride) & FORWARD
                on_post(p.y, z, p.rule[row_of(q, table, z)], pre_values(p, thread, own, left, step, h), post)

    @subkernel
    def arrivals(view, q, step, thread, h):
        """The post spikes that this thread's synapses hear in a step. They count in traces from the next step on."""
        net, p = net_of(view), plastic_of(view)
        table, mask = p.table[q], net.log_ids.shape[1] - 1
        begins = net.pops[net.projections[table[t.PROJECTION], t.TARGET], t.BEGIN]
        # The spikes of the step before enter the traces now: post is before pre, so a spike counts in K- from the step
        # after its arrival.
        first, last = heard_in(view, q, step - 1, thread)
        for place in range(first, last):
            target = np.int64(net.log_ids[thread, place & mask]) - begins
            m = np.int64(net.log_counts[thread, place & mask])
            keep_posts(p, table[t.FIRST_TARGET] + target, post_lefts(p, q, step - 1), step - 1, m)
        # At multiples of the epoch, whatever the slice: so cutting a run changes no bit.
        if step % table[t.EPOCH] == 0:
            enter_epoch(view, q, thread)
        first, last = heard_in(view, q, step, thread)
        for place in range(first, last):
            target = np.int64(net.log_ids[thread, place & mask]) - begins
            ahead = np.int64(net.log_ids[thread, min(place + 1, last - 1) & mask]) - begins
            ask_for_list(view, q, np.int64(net.log_ids[thread, min(place + 2, last - 1) & mask]) - begins)
            post_spike(view, q, target, ahead, np.int64(net.log_counts[thread, place & mask]), step, thread, h)

    @subkernel
    def pre_spike(view, q, source, step, nth, thread, h):
        """A pre spike: each synapse of this thread learns and sends; then the traces of the source grow."""
        net, p = net_of(view), plastic_of(view)
        table = p.table[q]
        row = net.projections[table[t.PROJECTION]]
        target_row = net.pops[row[t.TARGET]]
        receptors, relay = target_row[t.RECEPTORS], target_row[t.RELAY]
        own, left = table[t.FIRST_SOURCE] + source * table[t.SOURCE_STRIDE], post_lefts(p, q, step)
        pre = pre_values(p, thread, own, pre_lefts(p, q, step), step, h)
        line = row[t.ROW] + source * (net.edges.shape[1] - 1) + thread
        first, end = net.rows[line], net.rows[line + 1]
        at = step + np.int64(net.delays[row[t.DELAY]])
        ring = row[t.RING] + (at & row[t.RING_MASK]) * receptors * row[t.RING_SIZE]
        heard, width = address(p.heard) + 8 * p.heard.shape[1] * table[t.FIRST_TARGET], 8 * p.heard.shape[1]
        slot = address(net.buf) + 8 * ring
        to_synapse, to_target, size = table[t.FIRST_SYNAPSE] - row[t.SYNAPSE], table[t.FIRST_TARGET], row[t.RING_SIZE]
        weights, kept = address(p.y) + 8 * to_synapse, address(p.sent) + 8 * to_synapse
        # Eight weights a line: the whole row is asked for before its first synapse learns.
        for e in range(first, end, 8):
            prefetch(weights + 8 * e)
            prefetch(kept + 8 * e)
        for e in range(first, end):
            ahead = np.int64(net.targets[min(e + AHEAD, end - 1) & FORWARD])
            prefetch(slot + 8 * ahead)
            prefetch(heard + width * ahead)
            z = (to_synapse + e) & FORWARD
            target, c = np.int64(net.targets[e & FORWARD]), p.rule[row_of(q, table, z)]
            learn_pre(p, q, z, c, step, nth, pre, post_values(p, (to_target + target) & FORWARD, left, step, h))
            # A read between spikes shows the weight sent last, as NEST does.
            p.sent[z] = p.y[0, z]
            weight = sent(p.y, z, c) + 0.0  # -0.0 would be no input
            second = size if receptors == 2 and weight < 0.0 else 0
            net.buf[(ring + second + target) & FORWARD] += 1.0 if relay == 1 else weight
        if row[t.WAKE_ALL] == 1 and first < end:
            due_everywhere(net, target_row, at, thread)
        elif row[t.WAKE_ALL] > 1:
            blocks = net.awake.shape[0]
            mark = (at & slot_mask(net)) * blocks + target_row[t.FIRST_BLOCK]
            due, place = net.due[thread], np.uint64(mark)
            for e in range(np.uint64(first), np.uint64(end)):
                due[place + (np.uint64(net.targets[e]) >> _BLOCK_SHIFT)] = 1
        # After all synapses: a pre spike does not count in its own trace.
        keep_pres(p, thread, own, pre_lefts(p, q, step), step)

    @kernel
    def run(view, q, operation, index, step, thread, h):
        if operation >= PRE_SPIKE:
            pre_spike(view, q, index, step, operation - PRE_SPIKE, thread, h)
        else:
            arrivals(view, q, step, thread, h)
        return 0

    return Entry(run, RULE_TYPE, model)
