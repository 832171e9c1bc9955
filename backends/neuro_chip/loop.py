"""The compiled loop over steps, and the competition in groups of neurons.

The chip has no groups, so its host decides on winners after each step.
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
def choose(net, row, first, last, stride, step):
    """Return the candidate of first:last:stride with the largest margin above threshold, or -1; draws break ties."""
    winner = -1
    best_margin, best_draw = np.int64(0), -1.0
    # The chip has no winner-take-all, so its host compares voltages after each step. Ties are broken by the keyed draws
    # of the float backends.
    base = step_word(net.group_keys[row[t.GROUP]], step)
    for i in range(first, last, stride):
        if not net.fired[i] or net.muted[i]:
            continue
        margin = np.int64(net.v[i]) - np.int64(net.threshold[i])  # the difference of 32-bit numbers can have 33 bits
        draw = uniform(base, i - row[t.BEGIN])
        if winner < 0 or margin > best_margin or (margin == best_margin and draw > best_draw):
            winner, best_margin, best_draw = i, margin, draw
    return winner


@subkernel
def settle_one(net, row, step):
    """Let the best candidate of a group fire."""
    group, lo, hi = row[t.GROUP], row[t.BEGIN], row[t.END]
    winner = choose(net, row, lo, hi, 1, step)
    if winner < 0:
        return
    if net.groups[group, t.WINNER] < 0:
        net.groups[group, t.WINNER] = winner - lo
        net.groups[group, t.DECIDED] = step
        for i in range(lo, hi):
            # Stored before losers are reset, because rules for trials read the potentials at the decision.
            net.potential[i] = net.v[i]
    for i in range(lo, hi):
        if net.fired[i] and i != winner:
            net.fired[i] = 0
            if not net.groups[group, t.FIRST_TO_FIRE]:
                fire(net, i)
    if net.groups[group, t.FIRST_TO_FIRE]:
        net.groups[group, t.CLOSED] = 1


@subkernel
def settle_rivals(net, row, step):
    """Let the best neuron of each set of rivals fire, and reset the others."""
    group, lo = row[t.GROUP], row[t.BEGIN]
    rivals, stride = net.groups[group, t.RIVALS], net.groups[group, t.APART]
    for first in range(lo, row[t.END]):
        last = first + rivals * stride
        # Visit each set of rivals once, at its first neuron.
        if (first - lo) // stride % rivals != 0:
            continue
        winner = choose(net, row, first, last, stride, step)
        if winner >= 0:
            for i in range(first, last, stride):
                if i != winner:
                    net.fired[i] = 0
                    fire(net, i)


@subkernel
def settle_locally(net, row, step):
    """Let the winners of a group with several winners fire, the best first."""
    group, lo, hi = row[t.GROUP], row[t.BEGIN], row[t.END]
    winner = choose(net, row, lo, hi, 1, step)
    while winner >= 0:
        win(net, row, winner, step)
        # A winner silences other neurons, so the next best is searched again.
        winner = choose(net, row, lo, hi, 1, step)
    for i in range(lo, hi):
        if net.fired[i] and not net.muted[i] & t.WON:
            net.fired[i] = 0
    net.groups[group, t.CLOSED] = net.standing[group, t.OPEN] == 0


@subkernel
def win(net, row, i, step):
    """Enter neuron i as a winner, store the voltages at the first win of the map, and silence the neighbourhood."""
    group, lo = row[t.GROUP], row[t.BEGIN]
    local = net.local[group]
    maps, rows, columns, radius = local[t.LOCAL_MAPS], local[t.LOCAL_ROWS], local[t.LOCAL_COLUMNS], local[t.RADIUS]
    places = rows * columns
    m, r, c = (i - lo) // places, (i - lo) // columns % rows, (i - lo) % columns
    map_begin = lo + m * places
    if net.map_wins[group, m] == 0:
        for k in range(map_begin, map_begin + places):
            net.potential[k] = net.v[k]
    for near_r in range(max(0, r - radius), min(rows, r + radius + 1)):
        for near_c in range(max(0, c - radius), min(columns, c + radius + 1)):
            place = lo + near_r * columns + near_c
            silence(net, group, place, place + maps * places, places)
    net.map_wins[group, m] += 1
    if net.map_wins[group, m] == local[t.PER_MAP]:
        silence(net, group, map_begin, map_begin + places, 1)
    net.muted[i] |= t.WON
    if net.groups[group, t.WINNER] < 0:
        net.groups[group, t.WINNER] = i - lo
        net.groups[group, t.DECIDED] = step
    net.won[lo + net.standing[group, t.WINS], 0] = i - lo
    net.won[lo + net.standing[group, t.WINS], 1] = step
    net.standing[group, t.WINS] += 1


@subkernel
def silence(net, group, begin, end, step):
    """Silence the neurons begin:end:step, and count those that were not silenced before."""
    for i in range(begin, end, step):
        net.standing[group, t.OPEN] -= net.muted[i] == 0
        net.muted[i] |= t.BLOCKED


@subkernel
def count_open(net):
    """Count the neurons of each group with several winners that may still win."""
    for k in range(net.groups.shape[0]):
        if net.local[k, t.RADIUS] >= 0:
            row = net.pops[net.groups[k, t.POPULATION]]
            is_free = 0
            for i in range(row[t.BEGIN], row[t.END]):
                is_free += net.muted[i] == 0
            net.standing[k, t.OPEN] = is_free


@subkernel
def open_groups(net):
    """Clear all decisions, so that neurons silenced by winners may fire again."""
    net.groups[:, t.CLOSED] = 0
    net.groups[:, t.WINNER] = t.NONE
    for i in range(net.muted.size):
        # Silence by a winner ends here; silence for a trial lasts until the end of the trial.
        net.muted[i] &= t.SILENCED
    net.map_wins[:] = 0
    net.standing[:, t.WINS] = 0
    count_open(net)


@kernel
def open_all(view, words):
    """Open the groups; `view` and `words` are those of `net`."""
    open_groups(net_of(view, words))


@subkernel
def emit(net, pop, row, i, times, step):
    """Count, record and queue a spike of neuron i, numbered over all populations."""
    if row[t.BINARY] and times > 1:  # merged before counting, recording and sending
        net.native[pop, t.MERGED] += times - 1
        times = 1
    at = net.clock[t.EMITTED]
    net.emitted[at] = i
    net.emitted_times[at] = times
    net.clock[t.EMITTED] = at + 1
    net.events[i] += 1
    net.spikes[i] += times
    # The host's rules for trials need only first spikes. Without this array they would need a record.
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

    Spikes are sent at the beginning of the next step. Weights that learning changes in a step are therefore used from
    the next step on. Spikes of generators are sent before the host writes weights between steps (`send_ahead`).
    """
    total = net.clock[t.EMITTED]
    first = 0
    for pop in range(net.pops.shape[0]):
        last, begin, end = first, net.pops[pop, t.BEGIN], net.pops[pop, t.END]
        # Emitted ids ascend, because populations are stepped in order, so one pass separates them by population.
        while last < total and net.emitted[last] < end:
            last += 1
        if first < last:
            for k in range(net.out_ends[pop], net.out_ends[pop + 1]):
                # `send_ahead` has already sent these spikes with the old words.
                if net.set_out[net.out[k]] < step:
                    send_along(net, net.out[k], begin, first, last, step)
        first = last
    net.clock[t.EMITTED] = 0


