"""Delivery of spikes when they arrive. Spikes are read from the log. Synapses with several delays are in joined rows.

A joined row has the synapses of a projection, or of several projections from the same source population. A run has the
synapses of one source neuron with the same delay, onto all targets of the row. In each step, a spike in the log adds
the run of its source whose delay equals the age of the spike. The input of one step stays in the cache, while a ring of
all future steps would not. The oldest spikes are added first, spikes of the same age by id, and the targets of a run
ascend. So all sums have the same order as in the reference backend. The order does not depend on the number of threads,
because each target belongs to one thread.

If each projection has few synapses, its runs are short and most runs are empty. A row of many projections needs a
look-up for each spike and delay, not for each spike, delay and projection. Joining keeps the order of each sum:
only one projection of a row reaches a given target, and rows follow the order of projections (see
`building.joined_rows`). A synapse takes six bytes: 16 bits for the distance from the place of the previous synapse of
the run, and 32 bits for the weight if 32 bits are enough. A weight that all synapses share is stored once. Memory
bandwidth sets the time: rows of six bytes per synapse take half the time of rows of twelve.
"""

# mypy: ignore-errors
from collections import namedtuple

import numpy as np

from neuro.kernels.instructions import address, prefetch
from neuro.kernels.jit import inlined, kernel, subkernel
from neuro_event.loop import tables as t
from neuro_event.loop.deliver import count_spikes, first_receptor, receptor, receptors_by_sign
from neuro_event.loop.tables import add_counts, add_row as call_add_row, deliver_log, net_of, slot_mask

_LINE_BYTES = 64


@subkernel
def prefetch_lines(begin, end):
    """Prefetch the cache lines between two addresses, the first three without a branch, because runs are short."""
    # A second prefetch of the same line takes less time than a mispredicted branch.
    final = end - 1
    prefetch(begin)
    prefetch(min(begin + _LINE_BYTES, final))
    prefetch(min(begin + 2 * _LINE_BYTES, final))
    for place in range(begin + 3 * _LINE_BYTES, end, _LINE_BYTES):
        prefetch(place)


@inlined
def log_delivery(view, q, j, k, begin, stop, ring):
    """Deliver the spikes of step j over projection q with `deliver_log`, if its source fired in this step."""
    net = net_of(view)
    # The test comes before the call, because most projections have no spike in most steps.
    if count_spikes(net, net.projections[q, t.SOURCE], j & (net.log_ends.shape[1] - 1)) > 0:
        deliver_log(view, q, j, k, begin, stop, ring)


@kernel
def carry(view, q, lag, now):
    """Write the spikes under way over a projection at the end of step `now`, with weights, into the new ring.

    Until now these spikes were read from the log `lag` steps after emission. Neurons send the spikes of step `now` when
    the next step begins, so the spikes of step `now` get the new weights.
    """
    net = net_of(view)
    row = net.projections[q]
    last = now if row[t.SENDS_AT_ONCE] == 1 else now - 1
    for thread in range(net.edges.shape[1] - 1):
        for step in range(max(now - lag, net.clock[thread, t.HORIZON]) + 1, last + 1):
            if row[t.DENSE_COUNTS] == 1:
                carry_counts(view, row, step, thread)
            else:
                log_delivery(view, q, step, now, thread, thread + 1, True)


