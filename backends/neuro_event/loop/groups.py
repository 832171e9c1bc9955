"""Groups: which of the neurons at threshold fire, and which that resets."""

# mypy: ignore-errors
import math

from neuro.kernels.draws import step_word, uniform
from neuro.kernels.jit import kernel, subkernel
from neuro_event.loop import tables as t
from neuro_event.loop.neurons import emit, spike, wake
from neuro_event.loop.tables import net_of


@kernel
def settle(view, thread, pop, n, step, at, done, h):
    """Let the winner among the found neurons of a group fire; return the next place in the log."""
    net = net_of(view)
    row = net.pops[pop]
    group = row[t.GROUP]
    if net.local[group, t.RADIUS] >= 0:
        return settle_locally(view, thread, pop, row, n, step, at, done, h)
    if net.groups[group, t.RIVALS] > 0:
        return settle_rivals(view, thread, pop, row, n, step, at, done, h)
    # A group lies on one thread, so all its candidates are in this thread's list.
    winner = choose(view, group, row, net.found[thread], n, step)
    if net.groups[group, t.IN_TRIAL] == 1 and net.groups[group, t.WINNER] < 0:
        # Before anybody is reset: the potentials of the maps are those at the decision.
        weigh_maps(view, thread, row, step, h)
        net.groups[group, t.WINNER] = winner
        net.groups[group, t.DECIDED] = step
    for k in range(n):
        i = net.found[thread, k]
        if i == winner:
            spike(view, pop, i)
            at = emit_found(view, thread, pop, k, step, at, done, h)
        # Losers of "best of each step" are reset without a spike; of "first to fire" they keep their potential, since
        # none of them fires any more.
        elif net.groups[group, t.FIRST_TO_FIRE] == 0:
            spike(view, pop, i)
    if net.groups[group, t.FIRST_TO_FIRE] == 1:
        net.closed[group] = 1
    return at


@subkernel
def emit_found(view, thread, pop, k, step, at, done, h):
    """Enter the spike of the found neuron number k; return the next place in the log."""
    net = net_of(view)
    net.active[thread, pop] += 1 - net.found_arrived[thread, k]
    return emit(view, thread, pop, net.found[thread, k], 1, step, done, h, at)


@subkernel
def choose(view, group, row, candidates, n, step):
    """The winner of the first n candidates of a group that may win: largest margin, then keyed draw, then id; or -1."""
    net = net_of(view)
    best, best_margin, best_draw = -1, -math.inf, -1.0
    base = step_word(net.group_keys[group], step)
    for k in range(n):
        i = candidates[k]
        if net.muted[i] != 0:
            continue
        c = net.constants[row[t.CONSTANT] + (i - row[t.BEGIN]) * row[t.CONSTANT_STRIDE]]
        margin = net.state[0, i] - c[0]
        # Most candidates lose by their margin: the hash of a draw is worked out for ties with the best alone.
        if margin < best_margin:
            continue
        # Keyed by the id, not by the place inside, so ties fall alike on all backends.
        draw = uniform(base, net.order[i])
        if margin > best_margin or draw > best_draw or (draw == best_draw and net.order[i] < net.order[best]):
            best, best_margin, best_draw = i, margin, draw
    return best


@subkernel
def weigh_maps(view, thread, row, step, h):
    """Largest V_m of each map that has not won, and the neuron that has it (the smaller id of equals)."""
    net = net_of(view)
    # A map that has won keeps what it had when it did.
    wins = net.map_wins[row[t.GROUP]]
    for block in range(row[t.FIRST_BLOCK], row[t.LAST_BLOCK]):
        # A sleeping block has the potentials of the step in which it fell asleep.
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
        # The first state is V_m wherever a model has it, see `Neuron`; groups of others are refused.
        v = net.state[0, i]
        if v > net.potential[m] or (v == net.potential[m] and net.order[i] < net.order[net.best[m]]):
            net.potential[m] = v
            net.best[m] = i


@subkernel
def first_rival(view, row, i):
    """The first of the neurons of which only one fires when neuron i does."""
    net = net_of(view)
    apart = net.groups[row[t.GROUP], t.APART]
    # Maps lie innermost, so neurons that differ along one axis are equally far apart.
    before = (i - row[t.BEGIN]) // apart % net.groups[row[t.GROUP], t.RIVALS]
    return i - before * apart


