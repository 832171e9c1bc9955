"""One step of a population whose step only adds its input to states, where few of its neurons have some.

All are stepped without input, so it is not read. Deliveries mark *spots*, eight neighbours each, and only what lies
there is added and cleared: the input of 4,000 neurons is as large as half of their states.
"""

# mypy: ignore-errors
import numpy as np

from neuro.kernels.jit import inner, kernel
from neuro.kernels.lanes import LANES, bits_of, lowest, marked, take
from neuro_event.neurons import IDLE, calm, emit, spike, wake
from neuro_event.operations import BARE
from neuro_event.tables import BLOCK, COLLECTS, END, GROUPED, NUMBER
from neuro_event.views import call_entry, net_of

SPOTS = BLOCK // LANES
"""Of a block."""

_ONE = np.uint64(1)


@inner
def collect(view, first_state, word):
    """Add what arrives at the marked spots of a group of blocks; their marks then tell who of the eight had some."""
    net = net_of(view)
    first = word * GROUPED * SPOTS
    one, other = net.state[first_state], net.state[first_state + 1]
    marks = marked(net.spots, first)
    while marks:
        spot = first + lowest(marks)
        marks &= marks - _ONE
        net.spots[spot] = take(one, net.x[0], spot * LANES) | take(other, net.x[1], spot * LANES)


@inner
def silent(view, pop, block):
    """Whether no neuron of a block can fire before its next input."""
    return calm(view, pop, block * BLOCK, min((block + 1) * BLOCK, net_of(view).pops[pop, END]))


@kernel
def step_collecting(view, thread, pop, step, at, done, h, slots, blocks):
    """One step of the population; return the next place in the log."""
    net = net_of(view)
    row = net.pops[pop]
    first, last = net.edges[row[NUMBER], thread], net.edges[row[NUMBER], thread + 1]
    slot = (step & slots) * blocks
    if first == last:
        return at
    total = 0
    for word in range(first // GROUPED, (last + GROUPED - 1) // GROUPED):
        due = net.due_groups[thread, slot // GROUPED + word] != 0
        if not due and net.awake_groups[word] == 0:
            continue
        begin, end = word * GROUPED, min((word + 1) * GROUPED, last)
        run = begin
        for block in range(begin, end + 1):
            if block < end and (net.awake[block] == 1 or net.due[thread, slot + block] == 1):
                if net.awake[block] == 0:
                    wake(view, thread, pop, block, step - 1, h)
                continue
            if run < block:
                call_entry(view, row, BARE, run * BLOCK, min(block * BLOCK, row[END]), thread, step, 0.0)
            run = block + 1
        if due:
            collect(view, row[COLLECTS], word)
            net.due_groups[thread, slot // GROUPED + word] = 0
        for block in range(begin, end):
            if net.awake[block] == 0:
                continue
            arrived, fired = net.spot_words[block], marked(net.fired, block * BLOCK)
            active = bits_of(arrived | fired)
            net.spot_words[block] = 0
            while fired:
                i = block * BLOCK + lowest(fired)
                fired &= fired - _ONE
                m = np.int64(net.fired[i])
                spike(view, pop, i)
                at = emit(view, thread, pop, i, m, step, done, h, at)
            total += active
            if active:
                net.busy[block] = step
            elif step % IDLE == 0 and step - net.busy[block] >= IDLE and silent(view, pop, block):
                net.awake[block] = 0
                net.slept[block] = step
    net.active[thread, pop] += total
    return at
