"""Groups with several winners, each of which silences what is near it: the host decides them for the chip."""

# mypy: ignore-errors
from neuro.kernels.jit import inner
from neuro_chip.groups import choose
from neuro_chip.tables import (
    BEGIN,
    BLOCKED,
    CLOSED,
    DECIDED,
    END,
    GROUP,
    LOCAL_COLUMNS,
    LOCAL_MAPS,
    LOCAL_ROWS,
    OPEN,
    PER_MAP,
    RADIUS,
    WINNER,
    WINS,
    WON,
)


@inner
def settle_locally(net, row, step):
    """Of the candidates of a group leave those that win, the best first."""
    group, lo, hi = row[GROUP], row[BEGIN], row[END]
    best = choose(net, row, lo, hi, 1, step)
    while best >= 0:
        win(net, row, best, step)
        best = choose(net, row, lo, hi, 1, step)
    for i in range(lo, hi):
        if net.fired[i] and not net.muted[i] & WON:
            net.fired[i] = 0
    net.groups[group, CLOSED] = net.standing[group, OPEN] == 0


@inner
def win(net, row, i, step):
    """Neuron i wins: enter it, keep the voltages of its map if it is the first of it, and silence what is near."""
    group, lo = row[GROUP], row[BEGIN]
    local = net.local[group]
    maps, rows, columns, radius = local[LOCAL_MAPS], local[LOCAL_ROWS], local[LOCAL_COLUMNS], local[RADIUS]
    places = rows * columns
    m, r, c = (i - lo) // places, (i - lo) // columns % rows, (i - lo) % columns
    own = lo + m * places
    if net.map_wins[group, m] == 0:
        for k in range(own, own + places):
            net.potential[k] = net.v[k]
    for near_r in range(max(0, r - radius), min(rows, r + radius + 1)):
        for near_c in range(max(0, c - radius), min(columns, c + radius + 1)):
            place = lo + near_r * columns + near_c
            silence(net, group, place, place + maps * places, places)
    net.map_wins[group, m] += 1
    if net.map_wins[group, m] == local[PER_MAP]:
        silence(net, group, own, own + places, 1)
    net.muted[i] |= WON
    if net.groups[group, WINNER] < 0:
        net.groups[group, WINNER] = i - lo
        net.groups[group, DECIDED] = step
    net.won[lo + net.standing[group, WINS], 0] = i - lo
    net.won[lo + net.standing[group, WINS], 1] = step
    net.standing[group, WINS] += 1


@inner
def silence(net, group, begin, end, step):
    """Silence the neurons begin:end:step that are not yet."""
    for i in range(begin, end, step):
        net.standing[group, OPEN] -= net.muted[i] == 0
        net.muted[i] |= BLOCKED
