"""Delivery at arrival over joined rows: the synapses of a source neuron along many projections, by delay.

Where each projection has few synapses a run has one or two, and most are empty: a step looks for them once a projection
and delay. In a joined row a run holds those onto all targets, and a step looks once a source population and delay. A
target is reached along one projection of a joined row, and rows follow in the order of projections (see
`building.joined_rows`): so each sum has the order that it has without.
"""

# mypy: ignore-errors
import numpy as np

from neuro.kernels.instructions import address
from neuro.kernels.jit import kernel, subkernel
from neuro_event.loop import tables as t
from neuro_event.loop.arrivals import PREFETCH_DISTANCE, gather_runs, prefetch_lines, run_of
from neuro_event.loop.steps import deliver
from neuro_event.loop.tables import net_of

_BLOCK_SHIFT = np.uint64(t.BLOCK_SHIFT)


@kernel
def deliver_joined(view, begin, stop, step):
    """Add what arrives in a step over all joined rows, and before over the projections that come before those."""
    net = net_of(view)
    for pop in range(net.pops.shape[0]):
        deliver(view, net.pops[pop, t.ARRIVALS], net.pops[pop, t.JOINED], begin, stop, step)
    for k in range(net.joined.shape[0]):
        for thread in range(begin, stop):
            gather_runs(view, net.joined[k], net.joined_runs, step, thread, add_joined)


@subkernel
def prefetch_joined(view, row, first, last):
    """Prefetch a run."""
    net = net_of(view)
    e = row[t.SYNAPSE]
    prefetch_lines(address(net.joined_targets) + 4 * (e + first), address(net.joined_targets) + 4 * (e + last))
    prefetch_lines(address(net.joined_weights) + 8 * (e + first), address(net.joined_weights) + 8 * (e + last))


@subkernel
def add_joined(view, row, thread, n, total, slot):
    """Add the first n runs of a thread's queue to the input of the present step, and mark the blocks that they reach.

    `total` is not used: what a row reaches is anywhere, so blocks are marked one by one.
    """
    net = net_of(view)
    queue, buf, targets, weights, due = net.queue[thread], net.buf, net.joined_targets, net.joined_weights, net.due
    blocks = np.uint64(net.awake.shape[0])
    mark, e = np.uint64(slot), row[t.SYNAPSE]
    for k in range(min(PREFETCH_DISTANCE, n)):
        prefetch_joined(view, row, queue[k, 0], queue[k, 1])
    for k in range(n):
        if k + PREFETCH_DISTANCE < n:
            prefetch_joined(view, row, queue[k + PREFETCH_DISTANCE, 0], queue[k + PREFETCH_DISTANCE, 1])
        first, last, m = np.uint64(e + queue[k, 0]), np.uint64(e + queue[k, 1]), np.float64(queue[k, 2])
        for s in range(first, last):
            buf[np.uint64(targets[s])] += weights[s] * m
        for s in range(first, last):
            block = np.uint64(targets[s]) >> _BLOCK_SHIFT
            # What goes to the second receptor lies behind all that goes to the first.
            due[thread, mark + block - (blocks if block >= blocks else np.uint64(0))] = 1


@kernel
def lay_joined(row_ends, targets, delays, edges, shortest, n_delays, weights, stride, inputs, following, places, laid):
    """Put the synapses of a projection into joined rows; `following` holds where the next one of each run goes.

    `inputs` are the places in x of target 0, of weights of either sign; `places` and `laid` take what a row has.
    """
    for source in range(row_ends.size - 1):
        for e in range(row_ends[source], row_ends[source + 1]):
            run = run_of(source, delays[e], targets[e], shortest, n_delays, edges)
            weight = weights[e * stride]
            places[following[run]] = inputs[1 if weight < 0.0 else 0] + targets[e]
            laid[following[run]] = weight
            following[run] += np.uint32(1)
