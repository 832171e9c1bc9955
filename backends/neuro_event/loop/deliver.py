"""Static delivery, which adds the spikes of one step to the input of a projection's targets.

`buf` has the input of the present step, (receptors, neurons), and then the rings of the projections whose spikes are
delivered at emission. `due` marks the blocks that receive input in a step.
"""

# mypy: ignore-errors

import numpy as np

from neuro.kernels.instructions import LANES, address, prefetch
from neuro.kernels.jit import inlined, kernel, subkernel
from neuro_event.loop import tables as t
from neuro_event.loop.tables import Destination, net_of, slot_mask

TARGETS_PER_LINE = 16
"""Number of targets (4 bytes each) in a cache line."""

_BLOCK_SHIFT = np.uint64(t.BLOCK_SHIFT)
_SPOT_SHIFT = np.uint64(3)
assert LANES == 1 << 3


@subkernel
def deliver_shared_weight(view, q, first_source, log_slot, begin, stop, out, mark, spot):
    """Deliver the spikes of a step to the targets of the threads begin:stop, with one weight for all synapses.

    `out` is the index of target 0 in `buf`. `mark` is the index of the population's first block in `due`, or -1 if the
    caller marks all blocks. `spot` is the index of the population's first group of eight neurons in `spots`, or -1 if
    `spots` is not used.
    """
    net = net_of(view)
    projection = net.projections[q]
    # The arrays are loaded into locals, because the compiler must assume that a store into `buf` may change the tables.
    # The code of a spike is inlined, so rows of one synapse are 1.4 times as fast: 10 ns a spike.
    targets, rows, buf, ids, counts = net.targets, net.rows, net.buf, net.log_ids, net.log_counts
    mask, source, senders = ids.shape[1] - 1, projection[t.SOURCE], net.edges.shape[1] - 1
    base, width = projection[t.ROW] + begin - first_source * senders, stop - begin
    weight, due, ending = net.weights[projection[t.WEIGHT]], net.due[begin], net.stop
    # Threads own ascending ids. Visited in order, they give the same sums as a single thread.
    for sender in range(senders):
        end = net.log_ends[sender, log_slot, source + 1]
        for place in range(net.log_ends[sender, log_slot, source], end):
            if ending[0] == t.AT_ONCE:
                return
            row = base + np.int64(ids[sender, place & mask]) * senders
            # Rows are scattered over a table of many megabytes, so the row of the next spike is prefetched.
            if place + 1 < end:
                next_row = base + np.int64(ids[sender, (place + 1) & mask]) * senders
            else:
                next_row = first_csr_row(view, projection, first_source, begin, sender + 1, log_slot, row)
            prefetch_at = address(targets) + 4 * rows[next_row]
            value = weight * np.float64(counts[sender, place & mask])
            first, last = rows[row], rows[row + width]
            add_weight(targets, first, last, value, buf, out, prefetch_at)
            if mark >= 0 and width == 1:
                mark_blocks(targets, first, last, due, mark)
            elif mark >= 0:
                for thread in range(begin, stop):
                    k = row + thread - begin
                    mark_blocks(targets, rows[k], rows[k + 1], net.due[thread], mark)
            if spot >= 0:
                mark_spots(targets, first, last, net.spots, spot)


@subkernel
def mark_spots(targets, first, last, spots, spot):
    """Mark the spots (groups of eight neurons) of the targets first:last. `spot` is the index for target 0."""
    begin = np.uint64(spot)
    for e in range(np.uint64(first), np.uint64(last)):
        spots[begin + (np.uint64(targets[e]) >> _SPOT_SHIFT)] = 1


@inlined
def csr_row(view, projection, first_source, thread, sender, place):
    """Return the CSR row of a spike in the log of thread `sender`, for the targets of `thread`."""
    net = net_of(view)
    source = np.int64(net.log_ids[sender, place & (net.log_ids.shape[1] - 1)]) - first_source
    return projection[t.ROW] + source * (net.edges.shape[1] - 1) + thread


@subkernel
def first_csr_row(view, projection, first_source, thread, sender, log_slot, otherwise):
    """Return the CSR row of the first spike of a step in the logs of thread `sender` and later threads.

    Return `otherwise` if there is none.
    """
    net = net_of(view)
    while sender < net.edges.shape[1] - 1:
        place = net.log_ends[sender, log_slot, projection[t.SOURCE]]
        if place < net.log_ends[sender, log_slot, projection[t.SOURCE] + 1]:
            return csr_row(view, projection, first_source, thread, sender, place)
        sender += 1
    return otherwise


