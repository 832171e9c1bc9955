"""Delivery at arrival over a projection whose synapses lie by source, then delay.

The synapses of one source with one delay are a run. A step adds the runs of the spikes that are as old as their delay
to its own input, which stays in the cache, where a ring of all steps to come would not. Spikes go in by their age, the
oldest first, then by id, and the targets of a run ascend: so the order of all sums is that of the reference, and the
same for any number of threads, which own targets.
"""

# mypy: ignore-errors
import numpy as np

from neuro.kernels.jit import inner, kernel
from neuro_event.alike import add, mark_blocks
from neuro_event.deliver import base_of, csr_own, receptor, told_apart
from neuro_event.logs import log_delivery
from neuro_event.tables import (
    BEGIN,
    DELAYS,
    FIRST_BLOCK,
    HORIZON,
    LAST_BLOCK,
    MIXED,
    NEGATIVE,
    NUMBER,
    RECEPTORS,
    RING,
    RING_MASK,
    RING_SIZE,
    RUN,
    SHORTEST,
    SIGN,
    SOURCE,
    SYNAPSE,
    TARGET,
    WEIGHT,
    WEIGHT_STRIDE,
)
from neuro_event.views import address, net_of, prefetch, slot_mask

AHEAD = 6
"""How many runs ahead."""

_LINE = 64


@inner
def ask(begin, end):
    """Ask for the lines between two addresses. Runs are short: what asks for three lines has no branch."""
    final = end - 1
    prefetch(begin)
    prefetch(min(begin + _LINE, final))
    prefetch(min(begin + 2 * _LINE, final))
    for place in range(begin + 3 * _LINE, end, _LINE):
        prefetch(place)


@inner
def ask_for(view, row, first, last):
    """Ask for the targets and the weights of a run."""
    net = net_of(view)
    targets = address(net.targets) + 4 * row[SYNAPSE]
    ask(targets + 4 * first, targets + 4 * last)
    if row[WEIGHT_STRIDE] == 1:
        weights = address(net.weights) + 8 * row[WEIGHT]
        ask(weights + 8 * first, weights + 8 * last)


@inner
def add_run(view, row, thread, first, last, m, receptors, between, out, mark):
    """Add a run, the synapses first:last of its projection, to the input whose target 0 lies at `out`."""
    net = net_of(view)
    e = row[SYNAPSE]
    if row[WEIGHT_STRIDE] == 0:
        weight = net.weights[row[WEIGHT]] * m
        at = out + receptor(weight, receptors) * between
        here = address(net.targets) + 4 * (e + first)  # asked for long before
        add(net.targets, e + first, e + last, weight, net.buf, at, here)
        if mark >= 0:
            mark_blocks(net.targets, e + first, e + last, net.due[thread], mark)
    else:
        apart, at = receptors, out
        if receptors == 2 and row[SIGN] != MIXED:
            apart, at = 1, out + (between if row[SIGN] == NEGATIVE else 0)
        w, due = row[WEIGHT] + first, net.due[thread]
        csr_own(net.targets, e + first, e + last, net.weights, w, m, apart, between, net.buf, at, due, mark)


@inner
def add_queue(view, row, thread, n, total, slot):
    """Add the first n runs of a thread's queue to the input of the present step, whose marks lie at `slot`.

    Where they reach many neurons, of all threads, all blocks are marked.
    """
    net = net_of(view)
    target = net.pops[row[TARGET]]
    queue = net.queue[thread]
    between = net.x.shape[1]
    out = target[BEGIN] + base_of(row) * between
    receptors = told_apart(row, target[RECEPTORS])
    wide = total > 2 * (target[LAST_BLOCK] - target[FIRST_BLOCK])
    mark = -1 if wide else slot + target[FIRST_BLOCK]
    for k in range(min(AHEAD, n)):
        ask_for(view, row, queue[k, 0], queue[k, 1])
    for k in range(n):
        if k + AHEAD < n:
            ask_for(view, row, queue[k + AHEAD, 0], queue[k + AHEAD, 1])
        add_run(view, row, thread, queue[k, 0], queue[k, 1], np.float64(queue[k, 2]), receptors, between, out, mark)
    if wide:
        first_block = net.edges[target[NUMBER], thread]
        last_block = net.edges[target[NUMBER], thread + 1]
        net.due[thread, slot + first_block : slot + last_block] = 1


