"""The compiled loop that runs every step of every network.

`advance` runs the steps first:last of the neurons of one thread. Nothing is allocated in it.
"""

# mypy: ignore-errors
import math

import numpy as np

from neuro_event import dispatch
from neuro_event.deliver import log_delivery
from neuro_event.draws import poisson_by_sum, poisson_by_table, step_word, uniform
from neuro_event.jit import inner, kernel
from neuro_event.plastic import learn_step, post_spike
from neuro_event.tables import (
    ARRIVALS,
    ARRIVALS_END,
    BEGIN,
    BLOCK,
    CONSTANT,
    CONSTANT_STRIDE,
    COUNTS,
    COUNTS_STEPS,
    DENSE_COUNTS,
    END,
    FIRST_BLOCK,
    GROUP,
    GROUPED,
    HISTORY,
    KIND,
    LAG,
    LAST_BLOCK,
    LINEAR,
    LISTED,
    MODEL,
    NEURON,
    POISSON,
    RECEPTORS,
    RECORD,
    RELAY,
    RING,
    RING_MASK,
    RING_SIZE,
    RINGS,
    RINGS_END,
    SOURCE,
    START,
    STOP,
    TABLE,
    WEIGHT,
)
from neuro_event.views import net_of

IDLE = 16
"""Steps without input after which a block may sleep; it is looked at every so many steps."""

_SIGN = np.int64(-(2**63))
_ONE = np.uint64(1)
DONE, DONE_DOPAMINE, HORIZON, CLOCK_COLUMNS = range(4)
POPULATION, FIRST_TO_FIRE, IN_TRIAL, WINNER, DECIDED, GROUP_COLUMNS = range(6)


@inner
def wake(view, thread, row, block, last, h):
    """Bring a sleeping block to the end of step `last`."""
    net = net_of(view)
    n = last - net.slept[block]
    if n > 0 and row[LINEAR] == 1:
        lo, hi = block * BLOCK, min((block + 1) * BLOCK, row[END])
        c = net.scratch[thread]
        if row[CONSTANT_STRIDE] == 0:
            dispatch.constants(row[MODEL], net.parameters[row[CONSTANT]], n * h, c)
            dispatch.step(row[MODEL], net.state, c, net.calm, net.current, np.uint64(lo), np.uint64(hi), net.fired)
        else:
            for i in range(lo, hi):
                dispatch.constants(row[MODEL], net.parameters[row[CONSTANT] + i - row[BEGIN]], n * h, c)
                u = np.uint64(i)
                dispatch.step(row[MODEL], net.state, c, net.calm, net.current, u, u + _ONE, net.fired)
    net.awake[block] = 1
    net.busy[block] = last


@inner
def is_quiet(view, row, lo, hi):
    """Whether no neuron of a block can fire before its next input."""
    net = net_of(view)
    if row[CONSTANT_STRIDE] == 0:
        return dispatch.quiet(row[MODEL], net.state, net.constants[row[CONSTANT]], net.current, lo, hi)
    for i in range(lo, hi):
        c = net.constants[row[CONSTANT] + i - row[BEGIN]]
        if not dispatch.quiet(row[MODEL], net.state, c, net.current, i, i + 1):
            return False
    return True


@inner
def emit(view, thread, pop, row, i, m, step, done, h, at):
    """Enter a spike of neuron i into the log, the counts, the record and the history; return the next place in the log."""
    net = net_of(view)
    place = at & (net.log_ids.shape[1] - 1)
    net.log_ids[thread, place] = i
    net.log_counts[thread, place] = m
    net.events[i] += 1
    net.spikes[i] += m
    if row[RECORD] == 1:
        r = net.rec_at[thread]
        net.rec_steps[thread, r] = step
        net.rec_ids[thread, r] = i
        net.rec_counts[thread, r] = m
        net.rec_at[thread] = r + 1
    if row[HISTORY] >= 0:
        post_spike(view, pop, thread, i - row[BEGIN], step, done, h)
    return at + 1


