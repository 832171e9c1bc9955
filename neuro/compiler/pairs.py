"""Pairs of neurons drawn at random, and where neurons lie, as far as the draws depend on it."""

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


MOST_AXES = 3

_SAMPLE, _PAIRS = 256, 1 << 21
"""Sources from which it is estimated how many pairs are connected, fewer where these have more pairs than that."""


@dataclass(frozen=True, eq=False)
class Space:
    """The places of neurons.

    Attributes:
        places: coordinates, shape (neurons, axes).
        extent: length of each axis; None where it is unknown.
        periodic: whether what leaves at one edge comes in at the other.
        lattice: the shape from which places follow, where their unit is the spacing; else None.
    """

    places: Floats
    extent: Floats | None
    periodic: bool
    lattice: tuple[int, ...] | None

    @property
    def periods(self) -> Floats:
        """Length after which an axis begins anew, 0 for an axis with edges."""
        if self.periodic and self.extent is not None:
            return np.asarray(self.extent)
        return np.zeros(self.places.shape[1])


def space_of(part: Population, shape: tuple[int, ...]) -> Space:
    """Where the neurons of a population lie.

    Raises:
        ModelError: nothing gives their places, or what does not fit.
    """
    message = f"population '{part.name}'"
    extent: Floats | None = None if part.extent is None else plain(part.extent)
    if part.positions is not None:
        return _given(part, np.asarray(plain(part.positions)), extent, math.prod(shape))
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


def _given(part: Population, places: Floats, extent: Floats | None, n: int) -> Space:
    places = places[:, None] if places.ndim == 1 else places
    if places.ndim != 2 or places.shape[0] != n or not 1 <= places.shape[1] <= MOST_AXES:
        text = f"positions have the shape {list(places.shape)}: expected [{n}, 1 to {MOST_AXES}], a row for each neuron"
        refuse(part, text)
    if extent is not None and extent.shape != places.shape[1:]:
        refuse(part, f"positions have {places.shape[1]} coordinates, extent {extent.size}: expected as many")
    if part.periodic and extent is None:
        refuse(part, "positions with periodic edges: expected 'extent', the length of each axis")
    if extent is not None and np.any(np.ptp(places, axis=0) > extent):
        axis = int(np.flatnonzero(np.ptp(places, axis=0) > extent)[0])
        text = f"positions span {np.ptp(places[:, axis]):g} on axis {axis}"
        refuse(part, f"{text}: expected at most its extent, {extent[axis]:g}")
    return Space(places, extent, part.periodic, None)


@dataclass(frozen=True, eq=False)
class Between:
    """What lies between the neurons of two populations."""

    source: Space
    target: Space

    def among(self, pre: Ints | None, post: Ints | None) -> Between:
        """What lies between some of the neurons, None: all."""
        ends = [(self.source, pre), (self.target, post)]
        return Between(*(end if ids is None else replace(end, places=end.places[ids]) for end, ids in ends))

    def displacement(self, pre: Ints, post: NDArray[np.integer]) -> Floats:
        """From each source to its target, the shortest way; shape (axes, pairs)."""
        apart = np.empty((len(self.source.periods), len(pre)))
        for way, begin, end, period in zip(
            apart, self.source.places.T, self.target.places.T, self.source.periods, strict=True
        ):
            np.subtract(end[post], begin[pre], out=way)
            if period:
                way -= period * np.rint(way / period)
        return apart

    def distance(self, pre: Ints, post: NDArray[np.integer]) -> Floats:
        """Of each pair."""
        return length(self.displacement(pre, post))

    def near(self, reach: float) -> Iterator[tuple[Ints, Ints]]:
        """All pairs that are not farther apart, and perhaps some that are, a block of sources at a time, in order."""
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
            found = tree.query_ball_point(places[first:last], radius, return_sorted=True)
            post = np.fromiter(chain.from_iterable(found), np.int64, int(ends[last - 1] - before))
            yield np.repeat(np.arange(first, last), counts[first:last]), post
            first = last


