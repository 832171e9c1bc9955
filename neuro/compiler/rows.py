"""Synapses put in order by counting, a piece at a time: a piece stays in the cache, so it takes a few ns a synapse."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.program.program import Ints

PIECE = 1 << 16
"""Synapses at a time, about."""

MANY = 1 << 20
"""Static synapses from which on those of a source lie by delay, then target, if their delays are drawn."""

_FEW = 1 << 12


def sorted_draws(draws: Callable[[], Iterator[Ints]], n: int, bound: int) -> Ints:
    """The n numbers below a bound that come in blocks, in order; they are drawn twice, to know first where they go."""
    bits = max(0, (bound - 1).bit_length() - (n // PIECE).bit_length())
    n_heaps = ((bound - 1) >> bits) + 1
    ends = np.cumsum(sum(np.bincount(block >> bits, minlength=n_heaps) for block in draws()))
    free, found = np.concatenate(([0], ends[:-1])), np.empty(n, dtype=np.int64)
    for block in draws():
        heap = block >> bits
        sizes = np.bincount(heap, minlength=n_heaps)
        before = np.cumsum(sizes) - sizes
        found[np.repeat(free - before, sizes) + np.arange(block.size)] = block[_order(heap, n_heaps)]
        free += sizes
    for k, (first, last) in enumerate(zip([0, *ends[:-1].tolist()], ends.tolist(), strict=True)):
        found[first:last] = _sorted(found[first:last] & ((1 << bits) - 1), bits) | (k << bits)
    return found


def by_delay(row_ends: Ints, delays: NDArray[np.int32], *others: NDArray[Any] | None) -> None:
    """Put the synapses of every source in the order of their delays, in place; those with one delay stay in order."""
    shortest, n = int(delays.min()), int(delays.max()) - int(delays.min()) + 1
    for first, last, begin, end in pieces(row_ends):
        rows = np.repeat(np.arange(last - first, dtype=np.int64) * n, np.diff(row_ends[first : last + 1]))
        order = _order(rows + (delays[begin:end] - shortest), (last - first) * n)
        for values in (delays, *others):
            if values is not None:
                values[begin:end] = values[begin:end][order]


def pieces(row_ends: Ints) -> Iterator[tuple[int, int, int, int]]:
    """Some rows, and where their synapses lie."""
    first, rows = 0, row_ends.size - 1
    while first < rows:
        last = int(np.searchsorted(row_ends, row_ends[first] + PIECE, side="right")) - 1
        last = min(max(last, first + 1), rows)
        yield first, last, int(row_ends[first]), int(row_ends[last])
        first = last


def _order(keys: Ints, n: int) -> NDArray[np.integer]:
    """The places of keys below n by key, then place."""
    if keys.size < _FEW or n > 8 * keys.size:  # a count of every key would cost more
        return np.argsort(keys, kind="stable")
    places: NDArray[np.integer] = _counted(keys, n, np.ones(keys.size, dtype=np.int8)).indices
    return places


def _sorted(values: Ints, bits: int) -> Ints:
    """Numbers of so many bits in order: by the lower half of their digits, then by the upper."""
    low = bits // 2
    if values.size < _FEW or (1 << (bits - low)) > 8 * values.size:
        return np.sort(values)
    once = _counted(values & ((1 << low) - 1), 1 << low, (values >> low).astype(np.int32))
    lower = np.repeat(np.arange(1 << low, dtype=np.int32), np.diff(once.indptr))
    twice = _counted(once.data, 1 << (bits - low), lower)
    upper = np.repeat(np.arange(1 << (bits - low), dtype=np.int64), np.diff(twice.indptr))
    return (upper << low) | twice.data


def _counted(keys: NDArray[np.integer], n: int, values: NDArray[Any]) -> Any:
    """Values by their keys below n: columns with one entry each, turned into rows."""
    from scipy.sparse import csc_array

    ends = np.arange(keys.size + 1, dtype=np.int32)
    return csc_array((values, keys.astype(np.int32, copy=False), ends), shape=(n, keys.size)).tocsr()
