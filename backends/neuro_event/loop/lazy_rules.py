"""Pairwise rules outside the loop: one pass over synapses, compiled for each by itself and called by its address.

What `lazy_stdp` does for `stdp` and `stdp_dopa`, for any list of traces. The history of the target, in which
`post_spike` keeps the values of the traces just before each spike, is all that a synapse needs to catch up.
"""

# mypy: ignore-errors
import math
from collections import namedtuple
from functools import cache

import numpy as np

from neuro.core.keyed_random import NTH_STRIDE
from neuro.kernels.address import Entry
from neuro.kernels.draws import step_word, uniform
from neuro.kernels.instructions import address, prefetch
from neuro.kernels.jit import compiled, inlined, kernel, subkernel
from neuro.model.synapses.base import DELAY as DELAY_ROW, steps_of
from neuro_event.loop import tables as t
from neuro_event.loop.tables import RULE_TYPE, net_of, plastic_of, slot_mask

ENTRIES, APPLIED, NEWEST = range(3)
ENTRY = 3
"""A history is a row: how many entries it has, the step up to which synapses without dopamine have used it, then
entries (step, K- just after, multiplicity), the newest first. All are integers but K-, which lies in the same memory
as a float."""

BRING, BRING_WHOLE, ARRIVE, PRE_SPIKE = range(4)
"""Operations of an entry: the first two of lazy passes, the third of eager ones; the last and those after it: the first
spike of a neuron in a step, the second, ..."""

AHEAD = 16
"""Synapses by which a history, and the target's place in the ring, is asked for before it is read."""

OWN = 3
"""Row of `decay` where a rule's traces begin: as in `kinds`, first those of pre, from the middle on those of post."""

TAU, NEAREST, ADDS = range(3)
"""Columns of `kinds`."""
TIME, OF_NEURON = -1.0, -2.0
"""In place of a time constant: the trace is a time; it decays with the neuron's tau_minus."""

Synapse = namedtuple("Synapse", "q z own target history delay")
"""A synapse in the tables of learning: number of the projection, column of its states, place of its source's traces.

`target` is the number of its target in the population, `history` in `past`; `delay` is in steps.
"""


@subkernel
def due_everywhere(net, target_row, at, thread):
    """Wake the blocks of this thread's neurons of a population when input arrives in a step."""
    blocks = net.awake.shape[0]
    mark = (at & slot_mask(net)) * blocks
    lo, hi = net.edges[target_row[t.NUMBER], thread], net.edges[target_row[t.NUMBER], thread + 1]
    net.due[thread, mark + lo : mark + hi] = 1


@subkernel
def slot_of_first(net, row, receptors, step):
    """Where the slot lies in which a spike arrives over the first synapse: over all, if they have one delay."""
    if net.delays.size <= row[t.DELAY]:  # there is no synapse
        return np.int64(0)
    # Only an address to ask memory for: with delays of their own most synapses use another slot, and a wrong guess
    # costs nothing but the request.
    at = step + np.int64(net.delays[row[t.DELAY]])
    return address(net.buf) + 8 * (row[t.RING] + (at & row[t.RING_MASK]) * receptors * row[t.RING_SIZE])


@inlined
def shared_row(q, table, z):
    """Where the constants of a rule are that all synapses share."""
    return q


@inlined
def own_row(q, table, z):
    """Where those of a synapse are, of its own or shared."""
    return table[t.CONSTANTS] + table[t.CONSTANTS_STRIDE] * z


@subkernel
def grown(kind, value, m):
    """A trace just after m spikes (0: none), from its value just before them."""
    if m == 0:
        return value
    return kind[ADDS] if kind[NEAREST] == 1.0 else value + kind[ADDS] * m


@inlined
def pre_value(p, q, j, kind, thread, own, step, h):
    """A pre trace at a step. A time trace holds the step of the last spike and 1, or 0 where there was none."""
    value = p.k_plus[thread, own + j]
    if kind[TAU] == TIME:
        return math.inf if value == 0.0 else (step - (value - 1.0)) * h
    # Saves the exponential of a source that has not fired.
    if value == 0.0:
        return 0.0
    return value * left(p.decay[q, OWN + j], step - p.k_time[thread, own], h, p.kinds[q, j, TAU])


