"""Bytes that a network and its records need, counted before anything is made, and arrays that many synapses share."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from neuro.compiler.connect import expected_synapses
from neuro.compiler.pairs import between, expected_pairs
from neuro.compiler.shapes import Shape, end_of, size
from neuro.core.errors import ModelError, Where
from neuro.core.memory import free_memory
from neuro.core.system import neighbours
from neuro.core.values import plain
from neuro.model.distributions import Distribution
from neuro.model.network import Network
from neuro.model.neurons import Generator, Neuron
from neuro.model.parts import Population, Projection
from neuro.model.rules import (
    all_to_all,
    distance_dependent,
    fixed_indegree,
    fixed_outdegree,
    fixed_total_number,
    one_to_one,
    pairs,
    symmetric_pairwise_bernoulli,
)
from neuro.model.space import of_distance
from neuro.program.compact import CompactProjection
from neuro.program.program import Floats, Projection as Resolved

MANY = 1 << 26
"""Synapses from which on they are laid out to save memory."""

LEAST = 1 << 28
"""Bytes from which on it is looked whether they are free."""

NO_ROOM = "memory"
"""Kind of the error, whose text has the free bytes of a moment."""

NEURON, STATE = 64, 12
"""Least bytes of a neuron, and of each of its states, measured: 72 of a parrot, 128 of iaf_psc_exp with four states."""

ROOM = 1.2
"""What is needed beside the synapses, over what these need: tables, neurons, and what is being drawn."""


def many_synapses(parts: Iterable[Projection], shapes: Mapping[str, Shape], least: int) -> bool:
    """Whether projections have about so many synapses that are stored one by one; views count as what they are of."""
    return sum(_synapses(part, size(shapes[part.source]), size(shapes[part.target])) for part in parts) >= least


def check_memory(
    net: Network, shapes: Mapping[str, Shape], shares: int = 1, drawn: Mapping[str, Projection] | None = None
) -> None:
    """Refuse a network that needs more memory than there is, before anything is made.

    Args:
        net: checked.
        shapes: of its populations.
        shares: how many processes have a share each; those on this machine have one memory.
        drawn: its projections whose synapses are drawn; None: all.

    Raises:
        ModelError: it needs more than is free.
    """
    sizes = {name: size(shape) for name, shape in shapes.items()}
    needs = [
        Need((NEURON + STATE * _states(part)) * n, f"population '{part.name}', {n:,} neurons", part.origin)
        for part, n in ((part, sizes[name]) for name, part in net.populations.items())
    ]
    # Views are worked out neuron by neuron, so not before the neurons fit.
    check_room(net.name, needs)
    here = min(shares, neighbours()) / shares
    for part in (net.projections if drawn is None else drawn).values():
        synapses, listed = _stored(net, part, shapes)
        what = f"projection '{part.name}', {synapses:,} synapses"
        needs.append(Need(here * ROOM * synapses * _bytes(part, shares, listed), what, part.origin))
    check_room(net.name, needs)


class Need(NamedTuple):
    """The bytes that a part of a network needs.

    Attributes:
        bytes: how many, about.
        what: the part and what it has, e.g. "population 'a', 1,000 neurons".
        where: its place.
    """

    bytes: float
    what: str
    where: Where | None


def check_room(network: str, needs: Sequence[Need], file: Path | None = None) -> None:
    """Refuse what needs more bytes than are at hand.

    Args:
        network: its name.
        needs: of its parts.
        file: where the bytes will be written; None: memory.

    Raises:
        ModelError: they need more; it names the part that needs most, and its place.
    """
    needed = sum(need.bytes for need in needs)
    if needed < LEAST:
        return
    free = free_memory() if file is None else shutil.disk_usage(file.parent).free
    if free is None or needed <= free:
        return
    largest = max(needs, key=lambda need: need.bytes)
    of = "of memory" if file is None else f"on the disk of {file}"
    raise ModelError(
        f"network '{network}' needs about {_told(needed)} {of}: expected at most what is free, {_told(free)}",
        where=largest.where,
        kind=NO_ROOM,
        hint=f"most are for {largest.what}: {_told(largest.bytes)}",
    )


def _states(part: Population) -> int:
    return len(part.model.states) if isinstance(part.model, (Neuron, Generator)) else 0


def _told(bytes_: float) -> str:
    return f"{bytes_:,.0f} bytes ({bytes_ / 1e9:.1f} GB)"


def _stored(net: Network, part: Projection, shapes: Mapping[str, Shape]) -> tuple[int, bool]:
    """About how many synapses of a projection are stored one by one, and whether their targets are, too."""
    source, target = (
        end_of(view, shapes[name]) for view, name in ((part.source_view, part.source), (part.target_view, part.target))
    )
    n_pre, n_post, whole = size(source.shape), size(target.shape), source.ids is None and target.ids is None
    match part.rule:
        case all_to_all(autapses=autapses) if not (whole and (autapses or part.source != part.target)):
            return n_pre * n_post, True
        case symmetric_pairwise_bernoulli(p=p):
            return round(2.0 * p * n_pre * max(0, n_pre - 1)), True
        case distance_dependent() if whole and n_pre * n_post >= MANY:
            apart = between(net.populations[part.source], net.populations[part.target], shapes)
            return round(expected_pairs(part.rule, apart)), True
    return _synapses(part, n_pre, n_post), not isinstance(part.rule, all_to_all)


def _synapses(part: Projection, n_pre: int, n_post: int) -> int:
    """About how many synapses that are stored one by one a projection has."""
    match part.rule:
        case one_to_one():
            return 0
        case all_to_all() if not (has_each(part.weight) or has_each(part.delay) or part.synapse.learns):
            return 0
        case pairs(pre=pre):
            return len(pre)
    return expected_synapses(part.rule, n_pre, n_post)


def _bytes(part: Projection, shares: int, listed: bool) -> int:
    """Of a synapse: its target, and a weight and a delay of its own; what learns has states, and an index by target.

    Where delays are drawn these take two bytes, four or eight, and one, unless a delay is longer than 255 steps or a
    population larger than 65,536 neurons; a backend's joined rows, which take their place, as much or less. In one of
    several shares they take four, eight and one.
    """
    weight = plain(part.weight)
    if _has_drawn_delays(part):
        if shares > 1:
            return 5 + 8 * has_each(weight)
        single = isinstance(weight, Distribution) and weight.single
        return 3 + (4 if single or not has_each(weight) else 8)
    return 4 * listed + 8 * has_each(weight) + 4 * has_each(part.delay) + (40 if part.synapse.learns else 0)


def _has_drawn_delays(part: Projection) -> bool:
    """Whether static synapses have drawn delays and are listed: these lie by themselves, see `packed`."""
    drawn = isinstance(plain(part.delay), (Distribution, of_distance))
    return drawn and not part.synapse.learns and not isinstance(part.rule, (all_to_all, one_to_one))


def has_each(value: object) -> bool:
    """Return whether a weight, a delay or a parameter has a value for each synapse: it is no single number."""
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
    whole = isinstance(part.rule, all_to_all) and part.rule.autapses
    if not whole and not isinstance(part.rule, one_to_one | fixed_indegree | fixed_outdegree | fixed_total_number):
        return None
    synapses = expected_synapses(part.rule, n_pre, n_post)
    targets = 0 if whole or isinstance(part.rule, one_to_one) else synapses
    return targets, synapses if has_each(part.weight) else 1


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
