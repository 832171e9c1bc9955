"""Spikes over synapses of one weight, most often all of a projection's.

In a large network the targets of a spike are scattered over the whole population. If their input does not fit into a
core's cache, all spikes of a step are added to one range of targets, then to the next. The sums are those without
ranges.
"""

# mypy: ignore-errors
import numpy as np

from neuro.kernels.instructions import LANES, address, prefetch
from neuro.kernels.jit import inlined, subkernel
from neuro_event.loop import tables as t
from neuro_event.loop.tables import net_of

TARGETS_PER_LINE = 16
"""Targets (4 bytes each) of a cache line."""

_BLOCK_SHIFT = np.uint64(t.BLOCK_SHIFT)
_SPOT_SHIFT = np.uint64(3)
assert LANES == 1 << 3


@subkernel
def deliver_shared_weight(view, q, first_source, log_slot, begin, stop, out, mark, spot):
    """Deliver the spikes of a step to the targets of the threads begin:stop; `out` is the index of target 0 in `buf`.

    `mark`: index in `due` of the population's first block; -1: the caller marks all blocks. `spot`: index in `spots` of
    its first group of eight neurons; -1: `spots` is not used.
    """
    net = net_of(view)
    projection = net.projections[q]
    # Loaded into locals, because the compiler cannot exclude that a store into `buf` changes the tables. With what runs
    # once a spike inlined, rows of one synapse are 1.4 times as fast: 10 ns a spike.
    targets, rows, buf, ids, counts = net.targets, net.rows, net.buf, net.log_ids, net.log_counts
    mask, source, senders = ids.shape[1] - 1, projection[t.SOURCE], net.edges.shape[1] - 1
    base, width = projection[t.ROW] + begin - first_source * senders, stop - begin
    weight, due, ending = net.weights[projection[t.WEIGHT]], net.due[begin], net.stop
    # Threads own ascending ids, so going through them in order adds as one thread would.
    for sender in range(senders):
        end = net.log_ends[sender, log_slot, source + 1]
        for place in range(net.log_ends[sender, log_slot, source], end):
            if ending[0] == t.AT_ONCE:
                return
            row = base + np.int64(ids[sender, place & mask]) * senders
            # Rows are scattered over a table of many megabytes: that of the next spike is prefetched.
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
    """Mark the spots (groups of eight neurons) of the targets first:last; `spot` is the index of that of target 0."""
    begin = np.uint64(spot)
    for e in range(np.uint64(first), np.uint64(last)):
        spots[begin + (np.uint64(targets[e]) >> _SPOT_SHIFT)] = 1


@inlined
def csr_row(view, projection, first_source, thread, sender, place):
    """The CSR row, with a thread's targets, of a spike at a place of the log of thread sender."""
    net = net_of(view)
    source = np.int64(net.log_ids[sender, place & (net.log_ids.shape[1] - 1)]) - first_source
    return projection[t.ROW] + source * (net.edges.shape[1] - 1) + thread


@subkernel
def first_csr_row(view, projection, first_source, thread, sender, log_slot, otherwise):
    """The CSR row of the first spike of a step in the logs of thread sender and later ones, if there is one."""
    net = net_of(view)
    while sender < net.edges.shape[1] - 1:
        place = net.log_ends[sender, log_slot, projection[t.SOURCE]]
        if place < net.log_ends[sender, log_slot, projection[t.SOURCE] + 1]:
            return csr_row(view, projection, first_source, thread, sender, place)
        sender += 1
    return otherwise


@inlined
def add_weight(targets, first, last, value, buf, out, prefetch_at):
    """Add one value to the targets first:last, and prefetch those of the next spike, at the address `prefetch_at`."""
    begin = np.uint64(out)  # unsigned indices: numba emits no check for negative ones
    # Whole cache lines of 16 targets, with one prefetch each.
    whole = first + (last - first) // TARGETS_PER_LINE * TARGETS_PER_LINE
    for line in range(np.uint64(first), np.uint64(whole), np.uint64(TARGETS_PER_LINE)):
        prefetch(prefetch_at + 4 * (np.int64(line) - first))
        for k in range(np.uint64(TARGETS_PER_LINE)):
            buf[begin + np.uint64(targets[line + k])] += value
    for e in range(np.uint64(whole), np.uint64(last)):
        buf[begin + np.uint64(targets[e])] += value


@inlined
def mark_blocks(targets, first, last, due, mark):
    """Mark the blocks of the targets first:last; `mark` is the index of the population's first block.

    Separate loop: that of additions stays free of other stores, and `due` is small enough for the first cache.
    """
    begin = np.uint64(mark)
    for e in range(np.uint64(first), np.uint64(last)):
        due[begin + (np.uint64(targets[e]) >> _BLOCK_SHIFT)] = 1


RANGE = 1 << 15
"""Targets of a range. Their input, 256 kB, takes a quarter to a half of a core's second cache (0.5 to 1 MB)."""


@subkernel
def deliver_in_ranges(view, q, first_source, log_slot, begin, stop, lo, hi, out):
    """Deliver the spikes of a step to the targets lo:hi, of the threads begin:stop; `out` is the index of target 0."""
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
    """Add the first n rows of the queue (targets ascending); column 0 advances to the first target not yet added."""
    ranges = -(-(hi - lo) // RANGE)
    # Ranges outside, spikes inside: each input still sums up in the order of spikes, as without ranges.
    for r in range(ranges):
        below = lo + (hi - lo) * (r + 1) // ranges
        for k in range(n):
            prefetch_at = address(targets) + 4 * queue[min(k + 1, n - 1), 0]
            value = weight * np.float64(queue[k, 2])
            queue[k, 0] = add_below(targets, queue[k, 0], queue[k, 1], below, value, buf, out, prefetch_at)


@subkernel
def add_below(targets, first, last, below, value, buf, out, prefetch_at):
    """Add one value to those of the targets first:last that are less than a bound; return where the others begin.

    Meanwhile prefetch those of the next spike, at the address `prefetch_at`.
    """
    begin = np.uint64(out)
    e = first
    # Targets ascend, so if the last of a line is below, all 16 are.
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
