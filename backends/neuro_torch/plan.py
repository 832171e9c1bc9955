"""Which part of a network runs by what: scans where they fit, else step by step; and it is told."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

from neuro.core.english import some
from neuro.program.program import Program
from neuro_torch.scan.layers import Component, components, unfit


@dataclass(frozen=True, slots=True, eq=False)
class Plan:
    """How a network runs; `str` tells it.

    Attributes:
        parts: what is scanned, in order; none where everything is stepped.
        by: "kernels" (compiled, on the CPU), "torch" (torch's operations, on any device) or "steps".
        why: the reasons for steps.
    """

    program: Program
    parts: tuple[Component, ...]
    by: str
    why: tuple[str, ...]

    def __str__(self) -> str:
        if not self.parts:
            return "\n".join(["all populations: step by step, since", *(f"  {why}" for why in self.why)])
        how = {"kernels": "by compiled kernels", "torch": "by torch's operations"}[self.by]
        return "\n".join(f"{self._named(part)}: {self._told(part)} {how}" for part in self.parts)

    def _named(self, part: Component) -> str:
        return ", ".join(f"'{self.program.populations[k].name}'" for k in part.cells)

    def _told(self, part: Component) -> str:
        if not part.inside:
            return "one scan over all steps"
        return f"a recurrent scan, {some(part.stretch, 'step')} at once"


def plan_of(program: Program, by: str | None, learning: Iterable[str]) -> Plan:
    """How a program runs.

    Args:
        program: the network.
        by: what is asked for, None for what is fastest on a CPU.
        learning: populations with parameters that learn.
    """
    why = [*unfit(program), *(f"population '{name}': its parameters learn" for name in learning)]
    if by == "steps":
        why.append("it is asked for")
    if why:
        return Plan(program, (), "steps", tuple(why))
    return Plan(program, tuple(components(program)), by or "kernels", ())
