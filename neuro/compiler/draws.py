"""Synapses as arrays: those that a rule draws, that it lists, or that a third-party rule says."""

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


def is_same(own: Ints | None, n_post: int) -> bool:
    """Whether sources and targets are the same neurons in the same order."""
    return own is not None and np.array_equal(own, np.arange(n_post))


def own_pairs(rule: Rule, source: Shape, target: Shape, same: bool, rng: np.random.Generator) -> tuple[Ints, Ints]:
    """The pairs that a third-party rule says, if they are whole numbers >= 0 and as many of each."""
    RULES.check(type(rule))
    said = rule.connect(source, target, same, rng)
    if not isinstance(said, tuple) or len(said) != 2:
        raise ModelError(f"{rule.name}.connect gives {said!r:.60}: expected (sources, targets)", path=(rule.name,))
    pre, post = (np.asarray(ids) for ids in said)
    for word, ids in (("sources", pre), ("targets", post)):
        if ids.ndim != 1 or (ids.size and (ids.dtype.kind not in "iu" or ids.min() < 0)):
            found = f"{ids.dtype} of shape {list(ids.shape)}"
            message = f"{rule.name}.connect: {word}: found {found}: expected a row of whole numbers >= 0"
            raise ModelError(message, path=(rule.name,))
    if pre.size != post.size:
        message = f"{rule.name}.connect: {pre.size} sources and {post.size} targets: expected as many of each"
        raise ModelError(message, path=(rule.name,))
    return pre.astype(np.int64), post.astype(np.int64)


def in_rows(row_ends: Ints, targets: NDArray[np.int32]) -> Connections:
    """The synapses of targets that are listed source by source."""
    return Connections("csr", len(targets), row_ends, targets)


def all_onto(n_pre: int, n_post: int, but: Ints | None, first: int, end: int) -> Connections:
    """Every source with each target of a range but the one that it does not reach, listed one by one."""
    kept = np.ones((n_pre, end - first), dtype=bool)
    if but is not None:
        there = np.flatnonzero((but >= first) & (but < end))
        kept[there, but[there] - first] = False
    pre, post = np.nonzero(kept)
    post += first
    shapes = ((n_pre, n_post), (n_pre * n_post,))
    return Connections("csr", pre.size, ends_of(pre, n_pre), post.astype(np.int32), pre * n_post + post, shapes)


def turned(own: Ints | None, n_post: int) -> Ints | None:
    """Of each target its place among the sources, from that of each source among the targets."""
    if own is None:
        return None
    places = np.full(n_post, -1, dtype=np.int64)
    places[own[own >= 0]] = np.flatnonzero(own >= 0)
    return places


def draw_partners(
    n: int, rows: int, among: int, but: Ints | None, repeats: bool, rng: np.random.Generator, what: str
) -> NDArray[np.int32]:
    """For each of `rows` neurons n partners `among` so many, `but` one of them where that is not -1; (rows, n)."""
    choices = np.full(rows, among) if but is None else among - (but >= 0)
    fewest = int(choices.min())
    check_degree(n, fewest, repeats, what)
    if repeats:
        most = fewest if fewest == choices.max() else choices[:, None]
        drawn = rng.integers(0, most, size=(rows, n), dtype=np.int32)
    else:
        drawn = np.empty((rows, n), dtype=np.int32)
        for row, most in zip(drawn, choices.tolist(), strict=True):
            row[:] = rng.choice(most, n, replace=False, shuffle=False)
    # One number less is drawn from, and those from the excluded one on move up by one: no draw is thrown away.
    if but is not None:
        drawn += drawn >= np.where(but < 0, among, but).astype(np.int32)[:, None]
    return drawn


def check_degree(n: int, fewest: int, repeats: bool, what: str) -> None:
    """Refuse more partners than the neuron with the fewest has to choose from.

    Raises:
        ModelError: there are not so many.
    """
    if fewest < 1 or (not repeats and n > fewest):
        message = f"n = {n} {what} of each neuron: expected at most {fewest}, as many as there are"
        hint = "multapses: true allows a pair to be drawn twice" if fewest > 0 else ""
        raise ModelError(message, hint=hint, path=("n",), about=("multapses",))


def drawn_rows(numbers: Ints, among: int, but: Ints | None, repeats: bool, rng: np.random.Generator) -> Connections:
    """For each source so many targets `among` so many, `but` one of them where that is not -1."""
    choices = np.full(numbers.size, among) if but is None else among - (but >= 0)
    if repeats:
        drawn = rng.integers(0, np.repeat(choices, numbers), dtype=np.int32)
    else:
        rows = zip(choices.tolist(), numbers.tolist(), strict=True)
        drawn = np.concatenate([rng.choice(most, n, replace=False, shuffle=False) for most, n in rows])
    pre = np.repeat(np.arange(numbers.size), numbers)
    if but is not None:
        drawn += drawn >= np.where(but < 0, among, but)[pre]
    place = pre * among + drawn
    place.sort()
    return in_rows(np.concatenate(([0], np.cumsum(numbers))), (place - pre * among).astype(np.int32))


