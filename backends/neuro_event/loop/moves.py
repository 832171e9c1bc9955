"""Learning by moves: eligibility is gathered after each step of the target, and a signal teaches all that has some.

A projection that learns so is delivered like a static one. What is kept beside is sparse: a list of the sources whose
traces are not 0 (*lit*), over which a post spike gathers, and one of those whose synapses may have a state that is not
0 (*live*), which a signal teaches. So a step costs with what is active, and a move with what was since the states were
last 0: of an agent's 61,000 synapses a few thousand.
"""

# mypy: ignore-errors
from functools import cache

import numpy as np

from neuro.kernels.address import Entry
from neuro.kernels.jit import compiled, inlined, kernel, subkernel
from neuro_event.loop import tables as t
from neuro_event.loop.lazy_rules import tuple_of
from neuro_event.loop.tables import RULE_TYPE, call_moves, net_of, plastic_of

GATHER, TEACH = range(2)
"""Operations of an entry."""

DENSE_FROM = 8
"""Where one of so many targets or more is concerned, all are."""

LIT, LIVE = range(2)
"""Columns of `move_count` of a projection."""


@inlined
def trace_of(p, j, kind, thread, own):
    """A pre trace of a source in the present step."""
    return p.move_x[thread, own + j]


@inlined
def targets_of(net, target_row, thread):
    """The targets of a thread: the first, and the end."""
    lo = net.edges[target_row[t.NUMBER], thread] * t.BLOCK - target_row[t.BEGIN]
    return lo, min(net.edges[target_row[t.NUMBER], thread + 1] * t.BLOCK, target_row[t.END]) - target_row[t.BEGIN]


@inlined
def row_of(net, row, source, thread):
    """A source's synapses onto the targets of a thread, counted within the projection: the first, and the end."""
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
    """The target of the synapse s of a projection."""
    if row[t.LAYOUT] == t.DENSE:
        target_row = net.pops[row[t.TARGET]]
        return s - source * (target_row[t.END] - target_row[t.BEGIN])
    return s if row[t.LAYOUT] == t.ONE_TO_ONE else np.int64(net.targets[row[t.SYNAPSE] + s])


@subkernel
def place_of(net, row, source, first, end, target):
    """The first synapse of a row, first:end, onto a target or one behind it; targets of a row ascend."""
    while first < end:
        middle = (first + end) // 2
        if target_of(net, row, source, middle) < target:
            first = middle + 1
        else:
            end = middle
    return first


@subkernel
def light(p, k, thread, source):
    """Put a source on the lists; its traces are 0."""
    place = p.move_table[k, t.MOVE_SOURCE] + source
    if p.move_is_lit[thread, place] == 0:
        p.move_is_lit[thread, place] = 1
        p.move_lists[thread, LIT, p.move_table[k, t.MOVE_SOURCE] + p.move_count[thread, k, LIT]] = source
        p.move_count[thread, k, LIT] += 1
    if p.move_is_live[thread, place] == 0:
        p.move_is_live[thread, place] = 1
        p.move_lists[thread, LIVE, p.move_table[k, t.MOVE_SOURCE] + p.move_count[thread, k, LIVE]] = source
        p.move_count[thread, k, LIVE] += 1


