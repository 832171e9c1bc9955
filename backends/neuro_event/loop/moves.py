"""Learning by moves: eligibility is gathered after each step of the target, and a signal applies it to the weights.

The projection is delivered like a static projection. In addition there are two sparse lists. A *lit* source has a trace
that is not 0; a post spike gathers eligibility from lit sources. A *live* source may have a synapse with a state that
is not 0; a signal teaches the synapses of live sources. So the time of a step grows with the number of active sources.
The time of a move grows with the number of sources that were active since the states were last 0. In an agent these
sources have a few thousand of 61,000 synapses.
"""

# mypy: ignore-errors
from functools import cache

import numpy as np

from neuro.kernels.address import Entry
from neuro.kernels.instructions import address
from neuro.kernels.jit import compiled, inlined, kernel, subkernel
from neuro_event.loop import tables as t
from neuro_event.loop.arrivals import prefetch_lines
from neuro_event.loop.lazy_rules import tuple_of
from neuro_event.loop.tables import RULE_TYPE, call_moves, net_of, plastic_of

GATHER, TEACH = range(2)
"""Operations of a compiled rule."""

DENSE_FROM = 8
"""A dense projection gathers for all targets, if at least one in `DENSE_FROM` targets is concerned by a step.

A target is concerned if it spiked, or if the rule reads a state of it that is not 0.
"""

LIT, LIVE = range(2)
"""The two lists of sources: index in `move_lists` and column of `move_count`."""


@inlined
def trace_of(plastic, j, kind, thread, x_at):
    """Return a pre trace of a source in the present step."""
    return plastic.move_x[thread, x_at + j]


@inlined
def targets_of(net, target_row, thread):
    """Return the first target of a thread and the end."""
    lo = net.edges[target_row[t.NUMBER], thread] * t.BLOCK - target_row[t.BEGIN]
    return lo, min(net.edges[target_row[t.NUMBER], thread + 1] * t.BLOCK, target_row[t.END]) - target_row[t.BEGIN]


@inlined
def synapse_range(net, row, source, thread):
    """Return the range of a source's synapses onto the targets of a thread, counted in the projection."""
    if row[t.LAYOUT] == t.DENSE:
        target_row = net.pops[row[t.TARGET]]
        lo, hi = targets_of(net, target_row, thread)
        first = source * (target_row[t.END] - target_row[t.BEGIN])
        return first + lo, first + hi
    if row[t.LAYOUT] == t.ONE_TO_ONE:
        lo, hi = targets_of(net, net.pops[row[t.TARGET]], thread)
        return source, source + (lo <= source < hi)
    line = row[t.ROW] + source * (net.edges.shape[1] - 1) + thread
    return net.rows[line] - row[t.SYNAPSE], net.rows[line + 1] - row[t.SYNAPSE]


@inlined
def target_of(net, row, source, s):
    """Return the target of synapse s of a projection."""
    if row[t.LAYOUT] == t.DENSE:
        target_row = net.pops[row[t.TARGET]]
        return s - source * (target_row[t.END] - target_row[t.BEGIN])
    return s if row[t.LAYOUT] == t.ONE_TO_ONE else np.int64(net.targets[row[t.SYNAPSE] + s])


@subkernel
def first_synapse_onto(net, row, source, first, end, target):
    """Return the first synapse among first:end whose target is `target` or a later one. The targets of a row ascend."""
    while first < end:
        middle = (first + end) // 2
        if target_of(net, row, source, middle) < target:
            first = middle + 1
        else:
            end = middle
    return first


@subkernel
def activate(plastic, k, thread, source):
    """Add a source to each of both lists, unless the list has the source."""
    first = plastic.move_table[k, t.MOVE_SOURCE]
    place = first + source
    if plastic.move_is_lit[thread, place] == 0:
        plastic.move_is_lit[thread, place] = 1
        plastic.move_lists[thread, LIT, first + plastic.move_count[thread, k, LIT]] = source
        plastic.move_count[thread, k, LIT] += 1
    if plastic.move_is_live[thread, place] == 0:
        plastic.move_is_live[thread, place] = 1
        plastic.move_lists[thread, LIVE, first + plastic.move_count[thread, k, LIVE]] = source
        plastic.move_count[thread, k, LIVE] += 1


