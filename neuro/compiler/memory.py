"""Whether a network fits into memory, counted before anything is drawn, and arrays that many synapses share."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.compiler.connect import expected_synapses
from neuro.compiler.shapes import Shape, size
from neuro.core.errors import ModelError
from neuro.core.launch import neighbours
from neuro.core.memory import free_memory
from neuro.core.values import plain
from neuro.model.distributions import Distribution
from neuro.model.network import Network
from neuro.model.parts import Projection
from neuro.model.rules import (
    all_to_all,
    fixed_indegree,
    fixed_outdegree,
    fixed_total_number,
    one_to_one,
    pairs,
)
from neuro.model.space import of_distance
from neuro.program.compact import CompactProjection
from neuro.program.program import Floats, Projection as Resolved

MANY = 1 << 26
"""Synapses from which on it is counted."""

ROOM = 1.2
"""What is needed beside the synapses, over what these need: tables, neurons, and what is being drawn."""


def many_synapses(parts: Iterable[Projection], shapes: Mapping[str, Shape], least: int) -> bool:
    """Whether projections have about so many synapses that are stored one by one; views count as what they are of."""
    return sum(_synapses(part, size(shapes[part.source]), size(shapes[part.target])) for part in parts) >= least


def check_memory(
    net: Network, shapes: Mapping[str, Shape], shares: int = 1, drawn: Mapping[str, Projection] | None = None
) -> None:
    """Refuse a network that has far more synapses than memory has room for.

    Args:
        net: checked.
        shapes: of its populations.
        shares: how many processes have a share each; those on this machine have one memory.
        drawn: its projections whose synapses are drawn; None: all.

    Raises:
        ModelError: it needs more than is free.
    """
    # Views have fewer synapses than the populations that they are of: counted as a whole they could refuse what fits.
    every = net.projections if drawn is None else drawn
    parts = [part for part in every.values() if part.source_view is None and part.target_view is None]
    synapses = {part.name: _synapses(part, size(shapes[part.source]), size(shapes[part.target])) for part in parts}
    total = sum(synapses.values())
    free = free_memory() if total > MANY else None
    if free is None:
        return
    here = min(shares, neighbours()) / shares
    needed = here * ROOM * sum(synapses[part.name] * _bytes(part, shares) for part in parts)
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
        case one_to_one():
            return 0
        case all_to_all() if not (_each(part.weight) or _each(part.delay) or part.synapse.learns):
            return 0
        case pairs(pre=pre):
            return len(pre)
    return expected_synapses(part.rule, n_pre, n_post)


def _bytes(part: Projection, shares: int) -> int:
    """Of a synapse: its target, and a weight and a delay of its own; what learns has states, and an index by target.

    Where delays are drawn these take two bytes, four or eight, and one, unless a delay is longer than 255 steps or a
    population larger than 65,536 neurons; a backend's joined rows, which take their place, as much or less. In one of
    several shares they take four, eight and one.
    """
    weight = plain(part.weight)
    if _has_drawn_delays(part):
        if shares > 1:
            return 5 + 8 * _each(weight)
        single = isinstance(weight, Distribution) and weight.single
        return 3 + (4 if single or not _each(weight) else 8)
    dense = isinstance(part.rule, all_to_all)
    return 4 * (not dense) + 8 * _each(weight) + 4 * _each(part.delay) + (40 if part.synapse.learns else 0)


def _has_drawn_delays(part: Projection) -> bool:
    """Whether static synapses have drawn delays and are listed: these lie by themselves, see `packed`."""
    drawn = isinstance(plain(part.delay), (Distribution, of_distance))
    return drawn and not part.synapse.learns and not isinstance(part.rule, (all_to_all, one_to_one))


def _each(value: object) -> bool:
    """Whether each synapse has a value of its own."""
    return not isinstance(value, (int, float))


@dataclass(frozen=True, slots=True, eq=False)
class SynapseRoom:
    """Where the targets and the weights of one projection will lie."""

    targets: NDArray[np.int32]
    weight: Floats


def rooms(projections: Mapping[str, Projection], shapes: Mapping[str, Shape]) -> dict[str, SynapseRoom] | None:
    """Neighbouring views of one array each, by name; None where how many synapses there are follows from draws."""
    parts = {name: part for name, part in projections.items() if not _has_drawn_delays(part)}
    known = [_numbers(part, size(shapes[part.source]), size(shapes[part.target])) for part in parts.values()]
    numbers = [number for number in known if number is not None]
    if len(numbers) < len(known):
        return None
    return _laid_out(dict(zip(parts, numbers, strict=True)))


def weight_room(part: Projection, synapses: int) -> NDArray[np.floating[Any]] | None:
    """Memory for the weights of a projection that lies by itself: 32 bits each if they are single."""
    weight = plain(part.weight)
    single = _has_drawn_delays(part) and isinstance(weight, Distribution) and weight.single
    return np.empty(synapses, dtype=np.float32) if single else None


def packed(projections: Iterable[Resolved], made: Mapping[str, SynapseRoom] | None, many: bool) -> tuple[Resolved, ...]:
    """The same projections; their `targets` and `weight` are neighbouring views of one array each, in their order.

    Those that do not lie in the rooms that were made for them are moved there. Where there are none, or they turned out
    to be of other sizes, all are moved, one by one, so that memory for all is needed once. With `many` synapses those
    of static projections with delays of their own take few bytes, and lie by themselves: who runs them may free them.
    """
    moved = [CompactProjection.of(part) if many and is_timed(part) else part for part in projections]
    others = [k for k, part in enumerate(moved) if not isinstance(part, CompactProjection) and part.undrawn is None]
    if made is None or any(moved[k].name not in made or _misfits(moved[k], made[moved[k].name]) for k in others):
        made = _laid_out({moved[k].name: (moved[k].targets.size, moved[k].weight.size) for k in others})
    # One by one, each freed as it is moved: both copies of a large network would not fit.
    for k in others:
        part, room = moved[k], made[moved[k].name]
        moved[k] = replace(part, targets=_into(room.targets, part.targets), weight=_into(room.weight, part.weight))
    return tuple(moved)


def is_timed(part: Resolved) -> bool:
    """Whether synapses are listed, static, and differ in delay, and not yet compact."""
    if isinstance(part, CompactProjection):
        return False
    return part.layout == "csr" and part.carries == "spikes" and not part.synapse.learns and part.delay.size > 1


def _numbers(part: Projection, n_pre: int, n_post: int) -> tuple[int, int] | None:
    """How many targets and weights a projection will have; None where that is not known."""
    if part.source_view is not None or part.target_view is not None:
        return None
    match part.rule:
        case fixed_indegree(n=n):
            targets = synapses = n * n_post
        case fixed_outdegree(n=n):
            targets = synapses = n * n_pre
        case fixed_total_number(n=n):
            targets = synapses = n
        case one_to_one():
            targets, synapses = 0, n_pre
        case all_to_all(autapses=True):
            targets, synapses = 0, n_pre * n_post
        case _:
            return None
    return targets, 1 if isinstance(part.weight, (int, float)) else synapses


def _misfits(part: Resolved, room: SynapseRoom) -> bool:
    return part.targets.size != room.targets.size or part.weight.size != room.weight.size


def _laid_out(numbers: Mapping[str, tuple[int, int]]) -> dict[str, SynapseRoom]:
    """Rooms for so many targets and weights each, side by side."""
    targets = np.empty(sum(number for number, _ in numbers.values()), dtype=np.int32)
    weights = np.empty(sum(number for _, number in numbers.values()))
    found, at_target, at_weight = {}, 0, 0
    for name, (n_targets, n_weights) in numbers.items():
        found[name] = SynapseRoom(
            targets[at_target : at_target + n_targets], weights[at_weight : at_weight + n_weights]
        )
        at_target, at_weight = at_target + n_targets, at_weight + n_weights
    return found


def _into(room: NDArray[Any], values: NDArray[Any]) -> NDArray[Any]:
    """The values, in a room."""
    # Drawn into its room already: the same memory.
    if room.size and room.ctypes.data != values.ctypes.data:
        room[:] = values
    return room
