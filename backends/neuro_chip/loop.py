"""The one compiled loop over steps, and the groups in which one neuron, or one of some rivals, fires.

The chip has no groups: its host decides them after each step.
"""

# mypy: ignore-errors
from __future__ import annotations

import numpy as np

from neuro.kernels.draws import poisson_by_sum, step_word, uniform
from neuro.kernels.jit import kernel, subkernel
from neuro_chip import tables as t
from neuro_chip.build import update
from neuro_chip.deliver import may_gather, send, send_grids
from neuro_chip.tables import net_of


@subkernel
def fire(net, i):
    """Reset a neuron that spiked."""
    net.v[i] = net.v_reset[i] if net.fall[i] == 0 else net.v[i] - net.fall[i]
    net.hold[i] = net.refractory[i]


@subkernel
def choose(net, row, first, last, apart, step):
    """The candidate of first:last:apart that may win of the largest margin; of equal ones the larger draw; or -1."""
    best = -1
    best_margin, best_draw = np.int64(0), -1.0
    # The chip has no winner-take-all: its host compares voltages after each step, with the keyed draws of the float
    # backends, so that ties fall alike.
    base = step_word(net.group_keys[row[t.GROUP]], step)
    for i in range(first, last, apart):
        if not net.fired[i] or net.muted[i]:
            continue
        margin = np.int64(net.v[i]) - np.int64(net.threshold[i])  # of two numbers of 32 bits: it may take 33
        draw = uniform(base, i - row[t.BEGIN])
        if best < 0 or margin > best_margin or (margin == best_margin and draw > best_draw):
            best, best_margin, best_draw = i, margin, draw
    return best


@subkernel
def settle_one(net, row, step):
    """Of the candidates of a group the best fires."""
    group, lo, hi = row[t.GROUP], row[t.BEGIN], row[t.END]
    best = choose(net, row, lo, hi, 1, step)
    if best < 0:
        return
    if net.groups[group, t.WINNER] < 0:
        net.groups[group, t.WINNER] = best - lo
        net.groups[group, t.DECIDED] = step
        for i in range(lo, hi):
            # Kept before losers are reset: rules for trials read the potentials at the decision.
            net.potential[i] = net.v[i]
    for i in range(lo, hi):
        if net.fired[i] and i != best:
            net.fired[i] = 0
            if not net.groups[group, t.FIRST_TO_FIRE]:
                fire(net, i)
    if net.groups[group, t.FIRST_TO_FIRE]:
        net.groups[group, t.CLOSED] = 1


@subkernel
def settle_rivals(net, row, step):
    """Of neurons that are rivals the best fires and all others are reset."""
    group, lo = row[t.GROUP], row[t.BEGIN]
    rivals, apart = net.groups[group, t.RIVALS], net.groups[group, t.APART]
    for first in range(lo, row[t.END]):
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


@subkernel
def settle_locally(net, row, step):
    """Of the candidates of a group leave those that win, the best first."""
    group, lo, hi = row[t.GROUP], row[t.BEGIN], row[t.END]
    best = choose(net, row, lo, hi, 1, step)
    while best >= 0:
        win(net, row, best, step)
        # A winner silences others, so the best of the rest is looked for anew.
        best = choose(net, row, lo, hi, 1, step)
    for i in range(lo, hi):
        if net.fired[i] and not net.muted[i] & t.WON:
            net.fired[i] = 0
    net.groups[group, t.CLOSED] = net.standing[group, t.OPEN] == 0


@subkernel
def win(net, row, i, step):
    """Neuron i wins: enter it, keep the voltages of its map if it is the first of it, and silence what is near."""
    group, lo = row[t.GROUP], row[t.BEGIN]
    local = net.local[group]
    maps, rows, columns, radius = local[t.LOCAL_MAPS], local[t.LOCAL_ROWS], local[t.LOCAL_COLUMNS], local[t.RADIUS]
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
    if net.map_wins[group, m] == local[t.PER_MAP]:
        silence(net, group, own, own + places, 1)
    net.muted[i] |= t.WON
    if net.groups[group, t.WINNER] < 0:
        net.groups[group, t.WINNER] = i - lo
        net.groups[group, t.DECIDED] = step
    net.won[lo + net.standing[group, t.WINS], 0] = i - lo
    net.won[lo + net.standing[group, t.WINS], 1] = step
    net.standing[group, t.WINS] += 1