@cache
def move_entry(model):
    """The passes of one rule."""
    gather, teach = compiled(model.arithmetic.gather), compiled(model.arithmetic.teach)
    traces = tuple_of(trace_of, model.pre, "p, {j}, {kind}, thread, own")
    n_pre, n_states = len(model.pre), len(model.states)

    @subkernel
    def hear(view, k, step, thread):
        """Let the traces decay for a step, and grow by the spikes that arrive in it."""
        net, p = net_of(view), plastic_of(view)
        row = net.projections[p.move_table[k, t.MOVE_PROJECTION]]
        first, lit = p.move_table[k, t.MOVE_SOURCE], p.move_lists[thread, LIT]
        n, at = p.move_count[thread, k, LIT], 0
        while at < n:
            source = lit[first + at]
            own, loud = (first + source) * t.MOVE_TRACES, False
            for j in range(n_pre):
                x = p.move_x[thread, own + j] * p.move_left[k, j]
                p.move_x[thread, own + j] = x
                loud |= abs(x) >= p.move_x_min[k]
            if loud:
                at += 1
                continue
            for j in range(n_pre):
                p.move_x[thread, own + j] = 0.0
            p.move_is_lit[thread, first + source] = 0
            n -= 1
            # The order of the list does not matter: a source's synapses are its own.
            lit[first + at] = lit[first + n]
        p.move_count[thread, k, LIT] = n
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
                light(p, k, thread, source)
                own = (first + source) * t.MOVE_TRACES
                for j in range(n_pre):
                    p.move_x[thread, own + j] += p.move_adds[k, j] * net.log_counts[sender, place & mask]

    @subkernel
    def gather_from(view, k, source, thread, n):
        """Let a step of the n concerned targets add to the eligibility of their synapses from a lit source."""
        net, p = net_of(view), plastic_of(view)
        row, c = net.projections[p.move_table[k, t.MOVE_PROJECTION]], p.move_rule[k]
        to_target, to = p.move_table[k, t.MOVE_TARGET], p.move_table[k, t.MOVE_SYNAPSE]
        pre = traces(p, thread, (p.move_table[k, t.MOVE_SOURCE] + source) * t.MOVE_TRACES)
        first, end = row_of(net, row, source, thread)
        lo, hi = targets_of(net, net.pops[row[t.TARGET]], thread)
        y = p.move_y
        if row[t.LAYOUT] == t.DENSE and DENSE_FROM * n >= hi - lo:
            # Neighbours of those concerned come along, for whom `gather` does nothing: four at a time are as fast as
            # one alone.
            s_0, i_0 = np.uint64(to + first), np.uint64(to_target + lo)
            for e in range(np.uint64(hi - lo)):
                gather(y, s_0 + e, c, pre, p.move_spikes[i_0 + e], p.move_seen[i_0 + e], p.move_gate[i_0 + e])
            return
        for at in range(n):
            target = p.move_concerned[to_target + lo + at]
            place = to_target + target
            spikes, seen, gate = p.move_spikes[place], p.move_seen[place], p.move_gate[place]
            if row[t.LAYOUT] == t.DENSE:  # all there are nearly always: no search
                gather(y, np.uint64(to + first + target - lo), c, pre, spikes, seen, gate)
                continue
            for s in range(place_of(net, row, source, first, end, target), end):
                if target_of(net, row, source, s) != target:
                    break
                gather(y, np.uint64(to + s), c, pre, spikes, seen, gate)

    @subkernel
    def gather_all(view, k, step, thread):
        """What a step of the target adds to the eligibility."""
        net, p = net_of(view), plastic_of(view)
        row = net.projections[p.move_table[k, t.MOVE_PROJECTION]]
        target_row, state = net.pops[row[t.TARGET]], p.move_table[k, t.MOVE_SEEN]
        begin, to, number = target_row[t.BEGIN], p.move_table[k, t.MOVE_TARGET], target_row[t.NUMBER]
        hear(view, k, step, thread)
        if p.move_count[thread, k, LIT] == 0:
            return
        mask = net.log_ids.shape[1] - 1
        lo, n = net.edges[number, thread] * t.BLOCK - begin, 0
        first, last = net.log_ends[thread, step & (net.log_ends.shape[1] - 1), number], net.log_at[thread, 0]
        for place in range(first, last):
            target = np.int64(net.log_ids[thread, place & mask]) - begin
            p.move_spikes[to + target] = net.log_counts[thread, place & mask]
            if state < 0:
                p.move_concerned[to + lo + n] = target
                n += 1
        if state >= 0:
            # Neurons that did not spike are seen, too.
            for target in range(lo, min(net.edges[number, thread + 1] * t.BLOCK, target_row[t.END]) - begin):
                p.move_seen[to + target] = net.state[state, begin + target]
                if p.move_seen[to + target] != 0.0 or p.move_spikes[to + target] != 0.0:
                    p.move_concerned[to + lo + n] = target
                    n += 1
        if n == 0:
            return
        for at in range(p.move_count[thread, k, LIT]):
            if net.stop[0] == t.AT_ONCE:
                return
            gather_from(view, k, p.move_lists[thread, LIT, p.move_table[k, t.MOVE_SOURCE] + at], thread, n)
        for at in range(n):
            p.move_spikes[to + p.move_concerned[to + lo + at]] = 0.0

    @subkernel
    def teach_row(view, k, source, thread):
        """Let the signal act on the synapses of a source; return whether any keeps a state that is not 0."""
        net, p = net_of(view), plastic_of(view)
        row, c = net.projections[p.move_table[k, t.MOVE_PROJECTION]], p.move_rule[k]
        first, end = row_of(net, row, source, thread)
        n, y, sign, some = np.uint64(end - first), p.move_y, p.move_sign[k], False
        z, w = np.uint64(p.move_table[k, t.MOVE_SYNAPSE] + first), np.uint64(row[t.WEIGHT] + first)
        signals = np.uint64(p.move_table[k, t.MOVE_TARGET])
        if n == 0:
            return False
        if row[t.LAYOUT] == t.DENSE:
            # Signals lie side by side, and the loop takes several at once.
            signals += np.uint64(target_of(net, row, source, first))
            for e in range(n):
                teach(y, z + e, c, p.move_signal[signals + e])
        else:
            for e in range(n):
                target = target_of(net, row, source, first + np.int64(e))
                teach(y, z + e, c, p.move_signal[signals + np.uint64(target)])
        for e in range(n):
            net.weights[w + e] = sign * y[0, z + e] + 0.0  # -0.0 would be no input
        for state in range(1, 1 + n_states):
            for e in range(n):
                some |= y[state, z + e] != 0.0
        return some

    @subkernel
    def teach_all(view, k):
        p = plastic_of(view)
        first = p.move_table[k, t.MOVE_SOURCE]
        for thread in range(p.move_lists.shape[0]):
            live, n, at = p.move_lists[thread, LIVE], p.move_count[thread, k, LIVE], 0
            while at < n:
                source = live[first + at]
                if teach_row(view, k, source, thread) or p.move_is_lit[thread, first + source] == 1:
                    at += 1
                    continue
                p.move_is_live[thread, first + source] = 0
                n -= 1
                live[first + at] = live[first + n]
            p.move_count[thread, k, LIVE] = n

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
    """After a step of a population: what the synapses onto it that learn by moves gather."""
    net, p = net_of(view), plastic_of(view)
    for k in range(p.move_table.shape[0]):
        if net.projections[p.move_table[k, t.MOVE_PROJECTION], t.TARGET] == pop:
            call_moves(view, k, GATHER, 0, step, thread, h)


