"""Kernels of groups, which choose the neurons at threshold that fire, and reset the other neurons."""

# mypy: ignore-errors
import math

from neuro.kernels.draws import step_word, uniform
from neuro.kernels.jit import kernel, subkernel
from neuro_event.loop import tables as t
from neuro_event.loop.neurons import emit, spike, wake
from neuro_event.loop.tables import net_of


@kernel
def settle(view, thread, pop, n, step, log_at, processed_step, h):
    """Let the winners among the candidates of a group fire. Return the next place in the log."""
    net = net_of(view)
    row = net.pops[pop]
    group = row[t.GROUP]
    if net.local[group, t.RADIUS] >= 0:
        return settle_locally(view, thread, pop, row, n, step, log_at, processed_step, h)
    if net.groups[group, t.RIVALS] > 0:
        return settle_rivals(view, thread, pop, row, n, step, log_at, processed_step, h)
    # A group belongs to a single thread, so all candidates are in this thread's list.
    winner = choose(view, group, row, net.candidates[thread], n, step)
    if net.groups[group, t.IN_TRIAL] == 1 and net.groups[group, t.WINNER] < 0:
        # The potentials of the maps are recorded before any neuron is reset.
        record_potentials(view, thread, row, step, h)
        net.groups[group, t.WINNER] = winner
        net.groups[group, t.DECIDED] = step
    for k in range(n):
        i = net.candidates[thread, k]
        if i == winner:
            spike(view, pop, i)
            log_at = emit_candidate(view, thread, pop, k, step, log_at, processed_step, h)
        # Losers of "best of each step" are reset without a spike. Losers of "first to fire" keep their potential,
        # because they cannot fire any more.
        elif net.groups[group, t.FIRST_TO_FIRE] == 0:
            spike(view, pop, i)
    if net.groups[group, t.FIRST_TO_FIRE] == 1:
        net.closed[group] = 1
    return log_at


@subkernel
def emit_candidate(view, thread, pop, k, step, log_at, processed_step, h):
    """Log the spike of candidate k. Return the next place in the log."""
    net = net_of(view)
    net.active[thread, pop] += 1 - net.candidate_arrived[thread, k]
    return emit(view, thread, pop, net.candidates[thread, k], 1, step, processed_step, h, log_at)


@subkernel
def choose(view, group, row, candidates, n, step):
    """Return the winner among the first n candidates that are not muted, or -1.

    The largest margin above threshold wins, then the largest keyed draw, then the smallest id.
    """
    net = net_of(view)
    best, best_margin, best_draw = -1, -math.inf, -1.0
    base = step_word(net.group_keys[group], step)
    for k in range(n):
        i = candidates[k]
        if net.muted[i] != 0:
            continue
        c = net.constants[row[t.CONSTANT] + (i - row[t.BEGIN]) * row[t.CONSTANT_STRIDE]]
        margin = net.state[0, i] - c[0]
        # Most candidates lose by their margin, so a draw is only computed for ties with the best.
        if margin < best_margin:
            continue
        # The draw depends on the id, not on the internal place, so all backends decide ties in the same way.
        draw = uniform(base, net.order[i])
        if margin > best_margin or draw > best_draw or (draw == best_draw and net.order[i] < net.order[best]):
            best, best_margin, best_draw = i, margin, draw
    return best


@subkernel
def record_potentials(view, thread, row, step, h):
    """Record the largest V_m of each map that has not won, and the neuron with this V_m.

    If several neurons have it, the smallest id is recorded.
    """
    net = net_of(view)
    # A map that has won keeps the potential at its first win.
    wins = net.map_wins[row[t.GROUP]]
    for block in range(row[t.FIRST_BLOCK], row[t.LAST_BLOCK]):
        # A sleeping block still has the potentials of the step in which it fell asleep.
        if net.awake[block] == 0:
            wake(view, thread, row[t.NUMBER], block, step, h)
    for m in range(net.potential.size):
        if wins[m] == 0:
            net.potential[m] = -math.inf
            net.best[m] = -1
    for i in range(row[t.BEGIN], row[t.END]):
        m = net.map_of[i - row[t.BEGIN]]
        if wins[m] > 0:
            continue
        # If a model has V_m, it is the first state, see `Neuron`. Groups of other models are refused.
        v = net.state[0, i]
        if v > net.potential[m] or (v == net.potential[m] and net.order[i] < net.order[net.best[m]]):
            net.potential[m] = v
            net.best[m] = i


@subkernel
def first_rival(view, row, i):
    """Return the first of neuron i and all rivals, among which a single neuron fires."""
    net = net_of(view)
    distance = net.groups[row[t.GROUP], t.APART]
    # Rivals differ along a single axis of the population, so they have equal distances.
    before = (i - row[t.BEGIN]) // distance % net.groups[row[t.GROUP], t.RIVALS]
    return i - before * distance


@subkernel
def best_rival(view, thread, row, i, step):
    """Return the winner among neuron i and its rivals at threshold."""
    net = net_of(view)
    first, distance = first_rival(view, row, i), net.groups[row[t.GROUP], t.APART]
    n = 0
    for k in range(net.groups[row[t.GROUP], t.RIVALS]):
        j = first + k * distance
        if net.fired[j] != 0:
            net.rivals[thread, n] = j
            n += 1
    return choose(view, row[t.GROUP], row, net.rivals[thread], n, step)


