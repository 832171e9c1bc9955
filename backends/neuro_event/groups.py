"""Groups: who of those at threshold fires, whom that resets, and how far the maps were."""

# mypy: ignore-errors
import math

from neuro.kernels.draws import step_word, uniform
from neuro.kernels.jit import inner
from neuro_event.neurons import emit, spike, wake
from neuro_event.tables import (
    APART,
    BEGIN,
    BLOCK,
    CONSTANT,
    CONSTANT_STRIDE,
    DECIDED,
    END,
    FIRST_BLOCK,
    FIRST_TO_FIRE,
    GROUP,
    IN_TRIAL,
    LAST_BLOCK,
    RIVALS,
    WINNER,
)
from neuro_event.views import net_of


@inner
def choose(view, group, row, candidates, n, step):
    """The winner among the first n candidates of a group: largest margin, then keyed draw, then id."""
    net = net_of(view)
    best, best_margin, best_draw = -1, -math.inf, -1.0
    base = step_word(net.group_keys[group], step)
    for k in range(n):
        i = candidates[k]
        c = net.constants[row[CONSTANT] + (i - row[BEGIN]) * row[CONSTANT_STRIDE]]
        margin = net.state[0, i] - c[0]
        if margin < best_margin:
            continue
        draw = uniform(base, net.order[i])
        if margin > best_margin or draw > best_draw or (draw == best_draw and net.order[i] < net.order[best]):
            best, best_margin, best_draw = i, margin, draw
    return best


@inner
def weigh_maps(view, thread, row, step, h):
    """Largest V_m of each map of a population and the neuron that has it (the smaller id of equals)."""
    net = net_of(view)
    for block in range(row[FIRST_BLOCK], row[LAST_BLOCK]):
        if net.awake[block] == 0:
            wake(view, thread, row, block, step, h)
    net.potential[:] = -math.inf
    net.best[:] = -1
    for i in range(row[BEGIN], row[END]):
        m = net.map_of[i - row[BEGIN]]
        v = net.state[0, i]
        if v > net.potential[m] or (v == net.potential[m] and net.order[i] < net.order[net.best[m]]):
            net.potential[m] = v
            net.best[m] = i


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
        if net.fired[j] != 0 and net.muted[j] == 0:
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
            wake(view, thread, row, j // BLOCK, step, h)
        spike(view, row, j)


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
        at = emit(view, thread, pop, row, i, 1, step, done, h, at)
        net.active[thread, pop] += 1 - net.found_arrived[thread, k]
    return at


@inner
def settle(view, thread, pop, row, n, step, at, done, h):
    """Let the winner among the found neurons of a group fire; return the next place in the log."""
    net = net_of(view)
    group = row[GROUP]
    if net.groups[group, RIVALS] > 0:
        return settle_rivals(view, thread, pop, row, n, step, at, done, h)
    winner = choose(view, group, row, net.found[thread], n, step)
    if net.groups[group, IN_TRIAL] == 1 and net.groups[group, WINNER] < 0:
        weigh_maps(view, thread, row, step, h)
        net.groups[group, WINNER] = winner
        net.groups[group, DECIDED] = step
    for k in range(n):
        i = net.found[thread, k]
        if i == winner:
            spike(view, row, i)
            at = emit(view, thread, pop, row, i, 1, step, done, h, at)
            net.active[thread, pop] += 1 - net.found_arrived[thread, k]
        elif net.groups[group, FIRST_TO_FIRE] == 0:
            spike(view, row, i)
    if net.groups[group, FIRST_TO_FIRE] == 1:
        net.closed[group] = 1
    return at