@kernel
def teach_moves(view, k, values):
    """Let a signal act on a projection, one value for each target."""
    p = plastic_of(view)
    first = p.move_table[k, t.MOVE_TARGET]
    for target in range(values.shape[0]):  # numba would copy the values before it assigns a slice
        p.move_signal[first + target] = values[target]
    call_moves(view, k, TEACH, 0, 0, 0, 0.0)


@kernel
def clear_moves(view, k):
    """Let all states of a projection be 0: only live rows have others."""
    net, p = net_of(view), plastic_of(view)
    row, first = net.projections[p.move_table[k, t.MOVE_PROJECTION]], p.move_table[k, t.MOVE_SOURCE]
    to = p.move_table[k, t.MOVE_SYNAPSE]
    for thread in range(net.edges.shape[1] - 1):
        n, at = p.move_count[thread, k, LIVE], 0
        while at < n:
            source = p.move_lists[thread, LIVE, first + at]
            begin, end = row_of(net, row, source, thread)
            for state in range(1, p.move_y.shape[0]):
                p.move_y[state, to + begin : to + end] = 0.0
            if p.move_is_lit[thread, first + source] == 1:
                at += 1
                continue
            p.move_is_live[thread, first + source] = 0
            n -= 1
            p.move_lists[thread, LIVE, first + at] = p.move_lists[thread, LIVE, first + n]
        p.move_count[thread, k, LIVE] = n


@kernel
def enliven(view, k):
    """Put all sources of a projection on the list of those that a signal teaches, after states were set."""
    net, p = net_of(view), plastic_of(view)
    row, first = net.projections[p.move_table[k, t.MOVE_PROJECTION]], p.move_table[k, t.MOVE_SOURCE]
    source_row = net.pops[row[t.SOURCE]]
    for thread in range(net.edges.shape[1] - 1):
        for source in range(source_row[t.END] - source_row[t.BEGIN]):
            p.move_lists[thread, LIVE, first + source] = source
            p.move_is_live[thread, first + source] = 1
        p.move_count[thread, k, LIVE] = source_row[t.END] - source_row[t.BEGIN]
