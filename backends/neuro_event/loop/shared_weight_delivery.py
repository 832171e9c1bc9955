"""Spikes over synapses of one weight, most often all of a projection's.

A spike reaches some of very many neurons everywhere. Where their input does not fit into a core's cache, all spikes of
a step are added to those of one range first, then to those of the next. Each input sums up as without ranges.
"""

# mypy: ignore-errors
import numpy as np

from neuro.kernels.instructions import LANES, address, prefetch
from neuro.kernels.jit import inlined, subkernel
from neuro_event.loop import tables as t
from neuro_event.loop.tables import net_of

LINE = 16
"""Targets of a cache line."""

_SHIFT = np.uint64(6)
assert t.BLOCK == 1 << 6
_SPOT = np.uint64(3)
assert LANES == 1 << 3


@subkernel
def deliver_shared_weight(view, q, first_source, step_slot, begin, stop, out, mark, spot):
    """Deliver the spikes of a step to the targets of the threads begin:stop; `out` is the place of target 0 in `buf`.

    `mark` is the place of the targets' first block in `due`, or -1 where all blocks are marked at once; `spot` that of
    their first spot, or -1 where none are marked.
    """
    net = net_of(view)
    row = net.projections[q]
    # Read once: a store into `buf` could be one into the tables, as far as the compiler knows. What is called for each
    # spike is inlined. Together they make short rows 1.4 times as fast: 10 ns a spike over one synapse.
    targets, rows, buf, ids, counts = net.targets, net.rows, net.buf, net.log_ids, net.log_counts
    mask, source, senders = ids.shape[1] - 1, row[t.SOURCE], net.edges.shape[1] - 1
    base, width = row[t.ROW] + begin - first_source * senders, stop - begin
    weight, due = net.weights[row[t.WEIGHT]], net.due[begin]
    # Threads own ascending ids, so going through them in order adds as one thread would.
    for sender in range(senders):
        end = net.log_ends[sender, step_slot, source + 1]
        for place in range(net.log_ends[sender, step_slot, source], end):
            at = base + np.int64(ids[sender, place & mask]) * senders
            # Rows lie anywhere in a table of many megabytes: that of the next spike is asked for now.
            if place + 1 < end:
                after = base + np.int64(ids[sender, (place + 1) & mask]) * senders
            else:
                after = first_row(view, row, first_source, begin, sender + 1, step_slot, at)
            ahead = address(targets) + 4 * rows[after]
            value = weight * np.float64(counts[sender, place & mask])
            first, last = rows[at], rows[at + width]
            add(targets, first, last, value, buf, out, ahead)
            if mark >= 0 and width == 1:
                mark_blocks(targets, first, last, due, mark)
            elif mark >= 0:
                for thread in range(begin, stop):
                    k = at + thread - begin
                    mark_blocks(targets, rows[k], rows[k + 1], net.due[thread], mark)
            if spot >= 0:
                mark_spots(targets, first, last, net.spots, spot)


@subkernel
def mark_spots(targets, first, last, spots, spot):
    """Mark the spots of the targets first:last; `spot` is that of target 0."""
    begin = np.uint64(spot)
    for e in range(np.uint64(first), np.uint64(last)):
        spots[begin + (np.uint64(targets[e]) >> _SPOT)] = 1


@inlined
def row_of(view, row, first_source, thread, sender, place):
    """The row of synapses, onto a thread's targets, of a spike at a place of the log of thread sender."""
    net = net_of(view)
    source = np.int64(net.log_ids[sender, place & (net.log_ids.shape[1] - 1)]) - first_source
    return row[t.ROW] + source * (net.edges.shape[1] - 1) + thread


@subkernel
def first_row(view, row, first_source, thread, sender, step_slot, otherwise):
    """The row of the first spike of a step in the logs of thread sender and those after it, if there is one."""
    net = net_of(view)
    while sender < net.edges.shape[1] - 1:
        place = net.log_ends[sender, step_slot, row[t.SOURCE]]
        if place < net.log_ends[sender, step_slot, row[t.SOURCE] + 1]:
            return row_of(view, row, first_source, thread, sender, place)
        sender += 1
    return otherwise


