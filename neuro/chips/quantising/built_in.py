"""Neurons in equations as the model of the package whose equations they are: a chip has registers for these."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from neuro.core.checks import check
from neuro.core.errors import ModelError
from neuro.model.equations import EquationNeuron
from neuro.model.equations.twin import Twin
from neuro.model.neurons import Model
from neuro.program.program import Floats, Population, Program

_TWINS: dict[type[EquationNeuron], Twin | ModelError] = {}


def as_built_in(program: Program) -> Program:
    """The program with built-in models in place of equations, where these are one's; elsewhere it is as it was."""
    if not any(isinstance(part.model, EquationNeuron) for part in program.populations):
        return program
    return replace(program, populations=tuple(_stands_for(part) for part in program.populations))


def why_not(model: Model) -> ModelError | None:
    """Why no built-in model has the equations of a model; None if one has, or it is no model in equations."""
    found = _twin(type(model)) if isinstance(model, EquationNeuron) else None
    return found if isinstance(found, ModelError) else None


def names_of(part: Population) -> dict[str, tuple[str, ...]]:
    """The states of the chip's model that each state of a population is, or the sum of which it is."""
    found = _twin(type(part.model)) if isinstance(part.model, EquationNeuron) else None
    if isinstance(found, Twin):
        return dict(found.states)
    return {state.name: (state.name,) for state in part.model.states}


def shares(values: Floats, names: tuple[str, ...]) -> list[Floats]:
    """A state as those of which it is the sum: of two, what is above 0 and what is below."""
    return [values] if len(names) == 1 else [np.maximum(values, 0.0), np.minimum(values, 0.0)]


def _twin(model: type[EquationNeuron]) -> Twin | ModelError:
    if model not in _TWINS:
        try:
            _TWINS[model] = model.twin()
        except ModelError as error:
            _TWINS[model] = error
    return _TWINS[model]


def _stands_for(part: Population) -> Population:
    found = _twin(type(part.model)) if isinstance(part.model, EquationNeuron) else None
    if not isinstance(found, Twin):
        return part
    model = found.model()
    parameters = found.parameters({word: part.parameters[word] for word in part.model.quantities()})
    for word in found.words:
        values = parameters[word]
        value = values if values.size > 1 else float(values[0])
        check(model.quantities()[word], value, f"population '{part.name}': {word} of its equations")
    initial = {state.name: np.zeros(1) for state in model.states}
    for own, names in found.states.items():
        initial |= zip(names, shares(part.initial[own], names), strict=True)
    return replace(part, model=model, parameters=parameters, initial=initial)
