"""The targets and the weights of all projections in one array each, which a backend can use without a copy."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.compiler.shapes import Shape, size
from neuro.model import parts
from neuro.model.network import Network
from neuro.model.rules import all_to_all, fixed_indegree, fixed_outdegree, fixed_total_number, one_to_one
from neuro.program.program import Floats, Projection


@dataclass(frozen=True, slots=True, eq=False)
class SynapseRoom:
    """Where the targets and the weights of one projection will lie."""

    targets: NDArray[np.int32]
    weight: Floats


def rooms(net: Network, shapes: Mapping[str, Shape]) -> dict[str, SynapseRoom] | None:
    """Neighbouring views of one array each, by name; None where how many synapses there are follows from draws."""
    known = [_numbers(part, size(shapes[part.source]), size(shapes[part.target])) for part in net.projections.values()]
    numbers = [number for number in known if number is not None]
    if len(numbers) < len(known):
        return None
    return _laid_out(dict(zip(net.projections, numbers, strict=True)))


def packed(projections: Iterable[Projection], made: Mapping[str, SynapseRoom] | None) -> tuple[Projection, ...]:
    """The same projections; their `targets` and `weight` are neighbouring views of one array each, in their order.

    Those that do not lie in the rooms that were made for them are moved there. Where there are none, or they turned out
    to be of other sizes, all are moved, one by one, so that memory for all is needed once.
    """
    moved = list(projections)
    if made is None or any(_misfits(part, made[part.name]) for part in moved):
        made = _laid_out({part.name: (part.targets.size, part.weight.size) for part in moved})
    # One by one, each freed as it is moved: both copies of a large network would not fit.
    for k in range(len(moved)):
        part, room = moved[k], made[moved[k].name]
        moved[k] = replace(part, targets=_into(room.targets, part.targets), weight=_into(room.weight, part.weight))
    return tuple(moved)


def _numbers(part: parts.Projection, n_pre: int, n_post: int) -> tuple[int, int] | None:
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


def _misfits(part: Projection, room: SynapseRoom) -> bool:
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
