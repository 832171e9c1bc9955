"""The targets and the weights of all projections in one array each, which a backend can use without a copy."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np

from neuro.program.program import Projection


def packed(projections: Iterable[Projection]) -> tuple[Projection, ...]:
    """The same projections; their `targets` and `weight` are neighbouring views of one array each, in their order.

    They are moved one by one, so that memory for all is needed once.
    """
    moved = list(projections)
    targets = np.empty(sum(p.targets.size for p in moved), dtype=np.int32)
    weights = np.empty(sum(p.weight.size for p in moved))
    at_target = at_weight = 0
    for k in range(len(moved)):
        part = moved[k]
        to = targets[at_target : at_target + part.targets.size]
        weight = weights[at_weight : at_weight + part.weight.size]
        to[:], weight[:] = part.targets, part.weight
        at_target, at_weight = at_target + to.size, at_weight + weight.size
        moved[k] = replace(part, targets=to, weight=weight)
    return tuple(moved)
