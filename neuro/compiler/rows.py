"""Very many synapses, put in order by counting: a few ns each, where sorting takes tens."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from neuro.kernels.draws import step_word, uniform
from neuro.kernels.jit import kernel
from neuro.program.program import Ints

_HEAP = 15
"""Power of two: numbers that are sorted at a time, so that they stay in the cache."""

_DIGIT = 10
"""Bits that a pass sorts by."""

_NONE: Ints = np.zeros(0, dtype=np.int64)


def sorted_draws(key: int, n: int, bound: int) -> Ints:
    """The first n of a key's whole numbers below a bound, `keyed_random.uniform` x bound, in order."""
    bits = max(1, (bound - 1).bit_length() - max(0, n.bit_length() - _HEAP))
    ends = np.zeros(((bound - 1) >> bits) + 2, dtype=np.int64)
    word = np.uint64(key)
    _count(word, n, bound, bits, ends)
    scratch = np.empty(int(ends.max()), dtype=np.int64)
    found = np.empty(n, dtype=np.int64)
    np.cumsum(ends, out=ends)
    _fill(word, n, bound, bits, ends, scratch, np.empty(1 << _DIGIT, dtype=np.int64), found)
    return found


def by_delay(row_ends: Ints, delays: NDArray[np.int32], targets: NDArray[np.int32], others: Ints | None) -> None:
    """Put the synapses of every source in the order of their delays, in place; those with one delay stay in order.

    Args:
        row_ends: where the synapses of each source end.
        delays: of each synapse.
        targets: of each synapse.
        others: what else each has; None: nothing.
    """
    shortest, longest = int(delays.min()), int(delays.max())
    room = int(np.diff(row_ends).max())
    counts = np.empty(longest - shortest + 2, dtype=np.int64)
    late = _NONE if others is None else others
    _sort_rows(row_ends, delays, targets, late, shortest, counts, *np.empty((2, room), dtype=np.int64))


@kernel
def split(places, ends, but, row_ends, targets):
    """Pairs in order as rows: `ends` are the places at which sources begin, `but` whom they do not reach."""
    source = 0
    for k in range(places.size):
        while places[k] >= ends[source + 1]:
            source += 1
            row_ends[source] = k
        target = places[k] - ends[source]
        if but.size > 0 and but[source] >= 0 and target >= but[source]:
            target += 1
        targets[k] = target
    for rest in range(source + 1, row_ends.size):
        row_ends[rest] = places.size


@kernel
def _count(key, n, bound, bits, ends):
    base = step_word(key, 0)
    for k in range(n):
        ends[(np.int64(uniform(base, k) * bound) >> bits) + 1] += 1


@kernel
def _fill(key, n, bound, bits, ends, scratch, counts, found):
    """Put the draws into their heaps, then sort each by its lower bits, a digit at a time."""
    base = step_word(key, 0)
    for k in range(n):
        place = np.int64(uniform(base, k) * bound)
        heap = place >> bits
        found[ends[heap]] = place
        ends[heap] += 1
    first = 0
    for heap in range(ends.size - 1):
        last = ends[heap]
        for low in range(0, bits, _DIGIT):
            counts[:] = 0
            for k in range(first, last):
                counts[(found[k] >> low) & (counts.size - 1)] += 1
            before = 0
            for digit in range(counts.size):
                number = counts[digit]
                counts[digit] = before
                before += number
            for k in range(first, last):
                digit = (found[k] >> low) & (counts.size - 1)
                scratch[counts[digit]] = found[k]
                counts[digit] += 1
            for k in range(first, last):
                found[k] = scratch[k - first]
        first = last


@kernel
def _sort_rows(row_ends, delays, targets, others, shortest, counts, scratch, late):
    for source in range(row_ends.size - 1):
        first, last = row_ends[source], row_ends[source + 1]
        counts[:] = 0
        for e in range(first, last):
            counts[delays[e] - shortest + 1] += 1
        for d in range(1, counts.size):
            counts[d] += counts[d - 1]
        for e in range(first, last):
            d = delays[e] - shortest
            scratch[counts[d]] = targets[e]
            if others.size > 0:
                late[counts[d]] = others[e]
            counts[d] += 1
        d = 0
        for k in range(last - first):
            while k >= counts[d]:
                d += 1
            delays[first + k] = shortest + d
            targets[first + k] = scratch[k]
            if others.size > 0:
                others[first + k] = late[k]
