"""Pairs drawn at random. A draw belongs to its pair or its synapse, in whatever order and by whomever it is drawn."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from neuro.core.errors import ModelError
from neuro.core.keyed_random import uniform, uniform_table
from neuro.program.program import Ints

BLOCK = 1 << 18
"""Draws at a time: what they take stays small beside the synapses."""


def total_number(
    n: int, n_pre: int, n_post: int, but_self: bool, repeats: bool, key: int
) -> tuple[Ints, NDArray[np.int32]]:
    """Source and target of n synapses, in the order of the source, then the target; draw k is that of synapse k.

    Args:
        n: synapses.
        n_pre: neurons of the source.
        n_post: of the target.
        but_self: whether a neuron does not reach itself.
        repeats: whether a pair may be drawn twice.
        key: of the draws.

    Raises:
        ModelError: there are not so many pairs.
    """
    choices = n_post - but_self
    pairs = n_pre * choices
    if n and (pairs < 1 or (not repeats and n > pairs)):
        hint = "multapses: true allows a pair to be drawn twice" if pairs > 0 else ""
        raise ModelError(f"n = {n} synapses: expected at most {pairs}, as many as there are pairs", hint=hint)
    places = _below(pairs, 0, n, key) if repeats else _distinct(n, pairs, key)
    places.sort()
    pre, post = np.divmod(places, max(choices, 1))
    if but_self:
        post += post >= pre
    return pre, post.astype(np.int32)


def _below(bound: int, first: int, last: int, key: int) -> Ints:
    """Draws first, ..., last - 1 of a sequence of whole numbers below a bound."""
    drawn = np.empty(last - first, dtype=np.int64)
    for begin, end in blocks(first, last, BLOCK):
        drawn[begin - first : end - first] = uniform(key, 0, np.arange(begin, end)) * bound
    return drawn


def _distinct(n: int, bound: int, key: int) -> Ints:
    """The first n different numbers of that sequence; where they are most of all, those that remain."""
    if 2 * n > bound:
        remain = np.ones(bound, dtype=bool)
        remain[_distinct(bound - n, bound, key)] = False
        return np.flatnonzero(remain)
    found, taken = _below(bound, 0, n, key), n
    while True:
        _, first = np.unique(found, return_index=True)
        if first.size == n:
            return found
        first.sort()
        missing = n - first.size
        found = np.concatenate((found[first], _below(bound, taken, taken + missing, key)))
        taken += missing


def bernoulli_pairs(p: float, n: int, key: int) -> tuple[Ints, Ints]:
    """The pairs (i, j), i != j, of n neurons of which each is drawn with probability p, in order."""
    drawn_pre, drawn_post = [], []
    for first, last in blocks(0, n, max(1, BLOCK // n)):
        hit = uniform_table(key, np.arange(first, last), n) < p
        hit[np.arange(last - first), np.arange(first, last)] = False
        pre, post = np.nonzero(hit)
        drawn_pre.append(pre + first)
        drawn_post.append(post)
    return np.concatenate(drawn_pre), np.concatenate(drawn_post)


def blocks(first: int, last: int, length: int) -> Iterator[tuple[int, int]]:
    """The bounds of pieces of a range."""
    for begin in range(first, last, length):
        yield begin, min(begin + length, last)
