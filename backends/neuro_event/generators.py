"""One step of a generator, and the input from those that keep counts."""

# mypy: ignore-errors
import numpy as np

from neuro.kernels.draws import poisson_by_sum, poisson_by_table, step_word, uniform, words_of
from neuro.kernels.jit import inner
from neuro_event.deliver import base_of, receptor, told_apart
from neuro_event.neurons import any_fired, emit, next_fired
from neuro_event.operations import STEP
from neuro_event.tables import (
    BEGIN,
    BLOCK,
    COUNTS,
    COUNTS_STEPS,
    END,
    FIRST_BLOCK,
    LAG,
    LAST_BLOCK,
    RECEPTORS,
    SOURCE,
    START,
    STOP,
    TABLE,
    WEIGHT,
)
from neuro_event.views import call_entry, net_of


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
        if net.awake[block] == 0 and (row[COUNTS] < 0 or step - net.busy[block] > row[COUNTS_STEPS]):
            continue
        lo, hi = block * BLOCK, min((block + 1) * BLOCK, row[END])
        if row[COUNTS] >= 0:
            place = row[COUNTS] + (step & (row[COUNTS_STEPS] - 1)) * (row[END] - row[BEGIN])
            counts = net.counts[place + lo - row[BEGIN] : place + hi - row[BEGIN]]
            if net.awake[block] == 0:  # what it kept while it was awake is not to be read again
                counts[:] = 0
                continue
            if row[TABLE] >= 0:
                guide, cumulative = net.guides[row[TABLE]], net.cumulative[row[TABLE]]
                words = net.words[thread]
                words_of(base, lo - row[BEGIN], words)
                for k in range(counts.shape[0]):
                    counts[k] = poisson_by_table(words[k], guide, cumulative)
            else:
                for k in range(counts.shape[0]):
                    counts[k] = poisson_by_sum(base, lo - row[BEGIN] + k, net.mean[lo + k], net.nothing[lo + k])
            events, spikes = net.events[lo:hi], net.spikes[lo:hi]
            for k in range(counts.shape[0]):
                events[k] += counts[k] > 0
                spikes[k] += counts[k]
        else:
            emits, nothing = net.fired[lo:hi], net.nothing[lo:hi]
            first = lo - row[BEGIN]
            for k in range(emits.size):
                emits[k] = uniform(base, first + k) >= nothing[k]
            if any_fired(view, lo, hi):
                i = next_fired(view, lo, hi)
                while i < hi:
                    m = poisson_by_sum(base, i - row[BEGIN], net.mean[i], net.nothing[i])
                    at = emit(view, thread, pop, row, i, m, step, done, h, at)
                    i = next_fired(view, i + 1, hi)
    return at


@inner
def let_emit(view, thread, pop, row, step, at, done, h):
    """One step of a generator with an entry of its own."""
    net = net_of(view)
    if step <= row[START] or step > row[STOP]:
        return at
    for block in range(max(row[FIRST_BLOCK], net.edges[thread]), min(row[LAST_BLOCK], net.edges[thread + 1])):
        lo, hi = block * BLOCK, min((block + 1) * BLOCK, row[END])
        call_entry(view, row, STEP, lo, hi, thread, step, h)
        if any_fired(view, lo, hi):
            i = next_fired(view, lo, hi)
            while i < hi:
                at = emit(view, thread, pop, row, i, np.int64(net.x[0, i]), step, done, h, at)
                i = next_fired(view, i + 1, hi)
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
    out = target[BEGIN] + (base_of(row) + receptor(weight, told_apart(row, target[RECEPTORS]))) * n_all
    for block in range(max(target[FIRST_BLOCK], net.edges[thread]), min(target[LAST_BLOCK], net.edges[thread + 1])):
        from_block = source[FIRST_BLOCK] + block - target[FIRST_BLOCK]
        # what one sent before it fell silent may still be under way
        if net.awake[from_block] == 0 and step - row[LAG] > net.busy[from_block]:
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
