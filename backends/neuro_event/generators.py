"""One step of a generator."""

# mypy: ignore-errors
import numpy as np

from neuro.kernels.draws import poisson_by_sum, reaching, step_word
from neuro.kernels.jit import inner
from neuro.kernels.lanes import LANES, lowest, marked
from neuro_event.neurons import emit
from neuro_event.operations import STEP
from neuro_event.stages import draw_counts
from neuro_event.tables import (
    BEGIN,
    BLOCK,
    COUNTS,
    END,
    NUMBER,
    START,
    STOP,
)
from neuro_event.views import call_entry, net_of

_ONE = np.uint64(1)


@inner
def draw_poisson(view, thread, pop, step, at, done, h):
    """One step of a poisson_generator: into its counts, or into the log."""
    net = net_of(view)
    row = net.pops[pop]
    if row[COUNTS] >= 0:
        draw_counts(view, thread, pop, step)
        return at
    if step <= row[START] or step > row[STOP]:
        return at
    base = step_word(net.keys[pop], step)
    for block in range(net.edges[row[NUMBER], thread], net.edges[row[NUMBER], thread + 1]):
        if net.awake[block] == 0:
            continue
        lo, hi = block * BLOCK, min((block + 1) * BLOCK, row[END])
        first = lo - row[BEGIN]
        fired = np.uint64(0)
        for k in range(0, hi - lo, LANES):  # to places that no neuron has 1 belongs, which no number reaches
            fired |= reaching(base, first + k, net.nothing, lo + k) << np.uint64(k)
        while fired:
            i = lo + lowest(fired)
            fired &= fired - _ONE
            m = poisson_by_sum(base, i - row[BEGIN], net.mean[i], net.nothing[i])
            at = emit(view, thread, pop, i, m, step, done, h, at)
    return at


@inner
def let_emit(view, thread, pop, step, at, done, h):
    """One step of a generator with an entry of its own."""
    net = net_of(view)
    row = net.pops[pop]
    if step <= row[START] or step > row[STOP]:
        return at
    for block in range(net.edges[row[NUMBER], thread], net.edges[row[NUMBER], thread + 1]):
        lo, hi = block * BLOCK, min((block + 1) * BLOCK, row[END])
        call_entry(view, row, STEP, lo, hi, thread, step, h)
        fired = marked(net.fired, lo)
        while fired:
            i = lo + lowest(fired)
            fired &= fired - _ONE
            at = emit(view, thread, pop, i, np.int64(net.x[0, i]), step, done, h, at)
    return at


@inner
def list_spikes(view, thread, pop, step, at, done, h):
    """The listed spikes of a spike_generator in this step."""
    net = net_of(view)
    lo, hi = net.edges[pop, thread] * BLOCK, net.edges[pop, thread + 1] * BLOCK
    place = net.cursor[thread, pop]
    end = net.cursor[net.cursor.shape[0] - 1, pop]
    while place < end and net.list_steps[place] <= step:
        i = np.int64(net.list_ids[place])
        if net.list_steps[place] == step and lo <= i < hi:
            at = emit(view, thread, pop, i, np.int64(net.list_counts[place]), step, done, h, at)
        place += 1
    net.cursor[thread, pop] = place
    return at
