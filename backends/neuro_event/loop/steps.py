"""The compiled loop, which runs every step of every network.

`advance` runs the steps first:last for a range of threads. If a single thread runs the neurons of all threads, each row
of synapses is read once, instead of once per thread. The loop allocates no memory.
"""

# mypy: ignore-errors
import numpy as np

from neuro.kernels.instructions import load_acquire, store_release
from neuro.kernels.jit import inlined, kernel, subkernel
from neuro_event.loop import tables as t
from neuro_event.loop.arrivals import deliver, log_delivery
from neuro_event.loop.generators import draw_poisson, list_spikes, step_generator
from neuro_event.loop.groups import open_groups, record_potentials, unmute_all
from neuro_event.loop.lazy_rules import ARRIVE, PRE_SPIKE
from neuro_event.loop.neurons import step_neurons, wake
from neuro_event.loop.tables import (
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
"""Value of the common end step at which all threads return."""

STRIDES = 5
"""Number of times that a thread publishes its progress within the shortest delay."""

PATIENCE = 50_000
"""Number of reads of the progress of other threads after which a thread yields its core. They take about 100 us."""


@subkernel
def act_at_emission(view, thread, upto, arrivals_upto, h):
    """Deliver the spikes emitted up to a step into rings, and learn from them, see `act`."""
    clock = net_of(view).clock[thread]
    for step in range(clock[t.DONE] + 1, upto + 1):
        # Spikes up to the horizon were dropped by a trial, a reset or a restored state.
        if step > clock[t.HORIZON]:
            act(view, step, clock[t.DONE_ARRIVALS], thread, h, 0)
    clock[t.DONE] = max(clock[t.DONE], upto)
    clock[t.DONE_ARRIVALS] = max(clock[t.DONE_ARRIVALS], upto)
    # At the end of a run, dopamine spikes, post spikes and the spikes of devices act up to one step later than the
    # spikes of neurons. The pre spikes of the last step must not act yet: a read must not show their effect, and
    # neurons send them with the weights that are set after the run.
    for step in range(clock[t.DONE_ARRIVALS] + 1, arrivals_upto + 1):
        act(view, step, clock[t.DONE_ARRIVALS], thread, h, 1)
    clock[t.DONE_ARRIVALS] = max(clock[t.DONE_ARRIVALS], arrivals_upto)


@subkernel
def act(view, step, done_arrivals, thread, h, arrivals_only):
    """Deliver the spikes of one step into rings, and learn from these spikes.

    With `arrivals_only`, only spikes of devices and arrivals at plastic synapses act, not the pre spikes of neurons.
    """
    net = net_of(view)
    # Static synapses come before learning, so that sums in rings have the same order for any number of threads.
    for k in range(net.at_emission.shape[0]):
        q = net.at_emission[k]
        if step > done_arrivals if net.projections[q, t.SENDS_AT_ONCE] == 1 else arrivals_only == 0:
            log_delivery(view, q, step, step, thread, thread + 1, True)
    learn_step(view, step, done_arrivals, thread, h, arrivals_only)
    if plastic_of(view).shared_table.shape[0] > 0:
        learn_kernels(view, step, done_arrivals, arrivals_only, h)


@inlined
def step_population(view, thread, pop, step, processed_step, h):
    """Run one step of a population on a thread, after all input of the step has been added."""
    net = net_of(view)
    row = net.pops[pop]
    log_at, kind = net.log_at[thread, 0], row[t.KIND]
    # Ends are stored for every step, even without spikes, so that the spikes of a population need no search. The
    # number of slots is a power of two, so a mask replaces a division.
    net.log_ends[thread, step & (net.log_ends.shape[1] - 1), pop] = log_at
    if kind == t.NEURON:
        slots, blocks = slot_mask(net), net.awake.shape[0]
        # A model that only adds input to states is stepped without input: `step_collecting` adds the input afterwards.
        if row[t.COLLECTS] >= 0:
            log_at = step_collecting(view, thread, pop, step, log_at, processed_step, h, slots, blocks)
        else:
            n_candidates, log_at = step_neurons(
                view, thread, pop, step, log_at, processed_step, h, net.x.shape[1], slots, blocks
            )
            # `settle` is called by address, so that only networks with groups compile this function.
            if n_candidates > 0:
                log_at = settle(view, thread, pop, n_candidates, step, log_at, processed_step, h)
    elif kind == t.POISSON:
        log_at = draw_poisson(view, thread, pop, step, log_at, processed_step, h)
    elif kind == t.LISTED:
        log_at = list_spikes(view, thread, pop, step, log_at, processed_step, h)
    elif kind == t.GENERATOR:
        log_at = step_generator(view, thread, pop, step, log_at, processed_step, h)
    # Each thread's place has its own cache line. A line that two threads write moves between cores, which takes 250 ns.
    net.log_at[thread, 0] = log_at
    if row[t.GATHERS] == 1:
        gather_moves(view, thread, pop, step, h)


@subkernel
def advance(view, begin, stop, first, last, h):
    """Run the steps first:last of the threads begin:stop. All spikes before `first` must be in the logs."""
    net = net_of(view)
    n, driven = net.pops.shape[0], net.lines.shape[0] > 0
    processed_step = first - 1
    # All threads have now logged the spikes of the last slice, which arrive in step `first` or later.
    for thread in range(begin, stop):
        act_at_emission(view, thread, processed_step, processed_step, h)
    for step in range(first, last):
        if net.stop[0] == t.AT_ONCE:
            return
        if driven:
            for thread in range(begin, stop):
                drive(view, thread, step)
        if net.joined.shape[0] > 0:
            deliver_joined(view, begin, stop, step)
        # Each population is stepped right after the deliveries to it, with the input in the cache. Spikes of this step
        # arrive in the next step at the earliest, so the order of populations has no effect.
        for pop in range(n):
            row = net.pops[pop]
            if row[t.KIND] == t.NEURON:
                deliver(view, row[t.JOINED_END], row[t.ARRIVALS_END], begin, stop, step)
            for thread in range(begin, stop):
                step_population(view, thread, pop, step, processed_step, h)
        for thread in range(begin, stop):
            if driven:
                charge(view, thread, step)
            net.log_ends[thread, step & (net.log_ends.shape[1] - 1), n] = net.log_at[thread, 0]


@subkernel
def room(view, step, steps, reach):
    """Return the number of next steps, at most `steps`, for which log and record have room even if all neurons fire."""
    net = net_of(view)
    for thread in range(net.edges.shape[1] - 1):
        n = net.most[thread]
        if n == 0:
            continue
        # Spikes older than `reach` steps have arrived everywhere, so their places in the log are free.
        oldest = net.log_ends[thread, (step - reach) & (net.log_ends.shape[1] - 1), 0]
        # At most `n` neurons fire in a step. With this bound, no emission has to test whether the log is full.
        steps = min(steps, (net.log_ids.shape[1] - (net.log_at[thread, 0] - oldest)) // n)
        steps = min(steps, (net.rec_ids.shape[1] - net.rec_at[thread, 0]) // n)
    return steps


@kernel
def has_room(view, step, steps, reach):
    """Return the result of `room` to Python."""
    return room(view, step, steps, reach)


@kernel
def run(view, first, last, longest, reach, h):
    """Run the steps first:last in slices of at most `longest` steps. Return the first step without room, or `last`."""
    net = net_of(view)
    threads = net.edges.shape[1] - 1
    step = first
    net.reached[0] = step
    while step < last:
        # Room is tested once for many steps. A test at each spike would need less memory, but take too much time.
        until = step + room(view, step, last - step, reach)
        if until == step or net.stop[0] != 0:
            break
        while step < until and net.stop[0] == 0:
            # All delays are at least `longest` steps, so within a slice no population needs spikes of another one.
            end = min(step + longest, until)
            advance(view, 0, threads, step, end, h)
            step = end
            net.reached[0] = step
    # A read after the run shows the effect of dopamine and post spikes up to the last step, but not of its pre spikes.
    for thread in range(threads):
        act_at_emission(view, thread, step - 2, step - 1, h)
    return step


@subkernel
def only_spikes(view):
    """Return whether threads only exchange spikes, because there are no rings, no learning and no varying currents."""
    net = net_of(view)
    # Rings, learning and currents are computed at the end of a slice from the logs of all threads, so threads that need
    # them must begin each slice together.
    return net.at_emission.shape[0] + plastic_of(view).table.shape[0] + net.lines.shape[0] == 0


@subkernel
def slowest(progress):
    """Return the first step that some thread has not finished."""
    step = load_acquire(progress, 0)
    for thread in range(1, progress.shape[0] - 1):
        step = min(step, load_acquire(progress, thread))
    return step


@subkernel
def allow(view, progress, step, last, most, reach):
    """Extend the common end step, if all threads have finished the steps before `step`, or halt them if logs are full.

    Some threads are ahead, and their spikes are counted twice. So the logs always have room up to the new end.
    """
    threads = progress.shape[0] - 1
    end = load_acquire(progress, threads)
    new_end = step + room(view, step, min(most, last - step), reach)
    # A single thread decides, so that all threads see the same end.
    if new_end > end:
        store_release(progress, threads, new_end)
    elif step == end:
        store_release(progress, threads, HALT)


@kernel
def share(view, progress, thread, last, longest, reach, h):
    """Run one thread's part of the steps up to `last`, while other threads run theirs.

    All delays are at least `longest` steps. So a thread that only needs spikes may be `longest` steps ahead of the
    slowest thread. Otherwise all threads begin each slice of `longest` steps together.

    Each row of `progress` has the next step of a thread. The last row has the step before which all threads must stop,
    or `HALT`. Thread 0 sets it.

    Return 1 if all steps are finished or the logs are full. Return 0 if the thread has waited in vain for other
    threads; a later call continues.
    """
    threads = progress.shape[0] - 1
    free = only_spikes(view)
    # Threads that only need spikes run up to `longest` steps ahead of the slowest thread, so that a thread with less
    # activity need not wait. The progress is published `STRIDES` times in this interval, which is early enough for
    # the other threads. With a publication at each step, a cache line would move between cores at each step.
    stride, most_ahead = (max(1, longest // STRIDES), 2 * longest) if free else (longest, longest)
    patience, last_least = PATIENCE, HALT
    while patience > 0:
        least = slowest(progress)
        # Only thread 0 sets the common end, and only after a change, since it has to read the logs of all threads.
        if thread == 0 and least != last_least:
            allow(view, progress, least, last, most_ahead, reach)
            last_least = least
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
            # The thread spins for about 100 us and then yields its processor. A synchronisation takes one to three
            # microseconds, but another program may occupy the other thread's core for milliseconds.
            patience -= 1
    return 0


@kernel
def finish(view, thread, last, h):
    """Apply the learning up to the end of a run, so that reads show it."""
    act_at_emission(view, thread, last - 1, last, h)


@kernel
def wake_blocks(view, pop, blocks, step, h):
    """Update the sleeping blocks among some blocks of a population to the end of a step."""
    net = net_of(view)
    for block in blocks:
        if net.awake[block] == 0:
            wake(view, 0, pop, block, step, h)


@kernel
def wake_population(view, pop, step, h):
    """Update the sleeping blocks of a population to the end of a step."""
    net = net_of(view)
    row = net.pops[pop]
    for block in range(row[t.FIRST_BLOCK], row[t.LAST_BLOCK]):
        if net.awake[block] == 0:
            wake(view, 0, pop, block, step, h)


@kernel
def begin_trial(view, pop, group, start, h):
    """Drop all spikes that are under way after step `start`, open the groups, and reset the output population."""
    net = net_of(view)
    row = net.pops[pop]
    # Spikes are dropped before the groups open, because a spike of the last trial must not decide this trial.
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
    """Run the steps first:last of a trial, up to a decision if `at_decision` is true. Return the next step to run."""
    net = net_of(view)
    for step in range(first, last):
        # Each step is a separate run, because a decision ends the trial in the same step.
        if net.stop[0] != 0 or room(view, step, 1, reach) < 1:
            return step
        advance(view, 0, net.edges.shape[1] - 1, step, step + 1, h)
        if at_decision and net.closed[group] == 1:
            return step + 1
    return last


@kernel
def end_trial(view, pop, group, end, h):
    """Finish a trial at step `end`: let silenced neurons fire again, and apply the learning.

    If there was no decision, or if a group may have several winners, the potentials of the maps are recorded.
    """
    net = net_of(view)
    row = net.pops[pop]
    if net.groups[group, t.WINNER] < 0 or net.local[group, t.RADIUS] >= 0:
        record_potentials(view, 0, row, end, h)
    unmute_all(view, row)
    for thread in range(net.edges.shape[1] - 1):
        act_at_emission(view, thread, end - 1, end, h)
    net.groups[group, t.IN_TRIAL] = 0


@subkernel
def drop_all(view, step):
    """Drop all spikes under way at the end of a step."""
    net = net_of(view)
    for thread in range(net.clock.shape[0]):
        net.clock[thread, t.HORIZON] = step
        net.clock[thread, t.DONE] = step
        net.clock[thread, t.DONE_ARRIVALS] = step
    # In `buf` the rings follow the input of the present step. -0.0 means no input, since adding -0.0 changes no bit.
    ring = net.x.shape[0] * net.x.shape[1]
    if net.buf.shape[0] > ring:
        net.buf[ring:] = -0.0
        net.due[:, :] = 0


@subkernel
def learn_step(view, step, done_arrivals, thread, h, arrivals_only):
    """Apply the pair learning of one step: first arriving post and dopamine spikes, then the emitted pre spikes."""
    net, plastic = net_of(view), plastic_of(view)
    for q in range(plastic.table.shape[0]):
        if step > done_arrivals:
            if plastic.table[q, t.DOPAMINE] >= 0:
                dopamine_arrivals(view, q, step, thread, h)
            elif plastic.table[q, t.EAGER] == 1:
                call_rule(view, plastic.table[q], ARRIVE, 0, step, thread, h)
        if arrivals_only == 1:
            continue
        # Pre spikes act at emission, after all arrivals of the step. So post acts before pre, as in NEST.
        source = net.projections[plastic.table[q, t.PROJECTION], t.SOURCE]
        slot = step & (net.log_ends.shape[1] - 1)
        mask = net.log_ids.shape[1] - 1
        for sender in range(net.edges.shape[1] - 1):
            for place in range(net.log_ends[sender, slot, source], net.log_ends[sender, slot, source + 1]):
                local = np.int64(net.log_ids[sender, place & mask]) - net.pops[source, t.BEGIN]
                for nth in range(net.log_counts[sender, place & mask]):
                    if net.stop[0] == t.AT_ONCE:
                        return
                    call_rule(view, plastic.table[q], PRE_SPIKE + nth, local, step, thread, h)
                    if plastic.table[q, t.NOTED] == 1:
                        note(view, q, local, step, thread)
