"""What pre spikes leave in synapses that learn, noted for the probes that ask for it."""

# mypy: ignore-errors
import numpy as np

from neuro.kernels.jit import kernel
from neuro_event.loop import tables as t
from neuro_event.loop.neurons import wake
from neuro_event.loop.tables import net_of, plastic_of


@kernel
def note(view, q, source, step, thread):
    """Keep the states of this thread's synapses of a source as its spike has just left them."""
    net, p = net_of(view), plastic_of(view)
    row = net.projections[p.table[q, t.PROJECTION]]
    place = row[t.ROW] + source * (net.edges.shape[1] - 1) + thread
    at = p.note_at[thread, 0]
    for e in range(net.rows[place], net.rows[place + 1]):
        z = p.table[q, t.FIRST_SYNAPSE] + e - row[t.SYNAPSE]
        # Probes name synapses, and a row has thousands: a byte for each is less than a search.
        if p.note_this[z] == 1:
            p.note_steps[thread, at] = step
            p.note_synapses[thread, at] = z
            for r in range(p.y.shape[0]):
                p.note_y[thread, r, at] = p.y[r, z]
            at += 1
    p.note_at[thread, 0] = at


@kernel
def notes_to_come(view, upto):
    """How many notes the spikes up to a step that have not acted yet can make on one thread at most."""
    net, p = net_of(view), plastic_of(view)
    threads = net.edges.shape[1] - 1
    mask = net.log_ids.shape[1] - 1
    most = np.int64(0)
    for thread in range(threads):
        # An upper bound before the step, so that no pre spike tests for room.
        number = p.note_at[thread, 0]
        for step in range(net.clock[thread, t.DONE] + 1, upto + 1):
            slot = step & (net.log_ends.shape[1] - 1)
            for q in range(p.table.shape[0]):
                if p.table[q, t.NOTED] == 0:
                    continue
                row = net.projections[p.table[q, t.PROJECTION]]
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
    """Fill `out` with a state of some neurons of a population as of `step`; a block that sleeps is put back to sleep.

    `aside` is room for the states of a block and for `fired`, shape (states + 1, t.BLOCK).
    """
    net = net_of(view)
    k = 0
    while k < places.shape[0]:
        block = places[k] // t.BLOCK
        # A read must not change what follows: a block that sleeps is brought up to date in a copy and put back, so that
        # probes do not decide when it wakes.
        if net.awake[block] == 1:
            out[k] = net.state[state, places[k]]
            k += 1
            continue
        lo, hi, busy = block * t.BLOCK, min((block + 1) * t.BLOCK, net.state.shape[1]), net.busy[block]
        # All neurons of the block and all states: `wake` steps whole blocks.
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
    """Note whose V_m is larger than at all ticks before, by id."""
    net = net_of(view)
    for i in range(net.pops[pop, t.BEGIN], net.pops[pop, t.END]):
        # By id: maps lie innermost here, and callers know nothing of that.
        k = net.order[i]
        if net.state[0, i] > value[k]:
            value[k], when[k] = net.state[0, i], tick