@inlined
def add_weight(targets, first, last, value, buf, out, prefetch_at):
    """Add a value to the targets first:last, and prefetch the next spike's targets from the address `prefetch_at`."""
    begin = np.uint64(out)  # numba emits no check for a negative value of an unsigned index
    # Whole cache lines of 16 targets, with one prefetch each.
    line_end = first + (last - first) // TARGETS_PER_LINE * TARGETS_PER_LINE
    for line in range(np.uint64(first), np.uint64(line_end), np.uint64(TARGETS_PER_LINE)):
        prefetch(prefetch_at + 4 * (np.int64(line) - first))
        for k in range(np.uint64(TARGETS_PER_LINE)):
            buf[begin + np.uint64(targets[line + k])] += value
    for e in range(np.uint64(line_end), np.uint64(last)):
        buf[begin + np.uint64(targets[e])] += value


@inlined
def mark_blocks(targets, first, last, due, mark):
    """Mark the blocks of the targets first:last. `mark` is the index of the population's first block.

    The marks have a separate loop, because other stores would slow the loop of additions. `due` is small enough for the
    first-level cache.
    """
    begin = np.uint64(mark)
    for e in range(np.uint64(first), np.uint64(last)):
        due[begin + (np.uint64(targets[e]) >> _BLOCK_SHIFT)] = 1


RANGE = 1 << 15
"""Number of targets in a range. Their input, 256 kB, fills at most half of a core's second-level cache."""


@subkernel
def deliver_in_ranges(view, q, first_source, log_slot, begin, stop, lo, hi, out):
    """Deliver the spikes of a step to the targets lo:hi of the threads begin:stop. `out` is the index of target 0."""
    net = net_of(view)
    projection = net.projections[q]
    mask = net.log_ids.shape[1] - 1
    queue = net.queue[begin]
    n = 0
    for sender in range(net.edges.shape[1] - 1):
        for place in range(
            net.log_ends[sender, log_slot, projection[t.SOURCE]],
            net.log_ends[sender, log_slot, projection[t.SOURCE] + 1],
        ):
            row = csr_row(view, projection, first_source, begin, sender, place)
            queue[n, 0], queue[n, 1] = net.rows[row], net.rows[row + stop - begin]
            queue[n, 2] = net.log_counts[sender, place & mask]
            n += 1
            if n == queue.shape[0]:
                if net.stop[0] == t.AT_ONCE:
                    return
                add_rows(net.targets, queue, n, net.weights[projection[t.WEIGHT]], net.buf, out, lo, hi)
                n = 0
    add_rows(net.targets, queue, n, net.weights[projection[t.WEIGHT]], net.buf, out, lo, hi)


