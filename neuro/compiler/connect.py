"""Connection rules as arrays: the synapses that exist, by source, then target, whole or in blocks."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from neuro.compiler.pairs import (
    BLOCK,
    Between,
    bernoulli_pairs,
    blocks,
    check_number,
    choices,
    distant_pairs,
    expected_pairs,
    shares,
    total_number,
)
from neuro.compiler.shapes import Shape, size
from neuro.core.errors import ModelError
from neuro.core.keyed_random import generator, key as key_of
from neuro.model.rules import (
    RULES,
    NamedRule,
    Rule,
    all_to_all,
    distance_dependent,
    fixed_indegree,
    fixed_outdegree,
    fixed_total_number,
    grid,
    one_to_one,
    pairs,
    pairwise_bernoulli,
    symmetric_pairwise_bernoulli,
)
from neuro.program.program import Floats, Grid, Ints

Apart: TypeAlias = Callable[[], Between]
_DRAWS = 1 << 22
NO_ROWS: Ints = np.zeros(0, dtype=np.int64)
NO_TARGETS: NDArray[np.int32] = np.zeros(0, dtype=np.int32)


@dataclass(frozen=True, slots=True, eq=False)
class Connections:
    """Synapses of one projection.

    Attributes:
        layout, row_ends, targets, size: as in `neuro.program.program.Projection`.
        order: for listed pairs that were not sorted: which listed pair each synapse is, else None.
        listed: the shapes that an array of weights may have; empty where synapses are drawn at random.
        shared: for synapses of which some share a drawn weight or delay: which draw each takes, else None.
        factors: of "weight" or "delay", one for each synapse in the program's order; 1 for all where it is not there.
    """

    layout: str
    size: int
    row_ends: Ints = field(default_factory=lambda: NO_ROWS)
    targets: NDArray[np.int32] = field(default_factory=lambda: NO_TARGETS)
    order: Ints | None = None
    listed: tuple[tuple[int, ...], ...] = ()
    shared: Ints | None = None
    factors: Mapping[str, Floats] = field(default_factory=dict)

    def ends(self, synapse: int) -> tuple[int, int]:
        """Source and target of one synapse."""
        match self.layout:
            case "one_to_one":
                return synapse, synapse
            case "dense":
                pre, post = divmod(synapse, self.listed[0][1])
                return pre, post
        return int(np.searchsorted(self.row_ends, synapse, side="right")) - 1, int(self.targets[synapse])

    def pairs(self, n_post: int) -> Iterator[tuple[Ints, NDArray[np.integer]]]:
        """Source and target of all synapses but those of a grid, in order, a piece at a time."""
        for first, last in blocks(0, self.size, BLOCK):
            synapses = np.arange(first, last)
            match self.layout:
                case "one_to_one":
                    yield synapses, synapses
                case "dense":
                    yield synapses // n_post, synapses % n_post
                case _:
                    pre = np.searchsorted(self.row_ends, synapses, side="right") - 1
                    yield pre, self.targets[first:last]


def expected_synapses(rule: Rule, n_pre: int, n_post: int) -> int:
    """Return how many synapses a rule makes in the mean; 0 where the number does not follow from the sizes."""
    if isinstance(rule, pairwise_bernoulli):
        return round(rule.p * n_pre * n_post)
    if isinstance(rule, fixed_total_number):
        return rule.n
    return (isinstance(rule, NamedRule) and rule.synapses(n_pre, n_post, False)) or 0


def listed_one_by_one(found: Connections, n_pre: int, n_post: int) -> Connections:
    """The same synapses with a target each."""
    match found.layout:
        case "one_to_one":
            row_ends, targets = np.arange(n_pre + 1), np.arange(n_pre, dtype=np.int32)
        case "dense":
            row_ends, targets = np.arange(n_pre + 1) * n_post, np.tile(np.arange(n_post, dtype=np.int32), n_pre)
        case _:
            return found
    return replace(found, layout="csr", row_ends=row_ends, targets=targets)


def _is_same(own: Ints | None, n_post: int) -> bool:
    """Whether sources and targets are the same neurons in the same order."""
    return own is not None and np.array_equal(own, np.arange(n_post))


def _own_pairs(rule: Rule, source: Shape, target: Shape, same: bool, rng: np.random.Generator) -> tuple[Ints, Ints]:
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


def _rows(row_ends: Ints, targets: NDArray[np.int32]) -> Connections:
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
    return Connections("csr", pre.size, _ends(pre, n_pre), post.astype(np.int32), pre * n_post + post, shapes)


def _turned(own: Ints | None, n_post: int) -> Ints | None:
    """Of each target its place among the sources, from that of each source among the targets."""
    if own is None:
        return None
    places = np.full(n_post, -1, dtype=np.int64)
    places[own[own >= 0]] = np.flatnonzero(own >= 0)
    return places


def _draw(
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
    return _rows(np.concatenate(([0], np.cumsum(numbers))), (place - pre * among).astype(np.int32))


def _by_source(sources: NDArray[np.int32], n_pre: int) -> Connections:
    """Sort (target, its sources) by source; a transposition, in which targets stay ascending."""
    from scipy.sparse import csc_array

    n_post, n = sources.shape
    flat = sources.reshape(-1)
    ends = np.arange(n_post + 1, dtype=np.int64) * n
    if flat.size < 2**31 - 1:
        ends = ends.astype(np.int32)
    # A transposition sorts by counting; an argsort of as many pairs takes several times as long.
    table = csc_array((np.zeros(flat.size, dtype=np.int8), flat, ends), shape=(n_pre, n_post)).tocsr()
    return _rows(table.indptr.astype(np.int64), table.indices.astype(np.int32, copy=False))


def _bernoulli(p: float, n_pre: int, n_post: int, but: Ints | None, rng: np.random.Generator) -> Connections:
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
    return _rows(np.cumsum(np.concatenate(degrees), dtype=np.int64), np.concatenate(targets))


def _both_ways(pre: Ints, post: Ints, n: int) -> Connections:
    """Each pair and its reverse, which take the same draw of a weight."""
    place = np.concatenate((pre * n + post, post * n + pre))
    order = np.argsort(place, kind="stable")
    sources, targets = np.divmod(place[order], n)
    row_ends = _ends(sources, n)
    return Connections("csr", len(place), row_ends, targets.astype(np.int32), shared=order % max(len(pre), 1))


def _ends(pre: NDArray[np.integer[Any]], n_pre: int) -> Ints:
    """Where the synapses of each source end, from those of all synapses."""
    return np.concatenate(([0], np.cumsum(np.bincount(pre, minlength=n_pre)))).astype(np.int64)


def _listed(pre: Ints, post: Ints, n_pre: int, n_post: int, name: str) -> Connections:
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
    return Connections("csr", len(targets), _ends(pre, n_pre), targets, order, ((len(targets),),), factors=sorted_)


LEAST = 1 << 22
"""Synapses that a block has at least, in the mean."""

LEAST_OF_SOURCE = 16
"""Synapses that a source has at least in a block, in the mean: each block has a table of its sources."""

Key = tuple[int, str, str]


@dataclass(frozen=True, slots=True)
class Block:
    """Targets first, ..., end - 1 of a rule; `index` is its place among the blocks."""

    index: int
    first: int
    end: int

    def key(self, key: Key) -> Key:
        """The key of its draws; the first block has that of an undivided projection."""
        seed, purpose, name = key
        return seed, f"{purpose} {self.index}" if self.index else purpose, name


@dataclass(frozen=True, eq=False)
class Blocks:
    """The synapses that a rule makes, block by block.

    Args:
        rule: the rule.
        source: shape of the source.
        target: shape of the target.
        own: of each source its place among the targets, -1 where it is none of them; None where the two are of
            different populations, so that there are no autapses.
        sizes: of a grid.
        key: of the draws, see `keyed_random`.
        apart: gives what lies between neurons, for rules that ask.
    """

    rule: Rule
    source: Shape
    target: Shape
    own: Ints | None
    sizes: Grid | None
    key: Key
    apart: Apart

    @cached_property
    def all(self) -> tuple[Block, ...]:
        """The blocks in order; one where the rule lists its pairs, or draws them together."""
        n_post = size(self.target)
        number = int(self._expected() // max(LEAST, LEAST_OF_SOURCE * size(self.source)))
        number = max(1, min(number, n_post))
        ends = [n_post * k // number for k in range(number + 1)]
        return tuple(Block(k, ends[k], ends[k + 1]) for k in range(number))

    def _expected(self) -> float:
        """How many synapses there are in the mean, if they can be drawn by blocks."""
        n_pre, n_post = size(self.source), size(self.target)
        if isinstance(self.rule, distance_dependent) and n_pre * n_post >= LEAST:
            return expected_pairs(self.rule, self.apart())
        return expected_synapses(self.rule, n_pre, n_post)

    def whole(self, room: NDArray[np.int32] | None = None, first: int = 0) -> Connections:
        """Return all synapses, undivided.

        Args:
            room: memory for the targets of all synapses, which may be used.
            first: of draws that belong to pairs: which target of the projection the first one is.

        Raises:
            ModelError: the rule does not fit the sizes.
        """
        rule, own, sizes = self.rule, self.own, self.sizes
        n_pre, n_post = size(self.source), size(self.target)
        rng, draws = generator(*self.key), key_of(*self.key)
        but = None if getattr(rule, "autapses", True) else own
        match rule:
            case one_to_one():
                if n_pre != n_post:
                    message = f"one_to_one from {n_pre} to {n_post} neurons: expected populations of equal size"
                    raise ModelError(message, hint="all_to_all connects populations of any size", path=(rule.name,))
                return Connections("one_to_one", n_pre, listed=((n_pre,),))
            case all_to_all():
                if but is not None:
                    return all_onto(n_pre, n_post, but, 0, n_post)
                return Connections("dense", n_pre * n_post, listed=((n_pre, n_post), (n_pre * n_post,)))
            case fixed_indegree():
                drawn = _draw(rule.n, n_post, n_pre, _turned(but, n_post), rule.multapses, rng, "sources")
                return _by_source(drawn, n_pre)
            case fixed_outdegree():
                drawn = _draw(rule.n, n_pre, n_post, but, rule.multapses, rng, "targets")
                # Ascending targets in each row: threads own ranges of targets, and caches like neighbours.
                drawn.sort(axis=1)
                return _rows(np.arange(n_pre + 1, dtype=np.int64) * rule.n, drawn.reshape(-1))
            case fixed_total_number():
                return _rows(*total_number(rule.n, n_pre, n_post, but, rule.multapses, draws, room))
            case symmetric_pairwise_bernoulli():
                if not _is_same(own, n_post):
                    message = f"{rule.name} between different neurons: expected one population, or view"
                    hint = "pairwise_bernoulli connects one population with another"
                    raise ModelError(f"{message}, connected with itself", hint=hint, path=(rule.name,))
                return _both_ways(*bernoulli_pairs(rule.p, n_pre, draws), n_pre)
            case distance_dependent():
                degrees, targets = np.zeros(n_pre, dtype=np.int64), [NO_TARGETS]
                for pre, post in distant_pairs(rule, self.apart(), but, draws, first):
                    degrees += np.bincount(pre, minlength=n_pre)
                    targets.append(post)
                return _rows(np.concatenate(([0], np.cumsum(degrees))), np.concatenate(targets))
            case pairwise_bernoulli():
                return _bernoulli(rule.p, n_pre, n_post, but, rng)
            case pairs():
                return _listed(rule.pre, rule.post, n_pre, n_post, "pairs")
            case grid():
                assert sizes is not None
                shape = sizes.kernels
                n = int(np.prod(shape))
                flat = ((shape[0], *shape[2:]),) if shape[1] == 1 else ()
                return Connections("grid", n, listed=(shape, (n,), *flat))
        # None of ours: a third-party rule.
        same = _is_same(own, n_post)
        return _listed(*_own_pairs(rule, self.source, self.target, same, rng), n_pre, n_post, rule.name)

    def connect(self, block: Block) -> Connections:
        """The synapses onto the targets of a block, one of several.

        Raises:
            ModelError: the rule does not fit the sizes.
        """
        rule, first, end = self.rule, block.first, block.end
        n_pre, n_post, width = size(self.source), size(self.target), end - first
        own = self.own
        if own is not None:
            own = np.where((own >= first) & (own < end), own - first, -1)
        but = None if getattr(rule, "autapses", True) else own
        part = replace(self, target=(width,), own=own, key=block.key(self.key))
        match rule:
            case one_to_one():
                self.whole()  # refuses what does not fit
                return one_onto(n_pre, first, end)
            case all_to_all():
                return all_onto(n_pre, n_post, None if rule.autapses else self.own, first, end)
            case fixed_outdegree():
                degrees = self._degrees[block.index].astype(np.int64)
                return _moved(drawn_rows(degrees, width, but, rule.multapses, generator(*part.key)), first)
            case fixed_total_number():
                part = replace(part, rule=replace(rule, n=int(self._numbers[block.index])))
            case distance_dependent():
                # A draw belongs to its pair, so it is of no block.
                within = np.arange(first, end)
                part = replace(part, key=self.key, apart=lambda: self.apart().among(None, within))
                return _moved(part.whole(first=first), first)
        return _moved(part.whole(), first)

    @cached_property
    def _numbers(self) -> Ints:
        """Of a total number the synapses of each block."""
        rule = self.rule
        assert isinstance(rule, fixed_total_number)
        but = None if rule.autapses else self.own
        n_pre = size(self.source)
        pairs = np.array([n_pre * (block.end - block.first) for block in self.all])
        if but is not None:
            ends = [block.end for block in self.all]
            pairs -= np.bincount(np.searchsorted(ends, but[but >= 0], side="right"), minlength=len(ends))
        check_number(rule.n, int(pairs.sum()), rule.multapses)
        return shares(rule.n, pairs, rule.multapses, generator(*self._of_numbers))

    @cached_property
    def _degrees(self) -> list[NDArray[np.int32]]:
        """Of an out-degree the synapses of each source in each block."""
        rule = self.rule
        assert isinstance(rule, fixed_outdegree)
        but = None if rule.autapses else self.own
        left, room = np.full(size(self.source), rule.n), choices(size(self.source), size(self.target), but)
        check_degree(rule.n, int(room.min()), rule.multapses, "targets")
        rng = generator(*self._of_numbers)
        found: list[NDArray[np.int32]] = []
        for block in self.all:
            here = np.full(left.size, block.end - block.first)
            if but is not None:
                here -= (but >= block.first) & (but < block.end)
            if rule.multapses:
                number = rng.binomial(left, here / np.maximum(room, 1))
            else:
                number = rng.hypergeometric(here, room - here, left)
            left, room = left - number, room - here
            found.append(number.astype(np.int32))
        return found

    @property
    def _of_numbers(self) -> Key:
        seed, purpose, name = self.key
        return seed, f"{purpose} numbers", name


def one_onto(n: int, first: int, end: int) -> Connections:
    """Neuron i to neuron i for a range of targets, listed one by one."""
    targets = np.arange(first, end, dtype=np.int32)
    row_ends = np.clip(np.arange(n + 1), first, end) - first
    return Connections("csr", end - first, row_ends, targets, targets.astype(np.int64), ((n,),))


def _moved(found: Connections, first: int) -> Connections:
    """The same synapses onto as many later targets."""
    found.targets[:] += np.int32(first)
    return found