@subkernel
def carry_counts(view, row, step, thread):
    """Write the spike counts of a step of a poisson_generator into the ring of a one-to-one projection."""
    net = net_of(view)
    source, target = net.pops[row[t.SOURCE]], net.pops[row[t.TARGET]]
    n, edges = source[t.END] - source[t.BEGIN], net.edges[row[t.TARGET]]
    counts = source[t.COUNTS] + (step & (source[t.COUNTS_STEPS] - 1)) * n
    at = step + np.int64(net.delays[row[t.DELAY]])
    ring = row[t.RING] + ((at & row[t.RING_MASK]) * target[t.RECEPTORS] + first_receptor(row)) * row[t.RING_SIZE]
    weight = net.weights[row[t.WEIGHT]]
    ring += receptor(weight, receptors_by_sign(row, target[t.RECEPTORS])) * row[t.RING_SIZE]
    due = (at & slot_mask(net)) * net.awake.shape[0]
    for i in range(edges[thread] * t.BLOCK - target[t.BEGIN], min(edges[thread + 1] * t.BLOCK - target[t.BEGIN], n)):
        if net.counts[counts + i] > 0:
            net.buf[ring + i] += weight * net.counts[counts + i]
            net.due[thread, due + target[t.FIRST_BLOCK] + i // t.BLOCK] = 1


@inlined
def deliver(view, first, last, begin, stop, step):
    """Add the spikes that arrive in a step over the projections first:last of `incoming`.

    The targets are the neurons of the threads begin:stop.

    The path of a projection is the first row whose condition holds:

    | condition | path | reason |
    | --- | --- | --- |
    | it carries a current | `generators.drive` | there are no spikes: currents are summed along lines |
    | learns by spike pairs | ring, at emission, by the rule's entry | spikes have the weight at emission |
    | a grid whose kernels learn by spike pairs | ring, `steps.act`, before it learns | likewise, once a step |
    | static, several delays, joined with others | `deliver_joined` | one look-up, long runs for all targets |
    | static, several delays, a row of its own | `add_row` | its input stays in the cache: 5 ns an event |
    | several delays otherwise | ring, `deliver.csr_delayed` | most runs would be empty: 42 ns an event |
    | weights were set | ring, `steps.act` | spikes under way keep the old weights (`carry`) |
    | one-to-one from a busy `poisson_generator` | `generators.add_counts` | counts instead of a list: 0.7 ns a draw |
    | CSR, one weight, busy and large | `deliver_in_ranges` | the input of a range fits the second-level cache |
    | CSR, one weight | `deliver_shared_weight` | one multiplication a spike; the next row is prefetched |
    | CSR, own weights | `deliver.csr_own` | a weight is read for each synapse |
    | dense | `deliver.scatter` | a row of weights (or one weight) is added as a whole, without a list of targets |
    | one-to-one | `deliver.scatter` | one target, without a table |
    | grid | `deliver.grid_add` | the weights of a kernel have the maps innermost: runs of neighbours |

    A projection is joined with others wherever sums keep their order (`building.joined_rows`, JOINED, JOINED_END). A
    projection has its own row (JOINED_ROW) if the row has at most as many runs as synapses, or at most 65,536 runs
    (`layout.in_runs`). A projection is busy and large if the spikes of the step reach nearly all blocks (WAKE_ALL) of a
    population without COLLECTS, and if the threads begin:stop have more than 32,768 targets. Both functions for one
    weight are in `deliver`.

    LAG, WEIGHT_STRIDE and WAKE_ALL are set in `building.projections`, LAYOUT in `building.layout`, DENSE_COUNTS in
    `building.build`. Projections with LAG 0 have a ring and are not delivered here.
    """
    net = net_of(view)
    for k in range(first, last):
        q = net.incoming[k]
        projection = net.projections[q]
        if projection[t.JOINED_ROW] >= 0:
            for thread in range(begin, stop):
                call_add_row(view, projection[t.JOINED_ROW], step, thread)
            continue
        # A spike stays in the log and is read LAG steps later, so it needs no ring.
        j = step - projection[t.LAG]
        if j <= net.clock[begin, t.HORIZON]:
            continue
        if projection[t.DENSE_COUNTS] == 1:
            for thread in range(begin, stop):
                add_counts(view, thread, q, step, net.x.shape[1], slot_mask(net), net.awake.shape[0])
        else:
            log_delivery(view, q, j, step, begin, stop, False)


QUEUE = 256
"""Number of runs that are gathered before they are added, so that their memory can be prefetched."""


@subkernel
def owner(edges, block):
    """Return the thread that owns a block."""
    thread = 0
    while block >= edges[thread + 1]:
        thread += 1
    return thread


@inlined
def run_of(source, delay, target, shortest, n_delays, edges):
    """Return the index of a run. Runs are numbered by source, then by delay, then by the thread of the target."""
    threads = edges.size - 1
    # The synapses of a source are sorted by delay, then target, so the thread is searched for each synapse.
    thread = owner(edges, target) if threads > 1 else 0
    return (source * n_delays + np.int64(delay) - shortest) * threads + thread


_BLOCK_SHIFT = np.uint64(t.BLOCK_SHIFT)

PREFETCH_DISTANCE = 16
"""Number of runs between a prefetch and its use."""

MOST = 2**32 - 1
"""Largest number of entries of a joined row, because the end of a run is an index of an entry with 32 bits.

An entry is a step from place to place. It leads to a synapse, or it has the length FAR and leads to no synapse.
"""

FAR = 2**16 - 1
"""Length of a step from place to place that ends at no synapse. A synapse at this distance or more takes several steps.

Example: the steps from place 10 to a synapse at place 65,550 (distance 65,540) are FAR and 5.
"""


@kernel
def deliver_joined(view, begin, stop, step):
    """Add the spikes that arrive in a step over all joined rows of several projections.

    Projections that come before the joined rows in the sums are added first.
    """
    net = net_of(view)
    for pop in range(net.pops.shape[0]):
        deliver(view, net.pops[pop, t.ARRIVALS], net.pops[pop, t.JOINED], begin, stop, step)
    for k in range(net.joined.shape[0]):
        if net.joined[k, t.TARGET] < 0:
            for thread in range(begin, stop):
                call_add_row(view, k, step, thread)


@kernel
def add_row(view, k, step, thread):
    """Add the spikes that arrive in a step over joined row k to the input of this thread's targets."""
    net = net_of(view)
    row, runs = net.joined[k], net.joined_runs
    threads = net.edges.shape[1] - 1
    first_source = net.pops[row[t.SOURCE], t.BEGIN]
    slot = (step & slot_mask(net)) * net.awake.shape[0]
    # Runs are short and scattered in memory, so they are gathered first and prefetched.
    queue = net.queue[thread]
    mask, steps = net.log_ids.shape[1] - 1, net.log_ends.shape[1] - 1
    n = 0
    # The longest delay comes first, because the oldest spikes come first in the order of sums.
    for d in range(row[t.DELAYS] - 1, -1, -1):
        j = step - row[t.SHORTEST] - d
        if j <= net.clock[thread, t.HORIZON]:
            continue
        for sender in range(threads):
            ends = net.log_ends[sender, j & steps]
            for place in range(ends[row[t.SOURCE]], ends[row[t.SOURCE] + 1]):
                i = np.int64(net.log_ids[sender, place & mask]) - first_source
                run = row[t.RUN] + (i * row[t.DELAYS] + d) * threads
                # The test is over the runs of all threads, so that all threads decide alike whether to mark all blocks.
                if runs[run + threads] == runs[run]:
                    continue
                queue[n, 0], queue[n, 1] = runs[run + thread], runs[run + thread + 1]
                queue[n, 2] = net.log_counts[sender, place & mask]
                n += 1
                # The queue has runs of several spikes, so that the runs of later spikes are prefetched too.
                if n == queue.shape[0]:
                    if net.stop[0] == t.AT_ONCE:
                        return
                    add_joined(view, row, thread, n, slot)
                    n = 0
    if n > 0:
        add_joined(view, row, thread, n, slot)


@subkernel
def prefetch_joined(view, row, first, last):
    """Prefetch the steps and the weights of a run of a joined row."""
    net = net_of(view)
    steps = address(net.joined_steps) + 2 * row[t.SYNAPSE]
    prefetch_lines(steps + 2 * first, steps + 2 * last)
    if row[t.WEIGHT_STRIDE] == 0:
        return
    if row[t.SINGLE] == 1:
        weights = address(net.joined_singles) + 4 * row[t.WEIGHT]
        prefetch_lines(weights + 4 * first, weights + 4 * last)
    else:
        weights = address(net.joined_weights) + 8 * row[t.WEIGHT]
        prefetch_lines(weights + 8 * first, weights + 8 * last)


@subkernel
def add_steps(steps, weights, e, w, n, at, m, buf):
    """Add n weights times m to places of `buf`. `steps` has the distances from place to place, which begin at `at`."""
    for k in range(n):
        at += np.uint64(steps[e + k])
        # After a step without a synapse not even -0.0 may be added, because the place may belong to another thread.
        if steps[e + k] != FAR:
            buf[at] += np.float64(weights[w + k]) * m


@subkernel
def add_value(steps, e, n, at, value, buf):
    """Like `add_steps`, for a row whose synapses all have one weight."""
    for k in range(n):
        at += np.uint64(steps[e + k])
        if steps[e + k] != FAR:
            buf[at] += value


@subkernel
def add_steps_by_sign(steps, weights, e, w, n, at, second, m, buf):
    """Like `add_steps`, for weights of both signs. Negative weights are added `second` places further."""
    for k in range(n):
        at += np.uint64(steps[e + k])
        if steps[e + k] != FAR:
            weight = np.float64(weights[w + k]) * m
            buf[at + (second if weight < 0.0 else np.uint64(0))] += weight


@subkernel
def add_joined(view, row, thread, n, slot):
    """Add the first n runs of a thread's queue to the input of the present step, and mark the blocks that they reach.

    If there are many runs, all blocks are marked. The number of runs decides, because it is the same for any number of
    threads. The number of entries is not, because a long distance takes several entries.
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
        if row[t.WEIGHT_STRIDE] == 0:
            weight = np.float64(net.joined_singles[w]) if row[t.SINGLE] == 1 else net.joined_weights[w]
            add_value(steps, e + first, length, begin, weight * m, buf)
        elif row[t.SINGLE] == 1 and row[t.SIGN] != t.MIXED:
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
                # The places of a receptor follow the places of the receptor before it.
                while block >= blocks:
                    block -= blocks
                due[thread, mark + block] = 1
    if mark_all:
        for pop in range(net.pops.shape[0]):
            if net.joined_reach[row[t.ROW], pop] == 1:
                due[thread, slot + net.edges[pop, thread] : slot + net.edges[pop, thread + 1]] = 1


Listed = namedtuple("Listed", "row_ends targets delays edges shortest n_delays weights stride begin")
"""The synapses of a projection in the program's order, to be copied to a joined row or from it.

`edges` has the first target of each thread and the end. `shortest` and `n_delays` are the shortest delay and the number
of delays of the joined row. `stride` is 0 if all synapses share a weight, else 1. Target 0 is at place `begin`.
"""


@kernel
def lay_joined(first_source, end_source, part, at, following, steps, laid):
    """Copy the synapses of some sources of a projection to joined rows, or count them if `steps` is empty.

    Args:
        first_source: the first source.
        end_source: the end of the sources.
        part: the projection, a `Listed`.
        at: place of the last synapse of each run.
        following: next free entry of each run, or its number of entries if `steps` is empty.
        steps: steps of the joined row.
        laid: weights of the joined row, or a single weight of all synapses.
    """
    copies, mask = steps.size > 0, np.uint32(0 if laid.size == 1 else MOST)
    for source in range(first_source, end_source):
        for synapse in range(part.row_ends[source], part.row_ends[source + 1]):
            # Unsigned indices are faster: numba tests signed ones for being negative.
            k = np.uint64(synapse)
            run = np.uint64(run_of(source, part.delays[k], part.targets[k], part.shortest, part.n_delays, part.edges))
            place, e = part.begin + np.int64(part.targets[k]), following[run]
            step = place - at[run]
            at[run] = place
            while step >= FAR:
                if copies:
                    steps[e], laid[e & mask] = FAR, -0.0
                e += np.uint32(1)
                step -= FAR
            if copies:
                steps[e], laid[e & mask] = step, part.weights[k * np.uint64(part.stride)]
            following[run] = e + np.uint32(1)


@kernel
def list_joined(part, end, bases, runs, steps, laid):
    """Fill `part`, a `Listed`, from a joined row. The targets of its projection are at the places begin:end."""
    threads, begin = bases.size, part.begin
    for source in range(part.row_ends.size - 1):
        e = part.row_ends[source]
        for d in range(part.n_delays):
            for thread in range(threads):
                run, at = (source * part.n_delays + d) * threads + thread, bases[thread]
                for s in range(runs[run], runs[run + 1]):
                    at += np.int64(steps[s])
                    if steps[s] < FAR and begin <= at < end:
                        part.targets[e], part.delays[e] = at - begin, part.shortest + d
                        if part.weights.size > 0:
                            part.weights[e] = laid[s]
                        e += 1