@subkernel
def add_rows(targets, queue, n, weight, buf, out, lo, hi):
    """Add the first n rows of the queue, whose targets ascend.

    Column 0 of the queue advances to the first target that was not added yet.
    """
    ranges = -(-(hi - lo) // RANGE)
    # The inner loop is over spikes, so each input is still summed in the order of spikes.
    for r in range(ranges):
        below = lo + (hi - lo) * (r + 1) // ranges
        for k in range(n):
            prefetch_at = address(targets) + 4 * queue[min(k + 1, n - 1), 0]
            value = weight * np.float64(queue[k, 2])
            queue[k, 0] = add_below(targets, queue[k, 0], queue[k, 1], below, value, buf, out, prefetch_at)


@subkernel
def add_below(targets, first, last, below, value, buf, out, prefetch_at):
    """Add a value to those targets among first:last that are below a bound. Return the end of these targets.

    The targets of the next spike are prefetched from the address `prefetch_at`.
    """
    begin = np.uint64(out)
    e = first
    # Targets ascend. If the last target of a cache line is below the bound, all 16 targets are.
    while e + TARGETS_PER_LINE <= last and targets[e + TARGETS_PER_LINE - 1] < below:
        prefetch(prefetch_at + 4 * (e - first))
        line = np.uint64(e)
        for k in range(np.uint64(TARGETS_PER_LINE)):
            buf[begin + np.uint64(targets[line + k])] += value
        e += TARGETS_PER_LINE
    while e < last and targets[e] < below:
        buf[begin + np.uint64(targets[e])] += value
        e += 1
    return e


@inlined
def count_spikes(net, source, slot):
    """Return the number of neurons of a population that fired in the step whose slot of the log is `slot`."""
    n = 0
    for sender in range(net.edges.shape[1] - 1):
        # Populations are logged in order, so a population ends where the next one begins.
        n += net.log_ends[sender, slot, source + 1] - net.log_ends[sender, slot, source]
    return n


@subkernel
def receptor(weight, receptors):
    """Return the index of the receptor that the sign of a weight chooses."""
    return 1 if receptors == 2 and weight < 0.0 else 0


@subkernel
def first_receptor(row):
    """Return the named receptor of a projection, or 0, the first receptor that it may reach."""
    return max(row[t.RECEPTOR], 0)


@subkernel
def receptors_by_sign(row, receptors):
    """Return the number of receptors among which the sign of a weight chooses: 1 if the receptor is named."""
    return receptors if row[t.RECEPTOR] < 0 else 1


@subkernel
def csr_own(view, first, last, w, m, thread, destination):
    """Add the weights of the synapses first:last, times m, to their targets. `w` is the index of the first weight."""
    net = net_of(view)
    targets, weights, buf, due = net.targets, net.weights, net.buf, net.due[thread]
    if destination.receptors == 2:
        for e in range(first, last):
            weight = weights[w + e - first] * m
            buf[destination.out + np.int64(targets[e]) + (destination.receptor_stride if weight < 0.0 else 0)] += weight
    else:
        # Unsigned indices need no test for negative values.
        begin, shift = np.uint64(destination.out), np.uint64(w) - np.uint64(first)
        for e in range(np.uint64(first), np.uint64(last)):
            buf[begin + np.uint64(targets[e])] += weights[shift + e] * m
    # The marks have a separate loop, because other stores would slow the loop above. Their few bytes stay in the cache.
    if destination.mark >= 0:
        for e in range(first, last):
            due[destination.mark + (np.int64(targets[e]) >> t.BLOCK_SHIFT)] = 1


@subkernel
def csr_delayed(view, q, source_id, m, step, after, thread, lo, hi):
    """Deliver one spike into the ring of a projection with individual delays, to the targets lo:hi.

    Synapses at which the spike arrives up to step `after` are skipped, because they have been served.
    """
    net = net_of(view)
    row = net.projections[q]
    threads, blocks, slots = net.edges.shape[1] - 1, net.awake.shape[0], slot_mask(net)
    # Each row has a piece for each thread, but synapses that are sorted by delay are not sorted by target. So each
    # thread reads all pieces of a row and skips the targets of other threads.
    place, receptors = row[t.ROW] + source_id * threads, net.pops[row[t.TARGET], t.RECEPTORS]
    receptor_stride, base, n_receptors = row[t.RING_SIZE], first_receptor(row), receptors_by_sign(row, receptors)
    mark = net.pops[row[t.TARGET], t.FIRST_BLOCK]
    for e in range(net.rows[place], net.rows[place + threads]):
        target = np.int64(net.targets[e])
        if target < lo or target >= hi:
            continue
        s = e - row[t.SYNAPSE]
        at = step + np.int64(net.delays[row[t.DELAY] + s * row[t.DELAY_STRIDE]])
        if at <= after:
            continue
        weight = net.weights[row[t.WEIGHT] + s * row[t.WEIGHT_STRIDE]] * m
        ring_at = (at & row[t.RING_MASK]) * receptors + base + receptor(weight, n_receptors)
        net.buf[row[t.RING] + ring_at * receptor_stride + target] += weight
        net.due[thread, (at & slots) * blocks + mark + (target >> t.BLOCK_SHIFT)] = 1


@subkernel
def grid_add(view, row, source, m, thread, lo, hi, destination):
    """Add the kernel of a grid, with maps innermost, to the targets lo:hi around one source, and mark the blocks.

    Negative weights are added `receptor_stride` places further, to the second receptor. A stride of 0 means that all
    weights go to one receptor.
    """
    net, (out, _, receptor_stride, mark, _) = net_of(view), destination
    weights, buf, due = net.weights, net.buf, net.due[thread]
    width, sheet = row[t.CHANNEL_WIDTH], row[t.CHANNEL_HEIGHT] * row[t.CHANNEL_WIDTH]
    maps, rows, columns, reach = row[t.MAPS], row[t.ROWS], row[t.COLUMNS], row[t.REACH]
    # A source that is also the target of a grid has the channels innermost, other sources outermost, in id order.
    inside = row[t.CHANNELS_INSIDE]
    channel, pixel = (source % inside, source // inside) if inside > 0 else (source // sheet, source % sheet)
    y, x = pixel // width + row[t.TOP], pixel % width + row[t.LEFT]
    stride = row[t.STRIDE]
    # In a grouped convolution a channel reaches only the maps of its own group.
    first_map, channel = channel // row[t.DEPTH] * reach, channel % row[t.DEPTH]
    first, last = max(0, (x - row[t.KERNEL_WIDTH]) // stride + 1), min(columns, x // stride + 1)
    for r in range(max(0, (y - row[t.KERNEL_HEIGHT]) // stride + 1), min(rows, y // stride + 1)):
        line = r * columns * maps + first_map
        if mark >= 0:
            begin, end = max(lo, line + first * maps), min(hi, line + (last - 1) * maps + reach)
            if begin < end:
                # The places of a row of the grid are neighbours in memory, so their blocks are marked at once.
                due[mark + (begin >> t.BLOCK_SHIFT) : mark + ((end - 1) >> t.BLOCK_SHIFT) + 1] = 1
        for c in range(first, last):
            place = (channel * row[t.KERNEL_HEIGHT] + y - r * stride) * row[t.KERNEL_WIDTH] + x - c * stride
            target = line + c * maps
            begin, end = max(lo, target), min(hi, target + reach)
            if begin >= end:
                continue
            # Maps are innermost, so a spike adds neighbouring weights to neighbouring neurons in a vectorised loop.
            w = row[t.WEIGHT] + place * maps + first_map + begin - target
            # The receptor is chosen for each weight only if signs are mixed.
            if receptor_stride != 0:
                for k in range(end - begin):
                    weight = weights[w + k] * m
                    buf[out + begin + k + (receptor_stride if weight < 0.0 else 0)] += weight
            else:
                targets, row_weights = buf[out + begin : out + end], weights[w : w + end - begin]
                for k in range(row_weights.size):
                    targets[k] += row_weights[k] * m


@subkernel
def add_by_sign(weights, m, first, second):
    """Add weights times m, the negative weights to the second receptor and the others to the first receptor.

    The opposite receptor gets -0.0, which changes no bit. So there is no branch, and the loop is vectorised.
    """
    for i in range(weights.size):
        weight = weights[i] * m
        second[i] += weight if weight < 0.0 else -0.0
        first[i] += -0.0 if weight < 0.0 else weight


@subkernel
def scatter(view, q, source_id, m, thread, lo, hi, n, destination):
    """Deliver a spike of multiplicity m over a projection with a single delay, to the targets lo:hi of n targets."""
    net, (out, receptors, receptor_stride, mark, spot) = net_of(view), destination
    row, buf, weights = net.projections[q], net.buf, net.weights
    layout = row[t.LAYOUT]
    if layout == t.CSR:
        place = row[t.ROW] + source_id * (net.edges.shape[1] - 1) + thread
        first, last = net.rows[place], net.rows[place + 1]
        w = row[t.WEIGHT] + first - row[t.SYNAPSE]
        csr_own(view, first, last, w, m, thread, destination)
        if spot >= 0:
            mark_spots(net.targets, first, last, net.spots, spot)
    elif layout == t.DENSE:
        # A row of weights and its targets are contiguous in memory, so the loops below are vectorised.
        w = row[t.WEIGHT] + source_id * n
        if row[t.WEIGHT_STRIDE] == 0:
            weight = weights[row[t.WEIGHT]] * m
            receptor_out = out + receptor(weight, receptors) * receptor_stride
            targets = buf[receptor_out + lo : receptor_out + hi]
            for k in range(targets.size):
                targets[k] += weight
        elif row[t.SIGN] != t.MIXED or receptors == 1:
            receptor_out = out + (receptor_stride if row[t.SIGN] == t.NEGATIVE and receptors == 2 else 0)
            targets, row_weights = buf[receptor_out + lo : receptor_out + hi], weights[w + lo : w + hi]
            for k in range(targets.size):
                targets[k] += row_weights[k] * m
        else:
            receptor_out = out + receptor_stride
            add_by_sign(
                weights[w + lo : w + hi], m, buf[out + lo : out + hi], buf[receptor_out + lo : receptor_out + hi]
            )
    elif layout == t.ONE_TO_ONE:
        # The only target may belong to another thread.
        if lo <= source_id < hi:
            weight = weights[row[t.WEIGHT] + source_id * row[t.WEIGHT_STRIDE]] * m
            buf[out + source_id + receptor(weight, receptors) * receptor_stride] += weight
            if mark >= 0:
                net.due[thread, mark + (source_id >> t.BLOCK_SHIFT)] = 1
    elif row[t.SIGN] == t.MIXED and receptors == 2:
        grid_add(view, row, source_id, m, thread, lo, hi, destination)
    else:
        receptor_out = out + (receptor_stride if row[t.SIGN] == t.NEGATIVE and receptors == 2 else 0)
        grid_add(view, row, source_id, m, thread, lo, hi, Destination(receptor_out, 1, 0, mark, spot))


@kernel
def deliver_log(view, q, sent_step, now, begin, stop, ring):
    """Deliver the spikes of step `sent_step` over projection q, to the targets of the threads begin:stop.

    With `ring`, spikes that arrive after `now` are added to the slot of the arrival in the ring of the projection.
    Without `ring` the spikes are added to the input of step `now`.
    """
    net = net_of(view)
    row = net.projections[q]
    target = net.pops[row[t.TARGET]]
    edges = net.edges[target[t.NUMBER]]
    # A small population may have no neuron in these threads.
    if edges[begin] >= edges[stop]:
        return
    own_delays = ring and row[t.DELAY_STRIDE] == 1
    if ring:
        arrival_step = sent_step + np.int64(net.delays[row[t.DELAY]])
        out = row[t.RING] + (arrival_step & row[t.RING_MASK]) * target[t.RECEPTORS] * row[t.RING_SIZE]
        receptor_stride = row[t.RING_SIZE]
    else:
        arrival_step = now
        out = target[t.BEGIN]
        receptor_stride = net.x.shape[1]
    # A named receptor shifts the whole delivery to its places.
    out += first_receptor(row) * receptor_stride
    log_slot = sent_step & (net.log_ends.shape[1] - 1)
    due_slot = (arrival_step & slot_mask(net)) * net.awake.shape[0]
    spot = target[t.BEGIN] // LANES if target[t.COLLECTS] >= 0 else -1
    # If the spikes reach nearly all blocks, it is faster to mark all blocks than to mark a block for each synapse.
    mark_all = not own_delays and spot < 0 and count_spikes(net, row[t.SOURCE], log_slot) >= row[t.WAKE_ALL]
    mark = -1 if mark_all else due_slot + target[t.FIRST_BLOCK]
    if row[t.LAYOUT] == t.CSR and row[t.WEIGHT_STRIDE] == 0 and not own_delays:
        to = out + receptor(net.weights[row[t.WEIGHT]], receptors_by_sign(row, target[t.RECEPTORS])) * receptor_stride
        source, n = net.pops[row[t.SOURCE], t.BEGIN], (edges[stop] - edges[begin]) * t.BLOCK
        # Ranges are faster only if the input is larger than the second-level cache.
        if mark_all and n > RANGE:
            lo = edges[begin] * t.BLOCK - target[t.BEGIN]
            deliver_in_ranges(
                view, q, source, log_slot, begin, stop, lo, min(lo + n, target[t.END] - target[t.BEGIN]), to
            )
        else:
            deliver_shared_weight(view, q, source, log_slot, begin, stop, to, mark, spot)
    else:
        for thread in range(begin, stop):
            deliver_each(view, q, sent_step, now, log_slot, thread, out, receptor_stride, mark, spot)
    if mark_all:
        for thread in range(begin, stop):
            net.due[thread, due_slot + edges[thread] : due_slot + edges[thread + 1]] = 1


@subkernel
def deliver_each(view, q, sent_step, now, log_slot, thread, out, receptor_stride, mark, spot):
    """Deliver the spikes of a step to a thread's targets, spike by spike.

    This is the path of all projections, except CSR projections with a single weight and a single delay.
    """
    net = net_of(view)
    row = net.projections[q]
    source, target = net.pops[row[t.SOURCE]], net.pops[row[t.TARGET]]
    n = target[t.END] - target[t.BEGIN]
    lo = net.edges[target[t.NUMBER], thread] * t.BLOCK - target[t.BEGIN]
    hi = min(net.edges[target[t.NUMBER], thread + 1] * t.BLOCK - target[t.BEGIN], n)
    mask, receptors = net.log_ids.shape[1] - 1, receptors_by_sign(row, target[t.RECEPTORS])
    destination = Destination(out, receptors, receptor_stride, mark, spot)
    if lo >= hi:
        return
    # Threads own ascending ids. Visited in order, they give the same sums as a single thread.
    for sender in range(net.edges.shape[1] - 1):
        for place in range(
            net.log_ends[sender, log_slot, row[t.SOURCE]], net.log_ends[sender, log_slot, row[t.SOURCE] + 1]
        ):
            source_id = np.int64(net.log_ids[sender, place & mask]) - source[t.BEGIN]
            m = np.float64(net.log_counts[sender, place & mask])
            if net.stop[0] == t.AT_ONCE:
                return
            if row[t.LAYOUT] == t.CSR and row[t.DELAY_STRIDE] == 1:
                csr_delayed(view, q, source_id, m, sent_step, now, thread, lo, hi)
            else:
                scatter(view, q, source_id, m, thread, lo, hi, n, destination)
