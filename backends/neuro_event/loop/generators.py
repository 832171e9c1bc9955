"""Kernels that run one step of a generator of spikes or currents."""

# mypy: ignore-errors

import numpy as np

from neuro.kernels.draws import poisson_by_sum, poisson_by_table, reaching, step_word, words_of
from neuro.kernels.instructions import LANES, address, lowest, marked, prefetch
from neuro.kernels.jit import kernel, subkernel
from neuro_event.loop import tables as t
from neuro_event.loop.deliver import first_receptor, receptor, receptors_by_sign
from neuro_event.loop.neurons import emit
from neuro_event.loop.operations import STEP
from neuro_event.loop.tables import call_entry, draw_counts as call_draw_counts, net_of

_ONE = np.uint64(1)
_AHEAD = 16
"""Number of listed spikes between a prefetch of counts and their use. The counts of a camera do not fit a cache."""


@subkernel
def draw_poisson(view, thread, pop, step, log_at, processed_step, h):
    """Run one step of a poisson_generator, which writes counts or log entries. Return the next place in the log."""
    net = net_of(view)
    row = net.pops[pop]
    # Generators with only one-to-one projections keep counts. A draw then takes 0.7 ns, while a spike in the log takes
    # about 10 ns with its delivery.
    if row[t.COUNTS] >= 0:
        call_draw_counts(view, thread, pop, step)
        return log_at
    if step <= row[t.START] or step > row[t.STOP]:
        return log_at
    # A draw is a hash of key, step and neuron. There is no state, so threads and sleeping blocks change no draw.
    base = step_word(net.keys[pop], step)
    for block in range(net.edges[row[t.NUMBER], thread], net.edges[row[t.NUMBER], thread + 1]):
        if net.awake[block] == 0:
            continue
        if net.stop[0] == t.AT_ONCE:
            break
        lo, hi = block * t.BLOCK, min((block + 1) * t.BLOCK, row[t.END])
        first = lo - row[t.BEGIN]
        fired = np.uint64(0)
        for k in range(0, hi - lo, LANES):  # places without a neuron have the bound 1, which no number reaches
            fired |= reaching(base, first + k, net.nothing, lo + k) << np.uint64(k)
        while fired:
            i = lo + lowest(fired)
            fired &= fired - _ONE
            # `reaching` only finds the neurons with at least one spike. The counts are then computed from the same
            # word, neuron by neuron.
            m = poisson_by_sum(base, i - row[t.BEGIN], net.mean[i], net.nothing[i])
            log_at = emit(view, thread, pop, i, m, step, processed_step, h, log_at)
    return log_at


@subkernel
def step_generator(view, thread, pop, step, log_at, processed_step, h):
    """Run one step of a third-party generator. Return the next place in the log."""
    net = net_of(view)
    row = net.pops[pop]
    if step <= row[t.START] or step > row[t.STOP]:
        return log_at
    for block in range(net.edges[row[t.NUMBER], thread], net.edges[row[t.NUMBER], thread + 1]):
        if net.stop[0] == t.AT_ONCE:
            break
        lo, hi = block * t.BLOCK, min((block + 1) * t.BLOCK, row[t.END])
        call_entry(view, row, STEP, lo, hi, thread, step, h)
        fired = marked(net.fired, lo)
        while fired:
            i = lo + lowest(fired)
            fired &= fired - _ONE
            log_at = emit(view, thread, pop, i, np.int64(net.x[0, i]), step, processed_step, h, log_at)
    return log_at


@subkernel
def list_spikes(view, thread, pop, step, log_at, processed_step, h):
    """Emit the spikes that a spike_generator lists for this step. Return the next place in the log."""
    net = net_of(view)
    lo, hi = net.edges[pop, thread] * t.BLOCK, net.edges[pop, thread + 1] * t.BLOCK
    place = net.cursor[thread, pop]
    end = net.cursor[net.cursor.shape[0] - 1, pop]
    # Each thread reads the whole list and emits the spikes of its neurons. To deliver the spikes takes far longer.
    while place < end and net.list_steps[place] <= step:
        if place + _AHEAD < end:
            coming = 8 * np.int64(net.list_ids[place + _AHEAD])
            prefetch(address(net.events) + coming)
            prefetch(address(net.spikes) + coming)
        i = np.int64(net.list_ids[place])
        if net.list_steps[place] == step and lo <= i < hi:
            log_at = emit(view, thread, pop, i, np.int64(net.list_counts[place]), step, processed_step, h, log_at)
        place += 1
    net.cursor[thread, pop] = place
    return log_at


