"""Synapses made by connection rules, as arrays sorted by source, then target, undivided or in blocks."""

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
    inverted,
    is_same,
    listed_pairs,
    one_onto,
    pairs_of_rule,
    shifted,
)
from neuro.compiler.pairs import (
    Geometry,
    bernoulli_pairs,
    check_number,
    choices,
    distant_pairs,
    expected_pairs,
    synapses_per_block,
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

GetGeometry: TypeAlias = Callable[[], Geometry]


def expected_synapses(rule: Rule, n_pre: int, n_post: int) -> int:
    """Return the expected number of synapses of a rule.

    The result is 0 if the number does not follow from the sizes.
    """
    if isinstance(rule, pairwise_bernoulli):
        return round(rule.p * n_pre * n_post)
    if isinstance(rule, fixed_total_number):
        return rule.n
    return (isinstance(rule, NamedRule) and rule.synapses(n_pre, n_post, False)) or 0


LEAST = 1 << 22
"""Smallest expected number of synapses of a block."""

LEAST_OF_SOURCE = 16
"""Smallest expected number of synapses of a source in a block. Fewer are not worth a block's table of sources."""

Key = tuple[int, str, str]


@dataclass(frozen=True, slots=True)
class Block:
    """Targets first, ..., end - 1 of a rule; `index` counts the blocks."""

    index: int
    first: int
    end: int

    def key(self, key: Key) -> Key:
        """Return the key for the draws of the block. The key of the first block is that of an undivided projection."""
        seed, purpose, name = key
        return seed, f"{purpose} {self.index}" if self.index else purpose, name


@dataclass(frozen=True, eq=False)
class Blocks:
    """Synapses made by a rule, block by block.

    Args:
        rule: the rule.
        source: shape of the source.
        target: shape of the target.
        target_index: index of each source neuron among the targets, -1 for other neurons. None between different
            populations, which have no autapses.
        sizes: sizes of a grid.
        key: key of the draws, see `keyed_random`.
        get_geometry: function that returns the distances between neurons, for rules that need distances.
    """

    rule: Rule
    source: Shape
    target: Shape
    target_index: Ints | None
    sizes: Grid | None
    key: Key
    get_geometry: GetGeometry

    @cached_property
    def all(self) -> tuple[Block, ...]:
        """The blocks in order. Rules that list pairs, or draw all pairs together, have a single block."""
        n_post = size(self.target)
        number = int(self._expected() // max(LEAST, LEAST_OF_SOURCE * size(self.source)))
        number = max(1, min(number, n_post))
        ends = [n_post * k // number for k in range(number + 1)]
        return tuple(Block(k, ends[k], ends[k + 1]) for k in range(number))

    def _expected(self) -> float:
        """Return the expected number of synapses for a rule that can be drawn in blocks, else 0."""
        n_pre, n_post = size(self.source), size(self.target)
        if isinstance(self.rule, distance_dependent) and n_pre * n_post >= LEAST:
            return expected_pairs(self.rule, self.get_geometry())
        return expected_synapses(self.rule, n_pre, n_post)

    def whole(self, buffer: NDArray[np.int32] | None = None, first: int = 0) -> Connections:
        """Return all synapses, undivided.

        Args:
            buffer: memory that may be used for the targets of all synapses.
            first: index of the first target in the projection, for draws with a key per pair.

        Raises:
            ModelError: the rule does not fit the sizes.
        """
        rule, target_index, sizes = self.rule, self.target_index, self.sizes
        n_pre, n_post = size(self.source), size(self.target)
        rng, draws = generator(*self.key), key_of(*self.key)
        excluded = None if getattr(rule, "autapses", True) else target_index
        match rule:
            case one_to_one():
                if n_pre != n_post:
                    message = f"one_to_one from {n_pre} to {n_post} neurons: expected populations of equal size"
                    raise ModelError(message, hint="all_to_all connects populations of any size", path=(rule.name,))
                return Connections("one_to_one", n_pre, weight_shapes=((n_pre,),))
            case all_to_all():
                if excluded is not None:
                    return all_onto(n_pre, n_post, excluded, 0, n_post)
                return Connections("dense", n_pre * n_post, weight_shapes=((n_pre, n_post), (n_pre * n_post,)))
            case fixed_indegree():
                partners = draw_partners(
                    rule.n, n_post, n_pre, inverted(excluded, n_post), rule.multapses, rng, "sources"
                )
                return by_source(partners, n_pre)
            case fixed_outdegree():
                partners = draw_partners(rule.n, n_pre, n_post, excluded, rule.multapses, rng, "targets")
                # Ascending targets in each row, since threads own ranges of targets, and neighbours share cache lines.
                partners.sort(axis=1)
                return in_rows(np.arange(n_pre + 1, dtype=np.int64) * rule.n, partners.reshape(-1))
            case fixed_total_number():
                return in_rows(*total_number(rule.n, n_pre, n_post, excluded, rule.multapses, draws, buffer))
            case symmetric_pairwise_bernoulli():
                if not is_same(target_index, n_post):
                    message = f"{rule.name} between different neurons: expected one population, or view"
                    hint = "pairwise_bernoulli connects one population with another"
                    raise ModelError(f"{message}, connected with itself", hint=hint, path=(rule.name,))
                return both_ways(*bernoulli_pairs(rule.p, n_pre, draws), n_pre)
            case distance_dependent():
                degrees, targets = np.zeros(n_pre, dtype=np.int64), [NO_TARGETS]
                for pre, post in distant_pairs(rule, self.get_geometry(), excluded, draws, first):
                    degrees += np.bincount(pre, minlength=n_pre)
                    targets.append(post)
                return in_rows(np.concatenate(([0], np.cumsum(degrees))), np.concatenate(targets))
            case pairwise_bernoulli():
                return bernoulli(rule.p, n_pre, n_post, excluded, rng)
            case pairs():
                return listed_pairs(rule.pre, rule.post, n_pre, n_post, "pairs")
            case grid():
                assert sizes is not None
                shape = sizes.kernels
                n = int(np.prod(shape))
                flat = ((shape[0], *shape[2:]),) if shape[1] == 1 else ()
                return Connections("grid", n, weight_shapes=(shape, (n,), *flat))
        # A third-party rule.
        same = is_same(target_index, n_post)
        return listed_pairs(*pairs_of_rule(rule, self.source, self.target, same, rng), n_pre, n_post, rule.name)

    def connect(self, block: Block) -> Connections:
        """Return the synapses onto the targets of one of several blocks.

        Raises:
            ModelError: the rule does not fit the sizes.
        """
        rule, first, end = self.rule, block.first, block.end
        n_pre, n_post, width = size(self.source), size(self.target), end - first
        target_index = self.target_index
        if target_index is not None:
            target_index = np.where((target_index >= first) & (target_index < end), target_index - first, -1)
        excluded = None if getattr(rule, "autapses", True) else target_index
        part = replace(self, target=(width,), target_index=target_index, key=block.key(self.key))
        match rule:
            case one_to_one():
                self.whole()  # raises an error if the sizes differ
                return one_onto(n_pre, first, end)
            case all_to_all():
                return all_onto(n_pre, n_post, None if rule.autapses else self.target_index, first, end)
            case fixed_outdegree():
                degrees = self._degrees[block.index].astype(np.int64)
                return shifted(drawn_rows(degrees, width, excluded, rule.multapses, generator(*part.key)), first)
            case fixed_total_number():
                part = replace(part, rule=replace(rule, n=int(self._numbers[block.index])))
            case distance_dependent():
                # Each pair has a key for the draw, independent of the block.
                within = np.arange(first, end)
                part = replace(part, key=self.key, get_geometry=lambda: self.get_geometry().subset(None, within))
                return shifted(part.whole(first=first), first)
        return shifted(part.whole(), first)

    @cached_property
    def _numbers(self) -> Ints:
        """Numbers of synapses in each block, for a rule with a total number."""
        rule = self.rule
        assert isinstance(rule, fixed_total_number)
        excluded = None if rule.autapses else self.target_index
        n_pre = size(self.source)
        pairs = np.array([n_pre * (block.end - block.first) for block in self.all])
        if excluded is not None:
            ends = [block.end for block in self.all]
            pairs -= np.bincount(np.searchsorted(ends, excluded[excluded >= 0], side="right"), minlength=len(ends))
        check_number(rule.n, int(pairs.sum()), rule.multapses)
        return synapses_per_block(rule.n, pairs, rule.multapses, generator(*self._key_of_numbers))

    @cached_property
    def _degrees(self) -> list[NDArray[np.int32]]:
        """Numbers of synapses of each source in each block, for a rule with an out-degree."""
        rule = self.rule
        assert isinstance(rule, fixed_outdegree)
        excluded = None if rule.autapses else self.target_index
        remaining, targets_left = (
            np.full(size(self.source), rule.n),
            choices(size(self.source), size(self.target), excluded),
        )
        check_degree(rule.n, int(targets_left.min()), rule.multapses, "targets")
        rng = generator(*self._key_of_numbers)
        degrees: list[NDArray[np.int32]] = []
        for block in self.all:
            targets_here = np.full(remaining.size, block.end - block.first)
            if excluded is not None:
                targets_here -= (excluded >= block.first) & (excluded < block.end)
            if rule.multapses:
                number = rng.binomial(remaining, targets_here / np.maximum(targets_left, 1))
            else:
                number = rng.hypergeometric(targets_here, targets_left - targets_here, remaining)
            remaining, targets_left = remaining - number, targets_left - targets_here
            degrees.append(number.astype(np.int32))
        return degrees

    @property
    def _key_of_numbers(self) -> Key:
        seed, purpose, name = self.key
        return seed, f"{purpose} numbers", name