@inlined
def newest_before(past, before):
    """The newest entry of a history strictly before a step; the number of its entries if there is none."""
    i = 0
    # Newest first: nearly always the first or the second entry is the one.
    while i < past[ENTRIES] and past[NEWEST + ENTRY * i] >= before:
        i += 1
    return i


@inlined
def post_value(view, q, j, kind, column, history, i, neuron, before, h):
    """A post trace at a step, from the i-th entry of a history and those before it, if there is such an entry."""
    p = plastic_of(view)
    past = p.past[history]
    if i == past[ENTRIES]:
        return math.inf if kind[TAU] == TIME else 0.0
    row, value = p.kinds.shape[1] // 2 + j, p.others[history, i, column + j]
    passed = before - past[NEWEST + ENTRY * i]
    if kind[TAU] == TIME:
        return passed * h
    tau = net_of(view).tau_minus[neuron] if kind[TAU] == OF_NEURON else p.kinds[q, row, TAU]
    m = past[NEWEST + ENTRY * i + 2]
    return grown(kind, value, m) * left(p.decay[q, OWN + row], passed, h, tau)


@inlined
def kept_value(p, j, kind, column, history, k, m):
    """A post trace just before the k-th entry of a history, and after the first m of its spikes."""
    if m > 0 and kind[TAU] == TIME:
        return 0.0
    return grown(kind, p.others[history, k, column + j], m)


def tuple_of(function, traces, arguments):
    """A compiled function that gives the values of traces as a tuple; what is known of each stands in it as numbers."""
    name = function.py_func.__name__
    # Written out as text: a kernel makes no lists, and with the kinds of traces as literals the branches on them are
    # gone.
    calls = "".join(f"{name}({arguments.format(j=j, kind=_kind(each))}), " for j, each in enumerate(traces))
    space = {name: function}
    exec(f"def values({arguments.replace('{j}, {kind}, ', '')}):\n    return ({calls})", space)
    return inlined(space["values"])


def _kind(trace):
    """What is known of a trace without parameters, as in `kinds`; 0 for a time constant that is one."""
    tau = TIME if not trace.tau else OF_NEURON if trace.tau == "tau_minus" else 0.0
    return tau, float(trace.nearest), float(trace.adds)


def drawing(model):
    """What a rule does at a pre spike, with a random number if it draws one."""
    on_pre = compiled(model.arithmetic.on_pre)
    if model.draws:

        @subkernel
        def learn_pre(p, q, z, c, step, nth, pre, post):
            on_pre(p.y, z, c, pre, post, uniform(step_word(p.draw_keys[q], step + nth * NTH_STRIDE), p.drawn_as[z]))

    else:

        @subkernel
        def learn_pre(p, q, z, c, step, nth, pre, post):
            on_pre(p.y, z, c, pre, post)

    return learn_pre