@inlined
def add(targets, first, last, value, buf, out, ahead):
    """Add one value to the targets first:last; meanwhile ask for those of the next spike.

    These lie somewhere else in a table that is larger than the caches: at the address `ahead`.
    """
    begin = np.uint64(out)  # an unsigned place is never one from the end, so the innermost loop tests none
    # Whole cache lines of 16 targets: one request for memory each.
    whole = first + (last - first) // LINE * LINE
    for line in range(np.uint64(first), np.uint64(whole), np.uint64(LINE)):
        prefetch(ahead + 4 * (np.int64(line) - first))
        for k in range(np.uint64(LINE)):
            buf[begin + np.uint64(targets[line + k])] += value
    for e in range(np.uint64(whole), np.uint64(last)):
        buf[begin + np.uint64(targets[e])] += value


@inlined
def mark_blocks(targets, first, last, due, mark):
    """Mark the blocks of the targets first:last; `mark` is the place of the first of all.

    It is a loop of its own: the other is nothing but adds, and these few bytes stay in the cache.
    """
    begin = np.uint64(mark)
    for e in range(np.uint64(first), np.uint64(last)):
        due[begin + (np.uint64(targets[e]) >> _SHIFT)] = 1


RANGE = 1 << 15
"""Targets whose input takes 256 kB, a quarter of a core's second cache or a half."""


@subkernel
def deliver_in_ranges(view, q, first_source, step_slot, begin, stop, lo, hi, out):
    """Deliver the spikes of a step to the targets lo:hi, of the threads begin:stop; that of 0 in `buf` is `out`."""
    net = net_of(view)
    row = net.projections[q]
    mask = net.log_ids.shape[1] - 1
    queue = net.queue[begin]
    n = 0
    for sender in range(net.edges.shape[1] - 1):
        for place in range(
            net.log_ends[sender, step_slot, row[t.SOURCE]], net.log_ends[sender, step_slot, row[t.SOURCE] + 1]
        ):
            at = row_of(view, row, first_source, begin, sender, place)
            queue[n, 0], queue[n, 1] = net.rows[at], net.rows[at + stop - begin]
            queue[n, 2] = net.log_counts[sender, place & mask]
            n += 1
            if n == queue.shape[0]:
                add_rows(net.targets, queue, n, net.weights[row[t.WEIGHT]], net.buf, out, lo, hi)
                n = 0
    add_rows(net.targets, queue, n, net.weights[row[t.WEIGHT]], net.buf, out, lo, hi)


@subkernel
def add_rows(targets, queue, n, weight, buf, out, lo, hi):
    """Add the first n rows of a queue, whose targets ascend; the queue keeps where what is left of each begins."""
    ranges = -(-(hi - lo) // RANGE)
    # Ranges outside, spikes inside: each input still sums up in the order of spikes, as without ranges.
    for r in range(ranges):
        below = lo + (hi - lo) * (r + 1) // ranges
        for k in range(n):
            ahead = address(targets) + 4 * queue[min(k + 1, n - 1), 0]
            value = weight * np.float64(queue[k, 2])
            queue[k, 0] = add_below(targets, queue[k, 0], queue[k, 1], below, value, buf, out, ahead)


@subkernel
def add_below(targets, first, last, below, value, buf, out, ahead):
    """Add one value to those of the targets first:last that are less than a bound; return where the others begin.

    Meanwhile ask for those of the next spike, which lie at the address `ahead`.
    """
    begin = np.uint64(out)
    e = first
    # Targets ascend, so the last of a line tells of all 16.
    while e + LINE <= last and targets[e + LINE - 1] < below:
        prefetch(ahead + 4 * (e - first))
        line = np.uint64(e)
        for k in range(np.uint64(LINE)):
            buf[begin + np.uint64(targets[line + k])] += value
        e += LINE
    while e < last and targets[e] < below:
        buf[begin + np.uint64(targets[e])] += value
        e += 1
    return e