@inner
def draw_poisson(view, thread, pop, row, step, at, done, h):
    """One step of a poisson_generator: into its counts, or into the log."""
    net = net_of(view)
    if step <= row[START] or step > row[STOP]:
        if row[COUNTS] >= 0:
            n = row[END] - row[BEGIN]
            begin = row[COUNTS] + (step & (row[COUNTS_STEPS] - 1)) * n
            net.counts[begin : begin + n] = 0
        return at
    base = step_word(net.keys[pop], step)
    for block in range(max(row[FIRST_BLOCK], net.edges[thread]), min(row[LAST_BLOCK], net.edges[thread + 1])):
        if net.awake[block] == 0:
            continue
        lo, hi = block * BLOCK, min((block + 1) * BLOCK, row[END])
        if row[COUNTS] >= 0:
            place = row[COUNTS] + (step & (row[COUNTS_STEPS] - 1)) * (row[END] - row[BEGIN])
            guide = net.guides[row[TABLE]]
            cumulative = net.cumulative[row[TABLE]]
            counts = net.counts[place + lo - row[BEGIN] : place + hi - row[BEGIN]]
            if row[TABLE] >= 0:
                for k in range(counts.shape[0]):
                    counts[k] = poisson_by_table(base, lo - row[BEGIN] + k, guide, cumulative)
            else:
                for k in range(counts.shape[0]):
                    counts[k] = poisson_by_sum(base, lo - row[BEGIN] + k, net.mean[lo + k], net.nothing[lo + k])
            events, spikes = net.events[lo:hi], net.spikes[lo:hi]
            for k in range(counts.shape[0]):
                events[k] += counts[k] > 0
                spikes[k] += counts[k]
        else:
            for i in range(lo, hi):
                local = i - row[BEGIN]
                u = uniform(base, local)
                if u >= net.nothing[i]:
                    m = poisson_by_sum(base, local, net.mean[i], net.nothing[i])
                    at = emit(view, thread, pop, row, i, m, step, done, h, at)
    return at


@inner
def list_spikes(view, thread, pop, row, step, at, done, h):
    """The listed spikes of a spike_generator in this step."""
    net = net_of(view)
    lo, hi = net.edges[thread] * BLOCK, net.edges[thread + 1] * BLOCK
    place = net.cursor[thread, pop]
    end = net.cursor[net.cursor.shape[0] - 1, pop]
    while place < end and net.list_steps[place] <= step:
        i = np.int64(net.list_ids[place])
        if net.list_steps[place] == step and lo <= i < hi:
            at = emit(view, thread, pop, row, i, np.int64(net.list_counts[place]), step, done, h, at)
        place += 1
    net.cursor[thread, pop] = place
    return at


@inner
def add_counts(view, thread, row, target, step, n_all, slots, blocks):
    """One-to-one input from a poisson_generator that keeps its counts."""
    net = net_of(view)
    source = net.pops[row[SOURCE]]
    n = source[END] - source[BEGIN]
    place = source[COUNTS] + ((step - row[LAG]) & (source[COUNTS_STEPS] - 1)) * n
    weight = net.weights[row[WEIGHT]]
    out = target[BEGIN] + (n_all if target[RECEPTORS] == 2 and weight < 0.0 else 0)
    for block in range(max(target[FIRST_BLOCK], net.edges[thread]), min(target[LAST_BLOCK], net.edges[thread + 1])):
        if net.awake[source[FIRST_BLOCK] + block - target[FIRST_BLOCK]] == 0:
            continue
        lo = (block - target[FIRST_BLOCK]) * BLOCK
        hi = min(lo + BLOCK, n)
        counts = net.counts[place + lo : place + hi]
        into = net.buf[out + lo : out + hi]
        some = np.uint16(0)
        for i in range(counts.shape[0]):
            some |= counts[i]
            old = into[i]
            into[i] = old + weight * counts[i] if counts[i] > 0 else old
        if some:
            net.due[(step & slots) * blocks + block] = 1


@inner
def add_ring(view, row, block_lo, block_hi, target, step, n_all):
    """Move what a ring holds for this step into the input of some neurons, and clear it."""
    net = net_of(view)
    begin = target[BEGIN]
    receptors = target[RECEPTORS]
    for r in range(receptors):
        ring = row[RING] + ((step & row[RING_MASK]) * receptors + r) * row[RING_SIZE] - begin
        out = r * n_all
        for i in range(block_lo, block_hi):
            net.buf[out + i] = net.buf[out + i] + net.buf[ring + i]
            net.buf[ring + i] = -0.0


