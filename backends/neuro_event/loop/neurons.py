"""Kernels that run a step of a population of neurons: wake blocks, add the input of rings, step neurons, let them fire.

A quiet block sleeps: the block makes no step until input arrives.
"""

# mypy: ignore-errors
import numpy as np

from neuro.kernels.instructions import LANES, bits_of, lowest, marked, take
from neuro.kernels.jit import kernel, subkernel
from neuro_event.loop import tables as t
from neuro_event.loop.operations import BARE, CATCH_UP, FIRE, QUIET, STEP
from neuro_event.loop.tables import call_entry, net_of, post_spike

IDLE = 16
"""Number of steps without input after which a block may sleep. It is also the interval of the test in steps."""

_SIGN = np.int64(-(2**63))
_ONE = np.uint64(1)
_MOST = 2.0**63


@subkernel
def emit(view, thread, pop, i, m, step, processed_step, h, log_at):
    """Write a spike of neuron i to the log, counts, record and history. Return the next place in the log."""
    net = net_of(view)
    row = net.pops[pop]
    place = log_at & (net.log_ids.shape[1] - 1)
    net.log_ids[thread, place] = i
    net.log_counts[thread, place] = m
    # There is no test for a full log here, because `room` made sure before the step that all spikes of the step fit.
    net.events[i] += 1
    net.spikes[i] += m
    if row[t.RECORD] == 1:
        r = net.rec_at[thread, 0]
        net.rec_steps[thread, r] = step
        net.rec_ids[thread, r] = i
        net.rec_counts[thread, r] = m
        net.rec_at[thread, 0] = r + 1
    if row[t.HISTORY] >= 0:
        post_spike(view, pop, thread, i - row[t.BEGIN], m, step, processed_step, h)
    return log_at + 1


@subkernel
def wake(view, thread, pop, block, last, h):
    """Update a sleeping block to the end of step `last`."""
    net = net_of(view)
    row = net.pops[pop]
    # Every 16 steps, `quiet` of the model tests whether any neuron of a block without input can reach threshold without
    # input. It computes a bound and makes no steps. If no neuron can, the block sleeps until input is due or a value
    # is set. These moments only depend on steps and events, so a run in several parts gives the same result.
    n = last - net.slept[block]
    # Linear models make n steps at once. The states of other models did not change while they slept.
    if n > 0 and row[t.LINEAR] == 1:
        lo, hi = block * t.BLOCK, min((block + 1) * t.BLOCK, row[t.END])
        call_entry(view, row, CATCH_UP, lo, hi, thread, n, h)
    net.awake[block] = 1
    net.busy[block] = last


@subkernel
def is_block_quiet(view, pop, block):
    """Return whether no neuron of a block can fire before its next input."""
    row = net_of(view).pops[pop]
    lo, hi = block * t.BLOCK, min((block + 1) * t.BLOCK, row[t.END])
    # An entry returns integers for all operations.
    return call_entry(view, row, QUIET, lo, hi, 0, 0, 0.0) == 1


@subkernel
def spike(view, pop, i):
    """Apply the effect of a spike on the neuron, such as the reset."""
    row = net_of(view).pops[pop]
    call_entry(view, row, FIRE, i, i + 1, 0, 0, 0.0)


@subkernel
def add_ring(view, q, block_lo, block_hi, step, n_all):
    """Add the ring values of this step to the input of some neurons, and clear them."""
    net = net_of(view)
    row = net.projections[q]
    target = net.pops[row[t.TARGET]]
    begin = target[t.BEGIN]
    receptors = target[t.RECEPTORS]
    for r in range(receptors):
        ring = row[t.RING] + ((step & row[t.RING_MASK]) * receptors + r) * row[t.RING_SIZE] - begin
        out = r * n_all
        for i in range(block_lo, block_hi):
            net.buf[out + i] = net.buf[out + i] + net.buf[ring + i]
            # The place is cleared while it is in the cache. The slot is used again after the longest delay.
            net.buf[ring + i] = -0.0


@subkernel
def has_input(view, i, receptors):
    """Return whether a neuron has input in this step."""
    net = net_of(view)
    received = False
    for r in range(receptors):
        # A weight of 0 counts as input, but -0.0 does not. As floats 0.0 == -0.0, so they are compared as integers.
        received |= net.bits[r, i] != _SIGN
    return received


