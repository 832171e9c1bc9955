"""Whether a network fits into memory, counted before anything is drawn."""

from __future__ import annotations

from collections.abc import Mapping

from neuro.compiler.shapes import Shape, size
from neuro.core.errors import ModelError
from neuro.core.memory import free_memory
from neuro.core.values import plain
from neuro.model.distributions import Distribution
from neuro.model.network import Network
from neuro.model.parts import Projection
from neuro.model.rules import all_to_all, fixed_indegree, fixed_outdegree, fixed_total_number, pairs, pairwise_bernoulli
from neuro.model.space import of_distance

MANY = 1 << 26
"""Synapses from which on it is counted."""

ROOM = 1.2
"""What is needed beside the synapses, over what these need: tables, neurons, and what is being drawn."""


def many_synapses(net: Network, shapes: Mapping[str, Shape], least: int) -> bool:
    """Whether a network has about so many synapses that are stored one by one; views count as what they are of."""
    parts = net.projections.values()
    return sum(_synapses(part, size(shapes[part.source]), size(shapes[part.target])) for part in parts) >= least


def check_memory(net: Network, shapes: Mapping[str, Shape]) -> None:
    """Refuse a network that has far more synapses than memory has room for.

    Args:
        net: checked.
        shapes: of its populations.

    Raises:
        ModelError: it needs more than is free.
    """
    # Views have fewer synapses than the populations that they are of: counted as a whole they could refuse what fits.
    parts = [part for part in net.projections.values() if part.source_view is None and part.target_view is None]
    synapses = {part.name: _synapses(part, size(shapes[part.source]), size(shapes[part.target])) for part in parts}
    total = sum(synapses.values())
    free = free_memory() if total > MANY else None
    if free is None:
        return
    needed = ROOM * sum(synapses[part.name] * _bytes(part) for part in parts)
    if needed > free:
        largest = max(parts, key=lambda part: synapses[part.name])
        raise ModelError(
            f"network '{net.name}': {total:,} synapses need {needed / 1e9:.1f} GB: expected at most what is free, "
            f"{free / 1e9:.1f} GB",
            hint=f"most are of '{largest.name}', {synapses[largest.name]:,}; fewer neurons or inputs need less",
        )


def _synapses(part: Projection, n_pre: int, n_post: int) -> int:
    """About how many synapses that are stored one by one a projection has."""
    match part.rule:
        case all_to_all():
            return n_pre * n_post if _each(part.weight) or _each(part.delay) or part.synapse.learns else 0
        case fixed_indegree(n=n):
            return n * n_post
        case fixed_outdegree(n=n):
            return n * n_pre
        case fixed_total_number(n=n):
            return n
        case pairwise_bernoulli(p=p):
            return round(p * n_pre * n_post)
        case pairs(pre=pre):
            return len(pre)
    return 0


def _bytes(part: Projection) -> int:
    """Of a synapse: its target, and a weight and a delay of its own; what learns has states, and an index by target."""
    dense = isinstance(part.rule, all_to_all)
    static = 4 * (not dense) + 8 * _each(part.weight) + _delay_bytes(part) * _each(part.delay)
    return static + (40 if part.synapse.learns else 0)


def _delay_bytes(part: Projection) -> int:
    """A byte for a drawn delay of what does not learn, unless it is longer than 255 steps, which is not looked at."""
    drawn = isinstance(plain(part.delay), (Distribution, of_distance))
    return 1 if drawn and not part.synapse.learns else 4


def _each(value: object) -> bool:
    """Whether each synapse has a value of its own."""
    return not isinstance(value, (int, float))
