"""Delivery at arrival, for projections whose synapses are sorted by source, then delay, and for joined rows.

A run is the synapses of a source with the same delay. A step adds to its input the runs of all spikes whose age equals
the delay. The input of one step stays in the cache; a ring of all future steps would not. Spikes are added by age, the
oldest first, then by id, and the targets of a run ascend. So the order of all sums is that of the reference. The order
is the same for any number of threads, because each target belongs to one thread.

If each projection has few synapses, runs are short and most are empty, but a step looks for a run of each projection
and delay. In a joined row a run holds the synapses of a source neuron onto all targets, of many projections, so a step
looks for one run per source population and delay. A joined row reaches each target by a single projection, and rows
follow the order of projections (see `building.joined_rows`), so the order of each sum stays. A synapse of a joined row
takes six bytes: the synapses of a run are sorted by place, so 16 bits store the distance to the next place, and a
weight that fits into 32 bits is stored in 32 bits. Memory bandwidth sets the time: rows of six bytes take half the time
of rows of twelve.
"""

# mypy: ignore-errors
from collections import namedtuple

import numpy as np

from neuro.kernels.instructions import address, prefetch
from neuro.kernels.jit import inlined, kernel, subkernel
from neuro_event.loop import tables as t
from neuro_event.loop.deliver import (
    add_weight,
    count_spikes,
    csr_own,
    first_receptor,
    mark_blocks,
    receptor,
    receptors_by_sign,
)
from neuro_event.loop.tables import Destination, add_counts, arrive as call_arrive, deliver_log, net_of, slot_mask

PREFETCH_DISTANCE = 6
"""Number of runs between a prefetch and its use."""

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


@subkernel
def prefetch_run(view, row, first, last):
    """Prefetch the targets and the weights of a run."""
    net = net_of(view)
    targets = address(net.targets) + 4 * row[t.SYNAPSE]
    prefetch_lines(targets + 4 * first, targets + 4 * last)
    if row[t.WEIGHT_STRIDE] == 1:
        weights = address(net.weights) + 8 * row[t.WEIGHT]
        prefetch_lines(weights + 8 * first, weights + 8 * last)


@subkernel
def add_run(view, row, thread, first, last, m, receptors, receptor_stride, out, mark):
    """Add a run (synapses first:last of its projection) to the input, in which target 0 is at `out`."""
    net = net_of(view)
    e = row[t.SYNAPSE]
    if row[t.WEIGHT_STRIDE] == 0:
        weight = net.weights[row[t.WEIGHT]] * m
        at = out + receptor(weight, receptors) * receptor_stride
        own_address = address(net.targets) + 4 * (e + first)
        # `add_weight` prefetches the next row. Runs are prefetched already, so it gets the address of this run.
        add_weight(net.targets, e + first, e + last, weight, net.buf, at, own_address)
        if mark >= 0:
            mark_blocks(net.targets, e + first, e + last, net.due[thread], mark)
    else:
        n_receptors, at = receptors, out
        # If all weights have one sign, the receptor is chosen once instead of for each synapse.
        if receptors == 2 and row[t.SIGN] != t.MIXED:
            n_receptors, at = 1, out + (receptor_stride if row[t.SIGN] == t.NEGATIVE else 0)
        destination = Destination(at, n_receptors, receptor_stride, mark, -1)
        csr_own(view, e + first, e + last, row[t.WEIGHT] + first, m, thread, destination)


@subkernel
def add_queue(view, row, thread, n, total, slot):
    """Add the first n runs of a thread's queue to the input of the present step, whose marks begin at `slot`.

    If `total`, the number of synapses on all threads, is large, all blocks are marked.
    """
    net = net_of(view)
    target = net.pops[row[t.TARGET]]
    queue = net.queue[thread]
    receptor_stride = net.x.shape[1]
    out = target[t.BEGIN] + first_receptor(row) * receptor_stride
    receptors = receptors_by_sign(row, target[t.RECEPTORS])
    # With two synapses per block nearly all blocks would be marked.
    mark_all = total > 2 * (target[t.LAST_BLOCK] - target[t.FIRST_BLOCK])
    mark = -1 if mark_all else slot + target[t.FIRST_BLOCK]
    for k in range(min(PREFETCH_DISTANCE, n)):
        prefetch_run(view, row, queue[k, 0], queue[k, 1])
    for k in range(n):
        if k + PREFETCH_DISTANCE < n:
            prefetch_run(view, row, queue[k + PREFETCH_DISTANCE, 0], queue[k + PREFETCH_DISTANCE, 1])
        add_run(
            view, row, thread, queue[k, 0], queue[k, 1], np.float64(queue[k, 2]), receptors, receptor_stride, out, mark
        )
    if mark_all:
        first_block = net.edges[target[t.NUMBER], thread]
        last_block = net.edges[target[t.NUMBER], thread + 1]
        net.due[thread, slot + first_block : slot + last_block] = 1


