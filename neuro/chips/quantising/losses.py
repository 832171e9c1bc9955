"""Which roundings are worth a warning: those above stated limits."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from neuro.chips.arithmetic import Arithmetic
from neuro.chips.description import Chip
from neuro.chips.quantising.fixed import FixedPopulation, FixedProjection
from neuro.chips.quantising.inputs import Options, approximated, refused
from neuro.program.backend import Problem
from neuro.program.program import Program


@dataclass(frozen=True, slots=True)
class Limit:
    """Above which share an error is told.

    Attributes:
        share: the largest error without a warning.
        text: what the error is of.
        way_out: what makes it smaller.
    """

    share: float
    text: str
    way_out: str


_WEIGHTS = "raise the small weights, or lower the largest one, which sets the scale"
_DECAY = "use a coarser resolution: a decay register has few steps where little decays in a step"
_SCALE = "choose a larger scale; the largest V_th - E_L, current, V_m and weight of its population bound it"

HOPELESS = 10.0
"""Error of the threshold, relative to V_th - E_L, above which a network is refused."""

LIMITS = {
    "zeroed": Limit(0.01, "of the weights other than 0 become 0", _WEIGHTS),
    "rms": Limit(0.02, "is the rms error of the weights", _WEIGHTS),
    "tau_m": Limit(0.02, "is the error of the membrane time constant", _DECAY),
    "tau_syn_ex": Limit(0.02, "is the error of the synaptic time constant", _DECAY),
    "tau_syn_in": Limit(0.02, "is the error of the synaptic time constant", _DECAY),
    "V_th": Limit(0.001, "of the distance from E_L to V_th is the error of the threshold", _SCALE),
    "V_reset": Limit(0.001, "of the distance from E_L to V_th is the error of V_reset", "scale the potentials up"),
    "C_m": Limit(0.02, "is the error of the membrane capacity", "lower C_m, and weights and currents with it"),
    "I_e": Limit(0.02, "is the error of the constant current", "raise the current, or leave it out"),
    "dc": Limit(0.02, "is the error of the current of generators", "raise its amplitude, or leave it out"),
    "merged": Limit(
        0.01,
        "of the generator's spikes share a step with another of the same neuron and become one",
        "use a finer resolution or several generators of a lower rate",
    ),
}
"""Errors above which rounding is told as an approximation: of weights, time constants, potentials and spikes."""


def losses(
    program: Program,
    arithmetic: Arithmetic,
    populations: Sequence[FixedPopulation],
    wires: Sequence[FixedProjection | None],
) -> Iterator[Problem]:
    """Roundings beyond the limits."""
    for part, cells in zip(program.populations, populations, strict=True):
        for r in cells.rounding:
            limit = LIMITS.get(r.quantity)
            if r.quantity == "V_th" and abs(r.error) > HOPELESS:
                what = f"population '{part.name}': V_th = {r.wanted:g} becomes {r.got:.6g} {r.unit}"
                why = f"{cells.volt:.3g} units per mV leave no threshold: its largest weight or current takes all bits"
                yield refused(part.origin, what, why, "lower what is far above V_th - E_L, or set another scale")
            elif limit is not None and abs(r.error) > limit.share:
                what = f"population '{part.name}': {r.quantity} = {r.wanted:g} becomes {r.got:.6g} {r.unit}"
                yield approximated(part.origin, what, f"{abs(r.error):.1%} {limit.text}", limit.way_out)
    for projection, fixed in zip(program.projections, wires, strict=True):
        if fixed is None:
            continue
        for name in ("zeroed", "rms"):
            value, limit = getattr(fixed.rounding, name), LIMITS[name]
            if value > limit.share:
                what = f"projection '{projection.name}'"
                way_out = arithmetic.lossless(fixed) if fixed.native else limit.way_out
                yield approximated(projection.origin, what, f"{value:.1%} {limit.text}", way_out)


def merged(program: Program, arithmetic: Arithmetic) -> Iterator[Problem]:
    """Poisson generators whose multiple spikes in a step become one where a spike is one bit."""
    if not arithmetic.one_bit:
        return
    limit = LIMITS["merged"]
    for part in program.populations:
        if part.kind != "poisson":
            continue
        mean = part.largest("rate") * program.resolution / 1000.0
        share = 1.0 - -np.expm1(-mean) / mean if mean > 0.0 else 0.0
        if share > limit.share:
            why = f"{share:.1%} {limit.text}, since a spike on {arithmetic.title} is one bit"
            why += "; counts().native tells how many"
            yield approximated(part.origin, f"population '{part.name}': {part.model.name}", why, limit.way_out)


LEARN_ELSEWHERE = "learn on event, then give the delays of sim.network() to static synapses"
"""The way out for delays that a chip cannot learn."""


def foreign(program: Program, chip: Chip, index: int) -> Problem | None:
    """Why a synapse model cannot be on a chip: it is in the registers of another family; or None."""
    part = program.projections[index]
    other = part.synapse.chip
    message = f"projection '{part.name}': {part.synapse.name}"
    if not other or other == chip.arithmetic:
        return None
    return refused(part.origin, message, f"its parameters are registers of {other}", f"backend '{other}' runs it")


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
