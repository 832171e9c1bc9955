"""Pairs drawn at random. A draw belongs to its pair or its synapse, in whatever order and by whomever it is drawn."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from neuro.core.errors import ModelError
from neuro.core.keyed_random import uniform, uniform_table
from neuro.program.program import Ints

BLOCK = 1 << 16
"""Draws at a time: what they take stays small beside the synapses."""

MANY = 1 << 20
"""Synapses from which on those of a projection are put in order by compiled passes, those of a network by delay."""


def total_number(
    n: int,
    n_pre: int,
    n_post: int,
    but: Ints | None,
    repeats: bool,
    key: int,
    room: NDArray[np.int32] | None = None,
) -> tuple[Ints, NDArray[np.int32]]:
    """Where the synapses of each source end, and the targets of n synapses; draw k is that of synapse k.

    Args:
        n: synapses.
        n_pre: neurons of the source.
        n_post: of the target.
        but: of each source the target that it does not reach, -1: none; None: none of any.
        repeats: whether a pair may be drawn twice.
        key: of the draws.
        room: memory for the targets, which may be used.

    Raises:
        ModelError: there are not so many pairs.
    """
    ends = np.concatenate(([0], np.cumsum(choices(n_pre, n_post, but))))
    pairs = int(ends[-1])
    check_number(n, pairs, repeats)
    if repeats and n >= MANY // 2:
        from neuro.compiler.rows import draw_rows

        targets = np.empty(n, dtype=np.int32) if room is None else room
        return draw_rows(key, ends, but, targets), targets
    # A pair is one whole number, counted by source without the excluded ones: sorting it sorts by source, then target.
    places = _below(pairs, 0, n, key) if repeats else _distinct(n, pairs, key)
    places.sort()
    row_ends = np.searchsorted(places, ends)
    pre = np.repeat(np.arange(n_pre), np.diff(row_ends))
    post = places - ends[pre]
    if but is not None:
        post += (but[pre] >= 0) & (post >= but[pre])
    return row_ends, post.astype(np.int32)


def choices(n_pre: int, n_post: int, but: Ints | None) -> Ints:
    """How many targets each source may reach."""
    return np.full(n_pre, n_post) if but is None else n_post - (but >= 0)


def check_number(n: int, pairs: int, repeats: bool) -> None:
    """Refuse more synapses than there are pairs.

    Raises:
        ModelError: there are not so many.
    """
    if n and (pairs < 1 or (not repeats and n > pairs)):
        hint = "multapses: true allows a pair to be drawn twice" if pairs > 0 else ""
        message = f"n = {n} synapses: expected at most {pairs}, as many as there are pairs"
        raise ModelError(message, hint=hint, path=("n",), about=("multapses",))


def shares(n: int, pairs: Ints, repeats: bool, rng: np.random.Generator) -> Ints:
    """How many of n synapses each block has, from the pairs of each: multinomial; without repeats hypergeometric."""
    total = int(pairs.sum())
    if repeats:
        return rng.multinomial(n, pairs / total)
    # Each pair is taken with the probability n / total. Then pairs are drawn, one by one, of those that are left or of
    # those that are taken, until there are n of them, so that every set of n pairs is as likely. NumPy's own numbers
    # end at 10^9 pairs.
    taken = rng.binomial(pairs, n / total)
    while missing := n - int(taken.sum()):
        pool = pairs - taken if missing > 0 else taken
        taken[np.searchsorted(np.cumsum(pool), rng.integers(pool.sum()), side="right")] += np.sign(missing)
    return taken


def _below(bound: int, first: int, last: int, key: int) -> Ints:
    """Draws first, ..., last - 1 of a sequence of whole numbers below a bound."""
    drawn = np.empty(last - first, dtype=np.int64)
    for begin, end in blocks(first, last, BLOCK):
        drawn[begin - first : end - first] = uniform(key, 0, np.arange(begin, end)) * bound
    return drawn


def _distinct(n: int, bound: int, key: int) -> Ints:
    """The first n different numbers of that sequence; where they are most of all, those that remain."""
    # Of nearly all pairs it is the few that are left out which are drawn: redrawing what is taken would not end soon.
    if 2 * n > bound:
        remain = np.ones(bound, dtype=bool)
        remain[_distinct(bound - n, bound, key)] = False
        return np.flatnonzero(remain)
    found, taken = _below(bound, 0, n, key), n
    while True:
        # The first n different ones of one sequence: the result does not depend on how many were drawn at a time.
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
