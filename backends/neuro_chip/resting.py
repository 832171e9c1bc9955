"""Populations that rest: a step without input that changes nothing is followed by others until input comes.

So does whoever has decayed to where integers round to themselves, a bias or not, and whoever does not decay. What is
skipped would change neither states nor counts, so the bits are those of neurons that are updated in every step.
"""

# mypy: ignore-errors
import numpy as np

from neuro.kernels.jit import inner
from neuro_chip.tables import BEGIN, END


@inner
def keep_states(net, pop, row):
    """Keep the states of a population for `stayed`; return what has been counted of it."""
    for i in range(row[BEGIN], row[END]):
        net.still[0, i] = net.v[i]
        net.still[1, i] = net.u[i]
        net.still[2, i] = net.g_inh[i]
        net.still[3, i] = net.hold[i]
    return counted(net, pop)


@inner
def stayed(net, pop, row, before):
    """Whether a step has changed neither the states that were kept nor what was counted."""
    changed = np.int32(0)
    for i in range(row[BEGIN], row[END]):
        changed |= net.still[0, i] ^ net.v[i]
        changed |= net.still[1, i] ^ net.u[i]
        changed |= net.still[2, i] ^ net.g_inh[i]
        changed |= net.still[3, i] ^ net.hold[i]
    return changed == 0 and counted(net, pop) == before


@inner
def counted(net, pop):
    """Overflows and what else is counted of a population."""
    total = 0
    for column in range(net.native.shape[1]):
        total += net.native[pop, column]
    return total
