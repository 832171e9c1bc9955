"""Rules that change delays: how far a delay may go, and how many steps a spike takes that sets out now."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from neuro.core.errors import ModelError
from neuro.core.quantities import quantity
from neuro.model.neurons.base import State
from neuro.model.synapses.base import Synapse

DELAY = 1
"""The row of `y` that is the delay."""


@dataclass(frozen=True, kw_only=True, eq=False)
class DelayRule(Synapse):
    """Base of the rules that change delays within [d_min, d_max].

    A delay is a number of ms, which begins at the delay of the projection. A spike reads it when it sets out, takes as
    many steps as are nearest, at least one, and keeps them whatever becomes of the delay.
    """

    delays: ClassVar[bool] = True
    states: ClassVar[tuple[State, ...]] = (State("delay", "ms", "how long a spike takes that sets out now"),)

    d_min: float = quantity(0.1, "ms", "shortest delay", above=0)
    d_max: float = quantity(50.0, "ms", "longest delay; fixed, as it says how much may be under way", above=0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.d_min > self.d_max:
            raise ModelError(
                f"{self.name}.d_min = {self.d_min:g}: expected at most d_max = {self.d_max:g}", path=("d_min",)
            )

    def delay_range(self, h: float) -> tuple[int, int]:
        """The fewest and the most steps of `h` ms that a spike may take."""
        return max(1, math.floor(self.d_min / h + 0.5)), max(1, math.floor(self.d_max / h + 0.5))


def steps_of(delay: float, h: float, fewest: int, most: int) -> int:
    """How many steps a spike takes that sets out now."""
    return math.floor(max(fewest, min(most, delay / h)) + 0.5)