@inner
def choose(view, thread, group, row, n, step):
    """The winner among the first n found neurons of a group: largest margin, then keyed draw, then id."""
    net = net_of(view)
    best, best_margin, best_draw = -1, -math.inf, -1.0
    base = step_word(net.group_keys[group], step)
    for k in range(n):
        i = net.found[thread, k]
        c = net.constants[row[CONSTANT] + (i - row[BEGIN]) * row[CONSTANT_STRIDE]]
        margin = net.state[0, i] - c[0]
        if margin < best_margin:
            continue
        draw = uniform(base, net.order[i])
        if margin > best_margin or draw > best_draw or (draw == best_draw and net.order[i] < net.order[best]):
            best, best_margin, best_draw = i, margin, draw
    return best


@inner
def count_arrivals(view, lo, hi, two):
    """How many of a block's neurons have input in this step."""
    net = net_of(view)
    first, second = net.bits[0, lo:hi], net.bits[1, lo:hi]
    count = 0
    if two:
        for k in range(first.size):
            count += ((first[k] ^ _SIGN) | (second[k] ^ _SIGN)) != 0
    else:
        for k in range(first.size):
            count += first[k] != _SIGN
    return count


@inner
def any_fired(view, lo, hi):
    """Whether any of a block's neurons reached threshold."""
    fired = net_of(view).fired[lo:hi]
    some = np.uint8(0)
    for k in range(fired.size):
        some |= fired[k]
    return some != 0


@inner
def step_word_of_blocks(view, thread, row, begin, end, slot, step, h, n_all):
    """Wake the due blocks among begin:end, take in what their rings hold, and step all that are awake.

    Neighbours that are awake are stepped in one go.
    """
    net = net_of(view)
    run = begin
    for block in range(begin, end + 1):
        if block < end and (net.awake[block] == 1 or net.due[slot + block] == 1):
            lo, hi = block * BLOCK, min((block + 1) * BLOCK, row[END])
            if net.awake[block] == 0:
                wake(view, thread, row, block, step - 1, h)
            if net.due[slot + block] == 1:
                for k in range(row[RINGS], row[RINGS_END]):
                    add_ring(view, net.projections[net.incoming[k]], lo, hi, row, step, n_all)
            continue
        if run < block:
            step_run(view, row, run * BLOCK, min(block * BLOCK, row[END]))
        run = block + 1


@inner
def step_run(view, row, lo, hi):
    """Step neighbouring neurons."""
    net = net_of(view)
    if row[CONSTANT_STRIDE] == 0:
        c = net.constants[row[CONSTANT]]
        dispatch.step(row[MODEL], net.state, c, net.x, net.current, np.uint64(lo), np.uint64(hi), net.fired)
        return
    for i in range(lo, hi):
        c = net.constants[row[CONSTANT] + i - row[BEGIN]]
        u = np.uint64(i)
        dispatch.step(row[MODEL], net.state, c, net.x, net.current, u, u + _ONE, net.fired)