@subkernel
def take_arrivals(view, lo, receptors):
    """Return the number of neurons of a block with input in this step, and clear the input.

    Places of the block without a neuron receive no input.
    """
    net = net_of(view)
    first, bits = np.uint64(lo), net.bits
    count = 0
    # -0.0, which means no input, has only the sign bit. Two receptors are compared as integers without a branch.
    if receptors == 2:
        for k in range(first, first + np.uint64(t.BLOCK)):
            count += ((bits[0, k] ^ _SIGN) | (bits[1, k] ^ _SIGN)) != 0
            bits[0, k] = _SIGN
            bits[1, k] = _SIGN
    elif receptors == 1:
        for k in range(first, first + np.uint64(t.BLOCK)):
            count += bits[0, k] != _SIGN
            bits[0, k] = _SIGN
    else:
        for i in range(lo, lo + t.BLOCK):
            count += has_input(view, i, receptors)
        for r in range(receptors):
            bits[r, lo : lo + t.BLOCK] = _SIGN
    return count


@subkernel
def arrived(view, thread, pop, i):
    """Return the number of spikes that arrive at a relay. If 64 bits cannot count them, the engine raises an error."""
    net = net_of(view)
    number = net.x[0, i]
    if number + np.float64(net.spikes[i]) < _MOST:
        return np.int64(number)
    net.clock[thread, t.UNCOUNTED] = pop + 1
    return np.int64(1)


@subkernel
def step_word_of_blocks(view, thread, pop, begin, end, slot, step, h, n_all):
    """Wake the due blocks among begin:end, add their ring input, and step all awake blocks.

    Neighbouring awake blocks are stepped in one call.
    """
    net = net_of(view)
    row = net.pops[pop]
    run = begin
    for block in range(begin, end + 1):
        if block < end and (net.awake[block] == 1 or net.due[thread, slot + block] == 1):
            lo, hi = block * t.BLOCK, min((block + 1) * t.BLOCK, row[t.END])
            if net.awake[block] == 0:
                # The block is updated to the end of the last step. It makes this step together with the other blocks.
                wake(view, thread, pop, block, step - 1, h)
            if net.due[thread, slot + block] == 1:
                # Rings are only read for due blocks, because the ring of a large network does not fit the caches.
                for k in range(row[t.RINGS], row[t.RINGS_END]):
                    add_ring(view, net.incoming[k], lo, hi, step, n_all)
            continue
        # Neighbouring blocks are stepped in one call: a call costs 2 ns, a neuron less than 1 ns.
        if run < block:
            call_entry(view, row, STEP, run * t.BLOCK, min(block * t.BLOCK, row[t.END]), 0, step, 0.0)
        run = block + 1