@subkernel
def silence(net, group, begin, end, step):
    """Silence the neurons begin:end:step that are not yet."""
    for i in range(begin, end, step):
        net.standing[group, t.OPEN] -= net.muted[i] == 0
        net.muted[i] |= t.BLOCKED


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


@subkernel
def emit(net, pop, row, i, times, step):
    """Neuron i, counted through all populations, emits."""
    if row[t.BINARY] and times > 1:  # before it is counted, recorded or sent
        net.native[pop, t.MERGED] += times - 1
        times = 1
    at = net.clock[t.EMITTED]
    net.emitted[at] = i
    net.emitted_times[at] = times
    net.clock[t.EMITTED] = at + 1
    net.events[i] += 1
    net.spikes[i] += times
    # The host's rules for trials ask for first spikes only; to look for them in the record would need a record.
    if net.first[i] > step:
        net.first[i] = step
    if row[t.RECORD]:
        at = net.clock[t.RECORDED]
        net.rec_steps[at] = step
        net.rec_ids[at] = i
        net.rec_counts[at] = times
        net.clock[t.RECORDED] = at + 1


@subkernel
def send_all(net, step):
    """Send the spikes of the last step, sorted by population.

    They are sent when the next step begins, not when they are emitted: what learning changes in a step is sent from the
    next on. What generators have emitted is sent before the host writes weights in between (`send_ahead`).
    """
    total = net.clock[t.EMITTED]
    first = 0
    for pop in range(net.pops.shape[0]):
        last, begin, end = first, net.pops[pop, t.BEGIN], net.pops[pop, t.END]
        # Emitted ids ascend, since populations are stepped in order: one pass cuts them by population.
        while last < total and net.emitted[last] < end:
            last += 1
        if first < last:
            for k in range(net.out_ends[pop], net.out_ends[pop + 1]):
                # `send_ahead` has sent these already, with the words of before the host wrote.
                if net.set_out[net.out[k]] < step:
                    send_along(net, net.out[k], begin, first, last, step)
        first = last
    net.clock[t.EMITTED] = 0


@subkernel
def send_along(net, q, begin, first, last, step):
    """The spikes first:last of those emitted in a step, of the population that begins at a neuron, are sent along q."""
    row = net.projections[q]
    if may_gather(net, row, net.pops[row[t.TARGET], t.RECEPTORS] == 2):
        # All spikes of the step together: they meet in the same places.
        send_grids(net, row, begin, first, last, step)
    else:
        for at in range(first, last):
            if net.stop[0] == t.AT_ONCE:
                return
            send(net, q, net.emitted[at] - begin, net.emitted_times[at], step)


@kernel
def send_ahead(view, words, pop, q):
    """Send what a population emitted in the last step along a projection, with the words of now."""
    net = net_of(view, words)
    total, step, begin, end = net.clock[t.EMITTED], net.clock[t.STEP], net.pops[pop, t.BEGIN], net.pops[pop, t.END]
    first = 0
    while first < total and net.emitted[first] < begin:
        first += 1
    last = first
    while last < total and net.emitted[last] < end:
        last += 1
    if net.set_out[q] < step:
        send_along(net, q, begin, first, last, step)
        net.set_out[q] = step


