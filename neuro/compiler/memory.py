"""Estimates of the memory for a network and its records, and arrays shared by many projections."""

from __future__ import annotations

import shutil
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from neuro.compiler.connect import expected_synapses
from neuro.compiler.pairs import expected_pairs, geometry_of
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
"""Number of synapses above which the layout of synapses saves memory."""

LEAST = 1 << 28
"""Number of bytes above which free memory is checked."""

NO_ROOM = "memory"
"""Kind of the error for too little memory. The text of the error depends on the free memory at the moment."""

NEURON, STATE = 64, 12
"""Smallest number of bytes of a neuron, and of a state. Measured: 72 for a parrot, 128 for iaf_psc_exp, 4 states."""

OVERHEAD = 1.2
"""Factor on the memory of synapses, for tables, neurons and arrays that exist while synapses are drawn."""


def many_synapses(parts: Iterable[Projection], shapes: Mapping[str, Shape], least: int) -> bool:
    """Return whether projections store about `least` synapses or more. Views count as the whole population."""
    return sum(_synapses(part, size(shapes[part.source]), size(shapes[part.target])) for part in parts) >= least


def check_memory(
    net: Network, shapes: Mapping[str, Shape], shares: int = 1, projections: Mapping[str, Projection] | None = None
) -> None:
    """Refuse a network that does not fit into memory, before anything is allocated.

    Args:
        net: the network, already checked.
        shapes: shapes of its populations.
        shares: number of processes with a share each; the processes on this machine share its memory.
        projections: the projections with synapses to draw; None: all.

    Raises:
        ModelError: the network needs more than the free memory.
    """
    sizes = {name: size(shape) for name, shape in shapes.items()}
    needs = [
        Need((NEURON + STATE * _states(part)) * n, f"population '{part.name}', {n:,} neurons", part.origin)
        for part, n in ((part, sizes[name]) for name, part in net.populations.items())
    ]
    # Views are evaluated neuron by neuron, so first check that the neurons fit.
    check_room(net.name, needs)
    local_share = min(shares, neighbours()) / shares
    for part in (net.projections if projections is None else projections).values():
        synapses, has_targets = _stored(net, part, shapes)
        label = f"projection '{part.name}', {synapses:,} synapses"
        needs.append(Need(local_share * OVERHEAD * synapses * _bytes(part, shares, has_targets), label, part.origin))
    check_room(net.name, needs)


class Need(NamedTuple):
    """Bytes needed by a part of a network.

    Attributes:
        bytes: approximate number of bytes.
        what: the part and its size, e.g. "population 'a', 1,000 neurons".
        where: place of the part in the description.
    """

    bytes: float
    what: str
    where: Where | None


def check_room(network: str, needs: Sequence[Need], file: Path | None = None) -> None:
    """Refuse parts that need more bytes than are free.

    Args:
        network: name of the network.
        needs: needs of its parts.
        file: the file to which the bytes will be written; None: memory.

    Raises:
        ModelError: too few bytes are free. The message names the part with the largest need, and its place.
    """
    total = sum(need.bytes for need in needs)
    if total < LEAST:
        return
    free = free_memory() if file is None else shutil.disk_usage(file.parent).free
    if free is None or total <= free:
        return
    largest = max(needs, key=lambda need: need.bytes)
    kind = "of memory" if file is None else f"on the disk of {file}"
    raise ModelError(
        f"network '{network}' needs about {_in_bytes(total)} {kind}: expected at most the free {_in_bytes(free)}",
        where=largest.where,
        kind=NO_ROOM,
        hint=f"most are for {largest.what}: {_in_bytes(largest.bytes)}",
    )


def _states(part: Population) -> int:
    return len(part.model.states) if isinstance(part.model, (Neuron, Generator)) else 0


def _in_bytes(bytes_: float) -> str:
    return f"{bytes_:,.0f} bytes ({bytes_ / 1e9:.1f} GB)"


def _stored(net: Network, part: Projection, shapes: Mapping[str, Shape]) -> tuple[int, bool]:
    """Return the approximate number of stored synapses of a projection, and whether targets are stored, too."""
    source, target = (
        end_of(view, shapes[name]) for view, name in ((part.source_view, part.source), (part.target_view, part.target))
    )
    n_pre, n_post, is_whole = size(source.shape), size(target.shape), source.ids is None and target.ids is None
    match part.rule:
        case all_to_all(autapses=autapses) if not (is_whole and (autapses or part.source != part.target)):
            return n_pre * n_post, True
        case symmetric_pairwise_bernoulli(p=p):
            return round(2.0 * p * n_pre * max(0, n_pre - 1)), True
        case distance_dependent() if is_whole and n_pre * n_post >= MANY:
            geometry = geometry_of(net.populations[part.source], net.populations[part.target], shapes)
            return round(expected_pairs(part.rule, geometry)), True
    return _synapses(part, n_pre, n_post), not isinstance(part.rule, all_to_all)


def _synapses(part: Projection, n_pre: int, n_post: int) -> int:
    """Return the approximate number of individually stored synapses of a projection."""
    match part.rule:
        case one_to_one():
            return 0
        case all_to_all() if not (has_each(part.weight) or has_each(part.delay) or part.synapse.learns):
            return 0
        case pairs(pre=pre):
            return len(pre)
    return expected_synapses(part.rule, n_pre, n_post)


