"""Blocks of targets, whose synapses are drawn from streams of their own: each alone, in any order, by anyone.

A block is drawn as if its targets were all that the rule sees. What binds the blocks of a projection, how many
synapses each has, is drawn before, from one more stream.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from neuro.compiler.connect import Apart, Connections, all_onto, check_degree, connect, drawn_rows, expected_synapses
from neuro.compiler.drawn import check_number, choices, shares
from neuro.compiler.shapes import Shape, size
from neuro.compiler.space import expected_pairs
from neuro.core.keyed_random import generator
from neuro.model.rules import (
    Rule,
    all_to_all,
    distance_dependent,
    fixed_outdegree,
    fixed_total_number,
    one_to_one,
)
from neuro.program.program import Grid, Ints

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
    """The synapses that a rule makes, block by block; arguments as of `connect`."""

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
        key, apart = block.key(self.key), self.apart
        match rule:
            case one_to_one():
                connect(rule, self.source, self.target, None, None, key, apart)  # refuses what does not fit
                return one_onto(n_pre, first, end)
            case all_to_all():
                return all_onto(n_pre, n_post, None if rule.autapses else self.own, first, end)
            case fixed_outdegree():
                degrees = self._degrees[block.index].astype(np.int64)
                found = drawn_rows(degrees, width, but, rule.multapses, generator(*key))
                return _moved(found, first)
            case fixed_total_number():
                rule = replace(rule, n=int(self._numbers[block.index]))
            case distance_dependent():
                # A draw belongs to its pair, so it is of no block.
                key, within = self.key, np.arange(first, end)
                return _moved(
                    connect(
                        rule,
                        self.source,
                        (width,),
                        own,
                        None,
                        key,
                        lambda: self.apart().among(None, within),
                        first=first,
                    ),
                    first,
                )
        return _moved(connect(rule, self.source, (width,), own, None, key, apart), first)

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