@cache
def rule_entry(model, own_rows):
    """The passes of one rule, whose synapses share a row of constants or have their own."""
    # Compiled for either: a look at a stride for each synapse took 4 % of a network that learns.
    row_of = own_row if own_rows else shared_row
    arithmetic, modulated = model.arithmetic, model.modulated
    learn_pre, on_post = drawing(model), compiled(arithmetic.on_post)
    nearest = compiled(steps_of)
    advance, sent = compiled(arithmetic.advance) if modulated else None, compiled(model.sends())
    n_pre = len(model.pre)
    pre_values = tuple_of(pre_value, model.pre, "p, q, {j}, {kind}, thread, own, step, h")
    post_values = tuple_of(post_value, model.post, "view, q, {j}, {kind}, column, history, i, neuron, before, h")
    kept_values = tuple_of(kept_value, model.post, "p, {j}, {kind}, column, history, k, m")

    if modulated:

        @subkernel
        def learnt_until(p, z, thread, own, past):
            return p.reached[z]

        @subkernel
        def pass_time(view, q, z, target, since, upto, h):
            p = plastic_of(view)
            place = p.table[q, t.FIRST_TARGET] + target
            # Dopamine is kept as of its last change; `release` and `write_signal` catch all synapses up before they
            # change it, so between the two times of this pass it only decays.
            n = p.n[place] * math.exp(-(since - p.n_time[place]) * h / p.tau[q, 1]) if p.n[place] != 0.0 else 0.0
            advance(p.y, z, p.rule[q], since, upto, n, p.table[q, t.GRID_STEPS])
            p.reached[z] = upto

    else:

        @subkernel
        def learnt_until(p, z, thread, own, past):
            return max(p.k_time[thread, own], past[APPLIED])

        @subkernel
        def pass_time(view, q, z, target, since, upto, h):
            pass

    if model.delays:

        @subkernel
        # A delay that learns is that of the pre spike alone: post spikes act on the synapse at once.
        def heard_after(net, row, s):
            return 0

        @subkernel
        def taken(p, q, z, delay, h):
            return nearest(p.y[DELAY_ROW, z], h, p.table[q, t.FEWEST], p.table[q, t.MOST])

    else:

        @subkernel
        def heard_after(net, row, s):
            return np.int64(net.delays[row[t.DELAY] + s * row[t.DELAY_STRIDE]])

        @subkernel
        def taken(p, q, z, delay, h):
            return delay

    @inlined
    def flow(view, synapse, thread, upto, whole, h):
        """Let the post spikes up to step `upto` act on a synapse; with `whole` also what flows after the last."""
        net, p = net_of(view), plastic_of(view)
        q, z, own, target, history, delay = synapse
        # Lazily, a neuron's spikes go into a short history of its own, and a synapse reads it at its next pre spike:
        # 10,000 synapses onto a neuron cost nothing while their sources are silent.
        past, column = p.past[history], p.table[q, t.COLUMN]
        since = learnt_until(p, z, thread, own, past)
        i = 0
        # Newest first: the search ends at the first entry that has acted.
        while i < past[ENTRIES] and past[NEWEST + ENTRY * i] + delay > since:
            i += 1
        for k in range(i - 1, -1, -1):
            time = past[NEWEST + ENTRY * k]
            # Entries beyond the present stay for the next pre spike.
            if time + delay > upto:
                break
            pass_time(view, q, z, target, since, time + delay, h)
            since = time + delay
            pre = pre_values(p, q, thread, own, since, h)
            for m in range(past[NEWEST + ENTRY * k + 2]):
                if net.stop[0] == t.AT_ONCE:
                    return
                on_post(p.y, z, p.rule[row_of(q, p.table[q], z)], pre, kept_values(p, column, history, k, m))
        if whole and since < upto:
            pass_time(view, q, z, target, since, upto, h)

    @subkernel
    def pre_spike(view, q, source, step, nth, thread, h):
        net, p = net_of(view), plastic_of(view)
        table, column = p.table[q], p.table[q, t.COLUMN]
        row = net.projections[table[t.PROJECTION]]
        target_row = net.pops[row[t.TARGET]]
        receptors, relay = target_row[t.RECEPTORS], target_row[t.RELAY]
        blocks = net.awake.shape[0]
        slots, due = slot_mask(net), net.due[thread]
        own = table[t.FIRST_SOURCE] + source * table[t.SOURCE_STRIDE]
        pre = pre_values(p, q, thread, own, step, h)
        place = row[t.ROW] + source * (net.edges.shape[1] - 1) + thread
        end = net.rows[place + 1]
        # A row that reaches nearly all blocks marks them in one pass; with delays of their own they arrive in many
        # steps.
        wide = row[t.WAKE_ALL] == 1 and row[t.DELAY_STRIDE] == 0
        past_width, others_width = 8 * p.past.shape[1], 8 * p.others.shape[1] * p.others.shape[2]
        slot = slot_of_first(net, row, receptors, step)
        pasts, others = address(p.past), address(p.others)
        for e in range(net.rows[place], end):
            ahead = np.int64(net.targets[min(e + AHEAD, end - 1)])
            prefetch(slot + 8 * ahead)
            prefetch(pasts + past_width * (target_row[t.HISTORY] + ahead))
            prefetch(others + others_width * (target_row[t.HISTORY] + ahead))
            s = e - row[t.SYNAPSE]
            z = table[t.FIRST_SYNAPSE] + s
            target = np.int64(net.targets[e])
            delay = heard_after(net, row, s)
            history = target_row[t.HISTORY] + target
            # Post before pre within a step: what arrives now acts first, and is not in the traces that are read below.
            flow(view, Synapse(q, z, own, target, history, delay), thread, step, True, h)
            neuron = target_row[t.BEGIN] + target
            newest = newest_before(p.past[history], step - delay)
            post = post_values(view, q, column, history, newest, neuron, step - delay, h)
            c = p.rule[row_of(q, p.table[q], z)]
            learn_pre(p, q, z, c, step, nth, pre, post)
            weight = sent(p.y, z, c) + 0.0  # -0.0 would be no input
            second = 1 if receptors == 2 and weight < 0.0 else 0
            at = step + taken(p, q, z, delay, h)
            ring = row[t.RING] + ((at & row[t.RING_MASK]) * receptors + second) * row[t.RING_SIZE]
            net.buf[ring + target] += 1.0 if relay == 1 else weight
            if not wide:
                due[(at & slots) * blocks + target_row[t.FIRST_BLOCK] + (target >> t.BLOCK_SHIFT)] = 1
        if wide and net.rows[place] < end:
            # With one delay all arrive in one step: one pass of marks in place of one a synapse.
            due_everywhere(net, target_row, step + np.int64(net.delays[row[t.DELAY]]), thread)
        # After all synapses: a pre spike does not count in the trace that it reads itself.
        for j in range(n_pre):
            kind = p.kinds[q, j]
            if kind[TAU] == TIME:
                p.k_plus[thread, own + j] = step + 1.0
            else:
                p.k_plus[thread, own + j] = grown(kind, pre_value(p, q, j, kind, thread, own, step, h), 1)
        p.k_time[thread, own] = step
        p.spiked[thread, own] = step

    @subkernel
    def bring(view, q, target, step, thread, whole, h):
        net, p = net_of(view), plastic_of(view)
        table = p.table[q]
        row = net.projections[table[t.PROJECTION]]
        history = net.pops[row[t.TARGET], t.HISTORY] + target
        begin = table[t.INCOMING] + target
        for i in range(p.incoming[begin], p.incoming[begin + 1]):
            z = table[t.FIRST_SYNAPSE] + np.int64(p.in_synapse[i])
            own = table[t.FIRST_SOURCE] + np.int64(p.in_source[i]) * table[t.SOURCE_STRIDE]
            if not modulated and p.past[history, APPLIED] <= p.spiked[thread, own]:
                # The weight that a read shows is that of the last pre spike, as NEST's; what post spikes change is sent
                # later.
                p.sent[z] = p.y[0, z]  # see `lazy_stdp`
            delay = heard_after(net, row, z - table[t.FIRST_SYNAPSE])
            flow(view, Synapse(q, z, own, target, history, delay), thread, step, whole, h)

    @kernel
    def run(view, q, operation, index, step, thread, h):
        if operation >= PRE_SPIKE:
            pre_spike(view, q, index, step, operation - PRE_SPIKE, thread, h)
        else:
            bring(view, q, index, step, thread, operation == BRING_WHOLE, h)
        return 0

    return Entry(run, RULE_TYPE, model)


DECAYS = 2048
"""Steps for which decays are kept in tables."""


@inlined
def decayed(table, steps, h, tau, k):
    """What is left after some steps of a trace that decays with tau[k]; `table` holds it for the first steps."""
    # A table in place of exp; where it does not begin with 1, time constants differ and there is none.
    if steps < DECAYS and table[0] == 1.0:
        return table[steps]
    return math.exp(-steps * h / tau[k])


@inlined
def left(table, steps, h, tau):
    """Likewise of one time constant; where it is 0, nothing is ever left."""
    if steps < DECAYS and table[0] == 1.0:
        return table[steps]
    return math.exp(-steps * h / tau) if tau > 0.0 else 0.0