def by_source(sources: NDArray[np.int32], n_pre: int) -> Connections:
    """Sort (target, its sources) by source; a transposition, in which targets stay ascending."""
    from scipy.sparse import csc_array

    n_post, n = sources.shape
    flat = sources.reshape(-1)
    ends = np.arange(n_post + 1, dtype=np.int64) * n
    if flat.size < 2**31 - 1:
        ends = ends.astype(np.int32)
    # A transposition sorts by counting; an argsort of as many pairs takes several times as long.
    table = csc_array((np.zeros(flat.size, dtype=np.int8), flat, ends), shape=(n_pre, n_post)).tocsr()
    return in_rows(table.indptr.astype(np.int64), table.indices.astype(np.int32, copy=False))


def bernoulli(p: float, n_pre: int, n_post: int, but: Ints | None, rng: np.random.Generator) -> Connections:
    """Each pair with the probability `p`; `but` as of `drawn_rows`."""
    # A matrix of all pairs would take 8 bytes for each pair that is not connected, too.
    block = max(1, _DRAWS // n_post)
    degrees, targets = [np.zeros(1, dtype=np.int64)], [NO_TARGETS]
    for first in range(0, n_pre, block):
        last = min(first + block, n_pre)
        hit = rng.random((last - first, n_post)) < p
        if but is not None:
            there = np.flatnonzero(but[first:last] >= 0)
            hit[there, but[first:last][there]] = False
        degrees.append(np.count_nonzero(hit, axis=1))
        targets.append((np.flatnonzero(hit) % n_post).astype(np.int32))
    return in_rows(np.cumsum(np.concatenate(degrees), dtype=np.int64), np.concatenate(targets))


def both_ways(pre: Ints, post: Ints, n: int) -> Connections:
    """Each pair and its reverse, which take the same draw of a weight."""
    place = np.concatenate((pre * n + post, post * n + pre))
    order = np.argsort(place, kind="stable")
    sources, targets = np.divmod(place[order], n)
    row_ends = ends_of(sources, n)
    return Connections("csr", len(place), row_ends, targets.astype(np.int32), shared=order % max(len(pre), 1))


def ends_of(pre: NDArray[np.integer[Any]], n_pre: int) -> Ints:
    """Where the synapses of each source end, from those of all synapses."""
    return np.concatenate(([0], np.cumsum(np.bincount(pre, minlength=n_pre)))).astype(np.int64)


def listed_pairs(pre: Ints, post: Ints, n_pre: int, n_post: int, name: str) -> Connections:
    """The synapses of listed pairs.

    Raises:
        ModelError: one is of a neuron that its population does not have; it names the rule, `name`.
    """
    for word, ids, n in (("pre", pre, n_pre), ("post", post, n_post)):
        if len(ids) and ids.max() >= n:
            bad = int(np.flatnonzero(ids >= n)[0])
            message = f"{name}.{word}[{bad}] = {ids[bad]}: expected a neuron below {n}, the population's size"
            raise ModelError(message, path=(name, word))
    return listed(pre, post, n_pre, n_post, {})


def listed(
    pre: NDArray[np.integer[Any]],
    post: NDArray[np.integer[Any]],
    n_pre: int,
    n_post: int,
    factors: Mapping[str, Floats],
) -> Connections:
    """The synapses of listed pairs, sorted, with the factors of each."""
    place = pre.astype(np.int64) * n_post + post
    order = None if np.all(place[1:] >= place[:-1]) else np.argsort(place, kind="stable")
    targets = (post if order is None else post[order]).astype(np.int32)
    sorted_ = factors if order is None else {word: values[order] for word, values in factors.items()}
    return Connections("csr", len(targets), ends_of(pre, n_pre), targets, order, ((len(targets),),), factors=sorted_)


def one_onto(n: int, first: int, end: int) -> Connections:
    """Neuron i to neuron i for a range of targets, listed one by one."""
    targets = np.arange(first, end, dtype=np.int32)
    row_ends = np.clip(np.arange(n + 1), first, end) - first
    return Connections("csr", end - first, row_ends, targets, targets.astype(np.int64), ((n,),))


def moved(found: Connections, first: int) -> Connections:
    """The same synapses onto as many later targets."""
    found.targets[:] += np.int32(first)
    return found
