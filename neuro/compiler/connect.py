"""Connection rules as arrays: the synapses that exist, by source, then target, whole or in blocks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from neuro.compiler.connections import NO_TARGETS, Connections
from neuro.compiler.draws import (
    all_onto,
    bernoulli,
    both_ways,
    by_source,
    check_degree,
    draw_partners,
    drawn_rows,
    in_rows,
    is_same,
    listed_pairs,
    moved,
    one_onto,
    own_pairs,
    turned,
)
from neuro.compiler.pairs import (
    Between,
    bernoulli_pairs,
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
from neuro.program.program import Grid, Ints

Apart: TypeAlias = Callable[[], Between]


def expected_synapses(rule: Rule, n_pre: int, n_post: int) -> int:
    """Return how many synapses a rule makes in the mean; 0 where the number does not follow from the sizes."""
    if isinstance(rule, pairwise_bernoulli):
        return round(rule.p * n_pre * n_post)
    if isinstance(rule, fixed_total_number):
        return rule.n
    return (isinstance(rule, NamedRule) and rule.synapses(n_pre, n_post, False)) or 0


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
                drawn = draw_partners(rule.n, n_post, n_pre, turned(but, n_post), rule.multapses, rng, "sources")
                return by_source(drawn, n_pre)
            case fixed_outdegree():
                drawn = draw_partners(rule.n, n_pre, n_post, but, rule.multapses, rng, "targets")
                # Ascending targets in each row: threads own ranges of targets, and caches like neighbours.
                drawn.sort(axis=1)
                return in_rows(np.arange(n_pre + 1, dtype=np.int64) * rule.n, drawn.reshape(-1))
            case fixed_total_number():
                return in_rows(*total_number(rule.n, n_pre, n_post, but, rule.multapses, draws, room))
            case symmetric_pairwise_bernoulli():
                if not is_same(own, n_post):
                    message = f"{rule.name} between different neurons: expected one population, or view"
                    hint = "pairwise_bernoulli connects one population with another"
                    raise ModelError(f"{message}, connected with itself", hint=hint, path=(rule.name,))
                return both_ways(*bernoulli_pairs(rule.p, n_pre, draws), n_pre)
            case distance_dependent():
                degrees, targets = np.zeros(n_pre, dtype=np.int64), [NO_TARGETS]
                for pre, post in distant_pairs(rule, self.apart(), but, draws, first):
                    degrees += np.bincount(pre, minlength=n_pre)
                    targets.append(post)
                return in_rows(np.concatenate(([0], np.cumsum(degrees))), np.concatenate(targets))
            case pairwise_bernoulli():
                return bernoulli(rule.p, n_pre, n_post, but, rng)
            case pairs():
                return listed_pairs(rule.pre, rule.post, n_pre, n_post, "pairs")
            case grid():
                assert sizes is not None
                shape = sizes.kernels
                n = int(np.prod(shape))
                flat = ((shape[0], *shape[2:]),) if shape[1] == 1 else ()
                return Connections("grid", n, listed=(shape, (n,), *flat))
        # None of ours: a third-party rule.
        same = is_same(own, n_post)
        return listed_pairs(*own_pairs(rule, self.source, self.target, same, rng), n_pre, n_post, rule.name)

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
                return moved(drawn_rows(degrees, width, but, rule.multapses, generator(*part.key)), first)
            case fixed_total_number():
                part = replace(part, rule=replace(rule, n=int(self._numbers[block.index])))
            case distance_dependent():
                # A draw belongs to its pair, so it is of no block.
                within = np.arange(first, end)
                part = replace(part, key=self.key, apart=lambda: self.apart().among(None, within))
                return moved(part.whole(first=first), first)
        return moved(part.whole(), first)

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