@inner
def step_neurons(view, thread, pop, row, step, at, done, h, n_all, slots, blocks):
    """One step of a population of neurons; return the next place in the log."""
    net = net_of(view)
    first = max(row[FIRST_BLOCK], net.edges[thread])
    last = min(row[LAST_BLOCK], net.edges[thread + 1])
    slot = (step & slots) * blocks
    two = row[RECEPTORS] == 2
    n_found = 0
    for word in range(first // GROUPED, (last + GROUPED - 1) // GROUPED):
        if net.awake_groups[word] == 0 and net.due_groups[slot // GROUPED + word] == 0:
            continue
        begin, end = word * GROUPED, min((word + 1) * GROUPED, last)
        step_word_of_blocks(view, thread, row, begin, end, slot, step, h, n_all)
        for block in range(begin, end):
            if net.awake[block] == 0:
                continue
            due = net.due[slot + block]
            net.due[slot + block] = 0
            lo, hi = block * BLOCK, min((block + 1) * BLOCK, row[END])
            active = count_arrivals(view, lo, hi, two) if due else 0
            if any_fired(view, lo, hi):
                for i in range(lo, hi):
                    if net.fired[i] == 0:
                        continue
                    came = net.bits[0, i] != _SIGN or (two and net.bits[1, i] != _SIGN)
                    if row[GROUP] >= 0:
                        if net.muted[i] == 0 and net.closed[row[GROUP]] == 0:
                            net.found[thread, n_found] = i
                            net.found_arrived[thread, n_found] = came
                            n_found += 1
                        continue
                    own = net.constants[row[CONSTANT] + (i - row[BEGIN]) * row[CONSTANT_STRIDE]]
                    m = np.int64(net.x[0, i]) if row[RELAY] == 1 else 1
                    dispatch.fire(row[MODEL], net.state, own, i)
                    at = emit(view, thread, pop, row, i, m, step, done, h, at)
                    active += not came
                net.busy[block] = step
            if due:
                net.x[0, lo:hi] = -0.0
                if two:
                    net.x[1, lo:hi] = -0.0
            net.active[thread, pop] += active
            if active:
                net.busy[block] = step
            elif step % IDLE == 0 and step - net.busy[block] >= IDLE and is_quiet(view, row, lo, hi):
                net.awake[block] = 0
                net.slept[block] = step
    return n_found, at


@inner
def weigh_maps(view, thread, row, step, h):
    """Largest V_m of each map of a population and the neuron that has it (the smaller id of equals)."""
    net = net_of(view)
    for block in range(row[FIRST_BLOCK], row[LAST_BLOCK]):
        if net.awake[block] == 0:
            wake(view, thread, row, block, step, h)
    net.potential[:] = -math.inf
    net.best[:] = -1
    for i in range(row[BEGIN], row[END]):
        m = net.map_of[i - row[BEGIN]]
        v = net.state[0, i]
        if v > net.potential[m] or (v == net.potential[m] and net.order[i] < net.order[net.best[m]]):
            net.potential[m] = v
            net.best[m] = i


@inner
def settle(view, thread, pop, row, n, step, at, done, h):
    """Let the winner among the found neurons of a group fire; return the next place in the log."""
    net = net_of(view)
    group = row[GROUP]
    winner = choose(view, thread, group, row, n, step)
    if net.groups[group, IN_TRIAL] == 1 and net.groups[group, WINNER] < 0:
        weigh_maps(view, thread, row, step, h)
        net.groups[group, WINNER] = winner
        net.groups[group, DECIDED] = step
    for k in range(n):
        i = net.found[thread, k]
        own = net.constants[row[CONSTANT] + (i - row[BEGIN]) * row[CONSTANT_STRIDE]]
        if i == winner:
            dispatch.fire(row[MODEL], net.state, own, i)
            at = emit(view, thread, pop, row, i, 1, step, done, h, at)
            net.active[thread, pop] += 1 - net.found_arrived[thread, k]
        elif net.groups[group, FIRST_TO_FIRE] == 0:
            dispatch.fire(row[MODEL], net.state, own, i)
    if net.groups[group, FIRST_TO_FIRE] == 1:
        net.closed[group] = 1
    return at


@inner
def act_at_emission(view, thread, upto, dopamine_upto, h):
    """What spikes do when they are emitted: fill the rings, and learn, up to a step."""
    net = net_of(view)
    clock = net.clock[thread]
    for step in range(clock[DONE] + 1, upto + 1):
        if step <= clock[HORIZON]:
            continue
        for k in range(net.at_emission.shape[0]):
            q = net.at_emission[k]
            log_delivery(view, q, step, 0, thread, True)
        learn_step(view, step, clock[DONE_DOPAMINE], thread, h, False)
    clock[DONE] = max(clock[DONE], upto)
    clock[DONE_DOPAMINE] = max(clock[DONE_DOPAMINE], upto)
    for step in range(clock[DONE_DOPAMINE] + 1, dopamine_upto + 1):
        learn_step(view, step, clock[DONE_DOPAMINE], thread, h, True)
    clock[DONE_DOPAMINE] = max(clock[DONE_DOPAMINE], dopamine_upto)


@inner
def advance(view, thread, first, last, h):
    """Run the steps first:last of one thread's neurons; all spikes before `first` are known."""
    net = net_of(view)
    n_all = net.x.shape[1]
    blocks = net.awake.shape[0]
    slots = net.due.shape[0] // blocks - 1
    threads = net.edges.shape[0] - 1
    act_at_emission(view, thread, first - 1, first - 1, h)
    done = first - 1
    for step in range(first, last):
        at = net.log_at[thread]
        slot = step & (net.log_ends.shape[1] - 1)
        for pop in range(net.pops.shape[0]):
            row = net.pops[pop]
            net.log_ends[thread, slot, pop] = at
            if row[KIND] == NEURON:
                for k in range(row[ARRIVALS], row[ARRIVALS_END]):
                    q = net.incoming[k]
                    projection = net.projections[q]
                    j = step - projection[LAG]
                    if j <= net.clock[thread, HORIZON]:
                        continue
                    if projection[DENSE_COUNTS] == 1:
                        add_counts(view, thread, projection, row, step, n_all, slots, blocks)
                    else:
                        log_delivery(view, q, j, step, thread, False)
                n_found, at = step_neurons(view, thread, pop, row, step, at, done, h, n_all, slots, blocks)
                if n_found > 0:
                    at = settle(view, thread, pop, row, n_found, step, at, done, h)
            elif row[KIND] == POISSON:
                at = draw_poisson(view, thread, pop, row, step, at, done, h)
            elif row[KIND] == LISTED:
                at = list_spikes(view, thread, pop, row, step, at, done, h)
        net.log_ends[thread, slot, net.pops.shape[0]] = at
        net.log_at[thread] = at


@inner
def room(view, step, steps, reach):
    """How many of the next steps the log and the record have room for, whatever fires."""
    net = net_of(view)
    for thread in range(net.edges.shape[0] - 1):
        n = (net.edges[thread + 1] - net.edges[thread]) * BLOCK
        if n == 0:
            continue
        oldest = net.log_ends[thread, (step - reach) & (net.log_ends.shape[1] - 1), 0]
        steps = min(steps, (net.log_ids.shape[1] - (net.log_at[thread] - oldest)) // n)
        steps = min(steps, (net.rec_ids.shape[1] - net.rec_at[thread]) // n)
    return steps


@kernel
def has_room(view, step, steps, reach):
    """How many of the next steps have room for whatever fires."""
    net = net_of(view)
    return room(view, step, steps, reach)


@kernel
def run(view, first, last, longest, reach, h):
    """Run the steps first:last in slices of at most `longest`; return where there was no room to go on, or `last`."""
    net = net_of(view)
    threads = net.edges.shape[0] - 1
    step = first
    while step < last:
        steps = room(view, step, min(longest, last - step), reach)
        if steps < 1:
            return step
        for thread in range(threads):
            advance(view, thread, step, step + steps, h)
        step += steps
    for thread in range(threads):
        act_at_emission(view, thread, last - 2, last - 1, h)
    return last


@kernel
def run_slice(view, thread, first, last, h):
    """One slice of one thread."""
    net = net_of(view)
    advance(view, thread, first, last, h)


@kernel
def finish(view, thread, last, h):
    """What the end of a run shows of learning."""
    net = net_of(view)
    act_at_emission(view, thread, last - 1, last, h)


@kernel
def present(view, pop, group, start, duration, at_decision, h):
    """Run one trial from step `start` on; return the ticks that were run."""
    net = net_of(view)
    threads = net.edges.shape[0] - 1
    row = net.pops[pop]
    drop_all(view, start)
    net.closed[group] = 0
    net.groups[group, IN_TRIAL] = 1
    net.groups[group, WINNER] = -1
    for block in range(row[FIRST_BLOCK], row[LAST_BLOCK]):
        if net.awake[block] == 0:
            wake(view, 0, row, block, start, h)
    for k in range(net.resets.shape[0]):
        r = net.resets[k]
        for i in range(row[BEGIN], row[END]):
            net.state[r, i] = net.initial[r, i]
    ticks = duration
    for tick in range(duration):
        step = start + 1 + tick
        for thread in range(threads):
            advance(view, thread, step, step + 1, h)
        if at_decision and net.groups[group, WINNER] >= 0:
            ticks = tick + 1
            break
    if net.groups[group, WINNER] < 0:
        weigh_maps(view, 0, row, start + ticks, h)
    for thread in range(threads):
        act_at_emission(view, thread, start + ticks - 1, start + ticks, h)
    net.groups[group, IN_TRIAL] = 0
    return ticks


@inner
def drop_all(view, step):
    """Forget every spike under way at the end of a step."""
    net = net_of(view)
    for thread in range(net.clock.shape[0]):
        net.clock[thread, HORIZON] = step
        net.clock[thread, DONE] = step
        net.clock[thread, DONE_DOPAMINE] = step
    ring = 2 * net.x.shape[1]
    if net.buf.shape[0] > ring:
        net.buf[ring:] = -0.0
        net.due[:] = 0


@kernel
def wake_population(view, pop, step, h):
    """Bring the sleeping blocks of a population to the end of a step."""
    net = net_of(view)
    row = net.pops[pop]
    for block in range(row[FIRST_BLOCK], row[LAST_BLOCK]):
        if net.awake[block] == 0:
            wake(view, 0, row, block, step, h)
