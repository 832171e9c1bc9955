"""Static delivery: what the spikes of one step add to the input of a projection's targets.

`buf` holds the input of the present step (receptor 0, receptor 1, over all neurons) and, behind it, the rings
of the projections whose spikes are delivered at emission. `due` marks the blocks that a step must look at.
"""

# mypy: ignore-errors
import numpy as np

from neuro_event.jit import inner
from neuro_event.tables import (
    BEGIN,
    BLOCK,
    CHANNEL_HEIGHT,
    CHANNEL_WIDTH,
    COLUMNS,
    CSR,
    DELAY,
    DELAY_STRIDE,
    DENSE,
    END,
    FIRST_BLOCK,
    KERNEL_HEIGHT,
    KERNEL_WIDTH,
    LAST_BLOCK,
    LAYOUT,
    MAP_STEP,
    MAPS,
    MIXED,
    NEGATIVE,
    ONE_TO_ONE,
    PADDING,
    PLACE_STEP,
    RECEPTORS,
    RING,
    RING_MASK,
    RING_SIZE,
    ROW,
    ROWS,
    SIGN,
    SOURCE,
    STRIDE,
    SYNAPSE,
    TARGET,
    WAKE_ALL,
    WEIGHT,
    WEIGHT_STRIDE,
)

_BLOCK = 6
assert 1 << _BLOCK == BLOCK


@inner
def receptor(weight, receptors):
    """Which receptor a weight goes to."""
    return 1 if receptors == 2 and weight < 0.0 else 0


@inner
def csr_alike(targets, first, last, value, buf, out, due, mark):
    """Add one value to the targets first:last and mark their blocks."""
    for e in range(first, last):
        buf[out + np.int64(targets[e])] += value
    if mark >= 0:
        for e in range(first, last):
            due[mark + (np.int64(targets[e]) >> _BLOCK)] = 1


@inner
def csr_own(targets, first, last, weights, w, m, receptors, stride, buf, out, due, mark):
    """Add to the targets first:last their own weight times m; `w` is the place of the first one's weight."""
    if receptors == 2:
        for e in range(first, last):
            weight = weights[w + e - first] * m
            buf[out + np.int64(targets[e]) + (stride if weight < 0.0 else 0)] += weight
    else:
        for e in range(first, last):
            buf[out + np.int64(targets[e])] += weights[w + e - first] * m
    if mark >= 0:
        for e in range(first, last):
            due[mark + (np.int64(targets[e]) >> _BLOCK)] = 1


@inner
def csr_delayed(row, source_id, m, step, thread, threads, receptors, mark, slots, blocks, rows, targets, weights, delays, buf, due):
    """One spike over a projection whose synapses have delays of their own, into its ring."""
    place = row[ROW] + source_id * threads + thread
    size = row[RING_SIZE]
    for e in range(rows[place], rows[place + 1]):
        s = e - row[SYNAPSE]
        at = step + np.int64(delays[row[DELAY] + s * row[DELAY_STRIDE]])
        weight = weights[row[WEIGHT] + s * row[WEIGHT_STRIDE]] * m
        target = np.int64(targets[e])
        buf[row[RING] + ((at & row[RING_MASK]) * receptors + receptor(weight, receptors)) * size + target] += weight
        due[(at & slots) * blocks + mark + (target >> _BLOCK)] = 1


