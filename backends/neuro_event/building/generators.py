"""The tables of the poisson_generators."""

from __future__ import annotations

import numpy as np

from neuro.core import keyed_random
from neuro.kernels.draws import GUIDE_BITS, guide_to
from neuro.program.program import Floats, drawn_for
from neuro_event.building import layout
from neuro_event.building.arrays import EventArrays, aligned_zeros
from neuro_event.loop import tables as t
from neuro_event.loop.generators import wake_emitting

TABLE_WIDTH = 1400


def add_generators(a: EventArrays) -> None:
    """Set the rates, and make room for those that keep counts."""
    pops = a.net["pops"]
    a.net["keys"] = np.array(
        [keyed_random.key(a.program.seed, drawn_for(p), p.name) for p in a.program.populations], dtype=np.uint64
    )
    a.net["guides"] = np.zeros((len(a.program.populations), 1 << GUIDE_BITS), dtype=np.uint16)
    a.net["cumulative"] = np.full((len(a.program.populations), TABLE_WIDTH), np.inf)
    size = 0
    for k, p in enumerate(a.program.populations):
        if p.kind == "poisson":
            if _keeps_counts(a, k):
                own = [q for q, projection in enumerate(a.program.projections) if projection.source == k]
                a.net["projections"][own, t.DENSE_COUNTS] = 1
                steps = layout.power_of_two(int(a.net["projections"][own, t.LAG].max()) + a.longest_slice)
                pops[k, t.COUNTS], pops[k, t.COUNTS_STEPS] = size, steps
                size += steps * p.size
            set_rate(a, k, p.rate(1), 0)
    a.net["counts"] = aligned_zeros(size, np.uint16)
    a.net["tally"] = aligned_zeros(a.net["mean"].size if size else 0, np.uint32, line=24)


def settle(a: EventArrays) -> None:
    """Move what generators have tallied to their events and spikes."""
    tally = a.net["tally"]
    a.net["events"][: tally.size] += tally >> t.TALLY_BITS
    a.net["spikes"][: tally.size] += tally & ((1 << t.TALLY_BITS) - 1)
    tally[:] = 0


def _keeps_counts(a: EventArrays, k: int) -> bool:
    """Whether a generator's spikes are wanted only as one-to-one input, so that no list of them is needed."""
    outgoing = [q for q, p in enumerate(a.program.projections) if p.source == k]
    others = any(p.dopamine == k for p in a.program.projections)
    return (
        bool(outgoing)
        and not others
        and not a.program.populations[k].records
        and a.program.populations[k].largest("rate") * a.program.resolution > 50.0
        and all(
            a.synapses[q].layout == t.ONE_TO_ONE
            and not a.program.projections[q].synapse.learns
            and a.net["projections"][q, t.LAG] > 0
            and a.net["projections"][q, t.WEIGHT_STRIDE] == 0
            for q in outgoing
        )
    )


def set_rate(a: EventArrays, k: int, rate: Floats, step: int) -> None:
    """Set the rate in Hz of a poisson_generator, one value or one per neuron, after a step."""
    place, row = a.places[k], a.net["pops"][k]
    net, here = a.net, slice(place.begin, place.end)
    mean, nothing = net["mean"][here], net["nothing"][here]
    np.multiply(rate, a.program.resolution * 1e-3, out=mean)
    np.exp(np.negative(mean, out=nothing), out=nothing)
    wake_emitting(net["mean"], net["awake"], net["busy"], row[t.FIRST_BLOCK], row[t.LAST_BLOCK], step)
    if row[t.COUNTS] >= 0:
        _tabulate(a, k, mean)


def tabulate(a: EventArrays) -> None:
    """Fill the tables of all generators that keep counts, from the rates of now."""
    for k, place in enumerate(a.places):
        if a.net["pops"][k, t.COUNTS] >= 0:
            _tabulate(a, k, a.net["mean"][place.begin : place.end])


def _tabulate(a: EventArrays, k: int, mean: Floats) -> None:
    """Use a table of the Poisson distribution where all neurons share it."""
    row = a.net["pops"][k]
    row[t.TABLE] = t.NONE
    if np.all(mean == mean[0]):
        table = keyed_random.poisson_table(float(mean[0]))
        if table.size < a.net["cumulative"].shape[1]:
            row[t.TABLE] = k
            a.net["cumulative"][k] = np.inf
            a.net["cumulative"][k, : table.size] = table
            a.net["guides"][k] = guide_to(table)
