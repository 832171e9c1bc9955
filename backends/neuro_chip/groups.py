"""Groups in which one neuron, or one of some rivals, fires: the host decides them for the chip."""

from __future__ import annotations

import numpy as np

from neuro.kernels.draws import step_word, uniform
from neuro.kernels.jit import subkernel
from neuro_chip.tables import (
    APART,
    BEGIN,
    BLOCKED,
    CLOSED,
    DECIDED,
    END,
    FIRST_TO_FIRE,
    GROUP,
    LOCAL_COLUMNS,
    LOCAL_MAPS,
    LOCAL_ROWS,
    OPEN,
    PER_MAP,
    RADIUS,
    RIVALS,
    WINNER,
    WINS,
    WON,
)

# mypy: ignore-errors


@subkernel
def fire(net, i):
    """Reset a neuron that spiked."""
    net.v[i] = net.v_reset[i]
    net.hold[i] = net.refractory[i]


@subkernel
def choose(net, row, first, last, apart, step):
    """The candidate of first:last:apart that may win of the largest margin; of equal ones the larger draw; or -1."""
    best = -1
    best_margin, best_draw = np.int64(0), -1.0
    # The chip has no winner-take-all: its host compares voltages after each step, with the keyed draws of the float
    # backends, so that ties fall alike.
    base = step_word(net.group_keys[row[GROUP]], step)
    for i in range(first, last, apart):
        if not net.fired[i] or net.muted[i]:
            continue
        margin = np.int64(net.v[i]) - np.int64(net.threshold[i])  # of two numbers of 32 bits: it may take 33
        draw = uniform(base, i - row[BEGIN])
        if best < 0 or margin > best_margin or (margin == best_margin and draw > best_draw):
            best, best_margin, best_draw = i, margin, draw
    return best


@subkernel
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
            # Kept before losers are reset: rules for trials read the potentials at the decision.
            net.potential[i] = net.v[i]
    for i in range(lo, hi):
        if net.fired[i] and i != best:
            net.fired[i] = 0
            if not net.groups[group, FIRST_TO_FIRE]:
                fire(net, i)
    if net.groups[group, FIRST_TO_FIRE]:
        net.groups[group, CLOSED] = 1


@subkernel
def settle_rivals(net, row, step):
    """Of neurons that are rivals the best fires and all others are reset."""
    group, lo = row[GROUP], row[BEGIN]
    rivals, apart = net.groups[group, RIVALS], net.groups[group, APART]
    for first in range(lo, row[END]):
        last = first + rivals * apart
        # Each set of rivals once, from its first neuron.
        if (first - lo) // apart % rivals != 0:
            continue
        best = choose(net, row, first, last, apart, step)
        if best >= 0:
            for i in range(first, last, apart):
                if i != best:
                    net.fired[i] = 0
                    fire(net, i)


# mypy: ignore-errors


@subkernel
def settle_locally(net, row, step):
    """Of the candidates of a group leave those that win, the best first."""
    group, lo, hi = row[GROUP], row[BEGIN], row[END]
    best = choose(net, row, lo, hi, 1, step)
    while best >= 0:
        win(net, row, best, step)
        # A winner silences others, so the best of the rest is looked for anew.
        best = choose(net, row, lo, hi, 1, step)
    for i in range(lo, hi):
        if net.fired[i] and not net.muted[i] & WON:
            net.fired[i] = 0
    net.groups[group, CLOSED] = net.standing[group, OPEN] == 0


@subkernel
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


@subkernel
def silence(net, group, begin, end, step):
    """Silence the neurons begin:end:step that are not yet."""
    for i in range(begin, end, step):
        net.standing[group, OPEN] -= net.muted[i] == 0
        net.muted[i] |= BLOCKED
