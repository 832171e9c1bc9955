"""Spikes over synapses of one weight to very many neurons, one range of these after another.

A spike reaches some everywhere. Where their input does not fit into a core's cache, all spikes of a step are added to
those of one range first, then to those of the next. Each input sums up as without ranges.
"""

# mypy: ignore-errors
import numpy as np

from neuro.kernels.jit import inner
from neuro_event.alike import LINE, row_of
from neuro_event.tables import SOURCE, WEIGHT
from neuro_event.views import address, net_of, prefetch

RANGE = 1 << 15
"""Targets whose input takes 256 kB, a quarter of a core's second cache or a half."""


@inner
def deliver_in_ranges(view, q, first_source, step_slot, begin, stop, lo, hi, out):
    """Deliver the spikes of a step to the targets lo:hi, of the threads begin:stop; that of 0 in `buf` is `out`."""
    net = net_of(view)
    row = net.projections[q]
    mask = net.log_ids.shape[1] - 1
    queue = net.queue[begin]
    n = 0
    for t in range(net.edges.shape[1] - 1):
        for place in range(net.log_ends[t, step_slot, row[SOURCE]], net.log_ends[t, step_slot, row[SOURCE] + 1]):
            at = row_of(view, row, first_source, begin, t, place)
            queue[n, 0], queue[n, 1] = net.rows[at], net.rows[at + stop - begin]
            queue[n, 2] = net.log_counts[t, place & mask]
            n += 1
            if n == queue.shape[0]:
                add_rows(net.targets, queue, n, net.weights[row[WEIGHT]], net.buf, out, lo, hi)
                n = 0
    add_rows(net.targets, queue, n, net.weights[row[WEIGHT]], net.buf, out, lo, hi)


@inner
def add_rows(targets, queue, n, weight, buf, out, lo, hi):
    """Add the first n rows of a queue, whose targets ascend; the queue keeps where what is left of each begins."""
    ranges = -(-(hi - lo) // RANGE)
    for r in range(ranges):
        below = lo + (hi - lo) * (r + 1) // ranges
        for k in range(n):
            ahead = address(targets) + 4 * queue[min(k + 1, n - 1), 0]
            value = weight * np.float64(queue[k, 2])
            queue[k, 0] = add_below(targets, queue[k, 0], queue[k, 1], below, value, buf, out, ahead)


@inner
def add_below(targets, first, last, below, value, buf, out, ahead):
    """Add one value to those of the targets first:last that are less than a bound; return where the others begin.

    Meanwhile ask for those of the next spike, which lie at the address `ahead`.
    """
    begin = np.uint64(out)
    e = first
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
