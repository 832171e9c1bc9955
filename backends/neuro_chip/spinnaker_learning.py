"""SpiNNaker's plastic synapses: histories of post neurons, and rows of synapses that packets of their sources update.

Learning is deferred: post spikes and dopamine are only appended to the history of the neuron. A packet then processes
the entries since the last packet, each d ticks after the entry's time, where d is the delay of the synapse.

Weights are words of 16 bits, and word << shift in s16.15 during an update. Traces and tables are s4.11. Every product
is rounded down, sums wrap, and only the bounds of a rule are clipped.

With dopamine the rule changes the eligibility c, and the weight changes by K c D (E - 1): K is the gain, D the level of
dopamine, and E the product of the decays of c and D over the elapsed time. The order of the products is
that of the released programs; their source code has another order. A mark tells whether an entry is
dopamine. The programs read for entry k the mark of entry k + n, where n is the number of entries that are too new for
the packet. The kernels reproduce this error.

Source: sPyNNaker 7.4.1 (released machine code).
"""

# mypy: ignore-errors
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from neuro.chips.spinnaker_rule import (
    ALPHA,
    DOWN,
    DOWN_TRIPLET,
    FEWEST,
    GAIN,
    HIGH,
    LOW,
    MINUS,
    MOST,
    OF_WEIGHT,
    ONE,
    PLUS,
    TAUGHT,
    TAUGHT_HIGH,
    TAUGHT_LOW,
    TIMING,
    TIMINGS,
    UP,
    UP_TRIPLET,
    WINDOWS,
    C,
    D,
    X,
    Y,
)
from neuro.kernels.jit import inlined, kernel, subkernel

NEAREST, TRIPLET, VOGELS, RECURRENT = (TIMINGS.index(name) for name in TIMINGS[1:])
ENTRIES = 16
"""Number of entries of a history: a placeholder at tick 0, and 15 events."""
FAST, SLOW, SPIKE, DOPAMINE, TRACES = range(5)
"""Columns of an entry: the fast trace o1 (or the window), the slow trace o2 without its last spike, the tick of that
last spike, and the level of dopamine."""
LAST, R1, R2, ROW_COLUMNS = range(4)
"""Columns of a row: the tick of its last packet, its trace (or window) and its slow trace."""
EVALUATED, CHANGED, UNDELIVERED, MISSED, WRAPPED, OVERFLOWN, SENT, CUT, COUNTS = range(9)
"""Counts: synapses that packets updated; changed words; synapses without delivery; updates for which the history has
dropped entries; wrapped words; wrapped traces; spikes that carry signals; signals clipped to the largest one."""
i64 = np.int64
_WORD = 65535
_MASK = np.uint64(0xFFFFFFFF)


class Rule(NamedTuple):
    """The arrays of a `SpinnakerRule`, and `draws`: the state of the core's random generator, uint64 (4,)."""

    constants: Any
    table: Any
    places: Any
    draws: Any


class History(NamedTuple):
    """Histories of the post neurons.

    Attributes:
        counts: number of entries of each neuron, the placeholder included.
        times: ticks of the entries, (neurons, ENTRIES).
        traces: (neurons, ENTRIES, TRACES).
        marks: bit k is set if entry k is a dopamine event.
        dropped: the tick of the last dropped entry, or -1.
    """

    counts: Any
    times: Any
    traces: Any
    marks: Any
    dropped: Any


class Synapses(NamedTuple):
    """The synapses of a projection.

    Attributes:
        weights: words of the weights.
        tags: words of the eligibility, or the accumulators.
        row_ends: source i has the synapses row_ends[i] : row_ends[i + 1].
        targets: post neuron of each synapse.
        delays: ticks by which entries act later, one per synapse.
        delivered: whether each synapse delivers spikes. A synapse whose delay is the number of slots does not.
        shifts: shift of the receptor of each synapse.
        stages: number of times that a delay core holds back the packets of each synapse, each time for as many ticks as
            there are slots.
        rows: number of rows of a source, one for each stage.
    """

    weights: Any
    tags: Any
    row_ends: Any
    targets: Any
    delays: Any
    delivered: Any
    shifts: Any
    stages: Any
    rows: Any


