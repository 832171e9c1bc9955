"""Synapses as arrays, drawn by a rule, listed in a rule, or returned by a third-party rule."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.compiler.connections import NO_TARGETS, Connections
from neuro.compiler.shapes import Shape
from neuro.core.errors import ModelError
from neuro.model.rules import RULES, Rule
from neuro.program.program import Floats, Ints

_DRAWS = 1 << 22


def is_same(target_index: Ints | None, n_post: int) -> bool:
    """Return whether sources and targets are the same neurons in the same order."""
    return target_index is not None and np.array_equal(target_index, np.arange(n_post))


def pairs_of_rule(rule: Rule, source: Shape, target: Shape, same: bool, rng: np.random.Generator) -> tuple[Ints, Ints]:
    """Return the pairs of a third-party rule after checks: whole numbers >= 0, as many sources as targets."""
    RULES.check(type(rule))
    result = rule.connect(source, target, same, rng)
    if not isinstance(result, tuple) or len(result) != 2:
        raise ModelError(f"{rule.name}.connect gives {result!r:.60}: expected (sources, targets)", path=(rule.name,))
    pre, post = (np.asarray(ids) for ids in result)
    for word, ids in (("sources", pre), ("targets", post)):
        if ids.ndim != 1 or (ids.size and (ids.dtype.kind not in "iu" or ids.min() < 0)):
            actual = f"{ids.dtype} of shape {list(ids.shape)}"
            message = f"{rule.name}.connect: {word}: found {actual}: expected a row of whole numbers >= 0"
            raise ModelError(message, path=(rule.name,))
    if pre.size != post.size:
        message = f"{rule.name}.connect: {pre.size} sources and {post.size} targets: expected equal numbers"
        raise ModelError(message, path=(rule.name,))
    return pre.astype(np.int64), post.astype(np.int64)


def in_rows(row_ends: Ints, targets: NDArray[np.int32]) -> Connections:
    """Return the synapses for targets listed source by source."""
    return Connections("csr", len(targets), row_ends, targets)


def all_onto(n_pre: int, n_post: int, excluded: Ints | None, first: int, end: int) -> Connections:
    """Return synapses from every source to each target of a range, without the excluded target, in layout csr."""
    is_connected = np.ones((n_pre, end - first), dtype=bool)
    if excluded is not None:
        sources = np.flatnonzero((excluded >= first) & (excluded < end))
        is_connected[sources, excluded[sources] - first] = False
    pre, post = np.nonzero(is_connected)
    post += first
    shapes = ((n_pre, n_post), (n_pre * n_post,))
    return Connections("csr", pre.size, ends_of(pre, n_pre), post.astype(np.int32), pre * n_post + post, shapes)


def inverted(target_index: Ints | None, n_post: int) -> Ints | None:
    """Return the index of each target among the sources, from the index of each source among the targets.

    Example: [2, -1, 1] with 3 targets gives [-1, 2, 0].
    """
    if target_index is None:
        return None
    source_index = np.full(n_post, -1, dtype=np.int64)
    source_index[target_index[target_index >= 0]] = np.flatnonzero(target_index >= 0)
    return source_index


def draw_partners(
    n: int, rows: int, n_candidates: int, excluded: Ints | None, repeats: bool, rng: np.random.Generator, what: str
) -> NDArray[np.int32]:
    """Draw n partners for each of `rows` neurons, from `n_candidates` without the excluded one; shape (rows, n).

    `excluded` has a candidate for each row, or -1 for none.
    """
    choices = np.full(rows, n_candidates) if excluded is None else n_candidates - (excluded >= 0)
    fewest = int(choices.min())
    check_degree(n, fewest, repeats, what)
    if repeats:
        bound = fewest if fewest == choices.max() else choices[:, None]
        partners = rng.integers(0, bound, size=(rows, n), dtype=np.int32)
    else:
        partners = np.empty((rows, n), dtype=np.int32)
        for row, bound in zip(partners, choices.tolist(), strict=True):
            row[:] = rng.choice(bound, n, replace=False, shuffle=False)
    # Draw from n - 1 numbers, and add 1 to all draws >= the excluded number, so that no draw is rejected. Example:
    # of 10 candidates without 3, draws are 0 to 8, and 3 to 8 become 4 to 9.
    if excluded is not None:
        partners += partners >= np.where(excluded < 0, n_candidates, excluded).astype(np.int32)[:, None]
    return partners


def check_degree(n: int, fewest: int, repeats: bool, partner_noun: str) -> None:
    """Refuse more partners than candidates of any neuron.

    Raises:
        ModelError: there are too few candidates.
    """
    if fewest < 1 or (not repeats and n > fewest):
        message = f"n = {n} {partner_noun} of each neuron: expected at most {fewest}, the number of candidates"
        hint = "multapses: true allows a pair to be drawn twice" if fewest > 0 else ""
        raise ModelError(message, hint=hint, path=("n",), about=("multapses",))


def drawn_rows(
    numbers: Ints, n_candidates: int, excluded: Ints | None, repeats: bool, rng: np.random.Generator
) -> Connections:
    """Draw `numbers` targets for each source, from `n_candidates` without the excluded one.

    `excluded` has a candidate for each source, or -1 for none.
    """
    choices = np.full(numbers.size, n_candidates) if excluded is None else n_candidates - (excluded >= 0)
    if repeats:
        targets = rng.integers(0, np.repeat(choices, numbers), dtype=np.int32)
    else:
        rows = zip(choices.tolist(), numbers.tolist(), strict=True)
        targets = np.concatenate([rng.choice(most, n, replace=False, shuffle=False) for most, n in rows])
    pre = np.repeat(np.arange(numbers.size), numbers)
    if excluded is not None:
        targets += targets >= np.where(excluded < 0, n_candidates, excluded)[pre]
    place = pre * n_candidates + targets
    place.sort()
    return in_rows(np.concatenate(([0], np.cumsum(numbers))), (place - pre * n_candidates).astype(np.int32))


def by_source(sources: NDArray[np.int32], n_pre: int) -> Connections:
    """Return synapses sorted by source, with ascending targets, from the sources of each target (a transposition)."""
    from scipy.sparse import csc_array

    n_post, n = sources.shape
    flat = sources.reshape(-1)
    ends = np.arange(n_post + 1, dtype=np.int64) * n
    if flat.size < 2**31 - 1:
        ends = ends.astype(np.int32)
    # A transposition sorts by counting, several times faster than an argsort.
    table = csc_array((np.zeros(flat.size, dtype=np.int8), flat, ends), shape=(n_pre, n_post)).tocsr()
    return in_rows(table.indptr.astype(np.int64), table.indices.astype(np.int32, copy=False))


def bernoulli(p: float, n_pre: int, n_post: int, excluded: Ints | None, rng: np.random.Generator) -> Connections:
    """Connect each pair with the probability `p`; `excluded` as in `drawn_rows`."""
    # Pairs are drawn in blocks of sources, because a draw of all pairs at once would need 8 bytes for each pair.
    block = max(1, _DRAWS // n_post)
    degrees, targets = [np.zeros(1, dtype=np.int64)], [NO_TARGETS]
    for first in range(0, n_pre, block):
        last = min(first + block, n_pre)
        is_connected = rng.random((last - first, n_post)) < p
        if excluded is not None:
            rows = np.flatnonzero(excluded[first:last] >= 0)
            is_connected[rows, excluded[first:last][rows]] = False
        degrees.append(np.count_nonzero(is_connected, axis=1))
        targets.append((np.flatnonzero(is_connected) % n_post).astype(np.int32))
    return in_rows(np.cumsum(np.concatenate(degrees), dtype=np.int64), np.concatenate(targets))


def both_ways(pre: Ints, post: Ints, n: int) -> Connections:
    """Return each pair and its reverse. If weights are drawn, a pair and its reverse have the same weight."""
    place = np.concatenate((pre * n + post, post * n + pre))
    order = np.argsort(place, kind="stable")
    sources, targets = np.divmod(place[order], n)
    row_ends = ends_of(sources, n)
    return Connections("csr", len(place), row_ends, targets.astype(np.int32), shared=order % max(len(pre), 1))


def ends_of(pre: NDArray[np.integer[Any]], n_pre: int) -> Ints:
    """Return the row ends, from the source of each synapse."""
    return np.concatenate(([0], np.cumsum(np.bincount(pre, minlength=n_pre)))).astype(np.int64)


def listed_pairs(pre: Ints, post: Ints, n_pre: int, n_post: int, name: str) -> Connections:
    """Return the synapses of listed pairs.

    Raises:
        ModelError: a pair has a neuron beyond its population. The message has `name`, the name of the rule.
    """
    for word, ids, n in (("pre", pre, n_pre), ("post", post, n_post)):
        if len(ids) and ids.max() >= n:
            bad = int(np.flatnonzero(ids >= n)[0])
            message = f"{name}.{word}[{bad}] = {ids[bad]}: expected a neuron below {n}, the population's size"
            raise ModelError(message, path=(name, word))
    return connections_of_pairs(pre, post, n_pre, n_post, {})


def connections_of_pairs(
    pre: NDArray[np.integer[Any]],
    post: NDArray[np.integer[Any]],
    n_pre: int,
    n_post: int,
    factors: Mapping[str, Floats],
) -> Connections:
    """Return the synapses of listed pairs, sorted, with the factors of each pair."""
    place = pre.astype(np.int64) * n_post + post
    order = None if np.all(place[1:] >= place[:-1]) else np.argsort(place, kind="stable")
    targets = (post if order is None else post[order]).astype(np.int32)
    sorted_ = factors if order is None else {word: values[order] for word, values in factors.items()}
    return Connections("csr", len(targets), ends_of(pre, n_pre), targets, order, ((len(targets),),), factors=sorted_)


def one_onto(n: int, first: int, end: int) -> Connections:
    """Return synapses from neuron i to neuron i for a range of targets, in layout csr."""
    targets = np.arange(first, end, dtype=np.int32)
    row_ends = np.clip(np.arange(n + 1), first, end) - first
    return Connections("csr", end - first, row_ends, targets, targets.astype(np.int64), ((n,),))


def shifted(connections: Connections, first: int) -> Connections:
    """Shift the targets of synapses by `first`, in place."""
    connections.targets[:] += np.int32(first)
    return connections
