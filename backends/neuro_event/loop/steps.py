"""The compiled loop that runs every step of every network.

`advance` runs the steps first:last for a range of threads. One thread of the machine may do the work of all, and then
goes through each row of synapses once instead of once a thread. Nothing is allocated in it.
"""

# mypy: ignore-errors
import numpy as np

from neuro.kernels.instructions import load_acquire, store_release
from neuro.kernels.jit import inlined, kernel, subkernel
from neuro_event.loop import tables as t
from neuro_event.loop.arrivals import deliver
from neuro_event.loop.generators import draw_poisson, let_emit, list_spikes
from neuro_event.loop.groups import admit_all, open_groups, weigh_maps
from neuro_event.loop.lazy_rules import ARRIVE, PRE_SPIKE
from neuro_event.loop.neurons import step_neurons, wake
from neuro_event.loop.tables import (
    at_emission,
    call_rule,
    charge,
    deliver_joined,
    dopamine_arrivals,
    drive,
    gather_moves,
    learn_kernels,
    net_of,
    note,
    plastic_of,
    settle,
    slot_mask,
    step_collecting,
)

HALT = -1
"""Stands in place of a step where threads are to return."""

STRIDES = 5
"""How often a thread stores how far it is while a spike is under way."""

PATIENCE = 50_000
"""Loads of the other threads' steps, about 100 us, before a thread gives up its processor."""


@subkernel
def act_at_emission(view, thread, upto, dopamine_upto, h):
    """What spikes do when they are emitted: fill the rings, and learn, up to a step."""
    net = net_of(view)
    clock = net.clock[thread]
    for step in range(clock[t.DONE] + 1, upto + 1):
        # A trial, a reset or a restored state has dropped all spikes up to the horizon.
        if step <= clock[t.HORIZON]:
            continue
        for k in range(net.at_emission.shape[0]):
            at_emission(view, net.at_emission[k], step, step, thread)
        # Static synapses first, in the order of `at_emission`: sums of rings then have one order, whatever the threads.
        learn_step(view, step, clock[t.DONE_DOPAMINE], thread, h, False)
        if plastic_of(view).shared_table.shape[0] > 0:
            learn_kernels(view, step, clock[t.DONE_DOPAMINE], 0, h)
    clock[t.DONE] = max(clock[t.DONE], upto)
    clock[t.DONE_DOPAMINE] = max(clock[t.DONE_DOPAMINE], upto)
    # At the end of a run dopamine and post spikes count one step further than pre spikes, which a read must not see
    # yet.
    for step in range(clock[t.DONE_DOPAMINE] + 1, dopamine_upto + 1):
        learn_step(view, step, clock[t.DONE_DOPAMINE], thread, h, True)
        if plastic_of(view).shared_table.shape[0] > 0:
            learn_kernels(view, step, clock[t.DONE_DOPAMINE], 1, h)
    clock[t.DONE_DOPAMINE] = max(clock[t.DONE_DOPAMINE], dopamine_upto)


@inlined
def step_population(view, thread, pop, step, done, h):
    """One step of a population's neurons of a thread, whose input is there."""
    net = net_of(view)
    row = net.pops[pop]
    at, kind = net.log_at[thread, 0], row[t.KIND]
    # Ends are kept for every step, also an empty one: a reader of the log finds a population's spikes without a search.
    # The number of steps is a power of two, so a mask takes the place of a division.
    net.log_ends[thread, step & (net.log_ends.shape[1] - 1), pop] = at
    if kind == t.NEURON:
        slots, blocks = slot_mask(net), net.awake.shape[0]
        # Input that a model only adds to its states need not be read by its step: `step_collecting` steps without it.
        if row[t.COLLECTS] >= 0:
            at = step_collecting(view, thread, pop, step, at, done, h, slots, blocks)
        else:
            n_found, at = step_neurons(view, thread, pop, step, at, done, h, net.x.shape[1], slots, blocks)
            # Compiled apart and called by its address: only networks with groups compile it.
            if n_found > 0:
                at = settle(view, thread, pop, n_found, step, at, done, h)
    elif kind == t.POISSON:
        at = draw_poisson(view, thread, pop, step, at, done, h)
    elif kind == t.LISTED:
        at = list_spikes(view, thread, pop, step, at, done, h)
    elif kind == t.GENERATOR:
        at = let_emit(view, thread, pop, step, at, done, h)
    # Each thread's place is alone in its cache line: a line that two write goes back and forth, 250 ns each way.
    net.log_at[thread, 0] = at
    if row[t.GATHERS] == 1:
        gather_moves(view, thread, pop, step, h)


