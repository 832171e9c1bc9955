"""Groups in which a spike resets its rivals."""

# mypy: ignore-errors
from neuro.kernels.jit import inner
from neuro_event.candidates import choose
from neuro_event.neurons import emit, spike, wake
from neuro_event.tables import (
    APART,
    BEGIN,
    BLOCK,
    GROUP,
    NUMBER,
    RIVALS,
)
from neuro_event.views import net_of


@inner
def first_rival(view, row, i):
    """The first of the neurons of which only one fires when neuron i does."""
    net = net_of(view)
    apart = net.groups[row[GROUP], APART]
    before = (i - row[BEGIN]) // apart % net.groups[row[GROUP], RIVALS]
    return i - before * apart


@inner
def best_rival(view, thread, row, i, step):
    """The winner among neuron i and its rivals at threshold."""
    net = net_of(view)
    first, apart = first_rival(view, row, i), net.groups[row[GROUP], APART]
    n = 0
    for k in range(net.groups[row[GROUP], RIVALS]):
        j = first + k * apart
        if net.fired[j] != 0:
            net.rivals[thread, n] = j
            n += 1
    return choose(view, row[GROUP], row, net.rivals[thread], n, step)


@inner
def reset_rivals(view, thread, row, i, step, h):
    """Reset neuron i, which fires, and all its rivals."""
    net = net_of(view)
    first, apart = first_rival(view, row, i), net.groups[row[GROUP], APART]
    for k in range(net.groups[row[GROUP], RIVALS]):
        j = first + k * apart
        if net.awake[j // BLOCK] == 0:
            wake(view, thread, row[NUMBER], j // BLOCK, step, h)
        spike(view, row[NUMBER], j)


@inner
def settle_rivals(view, thread, pop, row, n, step, at, done, h):
    """Let the winners among the found neurons fire and reset their rivals; return the next place in the log."""
    net = net_of(view)
    winners = 0
    for k in range(n):
        i = net.found[thread, k]
        if best_rival(view, thread, row, i, step) == i:  # all are found before a reset changes what is compared
            net.found[thread, winners] = i
            net.found_arrived[thread, winners] = net.found_arrived[thread, k]
            winners += 1
    for k in range(winners):
        i = net.found[thread, k]
        reset_rivals(view, thread, row, i, step, h)
        at = emit(view, thread, pop, i, 1, step, done, h, at)
        net.active[thread, pop] += 1 - net.found_arrived[thread, k]
    return at