@subkernel
def step_neurons(view, thread, pop, step, log_at, processed_step, h, n_all, slots, blocks):
    """Run one step of a population. Return the number of candidates of its group and the next place in the log."""
    net = net_of(view)
    row = net.pops[pop]
    first = net.edges[row[t.NUMBER], thread]
    last = net.edges[row[t.NUMBER], thread + 1]
    slot = (step & slots) * blocks
    receptors = row[t.RECEPTORS]
    n_candidates = 0
    if first == last:  # this thread has no neuron of the population
        return n_candidates, log_at
    for word in range(first // t.GROUPED, (last + t.GROUPED - 1) // t.GROUPED):
        # A 64-bit word covers eight blocks, so 512 silent neurons are skipped at a time.
        if net.awake_groups[word] == 0 and net.due_groups[thread, slot // t.GROUPED + word] == 0:
            continue
        if net.stop[0] == t.AT_ONCE:
            break
        # A population begins at a multiple of 8 blocks, so a word never covers two populations.
        begin, end = word * t.GROUPED, min((word + 1) * t.GROUPED, last)
        step_word_of_blocks(view, thread, pop, begin, end, slot, step, h, n_all)
        for block in range(begin, end):
            if net.awake[block] == 0:
                continue
            # The mark is cleared here, because later deliveries mark this slot for another step.
            due = net.due[thread, slot + block]
            net.due[thread, slot + block] = 0
            lo, active = block * t.BLOCK, 0
            fired = marked(net.fired, lo)
            if fired:
                # Spikes are rare, so the bits of the word are visited in turn, in the order of ids.
                while fired:
                    i = lo + lowest(fired)
                    fired &= fired - _ONE
                    received = has_input(view, i, receptors)
                    if row[t.GROUP] < 0:
                        m = arrived(view, thread, pop, i) if row[t.RELAY] == 1 else np.int64(net.fired[i])
                        if row[t.PAYLOAD] >= 0:
                            m = np.int64(net.state[row[t.PAYLOAD], i])
                        spike(view, pop, i)
                        log_at = emit(view, thread, pop, i, m, step, processed_step, h, log_at)
                        active += not received
                    elif net.muted[i] == 0 and net.closed[row[t.GROUP]] == 0:
                        # Neurons of a group do not fire yet: `settle` compares all candidates after this loop.
                        net.candidates[thread, n_candidates] = i
                        net.candidate_arrived[thread, n_candidates] = received
                        n_candidates += 1
                net.busy[block] = step
            if due:
                active += take_arrivals(view, lo, receptors)
            net.active[thread, pop] += active
            if row[t.RELAY] == 1:  # a relay has no state, so it is awake only when spikes arrive
                net.awake[block] = 0
                net.slept[block] = step
            elif active:
                net.busy[block] = step
            # The test is at multiples of IDLE, not IDLE steps after the last event. So a run in several parts gives the
            # same result.
            elif step % IDLE == 0 and step - net.busy[block] >= IDLE and is_block_quiet(view, pop, block):
                net.awake[block] = 0
                net.slept[block] = step
    return n_candidates, log_at


SPOTS = t.BLOCK // LANES
"""Number of groups of eight neurons in a block."""


@subkernel
def collect(view, first_state, word):
    """Add the input of both receptors to two adjacent states, at the spots (eight neurons) that deliveries marked.

    Each mark is replaced by a mask of the neurons that had input.
    """
    net = net_of(view)
    first = word * t.GROUPED * SPOTS
    first_row, second_row = net.state[first_state], net.state[first_state + 1]
    # The input of 4,000 neurons takes half as much memory as the states, and is mostly empty. So only the input
    # at marked spots is added, counted and cleared, and no other input is read.
    marks = marked(net.spots, first)
    while marks:
        spot = first + lowest(marks)
        marks &= marks - _ONE
        # `step_collecting` counts the bits of this mask.
        net.spots[spot] = take(first_row, net.x[0], spot * LANES) | take(second_row, net.x[1], spot * LANES)


@kernel
def step_collecting(view, thread, pop, step, log_at, processed_step, h, slots, blocks):
    """Run one step of a population whose input is added after the step. Return the next place in the log."""
    net = net_of(view)
    row = net.pops[pop]
    first, last = net.edges[row[t.NUMBER], thread], net.edges[row[t.NUMBER], thread + 1]
    slot = (step & slots) * blocks
    if first == last:
        return log_at
    total = 0
    for word in range(first // t.GROUPED, (last + t.GROUPED - 1) // t.GROUPED):
        # `due` means that deliveries have marked spots of these blocks.
        due = net.due_groups[thread, slot // t.GROUPED + word] != 0
        if not due and net.awake_groups[word] == 0:
            continue
        if net.stop[0] == t.AT_ONCE:
            break
        begin, end = word * t.GROUPED, min((word + 1) * t.GROUPED, last)
        run = begin
        for block in range(begin, end + 1):
            if block < end and (net.awake[block] == 1 or net.due[thread, slot + block] == 1):
                if net.awake[block] == 0:
                    wake(view, thread, pop, block, step - 1, h)
                continue
            if run < block:
                # Input is collected after the step, because models with COLLECTS add input at the end of a step.
                call_entry(view, row, BARE, run * t.BLOCK, min(block * t.BLOCK, row[t.END]), thread, step, 0.0)
            run = block + 1
        if due:
            collect(view, row[t.COLLECTS], word)
            net.due_groups[thread, slot // t.GROUPED + word] = 0
        for block in range(begin, end):
            if net.awake[block] == 0:
                continue
            arrived, fired = net.spot_words[block], marked(net.fired, block * t.BLOCK)
            active = bits_of(arrived | fired)
            net.spot_words[block] = 0
            while fired:
                i = block * t.BLOCK + lowest(fired)
                fired &= fired - _ONE
                m = np.int64(net.fired[i])
                spike(view, pop, i)
                log_at = emit(view, thread, pop, i, m, step, processed_step, h, log_at)
            total += active
            if active:
                net.busy[block] = step
            elif step % IDLE == 0 and step - net.busy[block] >= IDLE and is_block_quiet(view, pop, block):
                net.awake[block] = 0
                net.slept[block] = step
    net.active[thread, pop] += total
    return log_at