@subkernel
def send_along(net, q, begin, first, last, step):
    """Send the emitted spikes first:last of a source population, whose neurons begin at `begin`, along projection q."""
    row = net.projections[q]
    if may_gather(net, row, net.pops[row[t.TARGET], t.RECEPTORS] == 2):
        # All spikes of the step together, because they reach the same places.
        send_grids(net, row, begin, first, last, step)
    else:
        for at in range(first, last):
            if net.stop[0] == t.AT_ONCE:
                return
            send(net, q, net.emitted[at] - begin, net.emitted_times[at], step)


@kernel
def send_ahead(view, words, pop, q):
    """Send the spikes that a population emitted in the last step along a projection, with the present words."""
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
    """Count the neurons that fired or that a spike reached. A spike that arrives now may act in the next update."""
    lo, hi = row[t.BEGIN], row[t.END]
    n = hi - lo
    # If input acts a step later (`LATE`), the arrivals of this update are in the next slot.
    slot = (step + row[t.LATE]) & (row[t.SLOTS] - 1)
    begin = row[t.RING] + slot * n
    arrived, fired = net.arrived[begin : begin + n], net.fired[lo:hi]
    if net.arrived_all[row[t.ARRIVED] + slot]:  # a dense row marks all its targets by one flag
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
    """Keep the neurons above threshold that may fire; return whether there are any."""
    has_any = np.uint8(0)
    for k in range(fired.size):
        fired[k] &= np.uint8(muted[k] == 0)
        # No early end: a loop without branches is vectorised.
        has_any |= fired[k]
    return has_any != 0