@subkernel
def best_rival(view, thread, row, i, step):
    """The winner among neuron i and its rivals at threshold."""
    net = net_of(view)
    # Rivals lie at equal distances: two numbers tell them, without a list.
    first, apart = first_rival(view, row, i), net.groups[row[t.GROUP], t.APART]
    n = 0
    for k in range(net.groups[row[t.GROUP], t.RIVALS]):
        j = first + k * apart
        if net.fired[j] != 0:
            net.rivals[thread, n] = j
            n += 1
    return choose(view, row[t.GROUP], row, net.rivals[thread], n, step)


@subkernel
def reset_rivals(view, thread, row, i, step, h):
    """Reset neuron i, which fires, and all its rivals."""
    net = net_of(view)
    first, apart = first_rival(view, row, i), net.groups[row[t.GROUP], t.APART]
    for k in range(net.groups[row[t.GROUP], t.RIVALS]):
        j = first + k * apart
        if net.awake[j // t.BLOCK] == 0:
            wake(view, thread, row[t.NUMBER], j // t.BLOCK, step, h)
        spike(view, row[t.NUMBER], j)


@subkernel
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
        # The winner is reset with its rivals; it emits afterwards, so that its spike is logged once.
        reset_rivals(view, thread, row, i, step, h)
        at = emit_found(view, thread, pop, k, step, at, done, h)
    return at


@subkernel
def silence(view, row, group, begin, end, step):
    """Silence the neurons begin:end:step that are not yet."""
    net = net_of(view)
    for i in range(begin, end, step):
        # Counted once a neuron: a neuron that is silenced twice, by its place and by its map, was open once.
        net.standing[group, t.OPEN] -= net.muted[i] == 0
        net.muted[i] |= t.BLOCKED


@subkernel
def win(view, row, i, step):
    """Neuron i of a group with several winners wins: enter it, and silence what is near it."""
    net = net_of(view)
    group = row[t.GROUP]
    local = net.local[group]
    rows, columns, radius = local[t.LOCAL_ROWS], local[t.LOCAL_COLUMNS], local[t.RADIUS]
    # By id, (map, row, column); inside, maps are innermost, so places are worked out from steps between neighbours.
    m, r, c = net.order[i] // (rows * columns), net.order[i] // columns % rows, net.order[i] % columns
    for near_r in range(max(0, r - radius), min(rows, r + radius + 1)):
        for near_c in range(max(0, c - radius), min(columns, c + radius + 1)):
            place = row[t.BEGIN] + (near_r * columns + near_c) * local[t.NEXT_PLACE]
            silence(view, row, group, place, place + local[t.LOCAL_MAPS] * local[t.NEXT_MAP], local[t.NEXT_MAP])
    net.map_wins[group, m] += 1
    # Tested for equality: once a map is full none of it can win again, so the count goes no further.
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
def settle_locally(view, thread, pop, row, n, step, at, done, h):
    """Let those of the found neurons fire that win, the best first; return the next place in the log."""
    net = net_of(view)
    group = row[t.GROUP]
    if net.groups[group, t.IN_TRIAL] == 1:
        weigh_maps(view, thread, row, step, h)
    best = choose(view, group, row, net.found[thread], n, step)
    # Each winner silences others, so the best of the rest is looked for anew.
    while best >= 0:
        win(view, row, best, step)
        best = choose(view, group, row, net.found[thread], n, step)
    for k in range(n):
        i = net.found[thread, k]
        if net.muted[i] & t.WON:
            spike(view, pop, i)
            at = emit_found(view, thread, pop, k, step, at, done, h)
    net.closed[group] = net.standing[group, t.OPEN] == 0
    return at


@subkernel
def open_groups(view):
    """No neuron has won: all but those that are left out of a trial may fire."""
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
def admit_all(view, row):
    """No neuron is left out any more; those silenced by a winner still are."""
    net = net_of(view)
    for i in range(row[t.BEGIN], row[t.END]):
        net.standing[row[t.GROUP], t.OPEN] += net.muted[i] == t.SILENCED
        net.muted[i] &= ~t.SILENCED
