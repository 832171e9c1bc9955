"""The exponential of a matrix, numerically, in place and without new arrays: the exact solution of a linear system."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
import math

TERMS = 14
"""Enough for an error below 1e-16 where the norm is at most 1/2."""
ROOM = 3
"""How many matrices of its size the exponential needs to lie in, itself among them."""


def change(c, at, n, more, h):
    """By how much z changes in h where z' = A z + B u, for a u that is constant meanwhile.

    Scaling, a Taylor sum and squaring. The identity is left out: beside it what is small would lose its last digits,
    and a potential that hardly changes in a step would come to rest elsewhere. Equal time constants and singular
    matrices are nothing special.

    Args:
        c: at `at` the matrix [[A, B], [0, 0]], row by row, which becomes [[exp(A h) - 1, integral of exp(A t) B],
            [0, 0]]; two matrices of room follow.
        at: where it begins.
        n: rows of A.
        more: columns of B.
        h: how long.
    """
    size = n + more
    norm = 0.0
    for i in range(n):
        row = 0.0
        for j in range(n):
            row += abs(c[at + i * size + j])
        norm = max(norm, row * h)
    if not norm < math.inf:
        for k in range(size * size):
            c[at + k] = math.nan
        return
    squarings, part = 0, h
    while norm > 0.5:
        norm *= 0.5
        part *= 0.5
        squarings += 1
    first, room = at + size * size, at + 2 * size * size
    for k in range(size * size):
        c[at + k] *= part
        c[first + k] = c[at + k]
    for term in range(TERMS, 1, -1):
        for k in range(size * size):
            c[at + k] /= term
        for i in range(size):
            c[at + i * size + i] += 1.0
        multiply(c, first, at, room, size)
        for k in range(size * size):
            c[at + k] = c[room + k]
    for _ in range(squarings):
        multiply(c, at, at, room, size)
        for k in range(size * size):
            c[at + k] = 2.0 * c[at + k] + c[room + k]


def multiply(c, a, b, to, size):
    """Write the product of two matrices, most of whose elements are 0, to a third place."""
    for k in range(size * size):
        c[to + k] = 0.0
    for i in range(size):
        for j in range(size):
            factor = c[a + i * size + j]
            if factor != 0.0:
                for k in range(size):
                    c[to + i * size + k] += factor * c[b + j * size + k]


def lasting(leak):
    """How long a state remembers, 1/leak; infinite without leak, NaN if it grows by itself."""
    return 1.0 / leak if leak > 0.0 else (math.inf if leak == 0.0 else math.nan)


def positive(tau):
    """A time constant, NaN if it is none."""
    return tau if tau > 0.0 else math.nan


def relaxed(value, drive, gain):
    """The highest that a state with a leak comes under a constant drive; `gain` is `lasting` of its leak."""
    if math.isinf(gain):
        return value if drive <= 0.0 else math.inf
    return max(value, drive * gain) if gain > 0.0 else math.inf