@kernel
def wake_emitting(mean, awake, busy, first, last, step):
    """Wake those blocks among first:last that have a rate above 0, and put the others to sleep.

    If a block was awake, `busy` of the block becomes `step`, the last step with the old rate.
    """
    for block in range(first, last):
        if awake[block] == 1:
            busy[block] = step
        has_rate = False
        for i in range(block * t.BLOCK, (block + 1) * t.BLOCK):
            has_rate |= mean[i] != 0.0
        awake[block] = has_rate


_FULL = np.uint32(1 << 31 | 1 << (t.TALLY_BITS - 1))
_SPIKES = np.uint32((1 << t.TALLY_BITS) - 1)
_EVENT, _SHIFT = np.uint32(1 << t.TALLY_BITS), np.uint32(t.TALLY_BITS)


@kernel
def draw_counts(view, thread, pop, step):
    """Run one step of a poisson_generator that keeps counts. Neighbouring awake blocks are drawn together."""
    net = net_of(view)
    row = net.pops[pop]
    n = row[t.END] - row[t.BEGIN]
    place = row[t.COUNTS] + (step & (row[t.COUNTS_STEPS] - 1)) * n
    if step <= row[t.START] or step > row[t.STOP]:
        net.counts[place : place + n] = 0
        return
    base = step_word(net.keys[pop], step)
    begin, end = net.edges[row[t.NUMBER], thread], net.edges[row[t.NUMBER], thread + 1]
    # Up to 512 neighbours are drawn together, so that vector instructions compute the random words.
    run = begin
    for block in range(begin, end + 1):
        if net.stop[0] == t.AT_ONCE:
            return
        awake = block < end and net.awake[block] == 1
        if run < block and (not awake or block - run == t.GROUPED):
            lo, hi = run * t.BLOCK - row[t.BEGIN], min(block * t.BLOCK, row[t.END]) - row[t.BEGIN]
            draw_some(view, thread, row, base, lo, hi, net.counts[place + lo : place + hi])
            run = block
        if not awake:
            run = block + 1
            # The ring may still have counts from the time when the block was awake.
            if block < end and step - net.busy[block] <= row[t.COUNTS_STEPS]:
                lo, hi = block * t.BLOCK - row[t.BEGIN], min((block + 1) * t.BLOCK, row[t.END]) - row[t.BEGIN]
                net.counts[place + lo : place + hi] = 0


@subkernel
def draw_some(view, thread, row, base, lo, hi, counts):
    """Draw the counts of the neurons lo:hi of a generator in a step, and update the tallies."""
    net = net_of(view)
    begin, end = row[t.BEGIN] + lo, row[t.BEGIN] + hi
    if row[t.TABLE] >= 0:
        words = net.words[thread, : hi - lo]
        words_of(base, lo, words)
        # If all rates are equal, all neurons share one table. Words with the same first 12 bits form a cell. A guide
        # has the least count of each cell, and whether all words of the cell give this count. If not, 53 bits decide.
        poisson_by_table(words, net.guides[row[t.TABLE]], net.cumulative[row[t.TABLE]], counts)
    else:
        for k in range(counts.size):
            counts[k] = poisson_by_sum(base, lo + k, net.mean[begin + k], net.nothing[begin + k])
    tally = net.tally[begin:end]
    full = np.uint32(0)
    for k in range(tally.size):
        m = np.uint32(counts[k])
        tally[k] += m + (_EVENT if m > 0 else np.uint32(0))
        full |= tally[k]
    # A tally takes 4 bytes per neuron, while two counts take 16. A single test finds whether any tally is nearly full.
    if full & _FULL:
        settle_tally(tally, net.events[begin:end], net.spikes[begin:end])


@subkernel
def settle_tally(tally, events, spikes):
    """Add tallies to the counts of events and spikes, and reset the tallies."""
    for k in range(tally.size):
        events[k] += np.int64(tally[k] >> _SHIFT)
        spikes[k] += np.int64(tally[k] & _SPIKES)
        tally[k] = 0


