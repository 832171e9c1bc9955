# mypy: ignore-errors
"""A random change of each time, and the order thereafter."""

import numpy as np

from neuro.kernels.draws import step_word
from neuro.kernels.jit import kernel

DIGIT = 11
"""Bits sorted by in one pass: the counts of 2^11 values stay in the innermost cache."""


@kernel
def shake(t, key, first, amount, out):
    """Event k of the part is number first + k of the recording; key: uint64; out: int64[n], us."""
    choices = np.uint64(2 * amount + 1)
    for k in range(t.shape[0]):
        out[k] = t[k] + np.int64(step_word(key, first + k) % choices) - amount


@kernel
def by_digit(t, lowest, shift, order, counts, out):
    """One pass of a stable radix sort: put order, int64[n] indices into t, by some bits of t - lowest into out."""
    mask = counts.shape[0] - 1
    counts[:] = 0
    for k in order:
        counts[((t[k] - lowest) >> shift) & mask] += 1
    begin = 0
    for digit in range(counts.shape[0]):
        begin, counts[digit] = begin + counts[digit], begin
    for k in order:
        digit = ((t[k] - lowest) >> shift) & mask
        out[counts[digit]] = k
        counts[digit] += 1
