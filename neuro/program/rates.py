"""Rates that change at listed steps, for whoever runs a network to set in between."""

from __future__ import annotations

from neuro.core.clock import NEVER
from neuro.program.program import Floats, Program


class Rates:
    """The rates of all generators of kind "poisson" whose rate is listed.

    Args:
        program: the whole network.
    """

    def __init__(self, program: Program) -> None:
        self._listed = [
            (k, p.schedule) for k, p in enumerate(program.populations) if p.kind == "poisson" and p.schedule is not None
        ]

    def at(self, step: int) -> list[tuple[int, Floats]]:
        """These populations and their rates in Hz in a step, shape (1,) or (size,)."""
        return [(k, listed.at(step)) for k, listed in self._listed]

    def new(self, step: int) -> list[tuple[int, Floats]]:
        """Those of them whose rate in step + 1 is another than in step, and that rate."""
        return [(k, listed.at(step + 1)) for k, listed in self._listed if (listed.steps == step + 1).any()]

    def next_change(self, step: int) -> int:
        """The last step before the next change after step + 1, or a step that never comes."""
        return min((listed.next_change(step) for _, listed in self._listed), default=NEVER)
