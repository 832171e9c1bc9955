"""Sorting of very many synapses by counting, in a few ns per synapse instead of tens."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.keyed_random import NEURON_STRIDE
from neuro.kernels.draws import mix, step_word
from neuro.kernels.jit import kernel, subkernel
from neuro.program.program import Ints

_HEAP = 15
"""Binary logarithm of the size of a heap. A heap of this size is sorted within the cache."""

_MOST_BITS = 31
"""Largest number of bits of a number within a heap: it is stored in place of a target."""

_DIGIT = 11
"""Largest number of bits of a digit in a pass of the radix sort."""

_NO_TARGET = 1 << 31
"""A number above all targets."""

_CHUNK = 1024
"""Number of draws in one vectorised batch."""

_NONE: Ints = np.zeros(0, dtype=np.int64)
_NEURON, _S11, _UNIT = np.uint64(NEURON_STRIDE), np.uint64(11), 2.0**-53


def draw_rows(key: int, ends: Ints, excluded: Ints | None, targets: NDArray[np.int32]) -> Ints:
    """Draw the targets of synapses into an array; return the row ends of the sources.

    Pairs are numbered by source. The draws are the first numbers `keyed_random.uniform` x pairs of a key. They are
    distributed to heaps and sorted within the array of targets, without other memory.

    Args:
        key: key of the draws.
        ends: index of the first pair of each source, and the end.
        excluded: the target that each source must not reach, -1 for none; None: none for any source.
        targets: targets of all synapses, to be filled.
    """
    n, pairs = targets.size, int(ends[-1])
    # Each heap has about 2^15 numbers, so that distributing touches few lines of memory at a time, and each heap is
    # sorted within the cache.
    bits = max(1, (pairs - 1).bit_length() - max(0, n.bit_length() - _HEAP))
    bits = min(bits, _MOST_BITS)
    passes = 2 if bits <= 2 * _DIGIT else 4
    heaps = np.zeros(((pairs - 1) >> bits) + 2, dtype=np.int64)
    word, chunk = np.uint64(key), np.empty(_CHUNK, dtype=np.int64)
    # All draws are made twice, to count and to distribute. A draw is a hash of its number and needs no memory.
    _count(word, n, pairs, bits, heaps, chunk)
    scratch = np.empty(int(heaps.max()), dtype=np.int32)
    np.cumsum(heaps, out=heaps)
    _deal(word, n, pairs, bits, heaps, chunk, targets)
    digit, row_ends = -(-bits // passes), np.zeros(ends.size, dtype=np.int64)
    places = np.empty(1 << digit, dtype=np.int32)
    _sort_heaps(
        bits, passes, digit, heaps, scratch, places, ends, _NONE if excluded is None else excluded, row_ends, targets
    )
    return row_ends


def by_delay(
    row_ends: Ints,
    delays: NDArray[np.integer[Any]],
    shortest: int,
    longest: int,
    targets: NDArray[np.int32],
    other_values: Sequence[NDArray[Any]],
) -> None:
    """Sort the synapses of every source by delay, in place; synapses with equal delays stay in order.

    Args:
        row_ends: row ends of the sources.
        delays: delay of each synapse.
        shortest: the smallest delay.
        longest: the largest delay.
        targets: target of each synapse.
        other_values: other values of each synapse.
    """
    longest_row = int(np.diff(row_ends).max())
    counts = np.empty(longest - shortest + 2, dtype=np.int64)
    for values in other_values:
        _sort_others(row_ends, delays, values, shortest, counts, np.empty(longest_row, dtype=values.dtype))
    _sort_rows(row_ends, delays, targets, shortest, counts, np.empty(longest_row, dtype=np.int32))


def put_rows(ends: Ints, values: NDArray[Any], starts: Ints, output: NDArray[Any]) -> None:
    """Copy the values of each source to `output`. `ends`: row ends in `values`; `starts`: places in `output`."""
    _put_rows(ends, values, starts, output)


@subkernel
def _draw(base, first, bound, chunk):
    """Write whole numbers below a bound, from draw `first` on, into a chunk."""
    z = base + np.uint64(first) * _NEURON
    for k in range(chunk.size):
        chunk[k] = np.int64(np.float64(mix(z + np.uint64(k) * _NEURON) >> _S11) * _UNIT * bound)


@kernel
def _count(key, n, bound, bits, heaps, chunk):
    base = step_word(key, 0)
    for first in range(0, n, chunk.size):
        draws = chunk[: min(chunk.size, n - first)]
        _draw(base, first, bound, draws)
        for k in range(draws.size):
            heaps[np.uint64((draws[k] >> bits) + 1)] += 1


@kernel
def _deal(key, n, bound, bits, heaps, chunk, targets):
    """Put the lower bits of each draw into its heap. The call moves `heaps` from the starts to the ends of heaps."""
    base, low = step_word(key, 0), (1 << bits) - 1
    for first in range(0, n, chunk.size):
        draws = chunk[: min(chunk.size, n - first)]
        _draw(base, first, bound, draws)
        for k in range(draws.size):
            heap = np.uint64(draws[k] >> bits)
            targets[np.uint64(heaps[heap])] = np.int32(draws[k] & low)
            heaps[heap] += 1


@subkernel
def _sort(numbers, scratch, places, passes, digit):
    """Sort numbers by a radix sort. The number of passes is even, so the result is in the original array."""
    for p in range(0, passes, 2):
        _deal_by(numbers, scratch, places, np.uint32(p * digit))
        _deal_by(scratch[: numbers.size], numbers, places, np.uint32((p + 1) * digit))


@subkernel
def _deal_by(numbers, output, places, shift):
    """Sort numbers by a digit. Numbers with the same digit stay in order."""
    # Unsigned indices take half the time, because numba need not check for negative indices.
    mask = np.uint32(places.size - 1)
    places[:] = 0
    for k in range(numbers.size):
        places[(np.uint32(numbers[k]) >> shift) & mask] += np.int32(1)
    before = np.int32(0)
    for d in range(places.size):
        number = places[d]
        places[d] = before
        before += number
    for k in range(numbers.size):
        d = (np.uint32(numbers[k]) >> shift) & mask
        output[np.uint32(places[d])] = numbers[k]
        places[d] += np.int32(1)


@kernel
def _sort_heaps(bits, passes, digit, heaps, scratch, places, ends, excluded, row_ends, targets):
    """Sort each heap, and convert its pairs to targets."""
    source = first = 0
    for heap in range(heaps.size - 1):
        last = heaps[heap]
        _sort(targets[first:last], scratch, places, passes, digit)
        base, k = heap << bits, first
        while k < last:
            while base + np.int64(targets[k]) >= ends[source + 1]:
                source += 1
                row_ends[source] = k
            begin, end = ends[source] - base, ends[source + 1] - base
            # Targets from the excluded target on are shifted up by 1, as in `pairs.total_number`, so that both draw the
            # same network.
            left_out = excluded[source] if excluded.size > 0 and excluded[source] >= 0 else _NO_TARGET
            while k < last and targets[k] < end:
                target = targets[k] - begin
                targets[k] = target + (target >= left_out)
                k += 1
        first = last
    row_ends[source + 1 :] = targets.size


@subkernel
def _places(delays, shortest, counts):
    """Write the index of the first synapse of each delay into `counts`."""
    counts[:] = 0
    for e in range(delays.size):
        counts[np.int64(delays[e]) - shortest + 1] += 1
    for d in range(1, counts.size):
        counts[d] += counts[d - 1]


@kernel
def _put_rows(ends, values, starts, output):
    for source in range(starts.size):
        first = ends[source]
        start = starts[source]
        for e in range(first, ends[source + 1]):
            output[start + e - first] = values[e]


@kernel
def _sort_others(row_ends, delays, other_values, shortest, counts, scratch):
    for source in range(row_ends.size - 1):
        first, last = row_ends[source], row_ends[source + 1]
        _places(delays[first:last], shortest, counts)
        for e in range(first, last):
            d = np.int64(delays[e]) - shortest
            scratch[counts[d]] = other_values[e]
            counts[d] += 1
        for e in range(first, last):
            other_values[e] = scratch[e - first]


@kernel
def _sort_rows(row_ends, delays, targets, shortest, counts, scratch):
    for source in range(row_ends.size - 1):
        first, last = row_ends[source], row_ends[source + 1]
        _places(delays[first:last], shortest, counts)
        for e in range(first, last):
            d = np.int64(delays[e]) - shortest
            scratch[counts[d]] = targets[e]
            counts[d] += 1
        for e in range(first, last):
            targets[e] = scratch[e - first]
        # The sorted delays follow from the counts and need not be moved.
        begin = first
        for d in range(counts.size - 1):
            delays[begin : first + counts[d]] = shortest + d
            begin = first + counts[d]