@inner
def grid_add(row, source, m, weights, buf, out):
    """A shared kernel, kept with the maps innermost: add it round one source neuron."""
    height, width = row[CHANNEL_HEIGHT], row[CHANNEL_WIDTH]
    maps, rows, columns = row[MAPS], row[ROWS], row[COLUMNS]
    channel = source // (height * width)
    y = source // width % height + row[PADDING]
    x = source % width + row[PADDING]
    stride = row[STRIDE]
    for r in range(max(0, (y - row[KERNEL_HEIGHT]) // stride + 1), min(rows, y // stride + 1)):
        for c in range(max(0, (x - row[KERNEL_WIDTH]) // stride + 1), min(columns, x // stride + 1)):
            place = (channel * row[KERNEL_HEIGHT] + y - r * stride) * row[KERNEL_WIDTH] + x - c * stride
            w = row[WEIGHT] + place * maps
            o = out + (r * columns + c) * row[PLACE_STEP]
            if row[MAP_STEP] == 1:
                for k in range(maps):
                    buf[o + k] += weights[w + k] * m
            else:
                for k in range(maps):
                    buf[o + k * row[MAP_STEP]] += weights[w + k] * m


@inner
def grid_signed(row, source, m, weights, buf, out, between):
    """The same for weights of both signs onto two receptors."""
    height, width = row[CHANNEL_HEIGHT], row[CHANNEL_WIDTH]
    maps, rows, columns = row[MAPS], row[ROWS], row[COLUMNS]
    channel = source // (height * width)
    y = source // width % height + row[PADDING]
    x = source % width + row[PADDING]
    stride = row[STRIDE]
    for r in range(max(0, (y - row[KERNEL_HEIGHT]) // stride + 1), min(rows, y // stride + 1)):
        for c in range(max(0, (x - row[KERNEL_WIDTH]) // stride + 1), min(columns, x // stride + 1)):
            place = (channel * row[KERNEL_HEIGHT] + y - r * stride) * row[KERNEL_WIDTH] + x - c * stride
            w = row[WEIGHT] + place * maps
            o = out + (r * columns + c) * row[PLACE_STEP]
            for k in range(maps):
                weight = weights[w + k] * m
                buf[o + k * row[MAP_STEP] + (between if weight < 0.0 else 0)] += weight


@inner
def scatter(row, source_id, m, thread, threads, lo, hi, n, receptors, out, between, mark, rows, targets, weights, buf, due):
    """One spike of multiplicity m over a projection with one delay, to this thread's targets lo:hi of n.

    `out` is the place of target 0 in `buf`, `between` the distance to the second receptor, and `mark` the
    place of the targets' first block in `due`, or -1 where all blocks are marked at once.
    """
    layout = row[LAYOUT]
    if layout == CSR:
        place = row[ROW] + source_id * threads + thread
        first, last = rows[place], rows[place + 1]
        if row[WEIGHT_STRIDE] == 0:
            weight = weights[row[WEIGHT]] * m
            csr_alike(targets, first, last, weight, buf, out + receptor(weight, receptors) * between, due, mark)
        else:
            w = row[WEIGHT] + first - row[SYNAPSE]
            csr_own(targets, first, last, weights, w, m, receptors, between, buf, out, due, mark)
    elif layout == DENSE:
        w = row[WEIGHT] + source_id * n
        if row[WEIGHT_STRIDE] == 0:
            weight = weights[row[WEIGHT]] * m
            o = out + receptor(weight, receptors) * between
            for i in range(lo, hi):
                buf[o + i] += weight
        elif row[SIGN] != MIXED or receptors == 1:
            o = out + (between if row[SIGN] == NEGATIVE and receptors == 2 else 0)
            for i in range(lo, hi):
                buf[o + i] += weights[w + i] * m
        else:
            for i in range(lo, hi):
                weight = weights[w + i] * m
                buf[out + i + (between if weight < 0.0 else 0)] += weight
    elif layout == ONE_TO_ONE:
        if lo <= source_id < hi:
            weight = weights[row[WEIGHT] + source_id * row[WEIGHT_STRIDE]] * m
            buf[out + source_id + receptor(weight, receptors) * between] += weight
            if mark >= 0:
                due[mark + (source_id >> _BLOCK)] = 1
    elif row[SIGN] == MIXED and receptors == 2:
        grid_signed(row, source_id, m, weights, buf, out, between)
    else:
        grid_add(row, source_id, m, weights, buf, out + (between if row[SIGN] == NEGATIVE and receptors == 2 else 0))


@inner
def log_delivery(q, j, k, thread, threads, edges, pops, row, log_ids, log_counts, log_ends, ring, rows, targets, weights, delays, buf, due, slots, blocks, n_all):
    """Deliver the spikes that projection q's source emitted in step j.

    With `ring` they go into the projection's ring, for the step in which they arrive; else to the input of
    step k, the present one.
    """
    source, target = pops[row[SOURCE]], pops[row[TARGET]]
    first_block = max(target[FIRST_BLOCK], edges[thread])
    last_block = min(target[LAST_BLOCK], edges[thread + 1])
    if first_block >= last_block:
        return
    n = target[END] - target[BEGIN]
    receptors = target[RECEPTORS]
    lo = first_block * BLOCK - target[BEGIN]
    hi = min(last_block * BLOCK - target[BEGIN], n)
    own_delays = ring and row[DELAY_STRIDE] == 1
    if ring:
        at = j + np.int64(delays[row[DELAY]])
        out = row[RING] + (at & row[RING_MASK]) * receptors * row[RING_SIZE]
        between = row[RING_SIZE]
    else:
        at = k
        out = target[BEGIN]
        between = n_all
    slot = (at & slots) * blocks
    mark = slot + target[FIRST_BLOCK]
    some = False
    wide = row[WAKE_ALL] == 1 and not own_delays
    mask = log_ids.shape[1] - 1
    step_slot = j & (log_ends.shape[1] - 1)
    for t in range(threads):
        for at_log in range(log_ends[t, step_slot, row[SOURCE]], log_ends[t, step_slot, row[SOURCE] + 1]):
            source_id = np.int64(log_ids[t, at_log & mask]) - source[BEGIN]
            m = np.float64(log_counts[t, at_log & mask])
            some = True
            if own_delays:
                csr_delayed(row, source_id, m, j, thread, threads, receptors, target[FIRST_BLOCK], slots, blocks, rows, targets, weights, delays, buf, due)
            else:
                scatter(row, source_id, m, thread, threads, lo, hi, n, receptors, out, between, -1 if wide else mark, rows, targets, weights, buf, due)
    if some and wide:
        due[slot + first_block : slot + last_block] = 1