def between(source: Population, target: Population, shapes: Mapping[str, tuple[int, ...]]) -> Between:
    """What lies between two populations, if their places are of one space.

    Raises:
        ModelError: they are not.
    """
    message = f"'{source.name}' and '{target.name}'"
    one, other = (space_of(part, shapes[part.name]) for part in (source, target))
    axes = one.places.shape[1], other.places.shape[1]
    if axes[0] != axes[1]:
        raise ModelError(f"positions of {message} have {axes[0]} and {axes[1]} coordinates: expected as many")
    if one.lattice != other.lattice:
        raise ModelError(
            f"{message} have no common scale: neurons of one lie a unit apart by their shape: "
            "expected 'extent' of both",
            hint="populations of one shape need none",
        )
    if not np.array_equal(one.periods, other.periods):
        raise ModelError(
            f"{message} have periodic edges of {_edges(one)} and {_edges(other)}: expected the same of both",
        )
    return Between(one, other)


def distant_pairs(
    rule: distance_dependent, apart: Between, but: Ints | None, key: int, first: int = 0
) -> Iterator[tuple[Ints, NDArray[np.int32]]]:
    """Pairs that are connected, a block of sources at a time, in order.

    Args:
        rule: says how likely each is.
        apart: what lies between the neurons.
        but: of each source the target that it does not reach, -1: none; None: none of any.
        key: of the draws.
        first: which target of the rule the first one is.

    Raises:
        ModelError: a probability is none, or the mask does not fit the space.
    """
    for pre, post, p in _candidates(rule, apart, but):
        hit = uniform_pairs(key, pre, post + first) < p
        yield pre[hit], post[hit].astype(np.int32)


def expected_pairs(rule: distance_dependent, apart: Between) -> float:
    """How many pairs are connected in the mean, from some of the sources."""
    n = len(apart.source.places)
    sample = min(_SAMPLE, max(16, _PAIRS // len(apart.target.places)))
    some = np.unique(np.linspace(0, n - 1, sample).astype(np.int64))
    found = _candidates(rule, apart.among(some, None), None)
    return sum(float(np.sum(np.broadcast_to(p, pre.size))) for pre, _, p in found) * n / some.size


def _candidates(
    rule: distance_dependent, apart: Between, but: Ints | None
) -> Iterator[tuple[Ints, Ints, Floats | float]]:
    """Pairs that may be connected, and how likely each is."""
    mask, profile = rule.mask, rule.p
    if mask is not None and (problem := mask.misfit(apart.source.places.shape[1])):
        raise ModelError(f"distance_dependent.mask: {problem}", path=("distance_dependent", "mask"))
    reach = min(
        mask.reach if mask is not None else math.inf, profile.reach if isinstance(profile, Profile) else math.inf
    )
    for pre, post in apart.near(reach):
        displacement = apart.displacement(pre, post)
        kept = np.ones(len(pre), dtype=bool) if mask is None else mask.inside(displacement)
        if but is not None:
            kept &= but[pre] != post
        pre, post, far = pre[kept], post[kept], length(displacement[:, kept])
        yield pre, post, _probability(profile, far) if isinstance(profile, Profile) else profile


def _probability(profile: Profile, distance: Floats) -> Floats:
    p = profile.values(distance)
    bad = np.flatnonzero((p < 0.0) | (p > 1.0))
    if bad.size:
        message = f"distance_dependent.p is {p[bad[0]]:g} at the distance {distance[bad[0]]:g}: expected 0 to 1"
        hint = "a mask keeps it to distances where it is a probability"
        raise ModelError(message, hint=hint, path=("distance_dependent", "p"), about=("mask",))
    return p


def length(displacement: Floats) -> Floats:
    """Of each column."""
    return np.asarray(np.sqrt((displacement**2).sum(axis=0)))


def _wrapped(places: Floats, periods: Floats) -> Floats:
    """Places of periodic axes in [0, period)."""
    places = places.copy()
    for axis in np.flatnonzero(periods):
        column = np.mod(places[:, axis], periods[axis])
        places[:, axis] = np.where(column < periods[axis], column, 0.0)
    return places


def _edges(space: Space) -> str:
    return str(space.periods.tolist()) if np.any(space.periods) else "no length"
