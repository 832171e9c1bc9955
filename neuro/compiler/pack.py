"""Keep the targets of all projections in one array, so that a backend can use them without a copy."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from neuro.program.program import Projection


def packed(projections: tuple[Projection, ...]) -> tuple[Projection, ...]:
    """The same projections; their `targets` are neighbouring views of one array, in their order."""
    if sum(p.targets.size > 0 for p in projections) < 2:
        return projections
    together = np.concatenate([p.targets for p in projections])
    ends = np.cumsum([p.targets.size for p in projections])
    return tuple(
        replace(p, targets=together[end - p.targets.size : end]) for p, end in zip(projections, ends, strict=True)
    )