@kernel
def arrive(view, q, step, thread):
    """Add the spikes that arrive in a step over a projection to the input of this thread's targets."""
    net = net_of(view)
    row = net.projections[q]
    # No target belongs to this thread.
    if net.edges[row[t.TARGET], thread] >= net.edges[row[t.TARGET], thread + 1]:
        return
    gather_runs(view, row, net.runs, step, thread, add_queue)


@inlined
def gather_runs(view, row, runs, step, thread, add):
    """Gather the runs that arrive in a step. `add` (`add_queue` or `add_joined`) adds them when the queue is full."""
    net = net_of(view)
    threads = net.edges.shape[1] - 1
    first_source = net.pops[row[t.SOURCE], t.BEGIN]
    blocks = net.awake.shape[0]
    slot = (step & slot_mask(net)) * blocks
    # The input of a step stays in the cache. A ring of a large network would not, and a write into a ring cost 42 ns an
    # # event. Runs are short and scattered in memory, so they are gathered first and prefetched.
    queue = net.queue[thread]
    mask, steps = net.log_ids.shape[1] - 1, net.log_ends.shape[1] - 1
    n = total = 0
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
                # Counted over all threads, so that every thread takes the same decision in `add_queue` to mark all
                # blocks.
                synapses = np.int64(runs[run + threads]) - np.int64(runs[run])
                if synapses == 0:
                    continue
                total += synapses
                queue[n, 0], queue[n, 1] = runs[run + thread], runs[run + thread + 1]
                queue[n, 2] = net.log_counts[sender, place & mask]
                n += 1
                # The queue holds `QUEUE` runs of several spikes, so that prefetches work across spikes.
                if n == queue.shape[0]:
                    if net.stop[0] == t.AT_ONCE:
                        return
                    add(view, row, thread, n, total, slot)
                    n = total = 0
    if n > 0:
        add(view, row, thread, n, total, slot)


@kernel
def at_emission(view, q, step, after, thread):
    """Write the spikes emitted in `step` that arrive later than step `after` into the projection's ring."""
    net = net_of(view)
    row = net.projections[q]
    # Weights were set after this step. `deliver_between` has written its spikes to the ring with the old weights.
    if step <= net.set_out[q]:
        return
    if row[t.RUN] < 0:
        log_delivery(view, q, step, after, thread, thread + 1, True)
        return
    mask, slot = net.log_ids.shape[1] - 1, step & (net.log_ends.shape[1] - 1)
    for sender in range(net.edges.shape[1] - 1):
        for place in range(net.log_ends[sender, slot, row[t.SOURCE]], net.log_ends[sender, slot, row[t.SOURCE] + 1]):
            if net.stop[0] == t.AT_ONCE:
                return
            i = np.int64(net.log_ids[sender, place & mask]) - net.pops[row[t.SOURCE], t.BEGIN]
            write_to_ring(view, row, i, np.float64(net.log_counts[sender, place & mask]), step, after, thread)


@subkernel
def write_to_ring(view, row, i, m, step, after, thread):
    """Write the spike of source i in a step, with multiplicity m, into the ring of its projection."""
    net = net_of(view)
    target = net.pops[row[t.TARGET]]
    threads = net.edges.shape[1] - 1
    blocks = net.awake.shape[0]
    slots = slot_mask(net)
    receptors = target[t.RECEPTORS]
    for d in range(row[t.DELAYS]):
        at = step + row[t.SHORTEST] + d
        run = row[t.RUN] + (i * row[t.DELAYS] + d) * threads + thread
        first, last = np.int64(net.runs[run]), np.int64(net.runs[run + 1])
        # Arrivals up to `after` are already in the sums of their step.
        if at <= after or first == last:
            continue
        out = row[t.RING] + ((at & row[t.RING_MASK]) * receptors + first_receptor(row)) * row[t.RING_SIZE]
        mark = (at & slots) * blocks + target[t.FIRST_BLOCK]
        add_run(view, row, thread, first, last, m, receptors_by_sign(row, receptors), row[t.RING_SIZE], out, mark)


@subkernel
def owner(edges, block):
    """Return the thread that owns a block."""
    thread = 0
    while block >= edges[thread + 1]:
        thread += 1
    return thread


