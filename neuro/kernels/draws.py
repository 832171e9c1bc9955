"""Keyed random numbers, bit-identical to those of `neuro.core.keyed_random`."""

# mypy: ignore-errors
import numpy as np
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from neuro.core.keyed_random import NEURON_STRIDE, STEP_STRIDE
from neuro.kernels.instructions import LANES, load
from neuro.kernels.jit import subkernel
from neuro.kernels.numba_internals import ir

_STEP = np.uint64(STEP_STRIDE)
_NEURON = np.uint64(NEURON_STRIDE)
_A, _B = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_S30, _S27, _S31, _S11 = np.uint64(30), np.uint64(27), np.uint64(31), np.uint64(11)
GUIDE_BITS = 12
"""Number of first bits of a word by which a guide is indexed."""
_GUIDE = np.uint64(64 - GUIDE_BITS)
UNSURE = 1 << 15
"""Bit of a guide entry whose words have different counts. The lower bits are then the smallest of these counts."""
_UNIT = 2.0**-53
_ENDS = np.arange((1 << GUIDE_BITS) + 1) / (1 << GUIDE_BITS)
_CELLS = ((_ENDS[:-1], "right"), (_ENDS[1:], "left"))
"""Bounds of the numbers of each guide entry, with the side of `searchsorted`: the first (inclusive), the end."""


@subkernel
def mix(z):
    """Return a word that is mixed by SplitMix64's finaliser."""
    z = (z ^ (z >> _S30)) * _A
    z = (z ^ (z >> _S27)) * _B
    return z ^ (z >> _S31)


@subkernel
def step_word(key, step):
    """Return the random word from which all draws of a part of the network in a step follow."""
    return mix(key + np.uint64(step) * _STEP)


@subkernel
def uniform(base, neuron):
    """Return a number in [0, 1) for one neuron. `base` is the result of `step_word`."""
    return np.float64(mix(base + np.uint64(neuron) * _NEURON) >> _S11) * _UNIT


@intrinsic
def reaching(typingctx, base, neuron, bounds, place):
    """Return eight bits, 1 where the number of a neuron, from `neuron` on, reaches its bound, from `place` on."""

    def codegen(context, builder, signature, arguments):
        word, real = ir.VectorType(ir.IntType(64), LANES), ir.VectorType(ir.DoubleType(), LANES)

        def same(value):
            one = builder.insert_element(ir.Constant(word, ir.Undefined), value, ir.IntType(32)(0))
            return builder.shuffle_vector(one, one, ir.Constant(ir.VectorType(ir.IntType(32), LANES), [0] * LANES))

        def number(value):
            return ir.Constant(word, [int(value)] * LANES)

        strides = [k * NEURON_STRIDE % 2**64 for k in range(LANES)]
        first = builder.add(arguments[0], builder.mul(arguments[1], ir.IntType(64)(NEURON_STRIDE)))
        z = builder.add(same(first), ir.Constant(word, strides))
        for shift, factor in ((_S30, _A), (_S27, _B)):
            z = builder.mul(builder.xor(z, builder.lshr(z, number(shift))), number(factor))
        z = builder.lshr(builder.xor(z, builder.lshr(z, number(_S31))), number(_S11))
        u = builder.fmul(builder.uitofp(z, real), ir.Constant(real, [_UNIT] * LANES))
        bits = builder.fcmp_ordered(">=", u, load(context, builder, signature.args[2], arguments[2], arguments[3]))
        return builder.zext(builder.bitcast(bits, ir.IntType(LANES)), ir.IntType(64))

    return types.uint64(types.uint64, types.int64, bounds, types.intp), codegen


@subkernel
def words_of(base, first, words):
    """Fill `words` with the random words of neighbouring neurons, from neuron `first` on."""
    z = base + np.uint64(first) * _NEURON
    for k in range(words.size):
        words[k] = mix(z)
        z += _NEURON


@subkernel
def poisson_by_table(words, guide, cumulative, counts):
    """Count the entries of `cumulative` up to the uniform number of each word.

    `guide` is the result of `guide_to`. The first bits of a word nearly always decide the count.
    """
    for k in range(words.size):
        counts[k] = words[k] >> _GUIDE  # a separate loop can be vectorised
    for k in range(words.size):
        m = guide[counts[k]]
        if m >= UNSURE:
            m = np.uint16(_count(words[k], np.int64(m) - UNSURE, cumulative))
        counts[k] = m


@subkernel
def _count(word, m, cumulative):
    """Return the number of entries up to the uniform number of a word, which is at least m."""
    u = np.float64(word >> _S11) * _UNIT
    while cumulative[m] <= u:
        m += 1
    return m


def guide_to(cumulative: NDArray[np.float64]) -> NDArray[np.uint16]:
    """Return the guide of `poisson_by_table`, (2 ** GUIDE_BITS,).

    Entry b is the count of all words whose first bits are b, or the smallest count plus `UNSURE` if counts differ.
    """
    lowest_count, highest_count = (np.searchsorted(cumulative, ends, side=side) for ends, side in _CELLS)
    return (lowest_count + UNSURE * (lowest_count < highest_count)).astype(np.uint16)


@subkernel
def poisson_by_sum(base, neuron, mean, none_probability):
    """Draw the same number as `poisson_by_table`, by a sum of probabilities. `none_probability` is exp(-mean)."""
    u = uniform(base, neuron)
    m = 0
    term = none_probability
    total = none_probability
    while u >= total:
        m += 1
        term = term * (mean / m)
        if total + term == total and m > mean:
            break
        total += term
    return m
