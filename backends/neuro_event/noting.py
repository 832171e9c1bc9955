"""What pre spikes leave in synapses that learn, noted for the probes that ask for it."""

# mypy: ignore-errors
import numpy as np

from neuro.kernels.jit import kernel
from neuro_event.tables import BEGIN, DONE, FIRST_SYNAPSE, NOTED, PROJECTION, ROW, SOURCE, SYNAPSE
from neuro_event.views import net_of, plastic_of


@kernel
def note(view, q, source, step, thread):
    """Keep the states of this thread's synapses of a source as its spike has just left them."""
    net, p = net_of(view), plastic_of(view)
    row = net.projections[p.table[q, PROJECTION]]
    place = row[ROW] + source * (net.edges.shape[1] - 1) + thread
    at = p.note_at[thread, 0]
    for e in range(net.rows[place], net.rows[place + 1]):
        z = p.table[q, FIRST_SYNAPSE] + e - row[SYNAPSE]
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
        number = p.note_at[thread, 0]
        for step in range(net.clock[thread, DONE] + 1, upto + 1):
            slot = step & (net.log_ends.shape[1] - 1)
            for q in range(p.table.shape[0]):
                if p.table[q, NOTED] == 0:
                    continue
                row = net.projections[p.table[q, PROJECTION]]
                source = row[SOURCE]
                for t in range(threads):
                    for i in range(net.log_ends[t, slot, source], net.log_ends[t, slot, source + 1]):
                        local = np.int64(net.log_ids[t, i & mask]) - net.pops[source, BEGIN]
                        place = row[ROW] + local * threads + thread
                        number += net.log_counts[t, i & mask] * (net.rows[place + 1] - net.rows[place])
        most = max(most, number)
    return most