@kernel
def deliver_counts(view, q, first, last):
    """Write the spike counts of the steps first..last of a poisson_generator into the ring of a projection.

    The projection is one-to-one, and each step has a slot in the ring.
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
        ring = row[t.RING] + ((at & row[t.RING_MASK]) * target[t.RECEPTORS] + first_receptor(row)) * row[t.RING_SIZE]
        for i in range(n):
            m = net.counts[place + i]
            if m > 0:
                weight = net.weights[row[t.WEIGHT] + i * row[t.WEIGHT_STRIDE]]
                receptor_index = receptor(weight, receptors_by_sign(row, target[t.RECEPTORS]))
                net.buf[ring + receptor_index * row[t.RING_SIZE] + i] += weight * m
                # Each thread has its own row of arrival marks, so the row of the owner of the block is marked.
                block = target[t.FIRST_BLOCK] + i // t.BLOCK
                net.due[owner(net.edges[row[t.TARGET]], block), (at & slots) * blocks + block] = 1


@kernel
def deliver_between(view, q, first, last, now):
    """Write the spikes of the steps first..last that arrive after `now` into the ring of a projection."""
    net = net_of(view)
    for thread in range(net.edges.shape[1] - 1):
        for step in range(max(first, net.clock[thread, t.HORIZON] + 1), last + 1):
            at_emission(view, q, step, now, thread)


@inlined
def log_delivery(view, q, j, k, begin, stop, ring):
    """Deliver the spikes of step j over projection q with `deliver_log`, if there are any."""
    net = net_of(view)
    # Tested before the call, because most projections have no spike in most steps.
    if count_spikes(net, net.projections[q, t.SOURCE], j & (net.log_ends.shape[1] - 1)) > 0:
        deliver_log(view, q, j, k, begin, stop, ring)


@inlined
def deliver(view, first, last, begin, stop, step):
    """Add arrivals of a step over the projections first:last of `incoming`, to neurons of the threads begin:stop.

    The path of a projection is the first row whose condition holds:

    | condition | path | reason |
    | --- | --- | --- |
    | the target of a current | `generators.drive` | no spikes: currents are summed along lines |
    | learns by spike pairs | ring, at emission, by the rule's entry | the weight is that at emission |
    | a grid whose kernels learn by spike pairs | ring, `at_emission`, before it learns | the same, per step |
    | static, own delays, joined rows (below) | `deliver_joined` | one look-up, long runs for all targets |
    | static, own delays, few runs (below) | `arrive` | its input stays in the cache: 5 ns an event |
    | own delays otherwise | ring, `deliver.csr_delayed` | most runs would be empty: 42 ns an event |
    | weights were set | ring, `at_emission` | spikes under way keep the old weights |
    | one-to-one from a busy `poisson_generator` | `generators.add_counts` | counts instead of a list: 0.7 ns a draw |
    | CSR, one weight, busy and large (below) | `deliver_in_ranges` | the input of a range fits the second-level cache |
    | CSR, one weight | `deliver_shared_weight` | one multiplication a spike; the next row is prefetched |
    | CSR, own weights | `deliver.csr_own` | a weight is read for each synapse |
    | dense | `deliver.scatter` | a row of weights (or the one weight) is added as a whole, without targets |
    | one-to-one | `deliver.scatter` | one target, without a table |
    | grid | `deliver.grid_add` | the weights of a kernel have the maps innermost: runs of neighbours |

    Joined rows: wherever sums keep their order (`building.joined_rows`); JOINED and JOINED_END. Few runs: at most as
    many as synapses, or 65,536; not for grids (`layout.in_runs`). Busy and large: the spikes of the step reach nearly
    all blocks (WAKE_ALL) of a population without COLLECTS, and these threads have more than 32,768 targets. Both
    functions for one weight are in `deliver`.

    RUN, LAG, WEIGHT_STRIDE and WAKE_ALL are set in `building.projections`, LAYOUT in `building.layout`, DENSE_COUNTS in
    `building.build`. Projections with LAG 0 have a ring and are not delivered here.
    """
    net = net_of(view)
    for k in range(first, last):
        q = net.incoming[k]
        projection = net.projections[q]
        if projection[t.RUN] >= 0:
            for thread in range(begin, stop):
                call_arrive(view, q, step, thread)
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


@kernel
def by_delay(row_ends, targets, delays):
    """Return whether the synapses of every source are sorted by delay, then target."""
    for source in range(row_ends.size - 1):
        row, ids = delays[row_ends[source] : row_ends[source + 1]], targets[row_ends[source] : row_ends[source + 1]]
        disorder = 0
        for e in range(1, row.size):  # without an early exit, so that the loop is vectorised
            disorder += (row[e] < row[e - 1]) | ((row[e] == row[e - 1]) & (ids[e] < ids[e - 1]))
        if disorder > 0:
            return False
    return True


@kernel
def fill_runs(row_ends, targets, delays, edges, shortest, n_delays, runs):
    """Compute the ends of the runs of each source, delay and thread. `edges` are local targets; `runs` must be 0."""
    count_runs(row_ends, targets, delays, edges, shortest, n_delays, runs)
    for k in range(1, runs.size):
        runs[k] += runs[k - 1]


@inlined
def run_of(source, delay, target, shortest, n_delays, edges):
    """Return the number of a run among all: by source, delay, and the thread of the target."""
    threads = edges.size - 1
    # Synapses of a source are sorted by delay, then target, so each needs its own search for the thread.
    thread = owner(edges, target) if threads > 1 else 0
    return (source * n_delays + np.int64(delay) - shortest) * threads + thread


@kernel
def count_runs(row_ends, targets, delays, edges, shortest, n_delays, runs):
    """Count the synapses of each run, in the entry after that of the run."""
    for source in range(row_ends.size - 1):
        for e in range(row_ends[source], row_ends[source + 1]):
            runs[run_of(source, delays[e], targets[e], shortest, n_delays, edges) + 1] += np.uint32(1)


_BLOCK_SHIFT = np.uint64(t.BLOCK_SHIFT)

JOINED_PREFETCH_DISTANCE = 16
"""Number of runs of joined rows between a prefetch and its use."""

FAR = 2**16 - 1
"""A step without a synapse. A synapse at this distance or more is reached by several steps.