@subkernel
def advance(view, begin, stop, first, last, h):
    """Run the steps first:last of the neurons of the threads begin:stop; all spikes before `first` are known."""
    net = net_of(view)
    n, driven = net.pops.shape[0], net.lines.shape[0] > 0
    done = first - 1
    # Only now have all threads logged the spikes of the slice before; what they send arrives in `first` or later.
    for thread in range(begin, stop):
        act_at_emission(view, thread, done, done, h)
    for step in range(first, last):
        if net.stop[0] == t.AT_ONCE:
            return
        if driven:
            for thread in range(begin, stop):
                drive(view, thread, step)
        if net.joined.shape[0] > 0:
            deliver_joined(view, begin, stop, step)
        # Deliver, then step, population by population: the input of one population is still in the cache when it is
        # stepped. Spikes of this step arrive in the next at the earliest, so the order of populations changes nothing.
        for pop in range(n):
            row = net.pops[pop]
            if row[t.KIND] == t.NEURON:
                deliver(view, row[t.JOINED_END], row[t.ARRIVALS_END], begin, stop, step)
            for thread in range(begin, stop):
                step_population(view, thread, pop, step, done, h)
        for thread in range(begin, stop):
            if driven:
                charge(view, thread, step)
            net.log_ends[thread, step & (net.log_ends.shape[1] - 1), n] = net.log_at[thread, 0]


