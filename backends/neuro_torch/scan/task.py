"""What one forward pass is about, whichever scans do it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import torch

from neuro.program.program import Floats
from neuro_torch.surrogates import Surrogate


@dataclass(frozen=True, slots=True, eq=False)
class ScanTask:
    """What one forward pass is about.

    Attributes:
        batch, steps: of it.
        dtype, device: of all numbers.
        surrogate: stands in for the derivative of a spike.
        damping: of gradients each time they go along a synapse of a circle.
        push: what currents add, by population, see `neuro_torch.scan.cells`.
        wanted: populations whose potentials are asked for.
    """

    batch: int
    steps: int
    dtype: torch.dtype
    device: torch.device
    surrogate: Surrogate
    damping: float
    push: Mapping[int, Floats]
    wanted: frozenset[int]