def history_of(neurons: int) -> History:
    """Return empty histories, each with its placeholder."""
    return History(
        np.ones(neurons, dtype=np.int64),
        np.zeros((neurons, ENTRIES), dtype=np.int64),
        np.zeros((neurons, ENTRIES, TRACES), dtype=np.int64),
        np.zeros(neurons, dtype=np.int64),
        np.full(neurons, -1, dtype=np.int64),
    )


SEED = np.array([123456789, 234567891, 345678912, 456789123], dtype=np.uint64)
"""Initial state of the random generator of every core."""


@inlined
def half(x):
    """Return the low 16 bits, signed."""
    return i64(np.int16(x))


@inlined
def word(x):
    """Return the low 32 bits, signed."""
    return i64(np.int32(x))


@inlined
def fine(a, b):
    """Return the product of two numbers in s4.11."""
    return (half(a) * half(b)) >> 11


@inlined
def product(a, b):
    """Return the product of two numbers in s16.15."""
    return word((a * b) >> 15)


@inlined
def scaled(a, s):
    """Return the product of a number in s16.15 and one in s4.11."""
    return product(a, s << 4)


@inlined
def decay(rule, k, ticks):
    """Return the factor, in s4.11, by which table k multiplies a value after some ticks."""
    indices = ticks >> rule.places[k, 2]
    return rule.table[rule.places[k, 0] + indices] if 0 <= indices < rule.places[k, 1] else i64(0)


@subkernel
def random(draws):
    """Return the next random number of the core, KISS-64."""
    draws[0] = (np.uint64(314527869) * draws[0] + np.uint64(1234567)) & _MASK
    y = draws[1]
    y ^= (y << np.uint64(5)) & _MASK
    y ^= y >> np.uint64(7)
    y ^= (y << np.uint64(22)) & _MASK
    draws[1] = y
    m = np.uint64(4294584393) * draws[2] + draws[3]
    draws[2], draws[3] = m & _MASK, m >> np.uint64(32)
    return i64((draws[0] + y + draws[2]) & _MASK)


@inlined
def window(rule, k):
    """Draw the length of a window from table k."""
    return rule.table[rule.places[k, 0] + random(rule.draws) % WINDOWS]


@subkernel
def append(rule, history, j, t, concentration, dopamine, counts):
    """Append a post spike, or dopamine of a signed concentration, to the history of neuron j."""
    timing = rule.constants[TIMING]
    n = history.counts[j]
    old = history.traces[j, n - 1]
    passed = t - history.times[j, n - 1]
    fast, slow, spike = fine(old[FAST], decay(rule, MINUS, passed)), old[SLOW], old[SPIKE]
    if timing == NEAREST:
        fast = 0
    elif timing == RECURRENT:
        fast = window(rule, MINUS)
    elif not dopamine:
        fast += ONE
    if timing == TRIPLET:
        if spike == 0:
            slow = fine(slow, decay(rule, Y, passed))
        else:
            slow = fine(slow + ONE, decay(rule, Y, t - spike))
        spike = t
    level = fine(old[DOPAMINE], decay(rule, D, passed)) + concentration if rule.constants[TAUGHT] else i64(0)
    if timing != RECURRENT:
        counts[OVERFLOWN] += fast != half(fast)
        fast = half(fast)
    counts[OVERFLOWN] += level != half(level)
    if n == ENTRIES:
        # The placeholder stays, so that every post neuron has a first entry.
        history.dropped[j] = history.times[j, 1]
        for k in range(1, ENTRIES - 1):
            history.times[j, k] = history.times[j, k + 1]
            for trace in range(TRACES):
                history.traces[j, k, trace] = history.traces[j, k + 1, trace]
        history.marks[j] >>= 1
        n -= 1
    history.times[j, n] = t
    new = history.traces[j, n]
    new[FAST], new[SLOW], new[SPIKE], new[DOPAMINE] = fast, half(slow), spike, half(level)
    history.marks[j] |= i64(dopamine) << n
    history.counts[j] = n + 1


