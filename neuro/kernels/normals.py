"""Normal numbers, bit-identical to NumPy's `Generator(PCG64).normal`, but several times as fast.

Random words: O'Neill, PCG, HMC-CS-2014-0905, 2014 (PCG XSL RR 128/64). Four neighbouring words are generated at a
time, independently of each other. Normal numbers: Marsaglia & Tsang, J. Stat. Softw. 5(8), 2000, with NumPy's tables.
"""

# mypy: disable-error-code="no-untyped-def,no-untyped-call,call-arg,misc,unreachable"
from __future__ import annotations

import numpy as np
from numba import types
from numba.extending import intrinsic
from numpy.typing import NDArray

from neuro.kernels.jit import kernel, subkernel
from neuro.kernels.numba_internals import ir, normal_tables

PIECE = 1 << 16
"""Largest number of values that are drawn at a time, before values outside the bounds are drawn again."""

TRIES = 1000
"""Largest number of times that values outside the bounds are drawn again."""

_LANES = 4
_WORDS = 1024
_MULTIPLIER = 0x2360ED051FC65DA44385DF649FCCF645
_LOW = (1 << 64) - 1
_AT, _HIGH, _JUMP, _STEP = 0, 1, 1 + 2 * _LANES, 3 + 2 * _LANES
"""Indices in a stream: number of used words; states of the lanes; factor, and summand, of a jump by `_LANES` steps."""

_HEAD = 5 + 2 * _LANES
_FI, _KI, _WI, _R, _INVERSE = normal_tables()
_ONE, _S8, _S9, _S11, _S58, _S63 = (np.uint64(n) for n in (1, 8, 9, 11, 58, 63))
_SIGN = np.uint64(1 << 8)
_LEVEL, _FRACTION = np.uint64(0xFF), np.uint64(0x000FFFFFFFFFFFFF)
_UNIT = 2.0**-53


class Normals:
    """Normal numbers that continue the stream of a NumPy generator. The generator must not be used any more."""

    def __init__(self, rng: np.random.Generator) -> None:
        state = rng.bit_generator.state["state"]
        modulus = 1 << 128
        lanes, jump, step = [state["state"]], 1, 0
        for _ in range(_LANES):
            lanes.append((lanes[-1] * _MULTIPLIER + state["inc"]) % modulus)
            jump, step = jump * _MULTIPLIER % modulus, (step * _MULTIPLIER + state["inc"]) % modulus
        self._stream = np.zeros(_HEAD + _WORDS, dtype=np.uint64)
        self._stream[_AT] = _WORDS
        numbers = (*lanes[1:], jump, step)
        self._stream[_HIGH:_HEAD] = [half for n in numbers for half in (n >> 64, n & _LOW)]
        self._outside, self._again = np.empty(PIECE, dtype=np.int32), np.empty(PIECE)

    def fill(self, values: NDArray[np.float64], mean: float, std: float, low: float, high: float) -> bool:
        """Fill at most `PIECE` values with numbers in [low, high]. Return False if hardly any number is inside."""
        return bool(_fill(self._stream, values, mean, std, low, high, self._outside, self._again))


@intrinsic
def _high(typingctx, a, b):
    """Return the upper half of the product of two words."""

    def codegen(context, builder, signature, arguments):
        wide = ir.IntType(128)
        product = builder.mul(*(builder.zext(word, wide) for word in arguments))
        return builder.trunc(builder.lshr(product, ir.Constant(wide, 64)), ir.IntType(64))

    return types.uint64(types.uint64, types.uint64), codegen


@subkernel
def _refill(stream):
    """Generate the next words. Each of the four lanes makes every fourth word."""
    a, b = stream[_JUMP], stream[_JUMP + 1]
    c, d = stream[_STEP], stream[_STEP + 1]
    for k in range(_HEAD, _HEAD + _WORDS, _LANES):
        for lane in range(_LANES):
            high, low = stream[_HIGH + 2 * lane], stream[_HIGH + 2 * lane + 1]
            turn = high >> _S58
            word = high ^ low
            stream[k + lane] = (word >> turn) | (word << ((-turn) & _S63))
            next_low = low * b + d
            carry = np.uint64(next_low < d)
            stream[_HIGH + 2 * lane] = high * b + low * a + _high(low, b) + c + carry
            stream[_HIGH + 2 * lane + 1] = next_low
    stream[_AT] = 0


@subkernel
def _word(stream):
    if stream[_AT] == _WORDS:
        _refill(stream)
    word = stream[np.uint64(_HEAD) + stream[_AT]]
    stream[_AT] += _ONE
    return word


@subkernel
def _uniform(stream):
    return np.float64(_word(stream) >> _S11) * _UNIT


@subkernel
def _beyond(stream, level, fraction, x):
    """Return the number for a draw outside the rectangle of its ziggurat level, and True if the number is accepted."""
    if level > 0:
        density = (_FI[level - 1] - _FI[level]) * _uniform(stream) + _FI[level]
        return x, density < np.exp(-0.5 * x * x)
    while True:
        out = -_INVERSE * np.log1p(-_uniform(stream))
        bound = -np.log1p(-_uniform(stream))
        if bound + bound > out * out:
            return (-(_R + out) if (fraction >> _S8) & _ONE else _R + out), True


@subkernel
def _fill_all(stream, values, mean, std):
    """Fill an array with normal numbers, without bounds."""
    filled = np.uint64(0)
    size = np.uint64(values.size)
    while filled < size:
        if stream[_AT] == _WORDS:
            _refill(stream)
        first = np.uint64(_HEAD) + stream[_AT] - filled
        end = min(size, filled + np.uint64(_WORDS) - stream[_AT])
        k = filled
        while k < end:
            word = stream[first + k]
            level = word & _LEVEL
            fraction = (word >> _S9) & _FRACTION
            x = np.float64(np.int64(fraction)) * _WI[level]
            values[k] = mean + std * (-x if word & _SIGN else x) + 0.0
            if fraction >= _KI[level]:
                break
            k += _ONE
        stream[_AT] += k - filled
        filled = k
        if k < end:
            stream[_AT] += _ONE
            x, accepted = _beyond(stream, np.int64(level), fraction, -x if word & _SIGN else x)
            if accepted:
                values[k] = mean + std * x + 0.0
                filled += _ONE


@kernel
def _fill(stream, values, mean, std, low, high, outside, redrawn):
    _fill_all(stream, values, mean, std)
    n = 0
    for k in range(values.size):
        n += (values[k] < low) | (values[k] > high)
    if n == 0:
        return True
    n = 0
    for k in range(values.size):
        outside[n] = k
        n += (values[k] < low) | (values[k] > high)
    for _ in range(TRIES):
        if n == 0:
            return True
        _fill_all(stream, redrawn[:n], mean, std)
        remaining = 0
        for j in range(n):
            values[outside[j]] = redrawn[j]
            outside[remaining] = outside[j]
            remaining += (redrawn[j] < low) | (redrawn[j] > high)
        n = remaining
    return False