@subkernel
def count_active(net, pop, row, step):
    """Neurons that a spike reached or fired; what arrives now may be seen by the next update only."""
    lo, hi = row[t.BEGIN], row[t.END]
    n = hi - lo
    # Where input acts a step late (`LATE`), the arrivals of this update lie one slot ahead.
    slot = (step + row[t.LATE]) & (row[t.SLOTS] - 1)
    begin = row[t.RING] + slot * n
    arrived, fired = net.arrived[begin : begin + n], net.fired[lo:hi]
    if net.arrived_all[row[t.ARRIVED] + slot]:  # a dense row marks all its targets by one flag instead of n
        net.arrived_all[row[t.ARRIVED] + slot] = 0
        arrived[:] = 0
        net.active[pop] += n
        return
    count = np.uint32(0)
    for k in range(n):
        count += np.uint32(arrived[k] | fired[k])
        arrived[k] = 0
    net.active[pop] += count


@subkernel
def admit(fired, muted):
    """Leave those above threshold that may fire; return whether there are any."""
    some = np.uint8(0)
    for k in range(fired.size):
        fired[k] &= np.uint8(muted[k] == 0)
        # No early end: a loop without branches looks at many neurons at a time.
        some |= fired[k]
    return some != 0


@subkernel
def decide(net, row, step):
    """Of the candidates of a group leave those that fire; reset those that lose by it."""
    group = row[t.GROUP]
    fired = net.fired[row[t.BEGIN] : row[t.END]]
    some = admit(fired, net.muted[row[t.BEGIN] : row[t.END]])
    if net.groups[group, t.CLOSED]:
        fired[:] = 0
        some = False
    if net.local[group, t.RADIUS] >= 0:
        settle_locally(net, row, step)
    elif not some:
        return
    elif net.groups[group, t.RIVALS] > 0:
        settle_rivals(net, row, step)
    else:
        settle_one(net, row, step)


@subkernel
def any_fired(fired):
    """Whether any of some neurons is above threshold."""
    some = np.uint8(0)
    for k in range(fired.size):
        some |= fired[k]
    return some != 0


@subkernel
def advance_neurons(net, pop, row, step):
    """A population of neurons: update, decide, emit, count; one at rest only counts what is on its way."""
    slot = row[t.ARRIVED] + (step & (row[t.SLOTS] - 1))
    # A population at rest: nothing came, no neuron reached threshold, and the last step changed no bit of any state. So
    # the next would not either, and the step is left out until input comes or the host writes.
    came, net.came[slot] = net.came[slot], 0
    if row[t.KIND] == t.RELAY:
        relay(net, pop, row, step)
    elif came or not net.resting[pop]:
        before = 0 if came else keep_states(net, pop, row)
        reached = update_and_fire(net, pop, row, step)
        # what resets its states at certain steps is never at rest
        net.resting[pop] = not came and not reached and row[t.INTERVAL] == 0 and stayed(net, pop, row, before)
    count_active(net, pop, row, step)


@subkernel
def update_and_fire(net, pop, row, step):
    """Update the neurons of a population, and let those fire that do; return whether any was above threshold."""
    update(net, pop, row, step)
    group, fired = row[t.GROUP], net.fired[row[t.BEGIN] : row[t.END]]
    reached = some = any_fired(fired)
    if group >= 0 and (some or net.local[group, t.RADIUS] >= 0):
        decide(net, row, step)
        some = any_fired(fired)
    if some:
        for i in range(row[t.BEGIN], row[t.END]):
            if net.fired[i]:
                # Silenced for a trial: no spike and no reset; it may go on rising.
                if net.muted[i] & t.SILENCED:
                    net.fired[i] = 0
                    continue
                if row[t.GRADED]:  # its step has reset it
                    emit(net, pop, row, i, np.int64(net.payload[i]), step)
                else:
                    fire(net, i)
                    emit(net, pop, row, i, 1, step)
    return reached


@subkernel
def relay(net, pop, row, step):
    """Parrots: as many spikes as arrived."""
    n = row[t.END] - row[t.BEGIN]
    begin = row[t.RING] + (step & (row[t.SLOTS] - 1)) * n
    for k in range(n):
        # A parrot's slot counts spikes, not weights: `relay_projection` gives every synapse the word 1.
        times = net.ring[begin + k]
        net.ring[begin + k] = 0
        i = row[t.BEGIN] + k
        net.fired[i] = times > 0 and not net.muted[i]
        if net.fired[i]:
            emit(net, pop, row, i, np.int64(times), step)


