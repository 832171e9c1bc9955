"""Models of populations, a module per family, and the registry of all models."""

from __future__ import annotations

from os.path import dirname
from typing import TYPE_CHECKING

from neuro.core.lazy import homes_in, public_names
from neuro.core.registry import Registry
from neuro.model.neurons.base import Generator as Generator, Model as Model, Neuron as Neuron, State as State
from neuro.model.neurons.own import complete

if TYPE_CHECKING:
    from neuro.model.neurons.builtin import *  # noqa: F403
    from neuro.model.neurons.current_generators import CurrentGenerator as CurrentGenerator

MODELS: Registry[type[Model]] = Registry(
    "model",
    homes_in(f"{dirname(__file__)}/builtin.py"),
    takes=lambda part: isinstance(part, type) and issubclass(part, Model),
    group="neuro.models",
    complete=complete,
)
"""All models of populations by name."""

if not TYPE_CHECKING:
    __getattr__, __dir__, _ = public_names(__name__, __file__)