@kernel
def add_counts(view, thread, q, step, n_all, slots, blocks):
    """Add the counts of a poisson_generator to the input of its targets."""
    net = net_of(view)
    row = net.projections[q]
    source, target = net.pops[row[t.SOURCE]], net.pops[row[t.TARGET]]
    n = source[t.END] - source[t.BEGIN]
    place = source[t.COUNTS] + ((step - row[t.LAG]) & (source[t.COUNTS_STEPS] - 1)) * n
    weight = net.weights[row[t.WEIGHT]]
    out = (
        target[t.BEGIN] + (first_receptor(row) + receptor(weight, receptors_by_sign(row, target[t.RECEPTORS]))) * n_all
    )
    for block in range(net.edges[target[t.NUMBER], thread], net.edges[target[t.NUMBER], thread + 1]):
        from_block = source[t.FIRST_BLOCK] + block - target[t.FIRST_BLOCK]
        # Spikes that were emitted before the block fell asleep may still be under way.
        if net.awake[from_block] == 0 and step - row[t.LAG] > net.busy[from_block]:
            continue
        lo = (block - target[t.FIRST_BLOCK]) * t.BLOCK
        hi = min(lo + t.BLOCK, n)
        counts = net.counts[place + lo : place + hi]
        inputs = net.buf[out + lo : out + hi]
        has_spikes = np.uint16(0)
        for i in range(counts.shape[0]):
            # The loop has no branch on counts, so that it is vectorised.
            has_spikes |= counts[i]
            old = inputs[i]
            inputs[i] = old + weight * counts[i] if counts[i] > 0 else old
        if has_spikes:
            net.due[thread, (step & slots) * blocks + block] = 1


@kernel
def drive(view, thread, step):
    """Compute the external current of the populations whose current changes at every step, before their step.

    The blocks of these populations never sleep.
    """
    net = net_of(view)
    for k in range(net.lines.shape[0]):
        line = net.lines[k]
        row = net.pops[line[t.DRIVEN]]
        for block in range(net.edges[row[t.NUMBER], thread], net.edges[row[t.NUMBER], thread + 1]):
            if net.stop[0] == t.AT_ONCE:
                return
            # A current that changes at each step keeps its neurons awake.
            net.busy[block] = step
            if line[t.CHARGED] < 0:
                lo, hi = block * t.BLOCK, min((block + 1) * t.BLOCK, row[t.END])
                if line[t.BEGINS] == 1:
                    net.current[lo:hi] = 0.0
                add_line(view, k, row, lo, hi, step, net.current)


@kernel
def charge(view, thread, step):
    """Add currents into receptors, times their share, to the states of the receptors, after the step of the neurons."""
    net = net_of(view)
    for k in range(net.lines.shape[0]):
        line = net.lines[k]
        if line[t.CHARGED] >= 0:
            row = net.pops[line[t.DRIVEN]]
            lo = net.edges[row[t.NUMBER], thread] * t.BLOCK
            hi = min(row[t.END], net.edges[row[t.NUMBER], thread + 1] * t.BLOCK)
            add_line(view, k, row, lo, hi, step, net.state[line[t.CHARGED]])


@subkernel
def add_line(view, number, row, lo, hi, step, out):
    """Add the currents that arrive along a line in a step to `out`.

    If the line leads to a receptor, the currents are multiplied by their share.
    """
    net = net_of(view)
    line, rows = net.lines[number], net.emitted_rows[number]
    begin, weight, stride = row[t.BEGIN], line[t.LINE_WEIGHT], line[t.LINE_STRIDE]
    # Currents are computed in NumPy for a stretch of steps. A current that is emitted at the end of a step acts in the
    # next step.
    at = step - 1 - net.emitted_from[0]
    if line[t.HOW] == t.AS_LISTED:
        for i in range(lo, hi):
            total = 0.0
            place = line[t.LINE_ENDS] + i - begin
            for k in range(net.line_ends[place], net.line_ends[place + 1]):
                value = line[t.FIRST_VALUE] + rows[at - net.line_lates[k]] * line[t.VALUES] + net.line_columns[k]
                total += net.emitted[value] * net.line_weights[weight + k * stride]
            out[i] += total if line[t.CHARGED] < 0 else net.shares[line[t.SHARE] + i - begin] * total
        return
    first = line[t.FIRST_VALUE] + rows[at - line[t.LATE]] * line[t.VALUES] + line[t.COLUMN_AT]
    each = np.int64(line[t.HOW] != t.TO_ALL)
    if line[t.CHARGED] >= 0:
        for i in range(lo, hi):
            arrived = net.emitted[first + (i - begin) * each] * net.line_weights[weight + (i - begin) * stride]
            out[i] += net.shares[line[t.SHARE] + i - begin] * arrived
    # A single value for all neurons is multiplied by the weight once.
    elif each == 0 and stride == 0:
        arrived = net.emitted[first] * net.line_weights[weight]
        for i in range(lo, hi):
            out[i] += arrived
    elif each == 1 and stride == 0:
        # Contiguous views, so that the loop is vectorised.
        emitted, factor = net.emitted[first + lo - begin : first + hi - begin], net.line_weights[weight]
        for i in range(lo, hi):
            out[i] += emitted[i - lo] * factor
    else:
        for i in range(lo, hi):
            out[i] += net.emitted[first + (i - begin) * each] * net.line_weights[weight + (i - begin) * stride]