@cache
def move_entry(model):
    """Compile the operations of a rule for moves."""
    gather, teach = compiled(model.arithmetic.gather), compiled(model.arithmetic.teach)
    traces = tuple_of(trace_of, model.pre, "plastic, {j}, {kind}, thread, x_at")
    n_pre, n_states = len(model.pre), len(model.states)

    @subkernel
    def update_traces(view, k, step, thread):
        """Let the pre traces decay by a step, and increase them by the spikes that arrive."""
        net, plastic = net_of(view), plastic_of(view)
        row = net.projections[plastic.move_table[k, t.MOVE_PROJECTION]]
        first, lit = plastic.move_table[k, t.MOVE_SOURCE], plastic.move_lists[thread, LIT]
        n, at = plastic.move_count[thread, k, LIT], 0
        while at < n:
            source = lit[first + at]
            x_at, is_active = (first + source) * t.MOVE_TRACES, False
            for j in range(n_pre):
                x = plastic.move_x[thread, x_at + j] * plastic.move_left[k, j]
                plastic.move_x[thread, x_at + j] = x
                is_active |= abs(x) >= plastic.move_x_min[k]
            if is_active:
                at += 1
                continue
            for j in range(n_pre):
                plastic.move_x[thread, x_at + j] = 0.0
            plastic.move_is_lit[thread, first + source] = 0
            n -= 1
            # The order of the list has no effect, because synapses of different sources are independent.
            lit[first + at] = lit[first + n]
        plastic.move_count[thread, k, LIT] = n
        emitted = step - 1
        if emitted <= net.clock[thread, t.HORIZON]:
            return
        slot, mask = emitted & (net.log_ends.shape[1] - 1), net.log_ids.shape[1] - 1
        begin = net.pops[row[t.SOURCE], t.BEGIN]
        for sender in range(net.edges.shape[1] - 1):
            for place in range(
                net.log_ends[sender, slot, row[t.SOURCE]], net.log_ends[sender, slot, row[t.SOURCE] + 1]
            ):
                source = net.log_ids[sender, place & mask] - begin
                activate(plastic, k, thread, source)
                x_at = (first + source) * t.MOVE_TRACES
                for j in range(n_pre):
                    plastic.move_x[thread, x_at + j] += plastic.move_adds[k, j] * net.log_counts[sender, place & mask]

    @subkernel
    def gather_dense(view, k, thread, lo, hi, width):
        """Gather the eligibility of a dense projection from all lit sources onto all targets lo:hi of the thread."""
        net, plastic = net_of(view), plastic_of(view)
        c, y, lit = plastic.move_rule[k], plastic.move_y, plastic.move_lists[thread, LIT]
        first_source, to = plastic.move_table[k, t.MOVE_SOURCE], plastic.move_table[k, t.MOVE_SYNAPSE] + lo
        spikes, values, gate = plastic.move_spikes, plastic.move_seen, plastic.move_gate
        i_0, n = np.uint64(plastic.move_table[k, t.MOVE_TARGET] + lo), np.uint64(hi - lo)
        # These are read once a step: in the loop, the compiler would read them again after each store to `y`.
        for at in range(plastic.move_count[thread, k, LIT]):
            if net.stop[0] == t.AT_ONCE:
                return
            source = lit[first_source + at]
            pre = traces(plastic, thread, (first_source + source) * t.MOVE_TRACES)
            s_0 = np.uint64(to + source * width)
            for e in range(n):
                gather(y, s_0 + e, c, pre, spikes[i_0 + e], values[i_0 + e], gate[i_0 + e])

    @subkernel
    def gather_from(view, k, source, thread, n):
        """Gather the eligibility of the synapses from a lit source onto the n targets that the step concerns."""
        net, plastic = net_of(view), plastic_of(view)
        row, c = net.projections[plastic.move_table[k, t.MOVE_PROJECTION]], plastic.move_rule[k]
        to_target, to = plastic.move_table[k, t.MOVE_TARGET], plastic.move_table[k, t.MOVE_SYNAPSE]
        pre = traces(plastic, thread, (plastic.move_table[k, t.MOVE_SOURCE] + source) * t.MOVE_TRACES)
        first, end = synapse_range(net, row, source, thread)
        lo, _ = targets_of(net, net.pops[row[t.TARGET]], thread)
        y = plastic.move_y
        for at in range(n):
            target = plastic.move_concerned[to_target + lo + at]
            place = to_target + target
            spikes, value, gate = plastic.move_spikes[place], plastic.move_seen[place], plastic.move_gate[place]
            if row[t.LAYOUT] == t.DENSE:  # the index of the synapse follows from the target without a search
                gather(y, np.uint64(to + first + target - lo), c, pre, spikes, value, gate)
                continue
            for s in range(first_synapse_onto(net, row, source, first, end, target), end):
                if target_of(net, row, source, s) != target:
                    break
                gather(y, np.uint64(to + s), c, pre, spikes, value, gate)

    @subkernel
    def gather_all(view, k, step, thread):
        """Gather the eligibility of all synapses of a projection after a step of its target population."""
        net, plastic = net_of(view), plastic_of(view)
        row = net.projections[plastic.move_table[k, t.MOVE_PROJECTION]]
        target_row, state = net.pops[row[t.TARGET]], plastic.move_table[k, t.MOVE_SEEN]
        begin, to, number = target_row[t.BEGIN], plastic.move_table[k, t.MOVE_TARGET], target_row[t.NUMBER]
        update_traces(view, k, step, thread)
        if plastic.move_count[thread, k, LIT] == 0:
            return
        mask = net.log_ids.shape[1] - 1
        lo, hi = targets_of(net, target_row, thread)
        n = 0
        first, last = net.log_ends[thread, step & (net.log_ends.shape[1] - 1), number], net.log_at[thread, 0]
        for place in range(first, last):
            target = np.int64(net.log_ids[thread, place & mask]) - begin
            plastic.move_spikes[to + target] = net.log_counts[thread, place & mask]
            if state < 0:
                plastic.move_concerned[to + lo + n] = target
                n += 1
        if state >= 0:
            # The rule also reads the state of neurons that did not spike.
            for target in range(lo, hi):
                plastic.move_seen[to + target] = net.state[state, begin + target]
                if plastic.move_seen[to + target] != 0.0 or plastic.move_spikes[to + target] != 0.0:
                    plastic.move_concerned[to + lo + n] = target
                    n += 1
        if n == 0:
            return
        if row[t.LAYOUT] == t.DENSE and DENSE_FROM * n >= hi - lo:
            # `gather` does nothing for the other targets. With vector instructions four synapses take the time of one.
            gather_dense(view, k, thread, lo, hi, target_row[t.END] - begin)
            for target in range(lo, hi):
                plastic.move_spikes[to + target] = 0.0
            return
        for at in range(plastic.move_count[thread, k, LIT]):
            if net.stop[0] == t.AT_ONCE:
                return
            gather_from(view, k, plastic.move_lists[thread, LIT, plastic.move_table[k, t.MOVE_SOURCE] + at], thread, n)
        for at in range(n):
            plastic.move_spikes[to + plastic.move_concerned[to + lo + at]] = 0.0

    @inlined
    def prefetch_synapses(net, y, z, w, n):
        """Prefetch the states of n synapses from z on, and their weights from w on."""
        for state in range(1 + n_states):
            begin = address(y) + 8 * (state * y.shape[1] + z)
            prefetch_lines(begin, begin + 8 * n)
        begin = address(net.weights) + 8 * w
        prefetch_lines(begin, begin + 8 * n)

    @subkernel
    def teach_all(view, k):
        """Apply the signal to the synapses of all live sources; sources whose states are all 0 leave the list."""
        net, plastic = net_of(view), plastic_of(view)
        row, c, y = net.projections[plastic.move_table[k, t.MOVE_PROJECTION]], plastic.move_rule[k], plastic.move_y
        first_source, to = plastic.move_table[k, t.MOVE_SOURCE], plastic.move_table[k, t.MOVE_SYNAPSE]
        signals, signal, sign = plastic.move_table[k, t.MOVE_TARGET], plastic.move_signal, plastic.move_sign[k]
        target_row, is_lit = net.pops[row[t.TARGET]], plastic.move_is_lit
        weights, to_weight = net.weights, row[t.WEIGHT]
        width, is_dense = target_row[t.END] - target_row[t.BEGIN], row[t.LAYOUT] == t.DENSE
        for thread in range(plastic.move_lists.shape[0]):
            live, n_live, at = plastic.move_lists[thread, LIVE], plastic.move_count[thread, k, LIVE], 0
            lo, hi = targets_of(net, target_row, thread)
            while at < n_live:
                source, is_live = live[first_source + at], False
                if is_dense:
                    first, n = source * width + lo, np.uint64(hi - lo)
                    z, i_0 = np.uint64(to + first), np.uint64(signals + lo)
                    # Rows are taught in no order of memory, so the processor does not load the next one by itself.
                    next_synapse = live[first_source + min(at + 1, n_live - 1)] * width + lo
                    prefetch_synapses(net, y, to + next_synapse, to_weight + next_synapse, hi - lo)
                    for e in range(n):  # signals are contiguous, so the loop is vectorised
                        teach(y, z + e, c, signal[i_0 + e])
                else:
                    first, end = synapse_range(net, row, source, thread)
                    n, z = np.uint64(end - first), np.uint64(to + first)
                    for e in range(n):
                        target = target_of(net, row, source, first + np.int64(e))
                        teach(y, z + e, c, signal[np.uint64(signals + target)])
                w = np.uint64(to_weight + first)
                for e in range(n):
                    weights[w + e] = sign * y[0, z + e] + 0.0  # -0.0 would be no input
                for state in range(1, 1 + n_states):
                    for e in range(n):
                        is_live |= y[state, z + e] != 0.0
                if is_live or is_lit[thread, first_source + source] == 1:
                    at += 1
                    continue
                plastic.move_is_live[thread, first_source + source] = 0
                n_live -= 1
                live[first_source + at] = live[first_source + n_live]
            plastic.move_count[thread, k, LIVE] = n_live

    @kernel
    def run(view, k, operation, index, step, thread, h):
        if operation == GATHER:
            gather_all(view, k, step, thread)
        else:
            teach_all(view, k)
        return 0

    return Entry(run, RULE_TYPE, model)


