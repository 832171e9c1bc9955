"""The built-in models by kind."""

from neuro.model.neurons import Neuron, builtin

MODELS = [each for each in vars(builtin).values() if isinstance(each, type)]
NEURONS = tuple(each for each in MODELS if issubclass(each, Neuron) and not each.chip)
INTEGRATED = tuple(each for each in NEURONS if "rk4_substeps" in each.quantities())
"""Neurons whose equations have no exact solution."""
NATIVE = tuple(each for each in MODELS if each.chip)
"""Neurons in the registers of a chip; they have no float arithmetic."""