@subkernel
def decide(net, row, step):
    """Keep the candidates of a group that win and reset the losers."""
    group = row[t.GROUP]
    fired = net.fired[row[t.BEGIN] : row[t.END]]
    has_candidates = admit(fired, net.muted[row[t.BEGIN] : row[t.END]])
    if net.groups[group, t.CLOSED]:
        fired[:] = 0
        has_candidates = False
    if net.local[group, t.RADIUS] >= 0:
        settle_locally(net, row, step)
    elif not has_candidates:
        return
    elif net.groups[group, t.RIVALS] > 0:
        settle_rivals(net, row, step)
    else:
        settle_one(net, row, step)


@subkernel
def any_fired(fired):
    """Return whether any neuron is above threshold."""
    has_any = np.uint8(0)
    for k in range(fired.size):
        has_any |= fired[k]
    return has_any != 0


@subkernel
def advance_neurons(net, pop, row, step):
    """Update the neurons of a population, decide, emit and count. A population at rest only counts arrivals."""
    slot = row[t.ARRIVED] + (step & (row[t.SLOTS] - 1))
    # A population is at rest if no input came, no neuron reached threshold, and the last step changed no bit of any
    # state. The next step would change nothing either, so steps are skipped until input comes or the host writes.
    came, net.came[slot] = net.came[slot], 0
    if row[t.KIND] == t.RELAY:
        relay(net, pop, row, step)
    elif came or not net.resting[pop]:
        previous = 0 if came else keep_states(net, pop, row)
        reached = update_and_fire(net, pop, row, step)
        # A population with periodic resets is never at rest.
        net.resting[pop] = not came and not reached and row[t.INTERVAL] == 0 and stayed(net, pop, row, previous)
    count_active(net, pop, row, step)


@subkernel
def update_and_fire(net, pop, row, step):
    """Update the neurons of a population, and emit their spikes; return whether any was above threshold."""
    update(net, pop, row, step)
    group, fired = row[t.GROUP], net.fired[row[t.BEGIN] : row[t.END]]
    reached = has_candidates = any_fired(fired)
    if group >= 0 and (has_candidates or net.local[group, t.RADIUS] >= 0):
        decide(net, row, step)
        has_candidates = any_fired(fired)
    if has_candidates:
        for i in range(row[t.BEGIN], row[t.END]):
            if net.fired[i]:
                # A neuron silenced for a trial neither spikes nor is reset; its voltage may continue to rise.
                if net.muted[i] & t.SILENCED:
                    net.fired[i] = 0
                    continue
                if row[t.GRADED]:  # already reset by the integer step
                    emit(net, pop, row, i, np.int64(net.payload[i]), step)
                else:
                    fire(net, i)
                    emit(net, pop, row, i, 1, step)
    return reached