@kernel
def gather_moves(view, thread, pop, step, h):
    """Gather the eligibility of all synapses onto a population that learn by moves, after a step of the population."""
    net, plastic = net_of(view), plastic_of(view)
    for k in range(plastic.move_table.shape[0]):
        if net.projections[plastic.move_table[k, t.MOVE_PROJECTION], t.TARGET] == pop:
            call_moves(view, k, GATHER, 0, step, thread, h)


@kernel
def teach_moves(view, k, values):
    """Apply a signal, one value per target, to a projection."""
    plastic = plastic_of(view)
    first = plastic.move_table[k, t.MOVE_TARGET]
    for target in range(values.shape[0]):  # a loop, because numba copies the values before it assigns a slice
        plastic.move_signal[first + target] = values[target]
    call_moves(view, k, TEACH, 0, 0, 0, 0.0)


@kernel
def clear_moves(view, k):
    """Set all states of the synapses of a projection to 0. Only the synapses of live sources have other states."""
    net, plastic = net_of(view), plastic_of(view)
    row, first = net.projections[plastic.move_table[k, t.MOVE_PROJECTION]], plastic.move_table[k, t.MOVE_SOURCE]
    to_synapse = plastic.move_table[k, t.MOVE_SYNAPSE]
    for thread in range(net.edges.shape[1] - 1):
        n, at = plastic.move_count[thread, k, LIVE], 0
        while at < n:
            source = plastic.move_lists[thread, LIVE, first + at]
            begin, end = synapse_range(net, row, source, thread)
            for state in range(1, plastic.move_y.shape[0]):
                plastic.move_y[state, to_synapse + begin : to_synapse + end] = 0.0
            if plastic.move_is_lit[thread, first + source] == 1:
                at += 1
                continue
            plastic.move_is_live[thread, first + source] = 0
            n -= 1
            plastic.move_lists[thread, LIVE, first + at] = plastic.move_lists[thread, LIVE, first + n]
        plastic.move_count[thread, k, LIVE] = n


@kernel
def mark_all_live(view, k):
    """Add all sources of a projection to the live list, after states were set."""
    net, plastic = net_of(view), plastic_of(view)
    row, first = net.projections[plastic.move_table[k, t.MOVE_PROJECTION]], plastic.move_table[k, t.MOVE_SOURCE]
    source_row = net.pops[row[t.SOURCE]]
    for thread in range(net.edges.shape[1] - 1):
        for source in range(source_row[t.END] - source_row[t.BEGIN]):
            plastic.move_lists[thread, LIVE, first + source] = source
            plastic.move_is_live[thread, first + source] = 1
        plastic.move_count[thread, k, LIVE] = source_row[t.END] - source_row[t.BEGIN]
