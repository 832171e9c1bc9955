"""The bill of a run by the name of a target: place where the target has cores, then price."""

from __future__ import annotations

from os import PathLike

from neuro.chips.known import chip
from neuro.chips.placing.place import place
from neuro.chips.pricing.energy import Energy
from neuro.chips.pricing.price import price
from neuro.program.backend import EngineCounts
from neuro.program.program import Program


def bill(
    program: Program,
    counts: EngineCounts,
    target: str | PathLike[str],
    *,
    step_s: float | None = None,
    chips: int | None = None,
) -> Energy:
    """What a run would take on a target.

    Args:
        program: what ran.
        counts: what it took, on any backend.
        target: the name of a chip or processor, or a table file.
        step_s: how long a step takes on the chip in s, if not as its table says.
        chips: that are on, if not those that the network needs.

    Raises:
        ModelError: there is no such target, the network does not fit on it, it has no published costs, or `step_s` or
            `chips` cannot be.
    """
    priced = chip(target)
    placement = place(program, priced) if priced.mesh is not None else None
    return price(program, counts, placement, priced, step_s=step_s, chips=chips)