@subkernel
def room(view, step, steps, reach):
    """How many of the next steps the log and the record have room for, whatever fires."""
    net = net_of(view)
    for thread in range(net.edges.shape[1] - 1):
        n = net.most[thread]
        if n == 0:
            continue
        # What was emitted before `reach` steps has arrived everywhere, and its place in the log is free.
        oldest = net.log_ends[thread, (step - reach) & (net.log_ends.shape[1] - 1), 0]
        # A bound on what can fire, so that no emission tests for room.
        steps = min(steps, (net.log_ids.shape[1] - (net.log_at[thread, 0] - oldest)) // n)
        steps = min(steps, (net.rec_ids.shape[1] - net.rec_at[thread, 0]) // n)
    return steps


@kernel
def has_room(view, step, steps, reach):
    """How many of the next steps have room for whatever fires."""
    return room(view, step, steps, reach)


@kernel
def run(view, first, last, longest, reach, h):
    """Run the steps first:last in slices of at most `longest`; return where there was no room to go on, or `last`."""
    net = net_of(view)
    threads = net.edges.shape[1] - 1
    step = first
    net.reached[0] = step
    while step < last:
        # Asked once for many steps: tests for room at each spike cost more than the space that an exact bound would
        # save.
        until = step + room(view, step, last - step, reach)
        if until == step:
            return step
        while step < until:
            if net.stop[0] != 0:
                return step
            # No spike needs less than `longest` steps, so within a slice no population waits for another one's spikes.
            end = min(step + longest, until)
            advance(view, 0, threads, step, end, h)
            step = end
            net.reached[0] = step
    # A read at the last step shows dopamine and post spikes up to it, but not the pre spikes emitted in it.
    for thread in range(threads):
        act_at_emission(view, thread, last - 2, last - 1, h)
    return last


@subkernel
def only_spikes(view):
    """Whether threads need nothing of each other but spikes that arrive: no ring to fill, no learning, no currents."""
    net = net_of(view)
    # Rings, learning and currents are worked out at the end of a slice from what all threads have logged in it: with
    # any of them all threads must begin each slice together.
    return net.at_emission.shape[0] + plastic_of(view).table.shape[0] + net.lines.shape[0] == 0


@subkernel
def slowest(progress):
    """The step up to which all threads are done."""
    step = load_acquire(progress, 0)
    for thread in range(1, progress.shape[0] - 1):
        step = min(step, load_acquire(progress, thread))
    return step


@subkernel
def allow(view, progress, step, last, ahead, reach):
    """Let all threads run on where all have done the steps up to `step`, or halt them where none can.

    They may go as far as there is room for whatever fires; what one that is ahead has logged is counted twice.
    """
    threads = progress.shape[0] - 1
    end = load_acquire(progress, threads)
    to = step + room(view, step, min(ahead, last - step), reach)
    # One thread decides for all, so that no two see different ends.
    if to > end:
        store_release(progress, threads, to)
    elif step == end:
        store_release(progress, threads, HALT)


@kernel
def share(view, progress, thread, last, longest, reach, h):
    """Run one thread's part of the steps up to `last` beside the other threads that do so.

    No spike needs less than `longest` steps: a thread that waits for nothing but spikes may be so many steps ahead of
    the slowest. Else threads begin each slice of so many together. Rows of `progress` hold the step up to which each
    thread is done; the last one holds the step up to which all may run, as thread 0 decides, or `HALT`. Return 1 where
    all is done or there is no room for more steps; 0 where the others have been waited for in vain: a later call goes
    on from there.
    """
    threads = progress.shape[0] - 1
    free = only_spikes(view)
    # Threads that need only spikes run up to `longest` steps ahead of the slowest: where one population is busier in
    # one part, the part that is done goes on instead of waiting. They report five times on the way, so that others
    # learn of it early; at each step it would cost a cache line that moves between cores.
    stride, ahead = (max(1, longest // STRIDES), 2 * longest) if free else (longest, longest)
    patience, known = PATIENCE, HALT
    while patience > 0:
        least = slowest(progress)
        # Thread 0 alone decides how far all may run, and only when something has changed: the decision reads the logs
        # of all.
        if thread == 0 and least != known:
            allow(view, progress, least, last, ahead, reach)
            known = least
        step, end = load_acquire(progress, thread), load_acquire(progress, threads)
        if end == HALT:
            return 1
        if net_of(view).stop[0] != 0:
            return 0
        end = min(step + stride, end)
        if step < end and least >= (end - longest if free else step):
            advance(view, thread, thread + 1, step, end, h)
            store_release(progress, thread, end)
            patience = PATIENCE
        else:
            # It spins for about 100 us and then gives up its processor: a meeting takes one to three microseconds, but
            # the other thread's core may be taken by another program for milliseconds.
            patience -= 1
    return 0


@kernel
def finish(view, thread, last, h):
    """What the end of a run shows of learning."""
    act_at_emission(view, thread, last - 1, last, h)


@kernel
def wake_blocks(view, pop, blocks, step, h):
    """Bring the sleeping ones of some blocks of a population to the end of a step."""
    net = net_of(view)
    for block in blocks:
        if net.awake[block] == 0:
            wake(view, 0, pop, block, step, h)


@kernel
def wake_population(view, pop, step, h):
    """Bring the sleeping blocks of a population to the end of a step."""
    net = net_of(view)
    row = net.pops[pop]
    for block in range(row[t.FIRST_BLOCK], row[t.LAST_BLOCK]):
        if net.awake[block] == 0:
            wake(view, 0, pop, block, step, h)


@kernel
def begin_trial(view, pop, group, start, h):
    """Drop what is under way after step `start`, open the groups, and reset the population of the trials' own."""
    net = net_of(view)
    row = net.pops[pop]
    # Before the groups are opened: a spike under way from the last trial must not decide this one.
    drop_all(view, start)
    open_groups(view)
    net.groups[group, t.IN_TRIAL] = 1
    net.groups[group, t.WINNER] = -1
    for block in range(row[t.FIRST_BLOCK], row[t.LAST_BLOCK]):
        if net.awake[block] == 0:
            wake(view, 0, pop, block, start, h)
    for k in range(net.resets.shape[0]):
        r = net.resets[k]
        for i in range(row[t.BEGIN], row[t.END]):
            net.state[r, i] = net.initial[r, i]


@kernel
def run_trial(view, group, first, last, at_decision, reach, h):
    """Run the steps first:last of a trial; return the next step: at a decision, where there was no room, or `last`."""
    net = net_of(view)
    for step in range(first, last):
        # One step at a time: a decision ends a trial in the step in which it falls.
        if net.stop[0] != 0 or room(view, step, 1, reach) < 1:
            return step
        advance(view, 0, net.edges.shape[1] - 1, step, step + 1, h)
        if at_decision and net.closed[group] == 1:
            return step + 1
    return last


@kernel
def end_trial(view, pop, group, end, h):
    """Weigh the maps without a decision, let all neurons fire that are not silenced, and finish step `end`."""
    net = net_of(view)
    row = net.pops[pop]
    if net.groups[group, t.WINNER] < 0 or net.local[group, t.RADIUS] >= 0:
        weigh_maps(view, 0, row, end, h)
    admit_all(view, row)
    for thread in range(net.edges.shape[1] - 1):
        act_at_emission(view, thread, end - 1, end, h)
    net.groups[group, t.IN_TRIAL] = 0


@subkernel
def drop_all(view, step):
    """Forget every spike under way at the end of a step."""
    net = net_of(view)
    for thread in range(net.clock.shape[0]):
        net.clock[thread, t.HORIZON] = step
        net.clock[thread, t.DONE] = step
        net.clock[thread, t.DONE_DOPAMINE] = step
    # The rings lie behind the input of the present step in `buf`; -0.0 stands for no input, since adding it changes no
    # bit.
    ring = net.x.shape[0] * net.x.shape[1]
    if net.buf.shape[0] > ring:
        net.buf[ring:] = -0.0
        net.due[:, :] = 0


@subkernel
def learn_step(view, step, done_arrivals, thread, h, arrivals_only):
    """All pairwise learning of one step: what arrives in it, then the pre spikes emitted in it."""
    net, p = net_of(view), plastic_of(view)
    for q in range(p.table.shape[0]):
        if step > done_arrivals:
            if p.table[q, t.DOPAMINE] >= 0:
                dopamine_arrivals(view, q, step, thread, h)
            elif p.table[q, t.EAGER] == 1:
                call_rule(view, p.table[q], ARRIVE, 0, step, thread, h)
        if arrivals_only:
            continue
        # Pre spikes act at emission, after all that arrives in the step: post is before pre, as in NEST.
        source = net.projections[p.table[q, t.PROJECTION], t.SOURCE]
        slot = step & (net.log_ends.shape[1] - 1)
        mask = net.log_ids.shape[1] - 1
        for sender in range(net.edges.shape[1] - 1):
            for place in range(net.log_ends[sender, slot, source], net.log_ends[sender, slot, source + 1]):
                local = np.int64(net.log_ids[sender, place & mask]) - net.pops[source, t.BEGIN]
                for nth in range(net.log_counts[sender, place & mask]):
                    if net.stop[0] == t.AT_ONCE:
                        return
                    call_rule(view, p.table[q], PRE_SPIKE + nth, local, step, thread, h)
                    if p.table[q, t.NOTED] == 1:
                        note(view, q, local, step, thread)
