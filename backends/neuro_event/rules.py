"""The learning of one step, by the entries of the rules."""

# mypy: ignore-errors
import numpy as np

from neuro.kernels.jit import inner
from neuro_event.own_rules import ARRIVE, PRE_SPIKE
from neuro_event.stages import dopamine_arrivals, note
from neuro_event.tables import BEGIN, DOPAMINE, EAGER, NOTED, PROJECTION, SOURCE
from neuro_event.views import call_rule, net_of, plastic_of


@inner
def learn_step(view, step, done_arrivals, thread, h, arrivals_only):
    """All pairwise learning of one step: what arrives in it, then the pre spikes emitted in it."""
    net, p = net_of(view), plastic_of(view)
    for q in range(p.table.shape[0]):
        if step > done_arrivals:
            if p.table[q, DOPAMINE] >= 0:
                dopamine_arrivals(view, q, step, thread, h)
            elif p.table[q, EAGER] == 1:
                call_rule(view, p.table[q], ARRIVE, 0, step, thread, h)
        if arrivals_only:
            continue
        source = net.projections[p.table[q, PROJECTION], SOURCE]
        slot = step & (net.log_ends.shape[1] - 1)
        mask = net.log_ids.shape[1] - 1
        for t in range(net.edges.shape[1] - 1):
            for place in range(net.log_ends[t, slot, source], net.log_ends[t, slot, source + 1]):
                local = np.int64(net.log_ids[t, place & mask]) - net.pops[source, BEGIN]
                for nth in range(net.log_counts[t, place & mask]):
                    call_rule(view, p.table[q], PRE_SPIKE + nth, local, step, thread, h)
                    if p.table[q, NOTED] == 1:
                        note(view, q, local, step, thread)
