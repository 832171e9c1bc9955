"""Kernels that Python calls between steps, for probes and for several engines of the same network.

A call takes as long as a step of a small network, so a single call for all engines saves most of the time.
"""

# mypy: ignore-errors

import numpy as np
from numba import types

from neuro.kernels.address import caller
from neuro.kernels.jit import kernel
from neuro_event.loop import tables as t
from neuro_event.loop.generators import wake_emitting
from neuro_event.loop.histories import write_signal
from neuro_event.loop.moves import clear_moves, teach_moves
from neuro_event.loop.neurons import wake
from neuro_event.loop.tables import net_of, plastic_of

_run = caller(types.int64, *(types.int64,) * 5, types.float64)


@kernel
def run_all(run, views, first, last, longest, reach, h, forget, reached):
    """Run the steps first:last of all engines.

    `run` is the address of `steps.run`. `reached` receives its result for each engine, (engines,). With `forget` spikes
    are not recorded, so the record is never full.
    """
    for k in range(views.shape[0]):
        if forget:
            net_of(views[k]).rec_at[0, 0] = 0
        step = first
        while step < last:
            reached[k] = _run(run, (views[k], step, last, longest, reach, h))
            if reached[k] == step or not forget:
                break
            step = reached[k]
            net_of(views[k]).rec_at[0, 0] = 0


@kernel
def list_all(views, pop, place, offsets, ticks, ids, step):
    """Replace the listed spikes of a population.

    Engine k emits the entries offsets[k]:offsets[k + 1] of `ticks` and `ids`. Ticks are counted from `step`.
    """
    for k in range(views.shape[0]):
        net = net_of(views[k])
        begin, at = net.pops[pop, t.BEGIN], place
        for i in range(offsets[k], offsets[k + 1]):
            net.list_steps[at], net.list_ids[at], net.list_counts[at] = step + ticks[i], begin + ids[i], 1
            at += 1
        net.cursor[0, pop], net.cursor[1, pop] = place, at


@kernel
def fired_by_all(views, pop, out):
    """Write the number of spikes of each neuron of a population into `out`, (engines, neurons), in internal order."""
    for k in range(views.shape[0]):
        net = net_of(views[k])
        begin = net.pops[pop, t.BEGIN]
        for i in range(out.shape[1]):
            out[k, i] = net.spikes[begin + i]


@kernel
def rate_all(views, pop, mean, p_silent, step):
    """Set the mean spikes per step of a poisson_generator and exp(-mean), (engines, neurons), in internal order."""
    for k in range(views.shape[0]):
        net = net_of(views[k])
        row = net.pops[pop]
        for i in range(mean.shape[1]):
            net.mean[row[t.BEGIN] + i], net.nothing[row[t.BEGIN] + i] = mean[k, i], p_silent[k, i]
        wake_emitting(net.mean, net.awake, net.busy, row[t.FIRST_BLOCK], row[t.LAST_BLOCK], step)


@kernel
def teach_all(views, q, values):
    """Apply a signal, (engines, targets), to a projection that learns by moves."""
    for k in range(views.shape[0]):
        teach_moves(views[k], q, values[k])


@kernel
def gate_all(views, q, values):
    """Set the gate of a projection that learns by moves, (engines, targets)."""
    for k in range(views.shape[0]):
        plastic = plastic_of(views[k])
        for i in range(values.shape[1]):
            plastic.move_gate[plastic.move_table[q, t.MOVE_TARGET] + i] = values[k, i]


@kernel
def signal_all(views, q, values, step, h):
    """Set the dopamine concentration n of a modulated projection, (engines, targets)."""
    for k in range(views.shape[0]):
        write_signal(views[k], q, values[k], step, h)


@kernel
def clear_all(views, q, which):
    """Set the states of a projection that learns by moves to 0 in the engines where `which` is true."""
    for k in range(views.shape[0]):
        if which[k]:
            clear_moves(views[k], q)


@kernel
def merge_all(views, q, weights, gained):
    """Add the changes of all engines to the weights of a projection that learns by moves, and set them in each.

    `weights` has the weights before the changes, and receives the result. `gained`, a buffer of the same size, must be
    0. Only weights that changed are written, because a write of all weights would load them into the cache.
    """
    for k in range(views.shape[0]):
        plastic = plastic_of(views[k])
        first = np.uint64(plastic.move_table[q, t.MOVE_SYNAPSE])
        for s in range(np.uint64(weights.shape[0])):
            gained[s] += plastic.move_y[0, first + s] - weights[s]
    for s in range(weights.shape[0]):
        weights[s] += gained[s]
    for k in range(views.shape[0]):
        net, plastic = net_of(views[k]), plastic_of(views[k])
        first = np.uint64(plastic.move_table[q, t.MOVE_SYNAPSE])
        weights_at = np.uint64(net.projections[plastic.move_table[q, t.MOVE_PROJECTION], t.WEIGHT])
        for s in range(np.uint64(weights.shape[0])):
            if plastic.move_y[0, first + s] != weights[s]:
                plastic.move_y[0, first + s] = weights[s]
                net.weights[weights_at + s] = plastic.move_sign[q] * weights[s] + 0.0


