"""Poisson generators whose spikes are wanted only as one-to-one input: they keep counts, and list no spikes."""

# mypy: ignore-errors
import numpy as np

from neuro.kernels.draws import poisson_by_sum, poisson_by_table, step_word, words_of
from neuro.kernels.jit import inner, kernel
from neuro_event.deliver import base_of, receptor, told_apart
from neuro_event.tables import (
    BEGIN,
    BLOCK,
    COUNTS,
    COUNTS_STEPS,
    END,
    FIRST_BLOCK,
    GROUPED,
    LAG,
    NUMBER,
    RECEPTORS,
    SOURCE,
    START,
    STOP,
    TABLE,
    TALLY_BITS,
    TARGET,
    WEIGHT,
)
from neuro_event.views import net_of

_FULL = np.uint32(1 << 31 | 1 << (TALLY_BITS - 1))
_SPIKES = np.uint32((1 << TALLY_BITS) - 1)
_EVENT, _SHIFT = np.uint32(1 << TALLY_BITS), np.uint32(TALLY_BITS)


@kernel
def draw_counts(view, thread, pop, step):
    """One step of a poisson_generator that keeps counts. Neighbours that are awake are drawn in one go."""
    net = net_of(view)
    row = net.pops[pop]
    n = row[END] - row[BEGIN]
    place = row[COUNTS] + (step & (row[COUNTS_STEPS] - 1)) * n
    if step <= row[START] or step > row[STOP]:
        net.counts[place : place + n] = 0
        return
    base = step_word(net.keys[pop], step)
    begin, end = net.edges[row[NUMBER], thread], net.edges[row[NUMBER], thread + 1]
    run = begin
    for block in range(begin, end + 1):
        awake = block < end and net.awake[block] == 1
        if run < block and (not awake or block - run == GROUPED):
            lo, hi = run * BLOCK - row[BEGIN], min(block * BLOCK, row[END]) - row[BEGIN]
            draw_some(view, thread, row, base, lo, hi, net.counts[place + lo : place + hi])
            run = block
        if not awake:
            run = block + 1
            # what it kept while it was awake is not to be read again
            if block < end and step - net.busy[block] <= row[COUNTS_STEPS]:
                lo, hi = block * BLOCK - row[BEGIN], min((block + 1) * BLOCK, row[END]) - row[BEGIN]
                net.counts[place + lo : place + hi] = 0


@inner
def draw_some(view, thread, row, base, lo, hi, counts):
    """The numbers of the neurons lo:hi of a generator for one step; they are tallied, too."""
    net = net_of(view)
    begin, end = row[BEGIN] + lo, row[BEGIN] + hi
    if row[TABLE] >= 0:
        words = net.words[thread, : hi - lo]
        words_of(base, lo, words)
        poisson_by_table(words, net.guides[row[TABLE]], net.cumulative[row[TABLE]], counts)
    else:
        for k in range(counts.size):
            counts[k] = poisson_by_sum(base, lo + k, net.mean[begin + k], net.nothing[begin + k])
    tally = net.tally[begin:end]
    full = np.uint32(0)
    for k in range(tally.size):
        m = np.uint32(counts[k])
        tally[k] += m + (_EVENT if m > 0 else np.uint32(0))
        full |= tally[k]
    if full & _FULL:
        settle_tally(tally, net.events[begin:end], net.spikes[begin:end])


@inner
def settle_tally(tally, events, spikes):
    """Move tallies to the numbers that they stand for: few bytes a step are cheaper than many."""
    for k in range(tally.size):
        events[k] += np.int64(tally[k] >> _SHIFT)
        spikes[k] += np.int64(tally[k] & _SPIKES)
        tally[k] = 0


@kernel
def add_counts(view, thread, q, step, n_all, slots, blocks):
    """One-to-one input from a poisson_generator that keeps its counts."""
    net = net_of(view)
    row = net.projections[q]
    source, target = net.pops[row[SOURCE]], net.pops[row[TARGET]]
    n = source[END] - source[BEGIN]
    place = source[COUNTS] + ((step - row[LAG]) & (source[COUNTS_STEPS] - 1)) * n
    weight = net.weights[row[WEIGHT]]
    out = target[BEGIN] + (base_of(row) + receptor(weight, told_apart(row, target[RECEPTORS]))) * n_all
    for block in range(net.edges[target[NUMBER], thread], net.edges[target[NUMBER], thread + 1]):
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
            net.due[thread, (step & slots) * blocks + block] = 1
