"""Who of those at threshold of a group is the best, and how far its maps were."""

# mypy: ignore-errors
import math

from neuro.kernels.draws import step_word, uniform
from neuro.kernels.jit import inner
from neuro_event.neurons import wake
from neuro_event.tables import (
    BEGIN,
    CONSTANT,
    CONSTANT_STRIDE,
    END,
    FIRST_BLOCK,
    GROUP,
    LAST_BLOCK,
    NUMBER,
)
from neuro_event.views import net_of


@inner
def choose(view, group, row, candidates, n, step):
    """Who wins of the first n candidates of a group that may: largest margin, then keyed draw, then id; or -1."""
    net = net_of(view)
    best, best_margin, best_draw = -1, -math.inf, -1.0
    base = step_word(net.group_keys[group], step)
    for k in range(n):
        i = candidates[k]
        if net.muted[i] != 0:
            continue
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
    """Largest V_m of each map that has not won, and the neuron that has it (the smaller id of equals)."""
    net = net_of(view)
    wins = net.map_wins[row[GROUP]]
    for block in range(row[FIRST_BLOCK], row[LAST_BLOCK]):
        if net.awake[block] == 0:
            wake(view, thread, row[NUMBER], block, step, h)
    for m in range(net.potential.size):
        if wins[m] == 0:
            net.potential[m] = -math.inf
            net.best[m] = -1
    for i in range(row[BEGIN], row[END]):
        m = net.map_of[i - row[BEGIN]]
        if wins[m] > 0:
            continue
        v = net.state[0, i]
        if v > net.potential[m] or (v == net.potential[m] and net.order[i] < net.order[net.best[m]]):
            net.potential[m] = v
            net.best[m] = i