@inlined
def potentiate(c, w, x, triplet):
    """Return the potentiated weight. Only the upper bound is checked, and not for a multiplicative rule."""
    if c[OF_WEIGHT]:
        return word(w + scaled(product(word(c[HIGH] - w), c[UP]), x))
    return min(word(w + scaled(c[UP], x) + scaled(c[UP_TRIPLET], triplet)), c[HIGH])


@inlined
def depress(c, w, x, triplet):
    """Return the depressed weight. Only the lower bound is checked."""
    if c[OF_WEIGHT]:
        return word(w - scaled(product(word(w - c[LOW]), c[DOWN]), x))
    return max(word(w - scaled(c[DOWN], x) - scaled(c[DOWN_TRIPLET], triplet)), c[LOW])


@inlined
def post_step(rule, w, tag, r1, history, j, k, gap, since):
    """Return w and the accumulator after post spike k.

    The spike acts `gap` ticks after the last packet, and `since` ticks after the entry before.
    """
    c, timing = rule.constants, rule.constants[TIMING]
    if timing == RECURRENT:
        if gap < r1:
            if tag < c[MOST]:
                tag += 1
            else:
                tag = i64(0)
                w = potentiate(c, w, i64(ONE), i64(0))
        return w, tag
    x = decay(rule, PLUS, gap)
    if timing == NEAREST:
        return potentiate(c, w, x if since >= gap else i64(0), i64(0)), tag
    x = fine(r1, x)
    return potentiate(c, w, x, fine(x, history.traces[j, k, SLOW]) if timing == TRIPLET else i64(0)), tag


@inlined
def pre_step(rule, w, tag, r2, history, j, k, since):
    """Return w and the accumulator after the packet, `since` ticks after the newest entry k."""
    c, timing = rule.constants, rule.constants[TIMING]
    if timing == RECURRENT:
        if since < history.traces[j, k, FAST]:
            if tag > c[FEWEST]:
                tag -= 1
            else:
                tag = i64(0)
                w = depress(c, w, i64(ONE), i64(0))
        return w, tag
    x = decay(rule, MINUS, since)
    if timing == NEAREST:
        return depress(c, w, x, i64(0)), tag
    x = fine(history.traces[j, k, FAST], x)
    if timing == VOGELS:  # a negative change is also a potentiation, so the lower bound is not checked
        return potentiate(c, w, x - c[ALPHA], i64(0)), tag
    return depress(c, w, x, fine(x, r2) if timing == TRIPLET else i64(0)), tag


@inlined
def elapse(rule, w, eligibility, level, ticks):
    """Return the weight and the eligibility after some ticks, from the level of dopamine at their beginning."""
    eligibility_decay = decay(rule, C, ticks)
    if level != 0:
        loss = half(fine(eligibility_decay, decay(rule, D, ticks)) - ONE)
        w = word(w + scaled(scaled(product(eligibility, rule.constants[GAIN]), level), loss))
    return w, scaled(eligibility, eligibility_decay)


