"""Random pairs of neurons, and the positions of neurons for draws that depend on distance."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import chain

import numpy as np
from numpy.typing import NDArray

from neuro.core.errors import ModelError
from neuro.core.keyed_random import uniform, uniform_pairs, uniform_table
from neuro.core.values import plain
from neuro.model.parts import Population, refuse
from neuro.model.rules import distance_dependent
from neuro.model.space import Profile
from neuro.program.program import Floats, Ints

BLOCK = 1 << 16
"""Number of draws in a batch. It is small compared with the number of synapses."""

MANY = 1 << 20
"""Number of synapses above which compiled passes sort a projection, and a network is sorted by delay."""


def total_number(
    n: int,
    n_pre: int,
    n_post: int,
    excluded: Ints | None,
    repeats: bool,
    key: int,
    buffer: NDArray[np.int32] | None = None,
) -> tuple[Ints, NDArray[np.int32]]:
    """Draw a pair of neurons for each of n synapses. Return the row ends of the sources, and the targets.

    Args:
        n: number of synapses.
        n_pre: neurons of the source.
        n_post: neurons of the target.
        excluded: the target that each source must not reach, -1 for none; None: none for any source.
        repeats: whether a pair may be drawn twice.
        key: key of the draws.
        buffer: memory that may be used for the targets.

    Raises:
        ModelError: there are fewer pairs than synapses.
    """
    ends = np.concatenate(([0], np.cumsum(choices(n_pre, n_post, excluded))))
    pairs = int(ends[-1])
    check_number(n, pairs, repeats)
    if repeats and n >= MANY // 2:
        from neuro.compiler.rows import draw_rows

        targets = np.empty(n, dtype=np.int32) if buffer is None else buffer
        return draw_rows(key, ends, excluded, targets), targets
    # Pairs are numbered by source, then target, without excluded pairs: sorted numbers are sorted pairs.
    places = _integers_below(pairs, 0, n, key) if repeats else _distinct(n, pairs, key)
    places.sort()
    row_ends = np.searchsorted(places, ends)
    pre = np.repeat(np.arange(n_pre), np.diff(row_ends))
    post = places - ends[pre]
    if excluded is not None:  # targets from the excluded one on have been numbered one too low
        post += (excluded[pre] >= 0) & (post >= excluded[pre])
    return row_ends, post.astype(np.int32)


def choices(n_pre: int, n_post: int, excluded: Ints | None) -> Ints:
    """Return the number of allowed targets of each source."""
    return np.full(n_pre, n_post) if excluded is None else n_post - (excluded >= 0)


def check_number(n: int, pairs: int, repeats: bool) -> None:
    """Refuse more synapses than pairs.

    Raises:
        ModelError: there are fewer pairs than synapses.
    """
    if n and (pairs < 1 or (not repeats and n > pairs)):
        hint = "multapses: true allows a pair to be drawn twice" if pairs > 0 else ""
        message = f"n = {n} synapses: expected at most {pairs}, the number of pairs"
        raise ModelError(message, hint=hint, path=("n",), about=("multapses",))


def synapses_per_block(n: int, pairs: Ints, repeats: bool, rng: np.random.Generator) -> Ints:
    """Draw the number of synapses in each block, n in total, from the number of pairs in each block.

    The distribution is multinomial; without repeats it is hypergeometric.
    """
    total = int(pairs.sum())
    if repeats:
        return rng.multinomial(n, pairs / total)
    # Each pair is chosen with the probability n / total. Then single pairs are added or removed at random until n pairs
    # are chosen: every set of n pairs has the same probability. NumPy's hypergeometric draws end at 10^9 pairs.
    chosen = rng.binomial(pairs, n / total)
    while missing := n - int(chosen.sum()):
        pool = pairs - chosen if missing > 0 else chosen
        chosen[np.searchsorted(np.cumsum(pool), rng.integers(pool.sum()), side="right")] += np.sign(missing)
    return chosen


def _integers_below(bound: int, first: int, last: int, key: int) -> Ints:
    """Return the numbers with index first to last - 1 of a random sequence of whole numbers below a bound."""
    numbers = np.empty(last - first, dtype=np.int64)
    for begin, end in blocks(first, last, BLOCK):
        numbers[begin - first : end - first] = uniform(key, 0, np.arange(begin, end)) * bound
    return numbers


def _distinct(count: int, bound: int, key: int) -> Ints:
    """Return the first `count` different numbers of the sequence of `_integers_below`.

    If `count` is more than half of `bound`, the numbers to leave out are drawn instead, and the others are returned.
    """
    # Few numbers are drawn quickly. To draw nearly all numbers, repeated numbers would have to be redrawn very often.
    if 2 * count > bound:
        remain = np.ones(bound, dtype=bool)
        remain[_distinct(bound - count, bound, key)] = False
        return np.flatnonzero(remain)
    numbers, n_drawn = _integers_below(bound, 0, count, key), count
    while True:
        # All batches continue one sequence, so that the result does not depend on the size of batches.
        _, first = np.unique(numbers, return_index=True)
        if first.size == count:
            return numbers
        first.sort()
        missing = count - first.size
        numbers = np.concatenate((numbers[first], _integers_below(bound, n_drawn, n_drawn + missing, key)))
        n_drawn += missing


def bernoulli_pairs(p: float, n: int, key: int) -> tuple[Ints, Ints]:
    """Draw each pair (i, j), i != j, of n neurons with probability p; return the pairs in order."""
    drawn_pre, drawn_post = [], []
    for first, last in blocks(0, n, max(1, BLOCK // n)):
        is_connected = uniform_table(key, np.arange(first, last), n) < p
        is_connected[np.arange(last - first), np.arange(first, last)] = False
        pre, post = np.nonzero(is_connected)
        drawn_pre.append(pre + first)
        drawn_post.append(post)
    return np.concatenate(drawn_pre), np.concatenate(drawn_post)


def blocks(first: int, last: int, length: int) -> Iterator[tuple[int, int]]:
    """Yield the bounds of pieces of a range."""
    for begin in range(first, last, length):
        yield begin, min(begin + length, last)


MOST_AXES = 3

_SAMPLE, _PAIRS = 256, 1 << 21
"""Number of sources, and largest number of pairs, in a sample that estimates the number of connected pairs."""


@dataclass(frozen=True, eq=False)
class Space:
    """The positions of neurons.

    Attributes:
        places: coordinates, shape (neurons, axes).
        extent: length of each axis; None if unknown.
        periodic: whether opposite edges are joined.
        lattice: shape of a population whose positions follow from its shape alone, with a spacing of 1; else None.
    """

    places: Floats
    extent: Floats | None
    periodic: bool
    lattice: tuple[int, ...] | None

    @property
    def periods(self) -> Floats:
        """Period of each axis, 0 for an axis with edges."""
        if self.periodic and self.extent is not None:
            return np.asarray(self.extent)
        return np.zeros(self.places.shape[1])


def space_of(part: Population, shape: tuple[int, ...]) -> Space:
    """Return the positions of the neurons of a population.

    Raises:
        ModelError: the population has no positions, or they do not fit its shape or extent.
    """
    message = f"population '{part.name}'"
    extent: Floats | None = None if part.extent is None else plain(part.extent)
    if part.positions is not None:
        return _space_from_positions(part, np.asarray(plain(part.positions)), extent, math.prod(shape))
    if len(shape) > MOST_AXES:
        raise ModelError(
            f"{message} has no positions: its shape {list(shape)} has {len(shape)} axes: expected at most {MOST_AXES}",
            where=part.origin,
            hint="give it 'positions'",
        )
    if len(shape) == 1 and extent is None:
        text = f"{message} has no positions: its shape is a number of neurons"
        hint = f"give it 'positions', a shape of several axes, or the 'extent' of a line, e.g. [{shape[0]}.0]"
        raise ModelError(text, where=part.origin, hint=hint)
    if extent is not None and extent.shape != (len(shape),):
        text = f"extent = {extent.tolist()}: expected {len(shape)} numbers, one for each axis of its shape"
        refuse(part, text)
    length = np.array(shape, dtype=np.float64) if extent is None else extent
    axes = [(np.arange(n) + 0.5 - 0.5 * n) * (size / n) for n, size in zip(shape, length, strict=True)]
    places = np.stack([axis.reshape(-1) for axis in np.meshgrid(*axes, indexing="ij")], axis=1)
    return Space(places, length, part.periodic, shape if extent is None else None)


def _space_from_positions(part: Population, places: Floats, extent: Floats | None, n: int) -> Space:
    places = places[:, None] if places.ndim == 1 else places
    if places.ndim != 2 or places.shape[0] != n or not 1 <= places.shape[1] <= MOST_AXES:
        text = f"positions have the shape {list(places.shape)}: expected [{n}, 1 to {MOST_AXES}], a row for each neuron"
        refuse(part, text)
    if extent is not None and extent.shape != places.shape[1:]:
        refuse(part, f"positions have {places.shape[1]} coordinates, extent {extent.size}: expected equal numbers")
    if part.periodic and extent is None:
        refuse(part, "positions with periodic edges: expected 'extent', the length of each axis")
    if extent is not None and np.any(np.ptp(places, axis=0) > extent):
        axis = int(np.flatnonzero(np.ptp(places, axis=0) > extent)[0])
        text = f"positions span {np.ptp(places[:, axis]):g} on axis {axis}"
        refuse(part, f"{text}: expected at most its extent, {extent[axis]:g}")
    return Space(places, extent, part.periodic, None)


@dataclass(frozen=True, eq=False)
class Geometry:
    """The positions of the neurons of two populations, and the distances between them."""

    source: Space
    target: Space

    def subset(self, pre: Ints | None, post: Ints | None) -> Geometry:
        """Return the geometry of some of the neurons, None: all."""
        ends = [(self.source, pre), (self.target, post)]
        return Geometry(*(end if ids is None else replace(end, places=end.places[ids]) for end, ids in ends))

    def displacement(self, pre: Ints, post: NDArray[np.integer]) -> Floats:
        """Return the shortest vector from each source to its target; shape (axes, pairs)."""
        vectors = np.empty((len(self.source.periods), len(pre)))
        for component, begin, end, period in zip(
            vectors, self.source.places.T, self.target.places.T, self.source.periods, strict=True
        ):
            np.subtract(end[post], begin[pre], out=component)
            if period:
                component -= period * np.rint(component / period)
        return vectors

    def distance(self, pre: Ints, post: NDArray[np.integer]) -> Floats:
        """Return the distance of each pair."""
        return length(self.displacement(pre, post))

    def pairs_within(self, reach: float) -> Iterator[tuple[Ints, Ints]]:
        """Yield all pairs up to a distance, and perhaps some more, in batches of sources, in order."""
        if not math.isfinite(reach):
            n_post = len(self.target.places)
            for first, last in blocks(0, len(self.source.places), max(1, BLOCK // n_post)):
                yield np.repeat(np.arange(first, last), n_post), np.tile(np.arange(n_post), last - first)
            return
        from scipy.spatial import cKDTree

        periods = self.source.periods
        tree = cKDTree(_wrapped(self.target.places, periods), boxsize=periods)
        places, radius = _wrapped(self.source.places, periods), reach * (1.0 + 1e-6)
        counts = tree.query_ball_point(places, radius, return_length=True)
        ends = np.cumsum(counts)
        first = 0
        while first < len(places):
            before = ends[first - 1] if first else 0
            last = max(first + 1, int(np.searchsorted(ends, before + BLOCK, side="right")))
            neighbours = tree.query_ball_point(places[first:last], radius, return_sorted=True)
            post = np.fromiter(chain.from_iterable(neighbours), np.int64, int(ends[last - 1] - before))
            yield np.repeat(np.arange(first, last), counts[first:last]), post
            first = last


def geometry_of(source: Population, target: Population, shapes: Mapping[str, tuple[int, ...]]) -> Geometry:
    """Return the geometry of two populations, if their positions are in the same space.

    Raises:
        ModelError: the positions are in different spaces.
    """
    message = f"'{source.name}' and '{target.name}'"
    first, second = (space_of(part, shapes[part.name]) for part in (source, target))
    axes = first.places.shape[1], second.places.shape[1]
    if axes[0] != axes[1]:
        raise ModelError(f"positions of {message} have {axes[0]} and {axes[1]} coordinates: expected equal numbers")
    if first.lattice != second.lattice:
        raise ModelError(
            f"{message} have no common scale: the shape gives one of them a spacing of 1: expected 'extent' of both",
            hint="populations of the same shape need no extent",
        )
    if not np.array_equal(first.periods, second.periods):
        raise ModelError(
            f"{message} have periodic edges of {_edges(first)} and {_edges(second)}: expected equal edges",
        )
    return Geometry(first, second)


def distant_pairs(
    rule: distance_dependent, geometry: Geometry, excluded: Ints | None, key: int, first: int = 0
) -> Iterator[tuple[Ints, NDArray[np.int32]]]:
    """Yield connected pairs, in batches of sources, in order.

    Args:
        rule: the rule with the probability of a pair.
        geometry: positions and distances of the neurons.
        excluded: the target that each source must not reach, -1 for none; None: none for any source.
        key: key of the draws.
        first: index of the first target in the projection.

    Raises:
        ModelError: a probability is not from 0 to 1, or the mask does not fit the space.
    """
    for pre, post, p in _candidates(rule, geometry, excluded):
        is_connected = uniform_pairs(key, pre, post + first) < p
        yield pre[is_connected], post[is_connected].astype(np.int32)


def expected_pairs(rule: distance_dependent, geometry: Geometry) -> float:
    """Estimate the expected number of connected pairs, from a sample of the sources."""
    n = len(geometry.source.places)
    sample = min(_SAMPLE, max(16, _PAIRS // len(geometry.target.places)))
    sources = np.unique(np.linspace(0, n - 1, sample).astype(np.int64))
    candidates = _candidates(rule, geometry.subset(sources, None), None)
    return sum(float(np.sum(np.broadcast_to(p, pre.size))) for pre, _, p in candidates) * n / sources.size


def _candidates(
    rule: distance_dependent, geometry: Geometry, excluded: Ints | None
) -> Iterator[tuple[Ints, Ints, Floats | float]]:
    """Yield candidate pairs and their probabilities of a connection."""
    mask, profile = rule.mask, rule.p
    if mask is not None and (problem := mask.misfit(geometry.source.places.shape[1])):
        raise ModelError(f"distance_dependent.mask: {problem}", path=("distance_dependent", "mask"))
    reach = min(
        mask.reach if mask is not None else math.inf, profile.reach if isinstance(profile, Profile) else math.inf
    )
    for pre, post in geometry.pairs_within(reach):
        displacement = geometry.displacement(pre, post)
        is_candidate = np.ones(len(pre), dtype=bool) if mask is None else mask.inside(displacement)
        if excluded is not None:
            is_candidate &= excluded[pre] != post
        pre, post, distances = pre[is_candidate], post[is_candidate], length(displacement[:, is_candidate])
        yield pre, post, _probability(profile, distances) if isinstance(profile, Profile) else profile


def _probability(profile: Profile, distance: Floats) -> Floats:
    p = profile.values(distance)
    bad = np.flatnonzero((p < 0.0) | (p > 1.0))
    if bad.size:
        message = f"distance_dependent.p is {p[bad[0]]:g} at the distance {distance[bad[0]]:g}: expected 0 to 1"
        hint = "a mask excludes distances where p is not a probability"
        raise ModelError(message, hint=hint, path=("distance_dependent", "p"), about=("mask",))
    return p


def length(displacement: Floats) -> Floats:
    """Return the length of each column."""
    return np.asarray(np.sqrt((displacement**2).sum(axis=0)))


def _wrapped(places: Floats, periods: Floats) -> Floats:
    """Return positions with periodic axes wrapped to [0, period)."""
    places = places.copy()
    for axis in np.flatnonzero(periods):
        column = np.mod(places[:, axis], periods[axis])
        places[:, axis] = np.where(column < periods[axis], column, 0.0)
    return places


def _edges(space: Space) -> str:
    return str(space.periods.tolist()) if np.any(space.periods) else "no length"
