"""Delays that learn: while training between two steps, else whole steps, as every backend has them."""

from __future__ import annotations

from dataclasses import replace

import torch
from torch import Tensor

from neuro_torch.scan.layers import Component, Synapses, delayed

Way = tuple[Synapses, Tensor]
"""Synapses that a spike goes along, and their weights."""


def ways(part: Synapses, weight: Tensor, steps: Tensor, exact: bool) -> list[Way]:
    """The ways of spikes along a projection.

    Args:
        part: its synapses, listed.
        weight: as a user sees it.
        steps: the delay, of all or of each, of `neuro_torch.bounds.in_steps`.
        exact: whether a spike arrives in the two steps between which the delay lies, in shares that say how near it is
            to each, so that a gradient moves it; else it arrives in the nearest step.
    """
    if not exact:
        return [(delayed(part, rounded(steps)), weight)]
    whole = steps.detach().floor()
    late = steps - whole
    # One weight of all synapses becomes one of each, since their delays differ.
    each = replace(part, slot=torch.arange(len(part.targets)).numpy())
    flat = weight.reshape(-1).expand(len(part.targets))
    earlier = whole.long().cpu().numpy()
    return [(delayed(each, earlier), flat * (1.0 - late)), (delayed(each, earlier + 1), flat * late)]


def rounded(steps: Tensor):  # type: ignore[no-untyped-def]
    """The nearest whole steps, as an array."""
    return steps.detach().round().long().cpu().numpy()


def component(part: Component, inside: list[Way]) -> Component:
    """A component with these synapses among its own populations."""
    least = min((synapses.least for synapses, _ in inside), default=0)
    return replace(part, inside=tuple(synapses for synapses, _ in inside), stretch=least)
