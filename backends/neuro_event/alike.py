"""Spikes over synapses of one weight, most often all of a projection's."""

# mypy: ignore-errors
import numpy as np

from neuro.kernels.jit import inner, merged
from neuro.kernels.lanes import LANES
from neuro_event.tables import BLOCK, ROW, SOURCE, WEIGHT
from neuro_event.views import address, net_of, prefetch

LINE = 16
"""Targets of a cache line."""

_SHIFT = np.uint64(6)
assert BLOCK == 1 << 6
_SPOT = np.uint64(3)
assert LANES == 1 << 3


@inner
def deliver_alike(view, q, first_source, step_slot, begin, stop, out, mark, spot):
    """Deliver the spikes of a step to the targets of the threads begin:stop; `out` is the place of target 0 in `buf`.

    `mark` is the place of the targets' first block in `due`, or -1 where all blocks are marked at once; `spot` that of
    their first spot, or -1 where none are marked.
    """
    net = net_of(view)
    row = net.projections[q]
    mask = net.log_ids.shape[1] - 1
    weight = net.weights[row[WEIGHT]]
    # Threads own ascending ids, so going through them in order adds as one thread would.
    for t in range(net.edges.shape[1] - 1):
        end = net.log_ends[t, step_slot, row[SOURCE] + 1]
        for place in range(net.log_ends[t, step_slot, row[SOURCE]], end):
            at = row_of(view, row, first_source, begin, t, place)
            if place + 1 < end:
                after = row_of(view, row, first_source, begin, t, place + 1)
            else:
                after = first_row(view, row, first_source, begin, t + 1, step_slot, at)
            ahead = address(net.targets) + 4 * net.rows[after]
            value = weight * np.float64(net.log_counts[t, place & mask])
            first, last = net.rows[at], net.rows[at + stop - begin]
            add(net.targets, first, last, value, net.buf, out, ahead)
            if mark >= 0:
                for thread in range(begin, stop):
                    k = at + thread - begin
                    mark_blocks(net.targets, net.rows[k], net.rows[k + 1], net.due[thread], mark)
            if spot >= 0:
                mark_spots(net.targets, first, last, net.spots, spot)


@inner
def mark_spots(targets, first, last, spots, spot):
    """Mark the spots of the targets first:last; `spot` is that of target 0."""
    begin = np.uint64(spot)
    for e in range(np.uint64(first), np.uint64(last)):
        spots[begin + (np.uint64(targets[e]) >> _SPOT)] = 1


@merged
def row_of(view, row, first_source, thread, t, place):
    """The row of synapses, onto a thread's targets, of a spike at a place of the log of thread t."""
    net = net_of(view)
    source = np.int64(net.log_ids[t, place & (net.log_ids.shape[1] - 1)]) - first_source
    return row[ROW] + source * (net.edges.shape[1] - 1) + thread


@inner
def first_row(view, row, first_source, thread, t, step_slot, otherwise):
    """The row of the first spike of a step in the logs of thread t and those after it, if there is one."""
    net = net_of(view)
    while t < net.edges.shape[1] - 1:
        place = net.log_ends[t, step_slot, row[SOURCE]]
        if place < net.log_ends[t, step_slot, row[SOURCE] + 1]:
            return row_of(view, row, first_source, thread, t, place)
        t += 1
    return otherwise


@inner
def add(targets, first, last, value, buf, out, ahead):
    """Add one value to the targets first:last; meanwhile ask for those of the next spike.

    These lie somewhere else in a table that is larger than the caches: at the address `ahead`.
    """
    begin = np.uint64(out)  # an unsigned place is never one from the end, so the innermost loop tests none
    whole = first + (last - first) // LINE * LINE
    for line in range(np.uint64(first), np.uint64(whole), np.uint64(LINE)):
        prefetch(ahead + 4 * (np.int64(line) - first))
        for k in range(np.uint64(LINE)):
            buf[begin + np.uint64(targets[line + k])] += value
    for e in range(np.uint64(whole), np.uint64(last)):
        buf[begin + np.uint64(targets[e])] += value


@inner
def mark_blocks(targets, first, last, due, mark):
    """Mark the blocks of the targets first:last; `mark` is the place of the first of all.

    It is a loop of its own: the other is nothing but adds, and these few bytes stay in the cache.
    """
    begin = np.uint64(mark)
    for e in range(np.uint64(first), np.uint64(last)):
        due[begin + (np.uint64(targets[e]) >> _SHIFT)] = 1