@kernel
def note(view, q, source, step, thread):
    """Record the states of a source's synapses onto this thread's neurons, after a spike of the source."""
    net, plastic = net_of(view), plastic_of(view)
    row = net.projections[plastic.table[q, t.PROJECTION]]
    place = row[t.ROW] + source * (net.edges.shape[1] - 1) + thread
    at = plastic.note_at[thread, 0]
    for e in range(net.rows[place], net.rows[place + 1]):
        z = plastic.table[q, t.FIRST_SYNAPSE] + e - row[t.SYNAPSE]
        # To test a byte for each of a row's thousands of synapses is faster than to search the synapses of a probe.
        if plastic.note_this[z] == 1:
            plastic.note_steps[thread, at] = step
            plastic.note_synapses[thread, at] = z
            for r in range(plastic.y.shape[0]):
                plastic.note_y[thread, r, at] = plastic.y[r, z]
            at += 1
    plastic.note_at[thread, 0] = at


@kernel
def notes_to_come(view, upto):
    """Return an upper bound of the number of records per thread after the spikes up to a step."""
    net, plastic = net_of(view), plastic_of(view)
    threads = net.edges.shape[1] - 1
    mask = net.log_ids.shape[1] - 1
    most = np.int64(0)
    for thread in range(threads):
        # The bound is computed before the step, so that no pre spike has to test whether the buffer is full.
        number = plastic.note_at[thread, 0]
        for step in range(net.clock[thread, t.DONE] + 1, upto + 1):
            slot = step & (net.log_ends.shape[1] - 1)
            for q in range(plastic.table.shape[0]):
                if plastic.table[q, t.NOTED] == 0:
                    continue
                row = net.projections[plastic.table[q, t.PROJECTION]]
                source = row[t.SOURCE]
                for sender in range(threads):
                    for i in range(net.log_ends[sender, slot, source], net.log_ends[sender, slot, source + 1]):
                        local = np.int64(net.log_ids[sender, i & mask]) - net.pops[source, t.BEGIN]
                        place = row[t.ROW] + local * threads + thread
                        number += net.log_counts[sender, i & mask] * (net.rows[place + 1] - net.rows[place])
        most = max(most, number)
    return most


@kernel
def sample(view, pop, state, places, step, h, aside, out):
    """Write a state of the neurons at `places` of a population, at `step`, into `out`. Sleeping blocks stay asleep.

    `aside` is a buffer for the states of a block and for `fired`, shape (states + 1, t.BLOCK).
    """
    net = net_of(view)
    k = 0
    while k < places.shape[0]:
        block = places[k] // t.BLOCK
        # A read must not change the run, so a sleeping block is updated and then restored.
        if net.awake[block] == 1:
            out[k] = net.state[state, places[k]]
            k += 1
            continue
        lo, hi, busy = block * t.BLOCK, min((block + 1) * t.BLOCK, net.state.shape[1]), net.busy[block]
        # All states of all neurons of the block are saved, because `wake` steps whole blocks.
        states = net.state.shape[0]
        for i in range(lo, hi):
            for r in range(states):
                aside[r, i - lo] = net.state[r, i]
            aside[states, i - lo] = net.fired[i]
        wake(view, 0, pop, block, step, h)
        while k < places.shape[0] and places[k] // t.BLOCK == block:
            out[k] = net.state[state, places[k]]
            k += 1
        for i in range(lo, hi):
            for r in range(states):
                net.state[r, i] = aside[r, i - lo]
            net.fired[i] = np.uint8(aside[states, i - lo])
        net.awake[block], net.busy[block] = np.uint8(0), busy


@kernel
def follow_peaks(view, pop, tick, value, when):
    """Update `value`, the largest V_m of each neuron so far, and `when`, its tick. Both are in the order of ids."""
    net = net_of(view)
    for i in range(net.pops[pop, t.BEGIN], net.pops[pop, t.END]):
        # Callers expect the order of ids, not the internal order.
        k = net.order[i]
        if net.state[0, i] > value[k]:
            value[k], when[k] = net.state[0, i], tick