def _bytes(part: Projection, shares: int, has_targets: bool) -> int:
    """Return the bytes of a synapse: target, weight and delay, and for learning also states and an index by target.

    With drawn delays a target takes two bytes, a weight four or eight, and a delay one, unless a delay exceeds 255
    steps or a population 65,536 neurons. The joined rows of a backend, which replace these arrays, need at most as
    much. With several shares a target takes four bytes, a weight eight and a delay one.
    """
    weight = plain(part.weight)
    if _has_drawn_delays(part):
        if shares > 1:
            return 5 + 8 * has_each(weight)
        single = isinstance(weight, Distribution) and weight.single
        return 3 + (4 if single or not has_each(weight) else 8)
    return 4 * has_targets + 8 * has_each(weight) + 4 * has_each(part.delay) + (40 if part.synapse.learns else 0)


def _has_drawn_delays(part: Projection) -> bool:
    """Return whether synapses are static, listed, and have drawn delays; see `packed`."""
    is_drawn = isinstance(plain(part.delay), (Distribution, of_distance))
    return is_drawn and not part.synapse.learns and not isinstance(part.rule, (all_to_all, one_to_one))


def has_each(value: object) -> bool:
    """Return whether a weight, delay or parameter has one value per synapse."""
    return not isinstance(value, (int, float))


@dataclass(frozen=True, slots=True, eq=False)
class SynapseBuffers:
    """Memory for the targets and the weights of one projection."""

    targets: NDArray[np.int32]
    weight: Floats


def synapse_buffers(
    projections: Mapping[str, Projection], shapes: Mapping[str, Shape]
) -> dict[str, SynapseBuffers] | None:
    """Return memory for the synapses of all projections: views of a common array for targets, and for weights.

    A projection with a random number of synapses has None.
    """
    parts = {name: part for name, part in projections.items() if not _has_drawn_delays(part)}
    all_sizes = [_numbers(part, size(shapes[part.source]), size(shapes[part.target])) for part in parts.values()]
    sizes = [number for number in all_sizes if number is not None]
    if len(sizes) < len(all_sizes):
        return None
    return _allocate(dict(zip(parts, sizes, strict=True)))


def weight_buffer(part: Projection, synapses: int) -> NDArray[np.floating[Any]] | None:
    """Return memory for the weights of a projection with its own arrays, in 32 bits if the weights are single.

    The result is None if weights need 64 bits.
    """
    weight = plain(part.weight)
    single = _has_drawn_delays(part) and isinstance(weight, Distribution) and weight.single
    return np.empty(synapses, dtype=np.float32) if single else None


def packed(
    projections: Iterable[Resolved], buffers: Mapping[str, SynapseBuffers] | None, many: bool
) -> tuple[Resolved, ...]:
    """Return the projections with `targets` and `weight` as views of one common array each.

    Args:
        projections: the projections.
        buffers: memory that may contain the arrays already. If it is None or has other sizes, all projections are
            copied to new memory, one by one, because two copies of all arrays would not fit.
        many: whether the network has many synapses. Static projections with individual delays are then compact, in
            separate arrays that a backend may free.
    """
    result = [CompactProjection.of(part) if many and is_timed(part) else part for part in projections]
    indices = [k for k, part in enumerate(result) if not isinstance(part, CompactProjection) and part.undrawn is None]
    if buffers is None or any(
        result[k].name not in buffers or _misfits(result[k], buffers[result[k].name]) for k in indices
    ):
        buffers = _allocate({result[k].name: (result[k].targets.size, result[k].weight.size) for k in indices})
    # Each projection is freed after the copy: memory has no room for two copies of a large network.
    for k in indices:
        part, buffer = result[k], buffers[result[k].name]
        result[k] = replace(part, targets=_into(buffer.targets, part.targets), weight=_into(buffer.weight, part.weight))
    return tuple(result)


def is_timed(part: Resolved) -> bool:
    """Return whether synapses are in layout csr, static, with individual delays, and not yet compact."""
    if isinstance(part, CompactProjection):
        return False
    return part.layout == "csr" and part.carries == "spikes" and not part.synapse.learns and part.delay.size > 1


def _numbers(part: Projection, n_pre: int, n_post: int) -> tuple[int, int] | None:
    """Return the numbers of targets and weights of a projection; None if they are random."""
    if part.source_view is not None or part.target_view is not None:
        return None
    is_dense = isinstance(part.rule, all_to_all) and part.rule.autapses
    if not is_dense and not isinstance(part.rule, one_to_one | fixed_indegree | fixed_outdegree | fixed_total_number):
        return None
    synapses = expected_synapses(part.rule, n_pre, n_post)
    targets = 0 if is_dense or isinstance(part.rule, one_to_one) else synapses
    return targets, synapses if has_each(part.weight) else 1


def _misfits(part: Resolved, buffers: SynapseBuffers) -> bool:
    return part.targets.size != buffers.targets.size or part.weight.size != buffers.weight.size


def _allocate(numbers: Mapping[str, tuple[int, int]]) -> dict[str, SynapseBuffers]:
    """Return neighbouring buffers with these numbers of targets and weights."""
    targets = np.empty(sum(number for number, _ in numbers.values()), dtype=np.int32)
    weights = np.empty(sum(number for _, number in numbers.values()))
    buffers, at_target, at_weight = {}, 0, 0
    for name, (n_targets, n_weights) in numbers.items():
        buffers[name] = SynapseBuffers(
            targets[at_target : at_target + n_targets], weights[at_weight : at_weight + n_weights]
        )
        at_target, at_weight = at_target + n_targets, at_weight + n_weights
    return buffers


def _into(buffer: NDArray[Any], values: NDArray[Any]) -> NDArray[Any]:
    """Copy values into a buffer, unless they are there already."""
    # Values that were drawn into the buffer share its memory.
    if buffer.size and buffer.ctypes.data != values.ctypes.data:
        buffer[:] = values
    return buffer
