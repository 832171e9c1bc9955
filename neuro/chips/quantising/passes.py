"""Compiled passes over all weights of a projection, which make no arrays of their size."""

# mypy: ignore-errors
import numpy as np

from neuro.kernels.jit import kernel

RUN = 4096
"""Squares that are summed before they are added to a sum of all: a sum of many millions of them loses fewer bits."""


@kernel
def arriving(targets, weight, sign, total):
    """Add to each target the weights of a sign, in their order."""
    for e in range(targets.size):
        w = sign * weight[e]
        if w > 0.0:
            total[targets[e]] += w


@kernel
def judge(weights, above, below, low, high, grain, peak, mantissas, found):
    """Round weights to mantissas, and see what that did to them.

    Args:
        weights: one per synapse, or one of all.
        above: weight per mantissa of weights from 0, one or one per synapse.
        below: the same of negative ones.
        low: the smallest mantissa.
        high: the largest.
        grain: mantissas are multiples of it, or these ends; a tie goes to the even one.
        peak: the largest magnitude of a weight, more than 0.
        mantissas: is filled, or empty.
        found: is filled: weights beyond a mantissa, those other than 0, those of them that do not become 0, the largest
            relative error of one, and the squares of all errors and of all weights, relative to `peak`.
    """
    n = max(weights.size, above.size) if weights.size else 0
    own, each, keep = weights.size > 1, above.size > 1, mantissas.size > 0
    half = 0.5 + 1e-9
    beyond = nonzero = kept = 0
    worst = errors = squares = 0.0
    for first in range(0, n, RUN):
        error_run = square_run = 0.0
        for e in range(first, min(first + RUN, n)):
            w = weights[e if own else 0]
            k = e if each else 0
            step = below[k] if w < 0.0 else above[k]
            exact = w / step
            beyond += (exact > high + half) | (exact < low - half)
            m = min(max(np.rint(w / (step * grain)) * grain, low), high)
            if keep:
                mantissas[e] = m
            sent = m * step
            if w != 0.0:
                nonzero += 1
                if m != 0:
                    kept += 1
                    worst = max(worst, abs(sent / w - 1.0))
            error = (sent - w) / peak
            square = w / peak
            error_run += error * error
            square_run += square * square
        errors += error_run
        squares += square_run
    found[0], found[1], found[2] = beyond, nonzero, kept
    found[3], found[4], found[5] = worst, errors, squares
