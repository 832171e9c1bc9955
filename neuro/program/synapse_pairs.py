"""Selection of synapses by pairs of a source and a target neuron."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from neuro.core.errors import ModelError
from neuro.core.values import shown
from neuro.model.parts import Part
from neuro.model.views import View
from neuro.program.program import Ints


@dataclass(frozen=True, slots=True, eq=False)
class Ends:
    """The source and target neurons of the synapses of a projection.

    Attributes:
        name: name of the projection.
        populations: names of the source and the target population.
        sizes: number of neurons of the source and the target population.
        pre, post: the source and the target neuron of each synapse.
    """

    name: str
    populations: tuple[str, str]
    sizes: tuple[int, int]
    pre: Ints
    post: Ints


def places_of_pairs(ends: Ends, of: Any) -> Ints:
    """Return the indices of the synapses between pairs (source, target), in the order of the pairs.

    Raises:
        ModelError: the value is not a list of pairs, or a pair has an unknown neuron, has no synapse or is
            repeated.
    """
    pairs = _pairs(of)
    for k, word in enumerate(("source", "target")):
        n = ends.sizes[k]
        for row in np.flatnonzero((pairs[:, k] < 0) | (pairs[:, k] >= n))[:1]:
            message = f"of: pair {row}: found {word} {pairs[row, k]}"
            raise ModelError(f"{message}: expected a neuron of '{ends.populations[k]}', 0 to {n - 1}")
    n = ends.sizes[1]
    keys, wanted_keys = ends.pre * n + ends.post, pairs[:, 0] * n + pairs[:, 1]
    order = None if (keys[1:] >= keys[:-1]).all() else np.argsort(keys, kind="stable")
    ascending = keys if order is None else keys[order]
    first, end = np.searchsorted(ascending, wanted_keys), np.searchsorted(ascending, wanted_keys, side="right")
    multiplicity = end - first
    for row in np.flatnonzero(multiplicity == 0)[:1]:
        pair = f"{pairs[row, 0]} to {pairs[row, 1]}"
        message = f"none of the {keys.size:,} synapses of '{ends.name}' goes from {pair}"
        raise ModelError(f"of: pair {row}: {message}")
    if np.unique(wanted_keys).size < wanted_keys.size:
        raise ModelError("of: found a pair more than once: expected each once")
    # The ranges first:end of all pairs, joined, e.g. [4, 5, 9] for 4:6 and 9:10.
    places: Ints = np.arange(multiplicity.sum()) + np.repeat(
        first - np.cumsum(multiplicity) + multiplicity, multiplicity
    )
    return places if order is None else order[places]


def refuse_some_of_a_grid(name: str, argument: str) -> None:
    """Refuse a choice of some synapses of a grid, where synapses share weights.

    Args:
        name: name of the projection.
        argument: the argument that chose the synapses, for the message.

    Raises:
        ModelError: always.
    """
    message = f"{argument} of '{name}', a grid, whose synapses share weights: expected all synapses"
    raise ModelError(message, hint="set its kernels as a whole, by map")


def _pairs(of: Any) -> Ints:
    """Return pairs of neurons as an array, shape (n, 2)."""
    message = "expected pairs (source, target) of neurons as whole numbers, such as [(0, 5), (3, 1)]"
    if isinstance(of, (Part, View, str)):
        text = f"'{of.name}'" if isinstance(of, Part) else repr(of)
        raise ModelError(f"of = {text}: {message}", hint="pre= and post= take the neurons at either end")
    try:
        pairs = np.atleast_2d(np.asarray(of))
    except ValueError:  # rows of different lengths
        raise ModelError(f"of = {shown(of)}: {message}") from None
    if pairs.dtype.kind not in "iu" or pairs.ndim != 2 or pairs.shape[1] != 2:
        raise ModelError(f"of = {shown(of)}: {message}", hint="pre= and post= take the neurons at either end")
    return pairs.astype(np.int64)