@kernel
def arrive(view, q, step, thread):
    """Add what arrives in a step over a projection to the input of this thread's targets."""
    net = net_of(view)
    row = net.projections[q]
    source, target = net.pops[row[SOURCE]], net.pops[row[TARGET]]
    threads = net.edges.shape[1] - 1
    if net.edges[target[NUMBER], thread] >= net.edges[target[NUMBER], thread + 1]:
        return
    blocks = net.awake.shape[0]
    slot = (step & slot_mask(net)) * blocks
    queue = net.queue[thread]
    mask, steps = net.log_ids.shape[1] - 1, net.log_ends.shape[1] - 1
    n = total = 0
    for d in range(row[DELAYS] - 1, -1, -1):
        j = step - row[SHORTEST] - d
        if j <= net.clock[thread, HORIZON]:
            continue
        for t in range(threads):
            ends = net.log_ends[t, j & steps]
            for place in range(ends[row[SOURCE]], ends[row[SOURCE] + 1]):
                i = np.int64(net.log_ids[t, place & mask]) - source[BEGIN]
                run = row[RUN] + (i * row[DELAYS] + d) * threads
                synapses = np.int64(net.runs[run + threads]) - np.int64(net.runs[run])
                if synapses == 0:
                    continue
                total += synapses
                queue[n, 0], queue[n, 1] = net.runs[run + thread], net.runs[run + thread + 1]
                queue[n, 2] = net.log_counts[t, place & mask]
                n += 1
                if n == queue.shape[0]:
                    add_queue(view, row, thread, n, total, slot)
                    n = total = 0
    if n > 0:
        add_queue(view, row, thread, n, total, slot)


@kernel
def at_emission(view, q, step, after, thread):
    """Put what the source of a projection emitted in a step, and what of it arrives after another, into its ring."""
    net = net_of(view)
    row = net.projections[q]
    if step <= net.set_out[q]:
        return
    if row[RUN] < 0:
        log_delivery(view, q, step, 0, thread, thread + 1, True)
        return
    mask, slot = net.log_ids.shape[1] - 1, step & (net.log_ends.shape[1] - 1)
    for t in range(net.edges.shape[1] - 1):
        for place in range(net.log_ends[t, slot, row[SOURCE]], net.log_ends[t, slot, row[SOURCE] + 1]):
            i = np.int64(net.log_ids[t, place & mask]) - net.pops[row[SOURCE], BEGIN]
            keep_for_later(view, row, i, np.float64(net.log_counts[t, place & mask]), step, after, thread)


@inner
def keep_for_later(view, row, i, m, step, after, thread):
    """Put the spike of source i in a step, of multiplicity m, into the ring of its projection."""
    net = net_of(view)
    target = net.pops[row[TARGET]]
    threads = net.edges.shape[1] - 1
    blocks = net.awake.shape[0]
    slots = slot_mask(net)
    receptors = target[RECEPTORS]
    for d in range(row[DELAYS]):
        at = step + row[SHORTEST] + d
        run = row[RUN] + (i * row[DELAYS] + d) * threads + thread
        first, last = np.int64(net.runs[run]), np.int64(net.runs[run + 1])
        if at <= after or first == last:
            continue
        out = row[RING] + ((at & row[RING_MASK]) * receptors + base_of(row)) * row[RING_SIZE]
        mark = (at & slots) * blocks + target[FIRST_BLOCK]
        add_run(view, row, thread, first, last, m, told_apart(row, receptors), row[RING_SIZE], out, mark)
