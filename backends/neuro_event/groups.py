"""Winner-take-all: who of a group fires, and how far the maps were."""

# mypy: ignore-errors
import math

from neuro.kernels.draws import step_word, uniform
from neuro.kernels.jit import inner
from neuro_event.neurons import emit, spike, wake
from neuro_event.tables import (
    BEGIN,
    BLOCKED,
    CONSTANT,
    CONSTANT_STRIDE,
    DECIDED,
    END,
    FIRST_BLOCK,
    FIRST_TO_FIRE,
    GROUP,
    GROUP_COLUMNS,
    GROUP_MAPS,
    GROUP_ROWS,
    IN_TRIAL,
    LAST_BLOCK,
    NEXT_MAP,
    NEXT_PLACE,
    OPEN,
    PER_MAP,
    RADIUS,
    SILENCED,
    WINNER,
    WINS,
    WON,
)
from neuro_event.views import net_of


@inner
def choose(view, thread, group, row, n, step):
    """Who wins of the first n found neurons of a group that may: largest margin, then keyed draw, then id; or -1."""
    net = net_of(view)
    best, best_margin, best_draw = -1, -math.inf, -1.0
    base = step_word(net.group_keys[group], step)
    for k in range(n):
        i = net.found[thread, k]
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
            wake(view, thread, row, block, step, h)
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


@inner
def silence(view, row, group, begin, end, step):
    """Silence the neurons begin:end:step that are not yet."""
    net = net_of(view)
    for i in range(begin, end, step):
        net.standing[group, OPEN] -= net.muted[i] == 0
        net.muted[i] |= BLOCKED


@inner
def win(view, row, i, step):
    """Neuron i of a group with several winners wins: enter it, and silence what is near it."""
    net = net_of(view)
    group = row[GROUP]
    local = net.local[group]
    rows, columns, radius = local[GROUP_ROWS], local[GROUP_COLUMNS], local[RADIUS]
    m, r, c = net.order[i] // (rows * columns), net.order[i] // columns % rows, net.order[i] % columns
    for near_r in range(max(0, r - radius), min(rows, r + radius + 1)):
        for near_c in range(max(0, c - radius), min(columns, c + radius + 1)):
            place = row[BEGIN] + (near_r * columns + near_c) * local[NEXT_PLACE]
            silence(view, row, group, place, place + local[GROUP_MAPS] * local[NEXT_MAP], local[NEXT_MAP])
    net.map_wins[group, m] += 1
    if net.map_wins[group, m] == local[PER_MAP]:
        place = row[BEGIN] + m * local[NEXT_MAP]
        silence(view, row, group, place, place + rows * columns * local[NEXT_PLACE], local[NEXT_PLACE])
    net.muted[i] |= WON
    if net.groups[group, IN_TRIAL] == 1:
        if net.groups[group, WINNER] < 0:
            net.groups[group, WINNER] = i
            net.groups[group, DECIDED] = step
        net.won[net.standing[group, WINS], 0] = i
        net.won[net.standing[group, WINS], 1] = step
        net.standing[group, WINS] += 1


@inner
def settle_locally(view, thread, pop, row, n, step, at, done, h):
    """Let those of the found neurons fire that win, the best first; return the next place in the log."""
    net = net_of(view)
    group = row[GROUP]
    if net.groups[group, IN_TRIAL] == 1:
        weigh_maps(view, thread, row, step, h)
    best = choose(view, thread, group, row, n, step)
    while best >= 0:
        win(view, row, best, step)
        best = choose(view, thread, group, row, n, step)
    for k in range(n):
        i = net.found[thread, k]
        if net.muted[i] & WON:
            spike(view, row, i)
            at = emit(view, thread, pop, row, i, 1, step, done, h, at)
            net.active[thread, pop] += 1 - net.found_arrived[thread, k]
    net.closed[group] = net.standing[group, OPEN] == 0
    return at


@inner
def open_groups(view):
    """Nobody has won: all but those that are left out of a trial may fire."""
    net = net_of(view)
    net.closed[:] = 0
    net.map_wins[:] = 0
    for group in range(net.local.shape[0]):
        net.standing[group, OPEN] = net.standing[group, WINS] = 0
        if net.local[group, RADIUS] < 0:
            continue
        row = net.pops[net.groups[group, 0]]
        for i in range(row[BEGIN], row[END]):
            net.muted[i] &= SILENCED
            net.standing[group, OPEN] += net.muted[i] == 0


@inner
def admit_all(view, row):
    """Nobody is left out any more; who was silenced by a winner still is."""
    net = net_of(view)
    for i in range(row[BEGIN], row[END]):
        net.standing[row[GROUP], OPEN] += net.muted[i] == SILENCED
        net.muted[i] &= ~SILENCED


@inner
def settle(view, thread, pop, row, n, step, at, done, h):
    """Let the winner among the found neurons of a group fire; return the next place in the log."""
    net = net_of(view)
    group = row[GROUP]
    if net.local[group, RADIUS] >= 0:
        return settle_locally(view, thread, pop, row, n, step, at, done, h)
    winner = choose(view, thread, group, row, n, step)
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
