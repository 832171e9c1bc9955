"""Delivery at arrival. Spikes are read from the log; projections with several delays are stored as joined rows.

A joined row holds the synapses of one projection, or of several projections from one source population. A run is the
synapses of a source neuron with the same delay, onto all targets of the row. In each step, a spike in the log adds the
run of its source whose delay equals the age of the spike. The input of one step stays in the cache; a ring of all
future steps would not. Spikes are added by age, the oldest first, then by id, and the targets of a run ascend. So the
order of all sums is that of the reference. The order is the same for any number of threads, because each target belongs
to one thread.

If each projection has few synapses, its runs are short and most are empty. A row of many projections needs one look-up
per spike and delay, not one per spike, delay and projection. Joining keeps the order of each sum: only one projection
of a row reaches a given target, and rows follow the order of projections (see `building.joined_rows`). A synapse takes
six bytes: the synapses of a run are sorted by place, so 16 bits store the distance to the next place, and a weight that
fits into 32 bits is stored in 32 bits. One weight of all synapses is stored once. Memory bandwidth sets the time: rows
of six bytes take half the time of rows of twelve.
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
    """Prefetch the cache lines between two addresses. Runs are short, so the first three lines need no branch."""
    # A prefetch of the same line twice costs less than a branch that is mispredicted.
    final = end - 1
    prefetch(begin)
    prefetch(min(begin + _LINE_BYTES, final))
    prefetch(min(begin + 2 * _LINE_BYTES, final))
    for place in range(begin + 3 * _LINE_BYTES, end, _LINE_BYTES):
        prefetch(place)


@inlined
def log_delivery(view, q, j, k, begin, stop, ring):
    """Deliver the spikes of step j over projection q with `deliver_log`, if there are any."""
    net = net_of(view)
    # Tested before the call, because most projections have no spike in most steps.
    if count_spikes(net, net.projections[q, t.SOURCE], j & (net.log_ends.shape[1] - 1)) > 0:
        deliver_log(view, q, j, k, begin, stop, ring)


@kernel
def carry(view, q, lag, now):
    """Write the spikes under way over a projection at the end of step `now` into its new ring, with their weights.

    Until now they were read from the log `lag` steps after emission. Neurons send the spikes of step `now` when the
    next step begins, so these spikes get the next weights.
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
    """Add arrivals of a step over the projections first:last of `incoming`, to neurons of the threads begin:stop.

    The path of a projection is the first row whose condition holds:

    | condition | path | reason |
    | --- | --- | --- |
    | the target of a current | `generators.drive` | no spikes: currents are summed along lines |
    | learns by spike pairs | ring, at emission, by the rule's entry | the weight is that at emission |
    | a grid whose kernels learn by spike pairs | ring, `steps.act`, before it learns | the same, per step |
    | static, own delays, joined with others | `deliver_joined` | one look-up, long runs for all targets |
    | static, own delays, a row of its own | `add_row` | its input stays in the cache: 5 ns an event |
    | own delays otherwise | ring, `deliver.csr_delayed` | most runs would be empty: 42 ns an event |
    | weights were set | ring, `steps.act` | spikes under way keep the old weights (`carry`) |
    | one-to-one from a busy `poisson_generator` | `generators.add_counts` | counts instead of a list: 0.7 ns a draw |
    | CSR, one weight, busy and large (below) | `deliver_in_ranges` | the input of a range fits the second-level cache |
    | CSR, one weight | `deliver_shared_weight` | one multiplication a spike; the next row is prefetched |
    | CSR, own weights | `deliver.csr_own` | a weight is read for each synapse |
    | dense | `deliver.scatter` | a row of weights (or the one weight) is added as a whole, without targets |
    | one-to-one | `deliver.scatter` | one target, without a table |
    | grid | `deliver.grid_add` | the weights of a kernel have the maps innermost: runs of neighbours |

    Joined with others: wherever sums keep their order (`building.joined_rows`; JOINED and JOINED_END).
    A row of its own (JOINED_ROW): at most as many runs as synapses, or 65,536 (`layout.in_runs`). Busy and large: the
    spikes of the step reach nearly all blocks (WAKE_ALL) of a population without COLLECTS, and these threads have more
    than 32,768 targets. Both functions for one weight are in `deliver`.

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
        # A spike stays in the log and is read LAG steps later, so no ring is written and read.
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
    # Synapses of a source are sorted by delay, then target, so each needs its own search for the thread.
    thread = owner(edges, target) if threads > 1 else 0
    return (source * n_delays + np.int64(delay) - shortest) * threads + thread


_BLOCK_SHIFT = np.uint64(t.BLOCK_SHIFT)

PREFETCH_DISTANCE = 16
"""Number of runs between a prefetch and its use."""

MOST = 2**32 - 1
"""Largest number of entries of a joined row. The end of a run is an index of an entry, stored in 32 bits. An entry is a
step from place to place: to a synapse, or of length FAR."""

FAR = 2**16 - 1
"""Step from place to place that ends at no synapse. Several steps reach a synapse at this distance or more.

