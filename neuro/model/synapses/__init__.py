"""Synapse models, a module per family, and the registry of all models."""

from __future__ import annotations

from os.path import dirname
from typing import TYPE_CHECKING

from neuro.core.lazy import homes_in, public_names
from neuro.core.registry import Registry
from neuro.model.synapses.base import (
    K_MINUS as K_MINUS,
    K_PLUS as K_PLUS,
    DelayRule as DelayRule,
    Growth as Growth,
    Lesson as Lesson,
    Modulated as Modulated,
    Synapse as Synapse,
    Trace as Trace,
    TrialEnd as TrialEnd,
)
from neuro.model.synapses.own import complete

if TYPE_CHECKING:
    from neuro.model.synapses.builtin import *  # noqa: F403
    from neuro.model.synapses.moves import MoveRule as MoveRule

SYNAPSES: Registry[type[Synapse]] = Registry(
    "synapse",
    homes_in(f"{dirname(__file__)}/builtin.py"),
    takes=lambda part: isinstance(part, type) and issubclass(part, Synapse),
    group="neuro.synapses",
    complete=complete,
)
"""All synapse models by name."""

if not TYPE_CHECKING:
    __getattr__, __dir__, _ = public_names(__name__, __file__)
