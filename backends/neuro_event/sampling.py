"""States of some neurons, read between two steps without leaving a trace."""

# mypy: ignore-errors
import numpy as np

from neuro.kernels.jit import kernel
from neuro_event.neurons import wake
from neuro_event.tables import BLOCK
from neuro_event.views import net_of


@kernel
def sample(view, pop, state, places, step, h, aside, out):
    """Fill `out` with a state of some neurons of a population as of `step`; a block that sleeps is put back to sleep.

    `aside` is room for the states of a block and for who fired, shape (states + 1, BLOCK).
    """
    net = net_of(view)
    k = 0
    while k < places.shape[0]:
        block = places[k] // BLOCK
        if net.awake[block] == 1:
            out[k] = net.state[state, places[k]]
            k += 1
            continue
        lo, hi, busy = block * BLOCK, min((block + 1) * BLOCK, net.state.shape[1]), net.busy[block]
        states = net.state.shape[0]
        for i in range(lo, hi):
            for r in range(states):
                aside[r, i - lo] = net.state[r, i]
            aside[states, i - lo] = net.fired[i]
        wake(view, 0, pop, block, step, h)
        while k < places.shape[0] and places[k] // BLOCK == block:
            out[k] = net.state[state, places[k]]
            k += 1
        for i in range(lo, hi):
            for r in range(states):
                net.state[r, i] = aside[r, i - lo]
            net.fired[i] = np.uint8(aside[states, i - lo])
        net.awake[block], net.busy[block] = np.uint8(0), busy
