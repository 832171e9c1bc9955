"""What the host does round the loop in trials, in one pass each: their beginning, their end, and rules between them."""

# mypy: ignore-errors
import math
from functools import cache

import numpy as np

from neuro.core.clock import NEVER
from neuro.kernels.draws import step_word, uniform
from neuro.kernels.jit import compiled, kernel, subkernel
from neuro_chip import tables as t
from neuro_chip.tables import net_of


@subkernel
def count_open(net):
    """Count how many of each group with several winners may still win."""
    for k in range(net.groups.shape[0]):
        if net.local[k, t.RADIUS] >= 0:
            row = net.pops[net.groups[k, t.POPULATION]]
            free = 0
            for i in range(row[t.BEGIN], row[t.END]):
                free += net.muted[i] == 0
            net.standing[k, t.OPEN] = free


@subkernel
def open_groups(net):
    """No group has decided, and whoever was silenced by a winner may fire."""
    net.groups[:, t.CLOSED] = 0
    net.groups[:, t.WINNER] = t.NONE
    for i in range(net.muted.size):
        # What a winner silenced is over; whom the trial left out stays so until it ends.
        net.muted[i] &= t.SILENCED
    net.map_wins[:] = 0
    net.standing[:, t.WINS] = 0
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
    net.clock[t.EMITTED] = 0
    begin, end = net.pops[output, t.BEGIN], net.pops[output, t.END]
    per_map = (end - begin) // silenced.size
    for m in range(silenced.size):
        net.muted[begin + m * per_map : begin + (m + 1) * per_map] = t.SILENCED if silenced[m] else 0
    if rested:
        # A neuron that decided the last trial in its last step would else begin this one refractory.
        net.hold[begin:end] = 0
    open_groups(net)


@kernel
def list_trial(view, words, population, first, ticks, ids, began):
    """List a trial's spikes, sorted by tick, then id, of a generator from place `first` on, equal ones joined."""
    net = net_of(view, words)
    at, begin = first - 1, net.pops[population, t.BEGIN]
    for k in range(ticks.size):
        # Several spikes of one neuron in one tick are one event of that multiplicity, as generators emit them.
        if k > 0 and ticks[k] == ticks[k - 1] and ids[k] == ids[k - 1]:
            net.list_counts[at] += 1
            continue
        at += 1
        net.list_steps[at] = began + 1 + ticks[k]
        net.list_ids[at] = begin + ids[k]
        net.list_counts[at] = 1
    net.cursor[0, population], net.cursor[1, population] = first, at + 1


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
    begin, end = net.pops[output, t.BEGIN], net.pops[output, t.END]
    for i in range(begin, end):
        net.muted[i] &= ~t.SILENCED
    count_open(net)
    per_map = (end - begin) // potential.size
    for m in range(potential.size):
        if net.local[group, t.RADIUS] >= 0:
            decided = net.map_wins[group, m] > 0
        else:
            decided = net.groups[group, t.WINNER] >= 0
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
        for column in range(t.MERGED):
            wrapped |= net.native[pop, column] != 0
    return wrapped


@subkernel
def rounded(exact, low, high, grain, draw):
    """The mantissa below or above, so that the mean is exact; draw is uniform in [0, 1)."""
    # Rounded to nearest, lessons below half a grain would never move a weight; drawn, their mean is exact.
    floor = np.floor(exact / grain)
    mantissa = np.int64(floor + (draw < exact / grain - floor)) * grain
    return min(max(mantissa, low), high)


@kernel
def ages(first, begin, sources, delay, now, resolution, since):
    """For each source the ms from the arrival of its first spike to step `now`; -inf where it has not fired.

    `first` is of all neurons, `begin` where the sources' population begins there; `delay` is one, or one per source.
    """
    for k in range(sources.size):
        fired = first[begin + sources[k]]
        late = delay[k if delay.size > 1 else 0]
        since[k] = -np.inf if fired == NEVER else (now - fired - late) * resolution


@cache
def teacher(teach):
    """The pass over the inputs of one neuron, compiled for a rule's `teach`."""
    function = compiled(teach)

    @kernel
    def learn(mantissas, step, low, high, grain, slots, since, lesson, rule, key, count):
        """The rule for the inputs of one neuron.

        Args:
            mantissas: all weights, changed.
            step: weight per mantissa.
            low: the smallest mantissa.
            high: the largest.
            grain: the step between two.
            slots: which weight each input has.
            since: ms from the arrival of its spike to the moment of the lesson.
            lesson: the number that the rule gets.
            rule: constants of the rule.
            key: of the draws.
            count: how many changes there were, this one included; each has draws of its own.
        """
        # Keyed by how many lessons there were: the same draws however trials are cut into calls.
        base = step_word(key, count)
        for k in range(slots.size):
            w = function(mantissas[slots[k]] * step, since[k], lesson, rule)
            mantissas[slots[k]] = rounded(w / step, low, high, grain, uniform(base, slots[k]))

    return learn


@cache
def grower(encourage):
    """The pass over a range of weights, compiled for a rule's `encourage`."""
    function = compiled(encourage)

    @kernel
    def grow(mantissas, step, low, high, grain, begin, end, rule, key, count):
        """The rule for all weights from begin to end; arguments as of `teacher`."""
        base = step_word(key, count)
        for k in range(begin, end):
            w = function(mantissas[k] * step, rule)
            mantissas[k] = rounded(w / step, low, high, grain, uniform(base, k))

    return grow
