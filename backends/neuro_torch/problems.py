"""Features that torch cannot run, populations without a gradient, and the way out of each problem."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from neuro.model.neurons import Neuron
from neuro.program.backend import SAVE_FROZEN, Problem, floats_only
from neuro.program.program import Population, Program
from neuro_torch.translate import Untranslatable, translated

ELSEWHERE = "backend 'event' runs it"
LEARNT_THERE = f"backend 'event' runs it: {SAVE_FROZEN}"
RESET = {"izhikevich": "c"}
"""Name of the parameter that holds the reset potential, by model; V_reset for models that are not listed."""


def problems(program: Program) -> list[Problem]:
    """Return every feature of a program that the backend refuses."""
    chip_problems = floats_only(program)
    if chip_problems:
        return chip_problems
    refusals = [_refusal(f"group '{g.name}'", f"torch has no {g.choice.noun}", ELSEWHERE, g) for g in program.groups]
    if program.trials is not None:
        way_out = f"{ELSEWHERE}; neuro_torch.Module trains by gradients instead"
        refusals.append(_refusal("trials", "torch runs none", way_out, program.trials))
    for projection in program.projections:
        if projection.synapse.learns:
            label = f"projection '{projection.name}': {projection.synapse.name}"
            refusals.append(_refusal(label, "torch has static synapses only", LEARNT_THERE, projection))
    for part in program.populations:
        refusals += _population_problems(part)
    return refusals


def _population_problems(part: Population) -> Iterator[Problem]:
    if isinstance(part.model, Neuron) and part.model.most:
        message = f"population '{part.name}': {part.model_name}"
        yield _refusal(message, "its neurons depend on each other within a step", ELSEWHERE, part)
    elif isinstance(part.model, Neuron):
        for name in ("step", "fire"):
            try:
                translated(getattr(part.model.arithmetic, name))
            except Untranslatable as error:
                message = f"population '{part.name}': {part.model_name}"
                way_out = "write it with numbers, ifs and loops only; backend 'event' runs it as it is"
                yield _refusal(message, f"it cannot run for all neurons at once ({error})", way_out, part)


def without_gradient(program: Program) -> list[Problem]:
    """Return the populations through whose spikes no gradient flows."""
    refusals = []
    for part in program.populations:
        if isinstance(part.model, Neuron) and (reason := _no_gradient(part)):
            message = f"population '{part.name}': {part.model_name}"
            refusals.append(
                _refusal(message, f"its spikes have no gradient: {reason}", "use iaf_psc_delta or iaf_psc_exp", part)
            )
    return refusals


def _no_gradient(part: Population) -> str:
    model = part.model
    assert isinstance(model, Neuron)
    if model.relay:
        return ""
    if model.draws:
        return "it fires at random"
    if model.graded:
        return ""
    if model.resets_in_step:
        return "it resets within a step"
    if np.any(part.parameters.get("max_spikes", 1.0) != 1.0):
        return "it fires several times in a step"
    if reset_of(part) not in part.parameters or "V_th" not in part.parameters:
        return "a surrogate needs V_th - V_reset, and the model has no such parameters"
    return ""


def reset_of(part: Population) -> str:
    """Return the name of the parameter that holds the potential after a spike."""
    return RESET.get(part.model.name, "V_reset")


def _refusal(subject: str, reason: str, way_out: str, part: object) -> Problem:
    return Problem(True, subject, reason, way_out, getattr(part, "origin", None))
