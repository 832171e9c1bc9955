"""Groups with several winners, each of which silences what is near it."""

# mypy: ignore-errors
from neuro.kernels.jit import inner
from neuro_event.candidates import choose, weigh_maps
from neuro_event.neurons import emit, spike
from neuro_event.tables import (
    BEGIN,
    BLOCKED,
    DECIDED,
    END,
    GROUP,
    IN_TRIAL,
    LOCAL_COLUMNS,
    LOCAL_MAPS,
    LOCAL_ROWS,
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
    rows, columns, radius = local[LOCAL_ROWS], local[LOCAL_COLUMNS], local[RADIUS]
    m, r, c = net.order[i] // (rows * columns), net.order[i] // columns % rows, net.order[i] % columns
    for near_r in range(max(0, r - radius), min(rows, r + radius + 1)):
        for near_c in range(max(0, c - radius), min(columns, c + radius + 1)):
            place = row[BEGIN] + (near_r * columns + near_c) * local[NEXT_PLACE]
            silence(view, row, group, place, place + local[LOCAL_MAPS] * local[NEXT_MAP], local[NEXT_MAP])
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
    best = choose(view, group, row, net.found[thread], n, step)
    while best >= 0:
        win(view, row, best, step)
        best = choose(view, group, row, net.found[thread], n, step)
    for k in range(n):
        i = net.found[thread, k]
        if net.muted[i] & WON:
            spike(view, pop, i)
            at = emit(view, thread, pop, i, 1, step, done, h, at)
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
