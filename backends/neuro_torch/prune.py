"""Fewer synapses: the smallest weights go, so that their spikes travel less far, take less memory and cost less."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

import neuro
from neuro.compiler import compile_network
from neuro.core.errors import ModelError, unknown
from neuro_torch.module import Module

__all__ = ["prune"]


def prune(module: Module, share: float | Mapping[str, float]) -> Module:
    """A module of the same network without its smallest weights, by magnitude; it learns on.

    The synapses are gone, not 0: the network that it gives lists those that are left, which is what a chip stores and
    what a bill counts. Optimisers are made anew, since parameters are.

    Args:
        module: the network; it is not changed.
        share: of the synapses of each projection that learns, 0 to 1 and less than all; or by name of the projection.

    Raises:
        ModelError: a name is unknown or its weights are shared, or a share cannot be.
    """
    names = list(module.weights)
    shares = dict(share) if isinstance(share, Mapping) else {name: share for name in names if not _shared(module, name)}
    if not shares:
        raise ModelError("prune: found no projection with a weight of its own for each synapse: expected at least one")
    for name, part in shares.items():
        if name not in names:
            raise unknown("projection that learns", name, names)
        if _shared(module, name):
            raise ModelError(f"prune: projection '{name}': its synapses share weights", hint="leave it out")
        if isinstance(part, bool) or not isinstance(part, (int, float)) or not 0.0 <= part < 1.0:
            raise ModelError(f"prune: projection '{name}': share = {part!r}: expected 0 to 1, and less than 1")
    return module.on(_without(module, shares))


def _without(module: Module, shares: Mapping[str, float]) -> neuro.Network:
    """The network with what was learnt and without the smallest weights."""
    net = module.network()
    program = compile_network(net, 0)
    for index, part in enumerate(program.projections):
        if part.name not in shares:
            continue
        weight = np.broadcast_to(part.weight, part.size)
        pre, post = program.connections(index)
        kept = np.sort(np.argsort(np.abs(weight), kind="stable")[round(shares[part.name] * part.size) :])
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


def _shared(module: Module, name: str) -> bool:
    """Whether synapses of a projection share weights."""
    part = next(each for each in module.program.projections if each.name == name)
    return part.grid is not None or (part.weight.size == 1 and module.weights[name].numel() == 1)
