"""Keyed random numbers, bit for bit those of `neuro.core.keyed_random`."""

# mypy: ignore-errors
import numpy as np

from neuro.core.keyed_random import NEURON_STRIDE, STEP_STRIDE
from neuro.kernels.jit import inner

_STEP = np.uint64(STEP_STRIDE)
_NEURON = np.uint64(NEURON_STRIDE)
_A, _B = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_S30, _S27, _S31, _S11 = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11)
GUIDE_BITS = 10
_GUIDE = np.uint64(64 - GUIDE_BITS)
_UNIT = 2.0**-53


@inner
def mix(z):
    """SplitMix64's finaliser."""
    z = (z ^ (z >> _S30)) * _A
    z = (z ^ (z >> _S27)) * _B
    return z ^ (z >> _S31)


@inner
def step_word(key, step):
    """What all draws of one part in one step have in common."""
    return mix(key + np.uint64(step) * _STEP)


@inner
def uniform(base, neuron):
    """A number in [0, 1) for one neuron."""
    return np.float64(mix(base + np.uint64(neuron) * _NEURON) >> _S11) * _UNIT


@inner
def words_of(base, first, words):
    """Fill `words` with the random words of neighbouring neurons."""
    begin = np.uint64(first)
    for k in range(np.uint64(words.size)):
        words[k] = mix(base + (begin + k) * _NEURON)


@inner
def poisson_by_table(word, guide, cumulative):
    """Count of entries of `cumulative` up to the uniform number of a word; `guide` tells where to begin."""
    u = np.float64(word >> _S11) * _UNIT
    m = np.int64(guide[word >> _GUIDE])
    while cumulative[m] <= u:
        m += 1
    return m


@inner
def poisson_by_sum(base, neuron, mean, nothing):
    """The same number, summing the probabilities; `nothing` is exp(-mean)."""
    u = uniform(base, neuron)
    m = 0
    term = nothing
    total = nothing
    while u >= total:
        m += 1
        term = term * (mean / m)
        if total + term == total and m > mean:
            break
        total += term
    return m
