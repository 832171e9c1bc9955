"""The beginning and the end of a trial on a chip: what the host does round the loop, in one pass each."""

# mypy: ignore-errors
import math

from neuro.core.clock import NEVER
from neuro.kernels.jit import kernel, subkernel
from neuro_chip.net import net_of
from neuro_chip.tables import (
    AFTER,
    BEGIN,
    CLOSED,
    EMITTED,
    END,
    MERGED,
    NEXT,
    NONE,
    OPEN,
    POPULATION,
    RADIUS,
    SILENCED,
    WINNER,
    WINS,
)


@subkernel
def count_open(net):
    """Count how many of each group with several winners may still win."""
    for k in range(net.groups.shape[0]):
        if net.local[k, RADIUS] >= 0:
            row = net.pops[net.groups[k, POPULATION]]
            free = 0
            for i in range(row[BEGIN], row[END]):
                free += net.muted[i] == 0
            net.standing[k, OPEN] = free


@subkernel
def open_groups(net):
    """No group has decided, and whoever was silenced by a winner may fire."""
    net.groups[:, CLOSED] = 0
    net.groups[:, WINNER] = NONE
    for i in range(net.muted.size):
        # What a winner silenced is over; whom the trial left out stays so until it ends.
        net.muted[i] &= SILENCED
    net.map_wins[:] = 0
    net.standing[:, WINS] = 0
    count_open(net)


@kernel
def open_all(view, words):
    """Open the groups; `view` and `words` are as in `net`."""
    open_groups(net_of(view, words))


@kernel
def begin_trial(view, words, output, silenced, rested):
    """Drop all that is under way, silence maps of a population, and open the groups.

    Args:
        view: as in `net`.
        words: likewise.
        output: the population.
        silenced: whether each of its maps is.
        rested: whether none of its neurons is refractory any more.
    """
    net = net_of(view, words)
    # One kernel does all of it: each call from NumPy takes about a microsecond, and a trial begins with a dozen of
    # them.
    net.ring[:] = 0
    net.came[:] = 0
    net.arrived[:] = 0
    net.arrived_all[:] = 0
    net.first[:] = NEVER
    net.clock[EMITTED] = 0
    begin, end = net.pops[output, BEGIN], net.pops[output, END]
    per_map = (end - begin) // silenced.size
    for m in range(silenced.size):
        net.muted[begin + m * per_map : begin + (m + 1) * per_map] = SILENCED if silenced[m] else 0
    if rested:
        # A neuron that decided the last trial in its last step would else begin this one refractory.
        net.hold[begin:end] = 0
    open_groups(net)


@kernel
def list_trial(view, words, population, first, ticks, ids, began):
    """List a trial's spikes, sorted by tick, then id, of a generator from place `first` on, equal ones joined."""
    net = net_of(view, words)
    at, begin = first - 1, net.pops[population, BEGIN]
    for k in range(ticks.size):
        # Several spikes of one neuron in one tick are one event of that multiplicity, as generators emit them.
        if k > 0 and ticks[k] == ticks[k - 1] and ids[k] == ids[k - 1]:
            net.list_times[at] += 1
            continue
        at += 1
        net.list_steps[at] = began + 1 + ticks[k]
        net.list_ids[at] = begin + ids[k]
        net.list_times[at] = 1
    net.cursor[population, NEXT] = first
    net.cursor[population, AFTER] = at + 1


@kernel
def end_trial(view, words, output, group, volt, rest, potential, best):
    """Let all fire whom the trial silenced, and find the largest V_m of each map and the first neuron that has it.

    It is that at the decision, with several winners of each map at its own, else the present one.

    Args:
        view: as in `net`.
        words: likewise.
        output: the population.
        group: that decides it.
        volt: units of the voltage register per mV.
        rest: potential in mV where the register is 0, one or one a neuron.
        potential: filled, in mV, an entry a map.
        best: filled, counted in the population.

    Returns:
        Whether a register has overflowed since the start.
    """
    net = net_of(view, words)
    begin, end = net.pops[output, BEGIN], net.pops[output, END]
    for i in range(begin, end):
        net.muted[i] &= ~SILENCED
    count_open(net)
    per_map = (end - begin) // potential.size
    for m in range(potential.size):
        if net.local[group, RADIUS] >= 0:
            decided = net.map_wins[group, m] > 0
        else:
            decided = net.groups[group, WINNER] >= 0
        # After the decision losers were reset, so their present voltages say nothing of how close it was.
        v = net.potential if decided else net.v
        potential[m] = -math.inf
        for k in range(m * per_map, (m + 1) * per_map):
            # In mV, not in register units: neurons may rest at different potentials.
            here = v[begin + k] / volt + rest[k if rest.size > 1 else 0]
            if here > potential[m]:
                potential[m], best[m] = here, k
    wrapped = False
    for pop in range(net.native.shape[0]):
        for column in range(MERGED):
            wrapped |= net.native[pop, column] != 0
    return wrapped