@subkernel
def draw(net, pop, row, step):
    """One step of a poisson_generator."""
    if step <= row[t.START] or step > row[t.STOP]:
        return
    base = step_word(net.keys[pop], step)
    for i in range(row[t.BEGIN], row[t.END]):
        # Most draws are 0, and one comparison shows it: the sum over the distribution is only for the others.
        if uniform(base, i - row[t.BEGIN]) >= net.nothing[i]:
            times = poisson_by_sum(base, i - row[t.BEGIN], net.mean[i], net.nothing[i])
            if times > 0:
                emit(net, pop, row, i, times, step)


@subkernel
def list_spikes(net, pop, row, step):
    """The listed spikes of a spike_generator in this step."""
    at, end = net.cursor[0, pop], net.cursor[1, pop]
    while at < end and net.list_steps[at] <= step:
        if net.list_steps[at] == step:
            emit(net, pop, row, net.list_ids[at], net.list_counts[at], step)
        at += 1
    net.cursor[0, pop] = at


@kernel
def advance(view, words, end):
    """Run to a step; stop earlier where the record is full or the group that is waited for has decided.

    A spike reaches no neuron in the step in which it is emitted, so the order of the populations matters only to the
    record, which is sorted by them, and to `send_all`, which relies on that. `view` and `words` are as in `net`.
    """
    net = net_of(view, words)
    net.resting[:] = 0  # the host may have written anything
    total = net.v.size  # a step records at most one event a neuron: there is room for it, or the caller empties first
    while net.stop[0] == 0 and net.clock[t.STEP] < end and net.clock[t.RECORDED] + total <= net.rec_steps.size:
        step = net.clock[t.STEP] + 1
        # At the beginning of a step, so that the host may write weights between steps, and what was emitted before is
        # sent with what learning has written.
        send_all(net, step - 1)
        for pop in range(net.pops.shape[0]):
            if net.stop[0] == t.AT_ONCE:
                return
            row = net.pops[pop]
            if row[t.KIND] == t.POISSON:
                draw(net, pop, row, step)
            elif row[t.KIND] == t.LISTED:
                list_spikes(net, pop, row, step)
            elif row[t.KIND] != t.CURRENT:
                advance_neurons(net, pop, row, step)
        net.clock[t.STEP] = step
        group = net.clock[t.STOP_GROUP]
        if group >= 0 and net.groups[group, t.CLOSED]:
            return


@subkernel
def keep_states(net, pop, row):
    """Keep the states of a population for `stayed`; return what has been counted of it."""
    lo, hi = row[t.BEGIN], row[t.END]
    # Only when nothing came: a step with input is never one at rest, and pays nothing here.
    copy(net.still[0, lo:hi], net.v[lo:hi])
    copy(net.still[1, lo:hi], net.u[lo:hi])
    copy(net.still[2, lo:hi], net.g_inh[lo:hi])
    copy(net.still[3, lo:hi], net.hold[lo:hi])
    return counted(net, pop)


@subkernel
def stayed(net, pop, row, before):
    """Whether a step has changed neither the states that were kept nor what was counted."""
    lo, hi = row[t.BEGIN], row[t.END]
    return (
        equal(net.still[0, lo:hi], net.v[lo:hi])
        and equal(net.still[1, lo:hi], net.u[lo:hi])
        and equal(net.still[2, lo:hi], net.g_inh[lo:hi])
        and equal(net.still[3, lo:hi], net.hold[lo:hi])
        and counted(net, pop) == before
    )


@subkernel
def copy(into, values):
    """Copy an array."""
    for k in range(into.size):
        into[k] = values[k]


@subkernel
def equal(one, other):
    """Whether two arrays are."""
    changed = np.int32(0)
    for k in range(one.size):
        changed |= np.int32(one[k] ^ other[k])
    return changed == 0


@subkernel
def counted(net, pop):
    """Overflows and what else is counted of a population."""
    total = 0
    for column in range(net.native.shape[1]):
        total += net.native[pop, column]
    return total
