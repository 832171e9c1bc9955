"""Delivery at arrival over joined rows: the synapses of a source neuron along many projections, by delay.

Where each projection has few synapses a run has a few, and most may be empty: a step looks for them once a projection
and delay. In a joined row a run holds those onto all targets, and a step looks once a source population and delay. A
target is reached along one projection of a joined row, and rows follow in the order of projections (see
`building.joined_rows`): so each sum has the order that it has without.

A synapse takes six bytes: synapses of a run lie by place, so 16 bits say how far the next place is, and a weight that
fits into 32 bits is kept so. Time is that of memory, and rows of six bytes take half the time of rows of twelve.
"""

# mypy: ignore-errors
import numpy as np

from neuro.kernels.instructions import address
from neuro.kernels.jit import kernel, subkernel
from neuro_event.loop import tables as t
from neuro_event.loop.arrivals import gather_runs, prefetch_lines, run_of
from neuro_event.loop.steps import deliver
from neuro_event.loop.tables import net_of

_BLOCK_SHIFT = np.uint64(t.BLOCK_SHIFT)

PREFETCH_DISTANCE = 16
"""Runs between a prefetch and its use."""

FAR = 2**16 - 1
"""A step that leads to no synapse: what lies as far or farther is reached by several."""


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
    steps = address(net.joined_steps) + 2 * row[t.SYNAPSE]
    prefetch_lines(steps + 2 * first, steps + 2 * last)
    if row[t.SINGLE] == 1:
        weights = address(net.joined_singles) + 4 * row[t.WEIGHT]
        prefetch_lines(weights + 4 * first, weights + 4 * last)
    else:
        weights = address(net.joined_weights) + 8 * row[t.WEIGHT]
        prefetch_lines(weights + 8 * first, weights + 8 * last)


@subkernel
def add_steps(steps, weights, e, w, n, at, m, buf):
    """Add n weights times m to places of `buf`, each some steps from the one before; the first from `at`."""
    for k in range(n):
        at += np.uint64(steps[e + k])
        # Not even -0.0 may be added where a step leads to no synapse: another thread may be adding there.
        if steps[e + k] != FAR:
            buf[at] += np.float64(weights[w + k]) * m


@subkernel
def add_steps_by_sign(steps, weights, e, w, n, at, second, m, buf):
    """The same for weights of both signs; those below 0 go `second` places further."""
    for k in range(n):
        at += np.uint64(steps[e + k])
        if steps[e + k] != FAR:
            weight = np.float64(weights[w + k]) * m
            buf[at + (second if weight < 0.0 else np.uint64(0))] += weight


@subkernel
def add_joined(view, row, thread, n, total, slot):
    """Add the first n runs of a thread's queue to the input of the present step, and mark the blocks that they reach.

    Many runs mark all blocks; how many does not depend on the threads, as `total` would, which counts long steps twice.
    """
    net = net_of(view)
    queue, buf, steps, due = net.queue[thread], net.buf, net.joined_steps, net.due
    e, w, base = np.uint64(row[t.SYNAPSE]), np.uint64(row[t.WEIGHT]), np.uint64(net.joined_bases[row[t.ROW], thread])
    second = np.uint64(net.x.shape[1])
    begin = base + (second if row[t.SIGN] == t.NEGATIVE else np.uint64(0))
    mark_all = n > row[t.WAKE_ALL]
    blocks, mark = np.uint64(net.awake.shape[0]), np.uint64(slot)
    for k in range(min(PREFETCH_DISTANCE, n)):
        prefetch_joined(view, row, queue[k, 0], queue[k, 1])
    for k in range(n):
        if k + PREFETCH_DISTANCE < n:
            prefetch_joined(view, row, queue[k + PREFETCH_DISTANCE, 0], queue[k + PREFETCH_DISTANCE, 1])
        first, m = np.uint64(queue[k, 0]), np.float64(queue[k, 2])
        length = np.uint64(queue[k, 1]) - first
        if row[t.SINGLE] == 1 and row[t.SIGN] != t.MIXED:
            add_steps(steps, net.joined_singles, e + first, w + first, length, begin, m, buf)
        elif row[t.SINGLE] == 1:
            add_steps_by_sign(steps, net.joined_singles, e + first, w + first, length, base, second, m, buf)
        elif row[t.SIGN] != t.MIXED:
            add_steps(steps, net.joined_weights, e + first, w + first, length, begin, m, buf)
        else:
            add_steps_by_sign(steps, net.joined_weights, e + first, w + first, length, base, second, m, buf)
        if not mark_all:
            at = base
            for s in range(e + first, e + first + length):
                at += np.uint64(steps[s])
                if steps[s] == FAR:
                    continue
                block = at >> _BLOCK_SHIFT
                # What goes to a second receptor that is named lies behind all that goes to the first.
                due[thread, mark + block - (blocks if block >= blocks else np.uint64(0))] = 1
    if mark_all:
        for pop in range(net.pops.shape[0]):
            if net.joined_reach[row[t.ROW], pop] == 1:
                due[thread, slot + net.edges[pop, thread] : slot + net.edges[pop, thread + 1]] = 1


@kernel
def lay_joined(
    first_source,
    end_source,
    row_ends,
    targets,
    delays,
    edges,
    shortest,
    n_delays,
    weights,
    stride,
    begin,
    at,
    following,
    steps,
    laid,
):
    """Put the synapses of some sources of a projection into joined rows, or count them if `steps` has no room.

    `edges` are those of the threads among the targets, `shortest` and `n_delays` of the row; `stride` is 0 where
    synapses share a weight. Target 0 lies at `begin`; `at` is the place of each run's last synapse, `following` where
    its next one goes, or how many it has.
    """
    lays = steps.size > 0
    for source in range(first_source, end_source):
        for synapse in range(row_ends[source], row_ends[source + 1]):
            # Unsigned places take less time: of others numba asks whether they count from the end.
            k = np.uint64(synapse)
            run = np.uint64(run_of(source, delays[k], targets[k], shortest, n_delays, edges))
            place, e = begin + np.int64(targets[k]), following[run]
            step = place - at[run]
            at[run] = place
            while step >= FAR:
                if lays:
                    steps[e], laid[e] = FAR, -0.0
                e += np.uint32(1)
                step -= FAR
            if lays:
                steps[e], laid[e] = step, weights[k * np.uint64(stride)]
            following[run] = e + np.uint32(1)


@kernel
def list_joined(row_ends, runs, steps, laid, shortest, n_delays, bases, begin, end, targets, weights, delays):
    """List the synapses of a projection, whose targets lie at the places begin:end, as they lie in a joined row."""
    threads = bases.size
    for source in range(row_ends.size - 1):
        e = row_ends[source]
        for d in range(n_delays):
            for thread in range(threads):
                run, at = (source * n_delays + d) * threads + thread, bases[thread]
                for s in range(runs[run], runs[run + 1]):
                    at += np.int64(steps[s])
                    if steps[s] < FAR and begin <= at < end:
                        targets[e], delays[e] = at - begin, shortest + d
                        if weights.size > 0:
                            weights[e] = laid[s]
                        e += 1
