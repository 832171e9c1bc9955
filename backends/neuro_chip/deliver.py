"""Sending the spikes of a step into the ring buffers of their targets."""

# mypy: ignore-errors
import numpy as np

from neuro.kernels.jit import inner
from neuro_chip.tables import (
    ARRIVED,
    BEGIN,
    CHANNEL_HEIGHT,
    CHANNEL_WIDTH,
    COLUMNS,
    CSR,
    DENSE,
    DEPTH,
    END,
    KERNEL_HEIGHT,
    KERNEL_WIDTH,
    LAG,
    LAG_STRIDE,
    LAYOUT,
    LEFT,
    NEGATIVE,
    ONE_TO_ONE,
    POSITIVE,
    REACH,
    RECEPTORS,
    RING,
    ROW,
    ROWS,
    SLOTS,
    STRIDE,
    SYNAPSE,
    TARGET,
    TOP,
    WORD,
    WORD_STRIDE,
)

OVER = np.int32(65536)
"""What a SpiNNaker slot holds in place of more than 65535: enough to tell that it is saturated."""


@inner
def add(ring, place, below, word, times, capped):
    """Add a word to a slot, or to that of the inhibitory receptor."""
    amount = np.int32(word * times)
    if not capped:
        ring[place] += amount
    elif amount >= 0:
        ring[place] = min(np.int32(ring[place] + amount), OVER)
    else:
        ring[place + below] = min(np.int32(ring[place + below] - amount), OVER)


@inner
def send(net, q, i, times, step):
    """Send a spike that source i emitted in `step` along a projection."""
    row = net.projections[q]
    target = net.pops[row[TARGET]]
    n = target[END] - target[BEGIN]
    mask = target[SLOTS] - 1  # slots are a power of two above the longest lag: none is written before it is read
    below = target[SLOTS] * n
    capped = target[RECEPTORS] == 2
    if row[LAYOUT] == DENSE:
        slot = (step + net.lags[row[LAG]]) & mask
        begin = target[RING] + slot * n
        net.arrived_all[target[ARRIVED] + slot] = 1
        net.came[target[ARRIVED] + slot] = 1
        into = net.ring[begin : begin + n]
        if row[WORD_STRIDE] == 0:  # one word for all
            word = net.words[row[WORD]]
            for k in range(n):
                add(net.ring, begin + k, below, word, times, capped)
        elif not capped:
            words = net.words[row[WORD] + i * n : row[WORD] + (i + 1) * n]
            send_row(into, words, times)
        else:
            words = net.words[row[WORD] + i * n : row[WORD] + (i + 1) * n]
            # one pass for each sign that there is: a loop without branches runs many words at a time
            if row[POSITIVE]:
                send_capped(into, words, np.int32(times))
            if row[NEGATIVE]:
                send_capped(net.ring[begin + below : begin + below + n], words, np.int32(-times))
    elif row[LAYOUT] == CSR:
        first, last = net.rows[row[ROW] + i], net.rows[row[ROW] + i + 1]
        base = row[SYNAPSE]
        # the common case by itself: its loop takes slices and has nothing to decide for a synapse
        if row[LAG_STRIDE] == 0 and not capped and times == 1 and row[WORD_STRIDE] == 1:
            slot = (step + net.lags[row[LAG]]) & mask
            begin = target[RING] + slot * n
            net.came[target[ARRIVED] + slot] = 1
            send_sparse(
                net.ring[begin : begin + n],
                net.arrived[begin : begin + n],
                net.targets[base + first : base + last],
                net.words[row[WORD] + first : row[WORD] + last],
            )
            return
        for e in range(first, last):
            slot = (step + net.lags[row[LAG] + e * row[LAG_STRIDE]]) & mask
            place = target[RING] + slot * n + net.targets[base + e]
            add(net.ring, place, below, net.words[row[WORD] + e * row[WORD_STRIDE]], times, capped)
            net.arrived[place] = 1
            net.came[target[ARRIVED] + slot] = 1
    elif row[LAYOUT] == ONE_TO_ONE:
        slot = (step + net.lags[row[LAG] + i * row[LAG_STRIDE]]) & mask
        place = target[RING] + slot * n + i
        add(net.ring, place, below, net.words[row[WORD] + i * row[WORD_STRIDE]], times, capped)
        net.arrived[place] = 1
        net.came[target[ARRIVED] + slot] = 1
    else:
        send_grid(net, row, target, i, times, step, below, capped)


@inner
def send_row(into, words, times):
    """Add a row of words to neighbouring slots."""
    if times == 1:
        for k in range(into.size):
            into[k] = np.int32(into[k] + np.int32(words[k]))
    else:
        for k in range(into.size):
            into[k] = np.int32(into[k] + np.int32(words[k] * times))


@inner
def send_capped(into, words, times):
    """Add the words of one sign to slots that saturate."""
    zero = np.int32(0)
    for k in range(into.size):
        amount = max(np.int32(words[k] * times), zero)
        into[k] = min(np.int32(into[k] + amount), OVER)


@inner
def send_sparse(into, arrived, targets, words):
    """Add words to scattered slots."""
    for e in range(targets.size):
        place = np.uint32(targets[e])  # unsigned: numba then looks for no index from the end
        into[place] = np.int32(into[place] + np.int32(words[e]))
        arrived[place] = 1


@inner
def send_grid(net, row, target, i, times, step, below, capped):
    """Add a shared kernel: every place of every map whose kernel covers the source."""
    sheet = row[CHANNEL_HEIGHT] * row[CHANNEL_WIDTH]
    channel, rest = i // sheet, i % sheet
    first = channel // row[DEPTH] * row[REACH]  # of the maps that the channel reaches
    y, x = rest // row[CHANNEL_WIDTH] + row[TOP], rest % row[CHANNEL_WIDTH] + row[LEFT]
    height, width, stride = row[KERNEL_HEIGHT], row[KERNEL_WIDTH], row[STRIDE]
    # the first and the last place whose kernel covers the line: ceil((y - height + 1) / stride) and y / stride
    r_first, r_last = max(0, -((height - 1 - y) // stride)), min(row[ROWS] - 1, y // stride)
    c_first, c_last = max(0, -((width - 1 - x) // stride)), min(row[COLUMNS] - 1, x // stride)
    n = target[END] - target[BEGIN]
    slot = (step + net.lags[row[LAG]]) & (target[SLOTS] - 1)
    net.came[target[ARRIVED] + slot] = 1
    for m in range(first, first + row[REACH]):
        kernel = row[WORD] + (m * row[DEPTH] + channel % row[DEPTH]) * height * width * row[WORD_STRIDE]
        for r in range(r_first, r_last + 1):
            line = kernel + (y - r * stride) * width * row[WORD_STRIDE]
            base = target[RING] + slot * n + (m * row[ROWS] + r) * row[COLUMNS]
            for c in range(c_first, c_last + 1):
                word = net.words[line + (x - c * stride) * row[WORD_STRIDE]]
                add(net.ring, base + c, below, word, times, capped)
                net.arrived[base + c] = 1
