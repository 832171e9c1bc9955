"""The compiled loop that runs every step of every network.

`Net` holds all arrays; `advance` runs the steps first:last of the neurons of one thread. Nothing is allocated in it.
"""

# mypy: ignore-errors
import math
from collections import namedtuple

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

Net = namedtuple(
    "Net",
    "pops projections incoming edges parameters constants state x bits calm buf current fired muted events spikes active "
    "awake awake_groups due due_groups slept busy mean nothing guides cumulative counts keys "
    "list_steps list_ids list_counts cursor rows targets weights delays tau_minus "
    "log_ids log_counts log_ends log_at rec_steps rec_ids rec_counts rec_at found found_arrived "
    "groups group_keys closed clock at_emission order map_of potential best scratch initial resets plastic",
)
"""Everything that a run reads and writes; see `neuro_event.layout` for shapes and meanings."""

IDLE = 16
"""Steps without input after which a block may sleep; it is looked at every so many steps."""

_SIGN = np.int64(-(2**63))
_ONE = np.uint64(1)
DONE, DONE_DOPAMINE, HORIZON, CLOCK_COLUMNS = range(4)
POPULATION, FIRST_TO_FIRE, IN_TRIAL, WINNER, DECIDED, GROUP_COLUMNS = range(6)


@inner
def wake(net, thread, row, block, last, h):
    """Bring a sleeping block to the end of step `last`."""
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
def is_quiet(net, row, lo, hi):
    """Whether no neuron of a block can fire before its next input."""
    if row[CONSTANT_STRIDE] == 0:
        return dispatch.quiet(row[MODEL], net.state, net.constants[row[CONSTANT]], net.current, lo, hi)
    for i in range(lo, hi):
        c = net.constants[row[CONSTANT] + i - row[BEGIN]]
        if not dispatch.quiet(row[MODEL], net.state, c, net.current, i, i + 1):
            return False
    return True


@inner
def emit(net, thread, pop, row, i, m, step, done, h, at):
    """Enter a spike of neuron i into the log, the counts, the record and the history; return the next place in the log."""
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
        post_spike(
            net.plastic, pop, row, thread, i - row[BEGIN], step, done, net.projections, net.delays, h, net.tau_minus[i]
        )
    return at + 1


@inner
def draw_poisson(net, thread, pop, row, step, at, done, h):
    """One step of a poisson_generator: into its counts, or into the log."""
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
            for i in range(lo, hi):
                local = i - row[BEGIN]
                if row[TABLE] >= 0:
                    m = poisson_by_table(base, local, guide, cumulative)
                else:
                    m = poisson_by_sum(base, local, net.mean[i], net.nothing[i])
                net.counts[place + local] = m
                net.events[i] += m > 0
                net.spikes[i] += m
        else:
            for i in range(lo, hi):
                local = i - row[BEGIN]
                u = uniform(base, local)
                if u >= net.nothing[i]:
                    m = poisson_by_sum(base, local, net.mean[i], net.nothing[i])
                    at = emit(net, thread, pop, row, i, m, step, done, h, at)
    return at


@inner
def list_spikes(net, thread, pop, row, step, at, done, h):
    """The listed spikes of a spike_generator in this step."""
    lo, hi = net.edges[thread] * BLOCK, net.edges[thread + 1] * BLOCK
    place = net.cursor[thread, pop]
    end = net.cursor[net.cursor.shape[0] - 1, pop]
    while place < end and net.list_steps[place] <= step:
        i = np.int64(net.list_ids[place])
        if net.list_steps[place] == step and lo <= i < hi:
            at = emit(net, thread, pop, row, i, np.int64(net.list_counts[place]), step, done, h, at)
        place += 1
    net.cursor[thread, pop] = place
    return at


@inner
def add_counts(net, thread, row, target, step, n_all, slots, blocks):
    """One-to-one input from a poisson_generator that keeps its counts."""
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
        some = 0
        for i in range(lo, hi):
            m = net.counts[place + i]
            some |= m
            old = net.buf[out + i]
            net.buf[out + i] = old + weight * m if m > 0 else old
        if some:
            net.due[(step & slots) * blocks + block] = 1


