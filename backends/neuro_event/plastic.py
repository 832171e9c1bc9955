"""Pairwise learning: lazy, one synapse at a time, at the events that concern it.

Post spikes are kept in a short history per neuron (`times`, and K- just after each). When it is full, the
synapses onto that neuron are caught up to what has been processed, and what nobody needs any more is dropped.
"""

# mypy: ignore-errors
import math
from collections import namedtuple

import numpy as np

from neuro_event.dispatch import advance, on_post, on_pre
from neuro_event.jit import inner
from neuro_event.tables import (
    BEGIN,
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
    INCOMING,
    LONGEST,
    MODULATED,
    PROJECTION,
    RECEPTORS,
    RING,
    RING_MASK,
    RING_SIZE,
    ROW,
    RULE,
    SOURCE,
    SYNAPSE,
    TARGET,
)

Plastic = namedtuple(
    "Plastic",
    "table rule tau y sent reached k_plus k_time n n_time incoming in_synapse in_source times traces head tail",
)
"""Arrays of the plastic projections.

table: (projections, columns); rule: constants of each rule; tau: tau_plus and tau_n of each.
y: (states, synapses); sent: weight at the last pre spike; reached: step up to which a synapse has learnt.
k_plus, k_time: (threads, sources), trace of each source at its last spike; each thread keeps its own copy.
n, n_time: dopamine of each target at a step. incoming, in_synapse, in_source: synapses by target.
times, traces, head, tail: history of the post spikes.
"""


@inner
def dopamine_at(p, q, target, step, h):
    """n of one target of a modulated projection."""
    place = p.table[q, FIRST_TARGET] + target
    if p.n[place] == 0.0:
        return 0.0
    return p.n[place] * math.exp(-(step - p.n_time[place]) * h / p.tau[q, 1])


@inner
def catch_up(p, q, y, z, thread, source, target, row, since, upto, delay, h):
    """Apply to synapse z the post spikes that arrive after `since` and up to `upto`, and what flows between."""
    table = p.table[q]
    rule, modulated, c = table[RULE], table[MODULATED], p.rule[q]
    place = table[FIRST_SOURCE] + source
    k_plus, k_time = p.k_plus[thread, place], p.k_time[thread, place]
    mask = p.times.shape[1] - 1
    head, tail = p.head[row], p.tail[row]
    i = head
    while i > tail and p.times[row, (i - 1) & mask] + delay > since:
        i -= 1
    while i < head:
        arrival = p.times[row, i & mask] + delay
        if arrival > upto:
            break
        if modulated >= 0:
            advance(modulated, y, z, c, since, arrival, dopamine_at(p, q, target, since, h), table[GRID_STEPS])
            since = arrival
        if k_plus != 0.0:
            on_post(rule, y, z, c, k_plus * math.exp(-(arrival - k_time) * h / p.tau[q, 0]))
        i += 1
    if modulated >= 0 and since < upto:
        advance(modulated, y, z, c, since, upto, dopamine_at(p, q, target, since, h), table[GRID_STEPS])


@inner
def post_trace(p, row, before, h, tau_minus):
    """K- of a neuron from its spikes strictly before a step."""
    mask = p.times.shape[1] - 1
    i = p.head[row] - 1
    while i >= p.tail[row]:
        time = p.times[row, i & mask]
        if time < before:
            return p.traces[row, i & mask] * math.exp(-(before - time) * h / tau_minus)
        i -= 1
    return 0.0


@inner
def pre_spike(p, q, row, target_row, source, m, step, thread, threads, h, rows, targets, delays, tau_minus, buf, due, slots, blocks):
    """A pre spike: each synapse of this thread catches up, learns and sends."""
    table = p.table[q]
    receptors = target_row[RECEPTORS]
    place = row[ROW] + source * threads + thread
    for e in range(rows[place], rows[place + 1]):
        s = e - row[SYNAPSE]
        z = table[FIRST_SYNAPSE] + s
        target = np.int64(targets[e])
        delay = np.int64(delays[row[DELAY] + s * row[DELAY_STRIDE]])
        history = target_row[HISTORY] + target
        catch_up(p, q, p.y, z, thread, source, target, history, p.reached[z], step, delay, h)
        p.reached[z] = step
        k_minus = post_trace(p, history, step - delay, h, tau_minus[target_row[BEGIN] + target])
        on_pre(table[RULE], p.y, z, p.rule[q], k_minus)
        weight = p.y[0, z]
        p.sent[z] = weight
        second = 1 if receptors == 2 and weight < 0.0 else 0
        at = step + delay
        buf[row[RING] + ((at & row[RING_MASK]) * receptors + second) * row[RING_SIZE] + target] += weight * m
        due[(at & slots) * blocks + target_row[FIRST_BLOCK] + (target >> 6)] = 1
    trace = 1.0
    own = table[FIRST_SOURCE] + source
    if p.k_plus[thread, own] != 0.0:
        trace += p.k_plus[thread, own] * math.exp(-(step - p.k_time[thread, own]) * h / p.tau[q, 0])
    p.k_plus[thread, own] = trace
    p.k_time[thread, own] = step


