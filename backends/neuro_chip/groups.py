"""Groups in which one neuron, or one of some rivals, fires: the host decides them for the chip."""

# mypy: ignore-errors
import numpy as np

from neuro.kernels.draws import step_word, uniform
from neuro.kernels.jit import inner
from neuro_chip.tables import APART, BEGIN, CLOSED, DECIDED, END, FIRST_TO_FIRE, GROUP, RIVALS, WINNER


@inner
def fire(net, i):
    """Reset a neuron that spiked."""
    net.v[i] = net.v_reset[i]
    net.hold[i] = net.refractory[i]


@inner
def choose(net, row, first, last, apart, step):
    """The candidate of first:last:apart that may win of the largest margin; of equal ones the larger draw; or -1."""
    best = -1
    best_margin, best_draw = np.int64(0), -1.0
    base = step_word(net.group_keys[row[GROUP]], step)
    for i in range(first, last, apart):
        if not net.fired[i] or net.muted[i]:
            continue
        margin = np.int64(net.v[i]) - np.int64(net.threshold[i])  # of two numbers of 32 bits: it may take 33
        draw = uniform(base, i - row[BEGIN])
        if best < 0 or margin > best_margin or (margin == best_margin and draw > best_draw):
            best, best_margin, best_draw = i, margin, draw
    return best


@inner
def settle_one(net, row, step):
    """Of the candidates of a group the best fires."""
    group, lo, hi = row[GROUP], row[BEGIN], row[END]
    best = choose(net, row, lo, hi, 1, step)
    if best < 0:
        return
    if net.groups[group, WINNER] < 0:
        net.groups[group, WINNER] = best - lo
        net.groups[group, DECIDED] = step
        for i in range(lo, hi):
            net.potential[i] = net.v[i]
    for i in range(lo, hi):
        if net.fired[i] and i != best:
            net.fired[i] = 0
            if not net.groups[group, FIRST_TO_FIRE]:
                fire(net, i)
    if net.groups[group, FIRST_TO_FIRE]:
        net.groups[group, CLOSED] = 1


@inner
def settle_rivals(net, row, step):
    """Of neurons that are rivals the best fires and all others are reset."""
    group, lo = row[GROUP], row[BEGIN]
    rivals, apart = net.groups[group, RIVALS], net.groups[group, APART]
    for first in range(lo, row[END]):
        last = first + rivals * apart
        if (first - lo) // apart % rivals != 0:
            continue
        best = choose(net, row, first, last, apart, step)
        if best >= 0:
            for i in range(first, last, apart):
                if i != best:
                    net.fired[i] = 0
                    fire(net, i)
