"""Spikes over synapses of one weight, most often all of a projection's.

Many spikes at once are counted first, at each target, and then added: counters of two bytes stay in the first cache,
where the input of thousands of neurons does not, and blocks that have counted something are those to mark. The weight
is added as often as it arrives, one by one, so that the sum is bit for bit that of one spike after the other.
"""

# mypy: ignore-errors
import numpy as np

from neuro.kernels.jit import inner, merged
from neuro_event.tables import BLOCK, ROW, SOURCE, WEIGHT
from neuro_event.views import TARGETS, net_of, prefetch

FEWEST = 4096
"""Targets of a thread from which on counting pays: the input of fewer stays in the cache itself."""

MOST = 65535
"""What a counter holds."""

LINE = 16
"""Targets of a cache line."""

_SHIFT = np.uint64(6)
assert BLOCK == 1 << 6


@inner
def deliver_alike(view, row, first_source, step_slot, thread, lo, hi, out, mark):
    """Deliver the spikes of a step to this thread's targets lo:hi; `out` is the place of target 0 in `buf`.

    `mark` is the place of the targets' first block in `due`, or -1 where all blocks are marked at once.
    """
    net = net_of(view)
    threads = net.edges.shape[0] - 1
    mask = net.log_ids.shape[1] - 1
    weight = net.weights[row[WEIGHT]]
    counting = hi - lo >= FEWEST and 2 * synaptic_events(view, row, first_source, step_slot, thread) >= hi - lo
    counted = 0
    # Threads own ascending ids, so going through them in order adds as one thread would.
    for t in range(threads):
        end = net.log_ends[t, step_slot, row[SOURCE] + 1]
        for place in range(net.log_ends[t, step_slot, row[SOURCE]], end):
            at = row_of(view, row, first_source, thread, t, place)
            ahead = view[TARGETS, 0] + 4 * net.rows[row_of(view, row, first_source, thread, t, min(place + 1, end - 1))]
            first, last, m = net.rows[at], net.rows[at + 1], net.log_counts[t, place & mask]
            apart = not counting or m != 1 or last - first > MOST
            if counted > 0 and (apart or counted + last - first > MOST):
                add_counted(view, thread, weight, lo, hi, out, mark)
                counted = 0
            if apart:
                add(net.targets, first, last, weight * np.float64(m), net.buf, out, net.due, mark, ahead)
            else:
                count(net.targets, first, last, net.hits[thread], ahead)
                counted += last - first
    if counted > 0:
        add_counted(view, thread, weight, lo, hi, out, mark)


@merged
def row_of(view, row, first_source, thread, t, place):
    """The row of synapses, onto a thread's targets, of a spike at a place of the log of thread t."""
    net = net_of(view)
    source = np.int64(net.log_ids[t, place & (net.log_ids.shape[1] - 1)]) - first_source
    return row[ROW] + source * (net.edges.shape[0] - 1) + thread


@inner
def synaptic_events(view, row, first_source, step_slot, thread):
    """How many the spikes of a step make among this thread's targets."""
    net = net_of(view)
    events = 0
    for t in range(net.edges.shape[0] - 1):
        for place in range(net.log_ends[t, step_slot, row[SOURCE]], net.log_ends[t, step_slot, row[SOURCE] + 1]):
            at = row_of(view, row, first_source, thread, t, place)
            events += net.rows[at + 1] - net.rows[at]
    return events


@inner
def add(targets, first, last, value, buf, out, due, mark, ahead):
    """Add one value to the targets first:last and mark their blocks; meanwhile ask for the next spike's, at `ahead`."""
    begin = np.uint64(out)  # an unsigned place is never one from the end, so the innermost loop tests none
    whole = first + (last - first) // LINE * LINE
    for line in range(np.uint64(first), np.uint64(whole), np.uint64(LINE)):
        prefetch(ahead + 4 * (np.int64(line) - first))
        for k in range(np.uint64(LINE)):
            buf[begin + np.uint64(targets[line + k])] += value
    for e in range(np.uint64(whole), np.uint64(last)):
        buf[begin + np.uint64(targets[e])] += value
    if mark >= 0:  # a second loop: the first is nothing but adds, and these few bytes stay in the cache
        block = np.uint64(mark)
        for e in range(np.uint64(first), np.uint64(last)):
            due[block + (np.uint64(targets[e]) >> _SHIFT)] = 1


@inner
def count(targets, first, last, hits, ahead):
    """One more for each of the targets first:last; meanwhile ask for the next spike's, at `ahead`."""
    whole = first + (last - first) // LINE * LINE
    for line in range(np.uint64(first), np.uint64(whole), np.uint64(LINE)):
        prefetch(ahead + 4 * (np.int64(line) - first))
        for k in range(np.uint64(LINE)):
            hits[np.uint64(targets[line + k])] += np.uint16(1)
    for e in range(np.uint64(whole), np.uint64(last)):
        hits[np.uint64(targets[e])] += np.uint16(1)


@inner
def add_counted(view, thread, weight, lo, hi, out, mark):
    """Add the weight as often as each of the targets lo:hi has counted; what was counted is forgotten."""
    net = net_of(view)
    for begin in range(lo, hi, BLOCK):
        end = min(begin + BLOCK, hi)
        hits, into = net.hits[thread, begin:end], net.buf[out + begin : out + end]
        most = np.uint16(0)
        for k in range(hits.size):
            most = max(most, hits[k])
        if most > 0:
            for n in range(most):
                for k in range(into.size):
                    into[k] = into[k] + weight if hits[k] > np.uint16(n) else into[k]
            hits[:] = 0
            if mark >= 0:
                net.due[mark + begin // BLOCK] = 1