@subkernel
def reset_rivals(view, thread, row, i, step, h):
    """Reset neuron i, which fires, and all its rivals."""
    net = net_of(view)
    first, distance = first_rival(view, row, i), net.groups[row[t.GROUP], t.APART]
    for k in range(net.groups[row[t.GROUP], t.RIVALS]):
        j = first + k * distance
        if net.awake[j // t.BLOCK] == 0:
            wake(view, thread, row[t.NUMBER], j // t.BLOCK, step, h)
        spike(view, row[t.NUMBER], j)


@subkernel
def settle_rivals(view, thread, pop, row, n, step, log_at, processed_step, h):
    """Let the winners among the candidates fire, and reset their rivals. Return the next place in the log."""
    net = net_of(view)
    winners = 0
    for k in range(n):
        i = net.candidates[thread, k]
        if best_rival(view, thread, row, i, step) == i:  # all winners are chosen before any reset changes a potential
            net.candidates[thread, winners] = i
            net.candidate_arrived[thread, winners] = net.candidate_arrived[thread, k]
            winners += 1
    for k in range(winners):
        i = net.candidates[thread, k]
        # `reset_rivals` also resets the winner, so the spike is only logged here.
        reset_rivals(view, thread, row, i, step, h)
        log_at = emit_candidate(view, thread, pop, k, step, log_at, processed_step, h)
    return log_at


@subkernel
def silence(view, row, group, begin, end, step):
    """Block the neurons begin:end:step, so that they cannot win any more."""
    net = net_of(view)
    for i in range(begin, end, step):
        # A neuron that is blocked twice, by a neighbour and by its map, counts as open only once.
        net.standing[group, t.OPEN] -= net.muted[i] == 0
        net.muted[i] |= t.BLOCKED


@subkernel
def enter_winner(view, row, i, step):
    """Record neuron i as a winner of a group with several winners, and block the neurons near it."""
    net = net_of(view)
    group = row[t.GROUP]
    local = net.local[group]
    rows, columns, radius = local[t.LOCAL_ROWS], local[t.LOCAL_COLUMNS], local[t.RADIUS]
    # Ids are in the order (map, row, column). Internal places have the maps innermost.
    m, r, c = net.order[i] // (rows * columns), net.order[i] // columns % rows, net.order[i] % columns
    for near_r in range(max(0, r - radius), min(rows, r + radius + 1)):
        for near_c in range(max(0, c - radius), min(columns, c + radius + 1)):
            place = row[t.BEGIN] + (near_r * columns + near_c) * local[t.NEXT_PLACE]
            silence(view, row, group, place, place + local[t.LOCAL_MAPS] * local[t.NEXT_MAP], local[t.NEXT_MAP])
    net.map_wins[group, m] += 1
    # Equality is enough: in a map with PER_MAP wins no neuron can win again, so the count does not increase.
    if net.map_wins[group, m] == local[t.PER_MAP]:
        place = row[t.BEGIN] + m * local[t.NEXT_MAP]
        silence(view, row, group, place, place + rows * columns * local[t.NEXT_PLACE], local[t.NEXT_PLACE])
    net.muted[i] |= t.WON
    if net.groups[group, t.IN_TRIAL] == 1:
        if net.groups[group, t.WINNER] < 0:
            net.groups[group, t.WINNER] = i
            net.groups[group, t.DECIDED] = step
        net.won[net.standing[group, t.WINS], 0] = i
        net.won[net.standing[group, t.WINS], 1] = step
        net.standing[group, t.WINS] += 1


@subkernel
def settle_locally(view, thread, pop, row, n, step, log_at, processed_step, h):
    """Choose winners among the candidates in turn, and let all winners fire. Return the next place in the log."""
    net = net_of(view)
    group = row[t.GROUP]
    if net.groups[group, t.IN_TRIAL] == 1:
        record_potentials(view, thread, row, step, h)
    best = choose(view, group, row, net.candidates[thread], n, step)
    # Each winner blocks other candidates, so the next winner is the best of the candidates that are left.
    while best >= 0:
        enter_winner(view, row, best, step)
        best = choose(view, group, row, net.candidates[thread], n, step)
    for k in range(n):
        i = net.candidates[thread, k]
        if net.muted[i] & t.WON:
            spike(view, pop, i)
            log_at = emit_candidate(view, thread, pop, k, step, log_at, processed_step, h)
    net.closed[group] = net.standing[group, t.OPEN] == 0
    return log_at


@subkernel
def open_groups(view):
    """Open all groups: every neuron may fire, unless it is silenced for the trial."""
    net = net_of(view)
    net.closed[:] = 0
    net.map_wins[:] = 0
    for group in range(net.local.shape[0]):
        net.standing[group, t.OPEN] = net.standing[group, t.WINS] = 0
        if net.local[group, t.RADIUS] < 0:
            continue
        row = net.pops[net.groups[group, 0]]
        for i in range(row[t.BEGIN], row[t.END]):
            net.muted[i] &= t.SILENCED
            net.standing[group, t.OPEN] += net.muted[i] == 0


@subkernel
def unmute_all(view, row):
    """Let the neurons that were silenced for a trial fire again. Neurons that a winner has blocked stay blocked."""
    net = net_of(view)
    for i in range(row[t.BEGIN], row[t.END]):
        net.standing[row[t.GROUP], t.OPEN] += net.muted[i] == t.SILENCED
        net.muted[i] &= ~t.SILENCED