Example: the steps from place 10 to a synapse at place 65,550 (distance 65,540) are FAR and 5.
"""


@kernel
def deliver_joined(view, begin, stop, step):
    """Add the arrivals of a step over all joined rows. Add first the projections that come before them in the sums."""
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
                # Counted over all threads, so that every thread takes the same decision to mark all blocks.
                if runs[run + threads] == runs[run]:
                    continue
                queue[n, 0], queue[n, 1] = runs[run + thread], runs[run + thread + 1]
                queue[n, 2] = net.log_counts[sender, place & mask]
                n += 1
                # The queue holds `QUEUE` runs of several spikes, so that prefetches work across spikes.
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
    """Add n weights times m to places of `buf`. Entries of `steps` are distances from place to place, from `at` on."""
    for k in range(n):
        at += np.uint64(steps[e + k])
        # Not even -0.0 may be added after a step without a synapse, because another thread may be adding there.
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
    """Like `add_steps`, for weights of both signs: negative weights are added `second` places further."""
    for k in range(n):
        at += np.uint64(steps[e + k])
        if steps[e + k] != FAR:
            weight = np.float64(weights[w + k]) * m
            buf[at + (second if weight < 0.0 else np.uint64(0))] += weight


@subkernel
def add_joined(view, row, thread, n, slot):
    """Add the first n runs of a thread's queue to the input of the present step, and mark the blocks that they reach.

    If there are many runs, all blocks are marked. The number of runs decides, because it does not depend on the number
    of threads. The number of entries does, because a long distance takes several entries.
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
                # Places of a further receptor follow those of the one before.
                while block >= blocks:
                    block -= blocks
                due[thread, mark + block] = 1
    if mark_all:
        for pop in range(net.pops.shape[0]):
            if net.joined_reach[row[t.ROW], pop] == 1:
                due[thread, slot + net.edges[pop, thread] : slot + net.edges[pop, thread + 1]] = 1


Listed = namedtuple("Listed", "row_ends targets delays edges shortest n_delays weights stride begin")
"""The synapses of a projection in the program's order, to be copied to joined rows or from them.

`edges` are the edges of the threads among the targets. `shortest` and `n_delays` are those of the joined row. `stride`
is 0 if all synapses share a weight. Target 0 is at place `begin`.
"""


@kernel
def lay_joined(first_source, end_source, part, at, following, steps, laid):
    """Copy the synapses of some sources of a projection to joined rows, or count them if `steps` is empty.

    Args:
        first_source: the first source.
        end_source: the end of the sources.
        part: the projection, a `Listed`.
        at: place of the last synapse of each run.
        following: next free entry of each run, or its number of entries while counting.
        steps: steps of the joined row.
        laid: weights of the joined row, or the one weight of all synapses.
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
