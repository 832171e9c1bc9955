"""Fewer synapses: the smallest weights go, so that their spikes travel less far, take less memory and cost less."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

import neuro
from neuro.core.errors import ModelError, unknown
from neuro_torch.module import Module
from neuro_torch.quantise import quantised_as

__all__ = ["largest", "prune"]

Bools = NDArray[np.bool_]


def prune(
    module: Module, share: float | Mapping[str, float] | None = None, *, stay: Mapping[str, Bools] | None = None
) -> Module:
    """A module of the same network without its smallest weights, by magnitude; it learns on.

    The synapses are gone, not 0: the network that it gives lists those that are left, which is what a chip stores and
    what a bill counts. Optimisers and bills are made anew, since parameters and synapses are. A module whose weights
    are quantised gives one that is, to the same bits of the same chip; it begins with the rounded weights.

    Args:
        module: the network; it is not changed.
        share: of the synapses of each projection that learns, 0 to 1 and less than all; or by name of the projection.
        stay: instead of a share the synapses that stay, by name, in the order of the weights.

    Raises:
        ModelError: a name is unknown or its weights are shared, or a share cannot be.
    """
    if (share is None) == (stay is None):
        raise ModelError("prune: expected a share, or which synapses stay")
    if stay is None:
        shares = share if isinstance(share, Mapping) else dict.fromkeys(_own(module), share)
        for name, part in shares.items():
            if isinstance(part, bool) or not isinstance(part, (int, float)) or not 0.0 <= part < 1.0:
                raise ModelError(f"prune: projection '{name}': share = {part!r}: expected 0 to 1, and less than 1")
        _check(module, shares)
        stay = {name: _largest(module, name, 1.0 - float(part)) for name, part in shares.items() if part is not None}
    _check(module, stay)
    for name, kept in stay.items():
        if not np.any(kept):
            raise ModelError(f"prune: projection '{name}': none of its {len(kept)} synapses stays: expected some")
    return quantised_as(module, module.on(_with(module, stay)))


def largest(module: Module, share: float) -> dict[str, Bools]:
    """Which synapses have the largest weights, by projection, in the order of the weights; shared ones are left out.

    Args:
        module: the network.
        share: of the synapses of each projection.
    """
    return {name: _largest(module, name, share) for name in _own(module)}


def _largest(module: Module, name: str, share: float) -> Bools:
    weight = module.weights[name].detach().abs().reshape(-1).cpu().numpy()
    chosen = np.zeros(weight.size, dtype=bool)
    chosen[np.argsort(weight, kind="stable")[weight.size - round(share * weight.size) :]] = True
    return chosen


def _check(module: Module, named: Mapping[str, object]) -> None:
    if not named:
        raise ModelError("prune: found no projection with a weight of its own for each synapse: expected at least one")
    for name in named:
        if name not in module.weights:
            raise unknown("projection that learns", name, list(module.weights))
        if name not in _own(module):
            raise ModelError(f"prune: projection '{name}': its synapses share weights", hint="leave it out")


def _own(module: Module) -> list[str]:
    """Projections that learn and have a weight of its own for each synapse."""
    parts = {part.name: part for part in module.program.projections}
    return [name for name in module.weights if parts[name].grid is None and parts[name].weight.size == parts[name].size]


def _with(module: Module, stay: Mapping[str, Bools]) -> neuro.Network:
    """The network with what was learnt, and of some projections only some synapses."""
    net = module.network()
    program = module.program
    for index, part in enumerate(program.projections):
        if part.name not in stay:
            continue
        kept = np.flatnonzero(stay[part.name])
        pre, post = program.connections(index)
        weight = module.weights[part.name].detach().cpu().double().numpy().reshape(-1)
        delay = np.broadcast_to(part.delay, part.size)[kept] * program.resolution
        net.projections[part.name] = replace(
            net.projections[part.name],
            rule=neuro.pairs(pre=pre[kept], post=post[kept]),
            weight=weight[kept],
            delay=float(delay[0]) if np.all(delay == delay[:1]) else delay,
            source_view=None,
            target_view=None,
        )
    return net
