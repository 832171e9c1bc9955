"""What of a network cannot be written as C: each reason, with the nearest thing that can."""

from __future__ import annotations

from collections.abc import Iterator

from neuro.chips.description import Chip
from neuro.chips.fixed_program import FixedProgram
from neuro.chips.inputs import refused
from neuro.chips.known import arithmetic_of, chip
from neuro.core.errors import ModelError
from neuro.exchange.c_code.groups import supports
from neuro.exchange.c_code.source import FAMILIES, INPUTS, STEPS
from neuro.model.neurons import CurrentGenerator
from neuro.program.backend import Problem

_FROZEN = "--frozen (frozen=True) leaves the rule out: weights stay as they are in the network"
_READABLE = ("spikes", "V_m", "v", "sigma", "real")


def check_chip(name: str) -> Chip:
    """The chip of a name or a table, if its arithmetic is written as C.

    Raises:
        ModelError: there is no such chip, or it has another arithmetic.
    """
    found = chip(name)
    if found.arithmetic not in FAMILIES:
        known = " or ".join(FAMILIES).replace(" or ", ", ", 1)
        raise ModelError(f"chip '{name}' cannot be written as C: expected the arithmetic of {known}")
    return found


def refuse(fixed: FixedProgram) -> None:
    """Refuse a program with all reasons at once.

    Raises:
        ModelError: a part of it cannot be written.
    """
    problems = [*_populations(fixed), *_projections(fixed), *_groups(fixed), *_probes(fixed)]
    if problems:
        count = f"{len(problems)} problem" + "s" * (len(problems) > 1)
        message = f"network '{fixed.program.name}' cannot be written as C ({count})"
        raise ModelError(message, others=tuple(problem.error() for problem in problems))


def _populations(fixed: FixedProgram) -> Iterator[Problem]:
    for part, cells in zip(fixed.program.populations, fixed.populations, strict=True):
        if isinstance(part.model, CurrentGenerator):
            why = "the host writes its current into registers while the network runs"
            yield refused(part, part.said, why, "give the neurons a constant current, I_e, or spikes")
        elif cells.kind not in STEPS and part.kind not in INPUTS:
            known = ", ".join(model.__name__ for model in arithmetic_of(fixed.chip).models)
            known += " or parrot_neuron"
            yield refused(part, part.said, f"it is no neuron of {fixed.chip.name}", f"use {known}")
    if not any(cells.kind in STEPS for cells in fixed.populations):
        yield Problem(True, f"network '{fixed.program.name}'", "it has no neurons", "add a population of iaf_psc_exp")


def _projections(fixed: FixedProgram) -> Iterator[Problem]:
    for part, wires in zip(fixed.program.projections, fixed.projections, strict=True):
        if part.signal >= 0 or part.dopamine >= 0:
            yield refused(part, part.synapse.name, "the program in C has no dopamine", _FROZEN)
        elif part.synapse.learns and (wires is None or wires.rule is None or fixed.chip.arithmetic != "loihi"):
            why = "the host applies the rule, and the program in C has none"
            if wires is not None and wires.rule is not None:
                why = f"the program in C has no learning of {fixed.chip.name}"
            yield refused(part, part.synapse.name, why, _FROZEN)


def _groups(fixed: FixedProgram) -> Iterator[Problem]:
    for group in fixed.program.groups:
        if not supports(group.choice):
            why = f"{group.choice.noun} is not written as C"
            way = "use winner_take_all or lateral_reset"
            yield Problem(True, f"group '{group.name}'", why, way, group.origin)


def _probes(fixed: FixedProgram) -> Iterator[Problem]:
    for probe in fixed.program.probes:
        if probe.record not in _READABLE or probe.mean:
            what = f"probe '{probe.name}': {'mean ' * probe.mean}{probe.record}"
            way = "leave it out, or probe spikes; NAME_voltage() reads the voltage register"
            yield Problem(True, what, "the program in C keeps no record", way, probe.origin)
    for one in fixed.program.synapse_probes:
        way = "leave it out, or probe spikes of a population"
        yield Problem(True, f"probe '{one.name}': {one.record}", "the program in C keeps no record", way, one.origin)