@subkernel
def visit(rule, history, synapses, e, t, p, r1, r2, counts):
    """Update synapse e for a packet at tick t.

    `p` and `r1` are the tick and the trace of the row's last packet. `r2` is the slow trace at the present packet.
    """
    c, j, d, shift = rule.constants, synapses.targets[e], synapses.delays[e], synapses.shifts[e]
    taught = c[TAUGHT] != 0
    first, last = max(p - d, 0), max(t - d, 0)
    n = history.counts[j]
    index = n - 1
    while index > 0 and history.times[j, index] > first:
        index -= 1
    newest = index
    while newest + 1 < n and history.times[j, newest + 1] <= last:
        newest += 1
    w = i64(synapses.weights[e]) << shift
    tag = i64(synapses.tags[e]) << (shift if taught else 0)
    position, level = p, i64(0)
    if taught and index > 0:
        # The delay is ignored here, as in the programs, although entries act later by the delay everywhere else.
        level = fine(history.traces[j, index, DOPAMINE], decay(rule, D, p - history.times[j, index]))
    marks = history.marks[j] >> (n - (newest - index))
    for k in range(index + 1, newest + 1):
        u = history.times[j, k] + d
        if taught:
            w, tag = elapse(rule, w, tag, level, u - position)
            position, level = u, history.traces[j, k, DOPAMINE]
        if marks & 1 == 0:
            gap, elapsed = u - p, u - history.times[j, k - 1]
            if taught:  # the rule changes the eligibility in place of the weight
                tag, _ = post_step(rule, tag, tag, r1, history, j, k, gap, elapsed)
            else:
                w, tag = post_step(rule, w, tag, r1, history, j, k, gap, elapsed)
        marks >>= 1
    if newest > 0:
        elapsed = t - (history.times[j, newest] + d)
        if taught:
            w, tag = elapse(rule, w, tag, level, t - position)
            tag, _ = pre_step(rule, tag, tag, r2, history, j, newest, elapsed)
        else:
            w, tag = pre_step(rule, w, tag, r2, history, j, newest, elapsed)
    if taught:
        w = min(max(w, c[TAUGHT_LOW]), c[TAUGHT_HIGH])
        tag >>= shift
        counts[WRAPPED] += tag < 0 or tag > _WORD
        tag &= _WORD
    w >>= shift
    counts[WRAPPED] += w < 0 or w > _WORD
    w &= _WORD
    counts[EVALUATED] += 1
    counts[CHANGED] += w != synapses.weights[e]
    counts[MISSED] += history.dropped[j] > first
    counts[UNDELIVERED] += not synapses.delivered[e]
    synapses.weights[e] = w
    synapses.tags[e] = tag


@kernel
def packets(rule, rows, history, synapses, ids, t, counts):
    """Update the rows of some sources whose packets were emitted at tick t.

    Args:
        rule: see `Rule`.
        rows: (rows, ROW_COLUMNS), by source and stage; changed.
        history: histories of the post neurons.
        synapses: the synapses; weights and tags are changed.
        ids: the rows, in their order.
        t: the tick.
        counts: the counts above; increased.
    """
    for i in ids:
        p, r1, r2 = rows[i, LAST], rows[i, R1], rows[i, R2]
        new = i64(0)
        if rule.constants[TIMING] == RECURRENT:
            new = window(rule, PLUS)
        elif rule.constants[TIMING] != NEAREST:
            new = fine(r1, decay(rule, PLUS, t - p)) + ONE
            counts[OVERFLOWN] += new != half(new)
            new = half(new)
        if rule.constants[TIMING] == TRIPLET:
            r2 = half(fine(r2 + ONE, decay(rule, X, t - p))) if p != 0 else i64(0)
        rows[i, LAST], rows[i, R1], rows[i, R2] = t, new, r2
        source, stage = i // synapses.rows, i % synapses.rows
        for e in range(synapses.row_ends[source], synapses.row_ends[source + 1]):
            if synapses.stages[e] == stage:
                visit(rule, history, synapses, e, t, p, r1, r2, counts)


@kernel
def events(rule, history, ids, concentrations, t, counts):
    """Append events of tick t to the histories of some neurons, in their order.

    Args:
        rule: see `Rule`.
        history: changed.
        ids: the neurons.
        concentrations: signed concentrations of dopamine in s4.11, one per neuron; empty for post spikes.
        t: the tick.
        counts: the counts above; increased.
    """
    for n in range(ids.size):
        if concentrations.size:
            append(rule, history, ids[n], t, concentrations[n], True, counts)
        else:
            append(rule, history, ids[n], t, i64(0), False, counts)
