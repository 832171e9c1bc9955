"""Wiring diagrams with one property drawn anew: controls for what a diagram explains."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from neuro.core.errors import ModelError
from neuro.model.wiring.edges import Edges

_ROUNDS = 200


def shuffle_edges(edges: Edges, what: str, rng: np.random.Generator, same: bool) -> Edges:
    """The same number of edges, with one property drawn anew.

    Args:
        edges: of the file.
        what: "edges": each keeps source, weight, sign and delay, and edges exchange their targets, so that every neuron
            keeps its numbers of inputs and outputs; no pair is connected twice and no neuron reaches itself, unless
            the diagram has such edges. "signs": neurons of the source exchange their transmitters where these are
            theirs, else edges exchange signs. "weights": edges exchange the sizes of their weights, and keep signs.
        rng: draws.
        same: whether source and target are one population.

    Raises:
        ModelError: there are no signs or weights, or too few pairs to exchange targets.
    """
    if what == "edges":
        return replace(edges, post=_exchanged(edges.pre, edges.post, rng, same))
    if edges.weight is None:
        raise ModelError(f"shuffle: {what}: found none in the file: expected a column 'weight' or 'transmitter'")
    if what == "weights":
        return replace(edges, weight=np.sign(edges.weight) * rng.permutation(np.abs(edges.weight)))
    if edges.sign is None:
        return replace(edges, weight=np.abs(edges.weight) * rng.permutation(np.sign(edges.weight)))
    connected = np.unique(edges.pre)
    exchanged = edges.sign.copy()
    exchanged[connected] = rng.permutation(edges.sign[connected])
    weight = edges.weight * edges.sign[edges.pre] * exchanged[edges.pre]
    return replace(edges, weight=weight, sign=exchanged)


def _exchanged(
    pre: NDArray[np.int32], post: NDArray[np.int32], rng: np.random.Generator, same: bool
) -> NDArray[np.int32]:
    """The targets in another order.

    All are permuted; then each edge that repeats a pair, or reaches its source, exchanges its target with a random
    edge, until there is none. Source: Maslov & Sneppen, Science 296:910, 2002, whose step this exchange is.
    """
    allowed_twice = bool(_repeats(pre, post).size)
    allowed_self = not same or bool((pre == post).any())
    found = rng.permutation(post)
    for _ in range(_ROUNDS):
        wrong = np.zeros(0, dtype=np.int64) if allowed_twice else _repeats(pre, found)
        if not allowed_self:
            wrong = np.union1d(wrong, np.flatnonzero(pre == found))
        if not wrong.size:
            return found
        for edge, other in zip(wrong.tolist(), rng.integers(0, pre.size, wrong.size).tolist(), strict=True):
            found[edge], found[other] = found[other], found[edge]
    raise ModelError(
        f"shuffle: edges: {wrong.size} of {pre.size} edges still repeat a pair: expected fewer edges among the neurons"
    )


def _repeats(pre: NDArray[np.int32], post: NDArray[np.int32]) -> NDArray[np.int64]:
    """The edges that connect a pair which another, before them in order of pairs, connects."""
    pairs = pre.astype(np.int64) << 32 | post
    order = np.argsort(pairs)
    pairs = pairs[order]
    found: NDArray[np.int64] = order[1:][pairs[1:] == pairs[:-1]]
    return found
