"""Population models, a file for each family, and the registry of all."""

from neuro.core.registry import Registry
from neuro.model.neurons import builtin
from neuro.model.neurons.base import (
    Generator as Generator,
    Model as Model,
    Neuron as Neuron,
    State as State,
    complete as complete,
)
from neuro.model.neurons.builtin import *  # noqa: F403
from neuro.model.neurons.current_generators import CurrentGenerator as CurrentGenerator

_MODELS: list[type[Model]] = [each for each in vars(builtin).values() if isinstance(each, type)]
GENERATORS = tuple(each for each in _MODELS if issubclass(each, Generator))
NEURONS = tuple(each for each in _MODELS if issubclass(each, Neuron) and not each.chip)
INTEGRATED = tuple(each for each in NEURONS if "rk4_substeps" in each.quantities())
"""Neurons whose equations have no exact solution."""
NATIVE = tuple(each for each in _MODELS if each.chip)
"""Neurons in the registers of a chip; they have no float arithmetic."""

MODELS: Registry[type[Model]] = Registry(
    "model",
    (*GENERATORS, *NEURONS, *NATIVE),
    takes=lambda part: isinstance(part, type) and issubclass(part, Model),
    group="neuro.models",
    complete=complete,
)
"""All models of populations by name."""
