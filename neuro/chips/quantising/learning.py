"""Rules of synapses that a chip cannot have, whatever its family."""

from __future__ import annotations

from collections.abc import Iterator

from neuro.chips.description import Chip
from neuro.chips.quantising.fixed import FixedProjection
from neuro.chips.quantising.inputs import Options, refused
from neuro.program.backend import Problem
from neuro.program.program import Program

LEARN_ELSEWHERE = "learn on event, then give the delays of sim.network() to static synapses"
"""The way out for delays that a chip cannot learn."""


def foreign(program: Program, chip: Chip, index: int) -> Problem | None:
    """Why a synapse model cannot be on a chip: it is in the registers of another family; or None."""
    part = program.projections[index]
    other = part.synapse.chip
    told = f"projection '{part.name}': {part.synapse.name}"
    if not other or other == chip.arithmetic:
        return None
    return refused(part.origin, told, f"its parameters are registers of {other}", f"backend '{other}' runs it")


def refuse_rules(
    program: Program, chip: Chip, wires: dict[int, FixedProjection], options: Options
) -> Iterator[Problem]:
    """Rules for a family whose learning is not emulated: every projection that learns on the chip is refused."""
    for index, part in enumerate(program.projections):
        if (problem := foreign(program, chip, index)) is not None:
            yield problem
        elif part.synapse.delays:
            yield refused(
                part.origin,
                f"projection '{part.name}': {part.synapse.name}",
                f"delays do not change while {chip.name} runs",
                LEARN_ELSEWHERE,
            )
        elif part.synapse.learns in ("pairs", "chip"):
            yield refused(
                part.origin,
                f"projection '{part.name}': {part.synapse.name}",
                f"pairwise learning is not emulated on {chip.name}",
                "run it on loihi or event, or send static weights: sim.network() has what was learnt",
            )
