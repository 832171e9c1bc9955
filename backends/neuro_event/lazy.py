"""Kernels that bring what is computed lazily to the present, between two runs."""

# mypy: ignore-errors
import math

import numpy as np

from neuro.kernels.jit import inner, kernel
from neuro_event import tables as t
from neuro_event.arrivals import at_emission
from neuro_event.deliver import base_of, receptor, told_apart
from neuro_event.own_rules import OF_NEURON, TAU, TIME, pre_value
from neuro_event.plastic import bring_history, bring_target, dopamine_at
from neuro_event.views import net_of, plastic_of, slot_mask


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
    """Let K+ and n decay to the present."""
    p = plastic_of(view)
    for target in range(n_targets):
        place = p.table[q, t.FIRST_TARGET] + target
        p.n[place] = dopamine_at(view, q, target, step, h)
        p.n_time[place] = step
    for thread in range(p.k_plus.shape[0]):
        for source in range(n_sources):
            place = p.table[q, t.FIRST_SOURCE] + source
            p.k_plus[thread, place] *= math.exp(-(step - p.k_time[thread, place]) * h / p.tau[q, 0])
            p.k_time[thread, place] = step


@kernel
def bring_own_traces(view, q, n_sources, n_targets, step, h):
    """Likewise of a stranger's rule; the time constants of post traces cannot be set."""
    p = plastic_of(view)
    for target in range(n_targets):
        place = p.table[q, t.FIRST_TARGET] + target
        p.n[place] = dopamine_at(view, q, target, step, h)
        p.n_time[place] = step
    for thread in range(p.k_plus.shape[0]):
        for source in range(n_sources):
            own = p.table[q, t.FIRST_SOURCE] + source * p.table[q, t.SOURCE_STRIDE]
            for j in range(p.table[q, t.SOURCE_STRIDE]):
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


@inner
def owner(edges, block):
    """The thread that a block belongs to."""
    thread = 0
    while block >= edges[thread + 1]:
        thread += 1
    return thread


@kernel
def deliver_counts(view, q, first, last):
    """Put the counts of the steps first..last, which a poisson_generator keeps, into the ring of a projection.

    The ring is one-to-one, and every step has a slot of its own.
    """
    net = net_of(view)
    row = net.projections[q]
    source, target = net.pops[row[t.SOURCE]], net.pops[row[t.TARGET]]
    n = source[t.END] - source[t.BEGIN]
    blocks = net.awake.shape[0]
    slots = slot_mask(net)
    for step in range(max(first, net.clock[0, t.HORIZON] + 1), last + 1):
        at = step + np.int64(net.delays[row[t.DELAY]])
        place = source[t.COUNTS] + (step & (source[t.COUNTS_STEPS] - 1)) * n
        ring = row[t.RING] + ((at & row[t.RING_MASK]) * target[t.RECEPTORS] + base_of(row)) * row[t.RING_SIZE]
        for i in range(n):
            m = net.counts[place + i]
            if m > 0:
                weight = net.weights[row[t.WEIGHT] + i * row[t.WEIGHT_STRIDE]]
                to = receptor(weight, told_apart(row, target[t.RECEPTORS]))
                net.buf[ring + to * row[t.RING_SIZE] + i] += weight * m
                block = target[t.FIRST_BLOCK] + i // t.BLOCK
                net.due[owner(net.edges[row[t.TARGET]], block), (at & slots) * blocks + block] = 1


@kernel
def deliver_between(view, q, first, last, now):
    """Put the spikes of a projection's source of the steps first..last that arrive after now into its ring."""
    net = net_of(view)
    for thread in range(net.edges.shape[1] - 1):
        for step in range(max(first, net.clock[thread, t.HORIZON] + 1), last + 1):
            at_emission(view, q, step, now, thread)