@inner
def bring_target(p, q, row, target_row, thread, target, step, delays, h):
    """Catch up every modulated synapse onto one target."""
    table = p.table[q]
    begin = table[INCOMING] + target
    for i in range(p.incoming[begin], p.incoming[begin + 1]):
        z = p.in_synapse[i]
        if p.reached[z] < step:
            delay = np.int64(delays[row[DELAY] + (z - table[FIRST_SYNAPSE]) * row[DELAY_STRIDE]])
            source = np.int64(p.in_source[i])
            history = target_row[HISTORY] + target
            catch_up(p, q, p.y, z, thread, source, target, history, p.reached[z], step, delay, h)
            p.reached[z] = step


@inner
def release(p, q, row, target_row, thread, target, step, amount, delays, h):
    """Dopamine arrives at one target."""
    bring_target(p, q, row, target_row, thread, target, step, delays, h)
    place = p.table[q, FIRST_TARGET] + target
    p.n[place] = dopamine_at(p, q, target, step, h) + amount
    p.n_time[place] = step


@inner
def dopamine_arrivals(p, q, step, row, target_row, begin, lo, hi, thread, threads, log_ids, log_counts, log_ends, delays, h):
    """The dopamine spikes that arrive in a step, at this thread's targets lo:hi; `begin` is their population's."""
    table = p.table[q]
    j = step - table[DOPAMINE_DELAY]
    if j < 1:
        return
    slot = j & (log_ends.shape[1] - 1)
    mask = log_ids.shape[1] - 1
    each = 1.0 / p.tau[q, 1]
    total = 0.0
    for t in range(threads):
        for place in range(log_ends[t, slot, table[DOPAMINE]], log_ends[t, slot, table[DOPAMINE] + 1]):
            m = log_counts[t, place & mask]
            if table[DOPAMINE_ONE_TO_ONE] == 1:
                target = np.int64(log_ids[t, place & mask]) - begin
                if lo <= target < hi:
                    release(p, q, row, target_row, thread, target, step, m * each, delays, h)
            else:
                total += m
    if total > 0.0:
        for target in range(lo, hi):
            release(p, q, row, target_row, thread, target, step, total * each, delays, h)


@inner
def flush(p, pop, thread, local, history, done, projections, delays, h):
    """The history of one neuron is full: let its synapses use it, and drop what none needs any more."""
    longest = 0
    for q in range(p.table.shape[0]):
        table = p.table[q]
        row = projections[table[PROJECTION]]
        if row[TARGET] != pop:
            continue
        longest = max(longest, table[LONGEST])
        begin = table[INCOMING] + local
        for i in range(p.incoming[begin], p.incoming[begin + 1]):
            z = p.in_synapse[i]
            delay = np.int64(delays[row[DELAY] + (z - table[FIRST_SYNAPSE]) * row[DELAY_STRIDE]])
            if p.reached[z] < done:
                source = np.int64(p.in_source[i])
                catch_up(p, q, p.y, z, thread, source, local, history, p.reached[z], done, delay, h)
                p.reached[z] = done
    mask = p.times.shape[1] - 1
    while p.tail[history] < p.head[history] - 1 and p.times[history, (p.tail[history] + 1) & mask] + longest <= done:
        p.tail[history] += 1


@inner
def post_spike(p, pop, target_row, thread, local, step, done, projections, delays, h, tau_minus):
    """Enter a spike of a neuron into its history."""
    history = target_row[HISTORY] + local
    mask = p.times.shape[1] - 1
    if p.head[history] - p.tail[history] == mask + 1:
        flush(p, pop, thread, local, history, done, projections, delays, h)
    head = p.head[history]
    trace = 1.0
    if head > p.tail[history]:
        last = (head - 1) & mask
        trace += p.traces[history, last] * math.exp(-(step - p.times[history, last]) * h / tau_minus)
    p.times[history, head & mask] = step
    p.traces[history, head & mask] = trace
    p.head[history] = head + 1


@inner
def learn_step(p, step, done_dopamine, thread, threads, edges, pops, projections, log_ids, log_counts, log_ends, rows, targets, delays, tau_minus, buf, due, slots, blocks, h, dopamine_only):
    """All pairwise learning of one step: dopamine that arrives in it, then the pre spikes emitted in it."""
    for q in range(p.table.shape[0]):
        table = p.table[q]
        row = projections[table[PROJECTION]]
        target_row, source_row = pops[row[TARGET]], pops[row[SOURCE]]
        lo = max(edges[thread] * 64 - target_row[BEGIN], 0)
        hi = min(edges[thread + 1] * 64, target_row[END]) - target_row[BEGIN]
        if table[DOPAMINE] >= 0 and step > done_dopamine:
            begin = pops[table[DOPAMINE], BEGIN]
            dopamine_arrivals(p, q, step, row, target_row, begin, lo, hi, thread, threads, log_ids, log_counts, log_ends, delays, h)
        if dopamine_only or step < 1:
            continue
        slot = step & (log_ends.shape[1] - 1)
        mask = log_ids.shape[1] - 1
        for t in range(threads):
            for place in range(log_ends[t, slot, row[SOURCE]], log_ends[t, slot, row[SOURCE] + 1]):
                source = np.int64(log_ids[t, place & mask]) - source_row[BEGIN]
                m = np.float64(log_counts[t, place & mask])
                pre_spike(p, q, row, target_row, source, m, step, thread, threads, h, rows, targets, delays, tau_minus, buf, due, slots, blocks)