Example: the steps from place 10 to a synapse at place 65,550 (distance 65,540) are FAR and 5.
"""


@kernel
def deliver_joined(view, begin, stop, step):
    """Add the arrivals of a step over all joined rows, after those of the projections that come first in the sums."""
    net = net_of(view)
    for pop in range(net.pops.shape[0]):
        deliver(view, net.pops[pop, t.ARRIVALS], net.pops[pop, t.JOINED], begin, stop, step)
    for k in range(net.joined.shape[0]):
        for thread in range(begin, stop):
            gather_runs(view, net.joined[k], net.joined_runs, step, thread, add_joined)


@subkernel
def prefetch_joined(view, row, first, last):
    """Prefetch the steps and the weights of a run of a joined row."""
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
    """Add n weights times m to places of `buf`. Each place is some steps after the last one, the first after `at`."""
    for k in range(n):
        at += np.uint64(steps[e + k])
        # Not even -0.0 may be added after a step without a synapse, because another thread may be adding there.
        if steps[e + k] != FAR:
            buf[at] += np.float64(weights[w + k]) * m


@subkernel
def add_steps_by_sign(steps, weights, e, w, n, at, second, m, buf):
    """Like `add_steps`, for weights of both signs: negative weights are added `second` places further."""
    for k in range(n):
        at += np.uint64(steps[e + k])
        if steps[e + k] != FAR:
            weight = np.float64(weights[w + k]) * m
            buf[at + (second if weight < 0.0 else np.uint64(0))] += weight


@subkernel
def add_joined(view, row, thread, n, total, slot):
    """Add the first n runs of a thread's queue to the input of the present step, and mark the blocks that they reach.

    Many runs mark all blocks. Their number `n` does not depend on the threads. `total` would, as it counts long steps
    twice.
    """
    net = net_of(view)
    queue, buf, steps, due = net.queue[thread], net.buf, net.joined_steps, net.due
    e, w, base = np.uint64(row[t.SYNAPSE]), np.uint64(row[t.WEIGHT]), np.uint64(net.joined_bases[row[t.ROW], thread])
    second = np.uint64(net.x.shape[1])
    begin = base + (second if row[t.SIGN] == t.NEGATIVE else np.uint64(0))
    mark_all = n > row[t.WAKE_ALL]
    blocks, mark = np.uint64(net.awake.shape[0]), np.uint64(slot)
    for k in range(min(JOINED_PREFETCH_DISTANCE, n)):
        prefetch_joined(view, row, queue[k, 0], queue[k, 1])
    for k in range(n):
        if k + JOINED_PREFETCH_DISTANCE < n:
            prefetch_joined(view, row, queue[k + JOINED_PREFETCH_DISTANCE, 0], queue[k + JOINED_PREFETCH_DISTANCE, 1])
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
                # Places of the second receptor follow those of the first.
                due[thread, mark + block - (blocks if block >= blocks else np.uint64(0))] = 1
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
        laid: weights of the joined row.
    """
    copies = steps.size > 0
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
                    steps[e], laid[e] = FAR, -0.0
                e += np.uint32(1)
                step -= FAR
            if copies:
                steps[e], laid[e] = step, part.weights[k * np.uint64(part.stride)]
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