@subkernel
def relay(net, pop, row, step):
    """Emit for each parrot neuron as many spikes as arrived at it."""
    n = row[t.END] - row[t.BEGIN]
    begin = row[t.RING] + (step & (row[t.SLOTS] - 1)) * n
    for k in range(n):
        # A parrot's slot counts spikes, because `relay_projection` gives every synapse the word 1.
        times = net.ring[begin + k]
        net.ring[begin + k] = 0
        i = row[t.BEGIN] + k
        net.fired[i] = times > 0 and not net.muted[i]
        if net.fired[i]:
            emit(net, pop, row, i, np.int64(times), step)


@subkernel
def draw(net, pop, row, step):
    """Draw and emit the spikes of a poisson_generator in a step."""
    if step <= row[t.START] or step > row[t.STOP]:
        return
    base = step_word(net.keys[pop], step)
    for i in range(row[t.BEGIN], row[t.END]):
        # Most draws are 0, which one comparison shows. Only the others need the sum over the distribution.
        if uniform(base, i - row[t.BEGIN]) >= net.nothing[i]:
            times = poisson_by_sum(base, i - row[t.BEGIN], net.mean[i], net.nothing[i])
            if times > 0:
                emit(net, pop, row, i, times, step)


@subkernel
def list_spikes(net, pop, row, step):
    """Emit the listed spikes of a spike_generator in a step."""
    at, end = net.cursor[0, pop], net.cursor[1, pop]
    while at < end and net.list_steps[at] <= step:
        if net.list_steps[at] == step:
            emit(net, pop, row, net.list_ids[at], net.list_counts[at], step)
        at += 1
    net.cursor[0, pop] = at


@kernel
def advance(view, words, end):
    """Run to a step, or until the record is full or the group in STOP_GROUP has decided.

    A spike reaches no neuron in the step of its emission. The order of the populations therefore only affects the
    record, which is sorted by population, and `send_all`, which relies on this order. `view` and `words` are those of
    `net`.
    """
    net = net_of(view, words)
    net.resting[:] = 0  # the host may have changed any state
    total = net.v.size  # largest number of events in a step; without room the caller empties the record
    while net.stop[0] == 0 and net.clock[t.STEP] < end and net.clock[t.RECORDED] + total <= net.rec_steps.size:
        step = net.clock[t.STEP] + 1
        # Spikes are sent at the beginning of the next step, so that the host can write weights between steps and
        # spikes are sent with the weights that learning has written.
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
    """Store the states of a population for `stayed`; return its counts."""
    lo, hi = row[t.BEGIN], row[t.END]
    # Called only without input: a population with input is never at rest, so its step skips this work.
    copy(net.still[0, lo:hi], net.v[lo:hi])
    copy(net.still[1, lo:hi], net.u[lo:hi])
    copy(net.still[2, lo:hi], net.g_inh[lo:hi])
    copy(net.still[3, lo:hi], net.hold[lo:hi])
    return counted(net, pop)


@subkernel
def stayed(net, pop, row, before):
    """Return whether a step has changed neither the stored states nor the counts."""
    lo, hi = row[t.BEGIN], row[t.END]
    return (
        equal(net.still[0, lo:hi], net.v[lo:hi])
        and equal(net.still[1, lo:hi], net.u[lo:hi])
        and equal(net.still[2, lo:hi], net.g_inh[lo:hi])
        and equal(net.still[3, lo:hi], net.hold[lo:hi])
        and counted(net, pop) == before
    )


@subkernel
def copy(output, values):
    """Copy an array."""
    for k in range(output.size):
        output[k] = values[k]


@subkernel
def equal(first, second):
    """Return whether two arrays are equal."""
    changed = np.int32(0)
    for k in range(first.size):
        changed |= np.int32(first[k] ^ second[k])
    return changed == 0


@subkernel
def counted(net, pop):
    """Return the sum of the overflows and other counts of a population."""
    total = 0
    for column in range(net.native.shape[1]):
        total += net.native[pop, column]
    return total