@inner
def add_ring(net, row, block_lo, block_hi, target, step, n_all):
    """Move what a ring holds for this step into the input of some neurons, and clear it."""
    begin = target[BEGIN]
    receptors = target[RECEPTORS]
    for r in range(receptors):
        ring = row[RING] + ((step & row[RING_MASK]) * receptors + r) * row[RING_SIZE] - begin
        out = r * n_all
        for i in range(block_lo, block_hi):
            net.buf[out + i] = net.buf[out + i] + net.buf[ring + i]
            net.buf[ring + i] = -0.0


@inner
def choose(net, thread, group, row, n, step):
    """The winner among the first n found neurons of a group: largest margin, then keyed draw, then id."""
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
def step_neurons(net, thread, pop, row, step, at, done, h, n_all, slots, blocks):
    """One step of a population of neurons; return the next place in the log."""
    first = max(row[FIRST_BLOCK], net.edges[thread])
    last = min(row[LAST_BLOCK], net.edges[thread + 1])
    slot = (step & slots) * blocks
    two = row[RECEPTORS] == 2
    shared = row[CONSTANT_STRIDE] == 0
    c = net.constants[row[CONSTANT]]
    n_found = 0
    for word in range(first // GROUPED, (last + GROUPED - 1) // GROUPED):
        if net.awake_groups[word] == 0 and net.due_groups[slot // GROUPED + word] == 0:
            continue
        for block in range(word * GROUPED, min((word + 1) * GROUPED, last)):
            due = net.due[slot + block]
            if net.awake[block] == 0 and due == 0:
                continue
            lo, hi = block * BLOCK, min((block + 1) * BLOCK, row[END])
            if net.awake[block] == 0:
                wake(net, thread, row, block, step - 1, h)
            if due:
                net.due[slot + block] = 0
                for k in range(row[RINGS], row[RINGS_END]):
                    add_ring(net, net.projections[net.incoming[k]], lo, hi, row, step, n_all)
            if shared:
                dispatch.step(row[MODEL], net.state, c, net.x, net.current, np.uint64(lo), np.uint64(hi), net.fired)
            else:
                for i in range(lo, hi):
                    own = net.constants[row[CONSTANT] + i - row[BEGIN]]
                    u = np.uint64(i)
                    dispatch.step(row[MODEL], net.state, own, net.x, net.current, u, u + _ONE, net.fired)
            arrivals = 0
            some = 0
            if due and two:
                for i in range(lo, hi):
                    arrived = (net.bits[0, i] != _SIGN) | (net.bits[1, i] != _SIGN)
                    arrivals += arrived | (net.fired[i] != 0)
                    some |= net.fired[i]
            elif due:
                for i in range(lo, hi):
                    arrivals += (net.bits[0, i] != _SIGN) | (net.fired[i] != 0)
                    some |= net.fired[i]
            else:
                for i in range(lo, hi):
                    arrivals += net.fired[i] != 0
                    some |= net.fired[i]
            if some:
                for i in range(lo, hi):
                    if net.fired[i] == 0:
                        continue
                    if row[GROUP] >= 0:
                        if net.muted[i] == 0 and net.closed[row[GROUP]] == 0:
                            net.found[thread, n_found] = i
                            net.found_arrived[thread, n_found] = net.bits[0, i] != _SIGN or (
                                two and net.bits[1, i] != _SIGN
                            )
                            n_found += 1
                        elif net.bits[0, i] == _SIGN and (not two or net.bits[1, i] == _SIGN):
                            arrivals -= 1
                        continue
                    own = net.constants[row[CONSTANT] + (i - row[BEGIN]) * row[CONSTANT_STRIDE]]
                    m = np.int64(net.x[0, i]) if row[RELAY] == 1 else 1
                    dispatch.fire(row[MODEL], net.state, own, i)
                    at = emit(net, thread, pop, row, i, m, step, done, h, at)
            if due:
                for i in range(lo, hi):
                    net.x[0, i] = -0.0
                if two:
                    for i in range(lo, hi):
                        net.x[1, i] = -0.0
            net.active[thread, pop] += arrivals
            if arrivals:
                net.busy[block] = step
            elif step % IDLE == 0 and step - net.busy[block] >= IDLE and is_quiet(net, row, lo, hi):
                net.awake[block] = 0
                net.slept[block] = step
    return n_found, at


@inner
def weigh_maps(net, thread, row, step, h):
    """Largest V_m of each map of a population and the neuron that has it (the smaller id of equals)."""
    for block in range(row[FIRST_BLOCK], row[LAST_BLOCK]):
        if net.awake[block] == 0:
            wake(net, thread, row, block, step, h)
    net.potential[:] = -math.inf
    net.best[:] = -1
    for i in range(row[BEGIN], row[END]):
        m = net.map_of[i - row[BEGIN]]
        v = net.state[0, i]
        if v > net.potential[m] or (v == net.potential[m] and net.order[i] < net.order[net.best[m]]):
            net.potential[m] = v
            net.best[m] = i


@inner
def settle(net, thread, pop, row, n, step, at, done, h):
    """Let the winner among the found neurons of a group fire; return the next place in the log."""
    group = row[GROUP]
    winner = choose(net, thread, group, row, n, step)
    if net.groups[group, IN_TRIAL] == 1 and net.groups[group, WINNER] < 0:
        weigh_maps(net, thread, row, step, h)
        net.groups[group, WINNER] = winner
        net.groups[group, DECIDED] = step
    for k in range(n):
        i = net.found[thread, k]
        own = net.constants[row[CONSTANT] + (i - row[BEGIN]) * row[CONSTANT_STRIDE]]
        if i == winner:
            dispatch.fire(row[MODEL], net.state, own, i)
            at = emit(net, thread, pop, row, i, 1, step, done, h, at)
        else:
            if net.groups[group, FIRST_TO_FIRE] == 0:
                dispatch.fire(row[MODEL], net.state, own, i)
            if not net.found_arrived[thread, k]:
                net.active[thread, pop] -= 1
    if net.groups[group, FIRST_TO_FIRE] == 1:
        net.closed[group] = 1
    return at


@inner
def act_at_emission(net, thread, upto, dopamine_upto, h):
    """What spikes do when they are emitted: fill the rings, and learn, up to a step."""
    blocks = net.awake.shape[0]
    slots = net.due.shape[0] // blocks - 1
    threads = net.edges.shape[0] - 1
    n_all = net.x.shape[1]
    clock = net.clock[thread]
    for step in range(clock[DONE] + 1, upto + 1):
        if step <= clock[HORIZON]:
            continue
        for k in range(net.at_emission.shape[0]):
            q = net.at_emission[k]
            log_delivery(
                q, step, 0, thread, threads, net.edges, net.pops, net.projections[q], net.log_ids, net.log_counts,
                net.log_ends, True, net.rows, net.targets, net.weights, net.delays, net.buf, net.due, slots, blocks, n_all,
            )
        learn_step(
            net.plastic, step, clock[DONE_DOPAMINE], thread, threads, net.edges, net.pops, net.projections, net.log_ids,
            net.log_counts, net.log_ends, net.rows, net.targets, net.delays, net.tau_minus, net.buf, net.due, slots,
            blocks, h, False,
        )
    clock[DONE] = max(clock[DONE], upto)
    clock[DONE_DOPAMINE] = max(clock[DONE_DOPAMINE], upto)
    for step in range(clock[DONE_DOPAMINE] + 1, dopamine_upto + 1):
        learn_step(
            net.plastic, step, clock[DONE_DOPAMINE], thread, threads, net.edges, net.pops, net.projections, net.log_ids,
            net.log_counts, net.log_ends, net.rows, net.targets, net.delays, net.tau_minus, net.buf, net.due, slots,
            blocks, h, True,
        )
    clock[DONE_DOPAMINE] = max(clock[DONE_DOPAMINE], dopamine_upto)


@inner
def advance(net, thread, first, last, h):
    """Run the steps first:last of one thread's neurons; all spikes before `first` are known."""
    n_all = net.x.shape[1]
    blocks = net.awake.shape[0]
    slots = net.due.shape[0] // blocks - 1
    threads = net.edges.shape[0] - 1
    act_at_emission(net, thread, first - 1, first - 1, h)
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
                        add_counts(net, thread, projection, row, step, n_all, slots, blocks)
                    else:
                        log_delivery(
                            q, j, step, thread, threads, net.edges, net.pops, projection, net.log_ids, net.log_counts,
                            net.log_ends, False, net.rows, net.targets, net.weights, net.delays, net.buf, net.due, slots,
                            blocks, n_all,
                        )
                n_found, at = step_neurons(net, thread, pop, row, step, at, done, h, n_all, slots, blocks)
                if n_found > 0:
                    at = settle(net, thread, pop, row, n_found, step, at, done, h)
            elif row[KIND] == POISSON:
                at = draw_poisson(net, thread, pop, row, step, at, done, h)
            elif row[KIND] == LISTED:
                at = list_spikes(net, thread, pop, row, step, at, done, h)
        net.log_ends[thread, slot, net.pops.shape[0]] = at
        net.log_at[thread] = at


@inner
def room(net, step, steps, reach):
    """How many of the next steps the log and the record have room for, whatever fires."""
    for thread in range(net.edges.shape[0] - 1):
        n = (net.edges[thread + 1] - net.edges[thread]) * BLOCK
        if n == 0:
            continue
        oldest = net.log_ends[thread, (step - reach) & (net.log_ends.shape[1] - 1), 0]
        steps = min(steps, (net.log_ids.shape[1] - (net.log_at[thread] - oldest)) // n)
        steps = min(steps, (net.rec_ids.shape[1] - net.rec_at[thread]) // n)
    return steps


@kernel
def has_room(net, step, steps, reach):
    """How many of the next steps have room for whatever fires."""
    return room(net, step, steps, reach)


@kernel
def run(net, first, last, longest, reach, h):
    """Run the steps first:last in slices of at most `longest`; return where there was no room to go on, or `last`."""
    threads = net.edges.shape[0] - 1
    step = first
    while step < last:
        steps = room(net, step, min(longest, last - step), reach)
        if steps < 1:
            return step
        for thread in range(threads):
            advance(net, thread, step, step + steps, h)
        step += steps
    for thread in range(threads):
        act_at_emission(net, thread, last - 2, last - 1, h)
    return last


@kernel
def run_slice(net, thread, first, last, h):
    """One slice of one thread."""
    advance(net, thread, first, last, h)


@kernel
def finish(net, thread, last, h):
    """What the end of a run shows of learning."""
    act_at_emission(net, thread, last - 1, last, h)


@kernel
def present(net, pop, group, start, duration, at_decision, h):
    """Run one trial from step `start` on; return the ticks that were run."""
    threads = net.edges.shape[0] - 1
    row = net.pops[pop]
    drop_all(net, start)
    net.closed[group] = 0
    net.groups[group, IN_TRIAL] = 1
    net.groups[group, WINNER] = -1
    for block in range(row[FIRST_BLOCK], row[LAST_BLOCK]):
        if net.awake[block] == 0:
            wake(net, 0, row, block, start, h)
    for k in range(net.resets.shape[0]):
        r = net.resets[k]
        for i in range(row[BEGIN], row[END]):
            net.state[r, i] = net.initial[r, i]
    ticks = duration
    for tick in range(duration):
        step = start + 1 + tick
        for thread in range(threads):
            advance(net, thread, step, step + 1, h)
        if at_decision and net.groups[group, WINNER] >= 0:
            ticks = tick + 1
            break
    if net.groups[group, WINNER] < 0:
        weigh_maps(net, 0, row, start + ticks, h)
    for thread in range(threads):
        act_at_emission(net, thread, start + ticks - 1, start + ticks, h)
    net.groups[group, IN_TRIAL] = 0
    return ticks


@inner
def drop_all(net, step):
    """Forget every spike under way at the end of a step."""
    for thread in range(net.clock.shape[0]):
        net.clock[thread, HORIZON] = step
        net.clock[thread, DONE] = step
        net.clock[thread, DONE_DOPAMINE] = step
    ring = 2 * net.x.shape[1]
    if net.buf.shape[0] > ring:
        net.buf[ring:] = -0.0
        net.due[:] = 0


@kernel
def wake_population(net, pop, step, h):
    """Bring the sleeping blocks of a population to the end of a step."""
    row = net.pops[pop]
    for block in range(row[FIRST_BLOCK], row[LAST_BLOCK]):
        if net.awake[block] == 0:
            wake(net, 0, row, block, step, h)
