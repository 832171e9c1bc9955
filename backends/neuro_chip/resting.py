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
    lo, hi = row[BEGIN], row[END]
    copy(net.still[0, lo:hi], net.v[lo:hi])
    copy(net.still[1, lo:hi], net.u[lo:hi])
    copy(net.still[2, lo:hi], net.g_inh[lo:hi])
    copy(net.still[3, lo:hi], net.hold[lo:hi])
    return counted(net, pop)


@inner
def stayed(net, pop, row, before):
    """Whether a step has changed neither the states that were kept nor what was counted."""
    lo, hi = row[BEGIN], row[END]
    return (
        equal(net.still[0, lo:hi], net.v[lo:hi])
        and equal(net.still[1, lo:hi], net.u[lo:hi])
        and equal(net.still[2, lo:hi], net.g_inh[lo:hi])
        and equal(net.still[3, lo:hi], net.hold[lo:hi])
        and counted(net, pop) == before
    )


@inner
def copy(into, values):
    """Copy an array."""
    for k in range(into.size):
        into[k] = values[k]


@inner
def equal(one, other):
    """Whether two arrays are."""
    changed = np.int32(0)
    for k in range(one.size):
        changed |= np.int32(one[k] ^ other[k])
    return changed == 0


@inner
def counted(net, pop):
    """Overflows and what else is counted of a population."""
    total = 0
    for column in range(net.native.shape[1]):
        total += net.native[pop, column]
    return total
