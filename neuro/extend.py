"""What parts of one's own are made of: neurons, generators, synapses, rules, distributions, formats, filters, chips.

from neuro.extend import Neuron, State, quantity, register

Names here stay, wherever they are defined.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from neuro.core.lazy import lazily

if TYPE_CHECKING:
    from neuro.chips.description import Chip, Figure, Mesh
    from neuro.core.errors import ModelError
    from neuro.core.quantities import Value, quantity
    from neuro.core.registry import register
    from neuro.events._events import Events
    from neuro.events.filters import Filter, Sieve
    from neuro.events.formats import Damage, Format, Piece, Reader, Seeker, Unsavable, in_order, refuse
    from neuro.kernels.jit import allocating, inner, kernel
    from neuro.model.distributions import Distribution
    from neuro.model.neurons.base import Generator, Neuron, State
    from neuro.model.neurons.integrators import (
        advance,
        fehlberg,
        finite_exp,
        is_still,
        rows,
        runge_kutta,
        step_adaptively,
        step_evenly,
        step_whole,
    )
    from neuro.model.neurons.propagators import from_alpha, from_constant, from_exponential, leak
    from neuro.model.rules import Rule
    from neuro.model.space import Profile
    from neuro.model.synapses.base import K_MINUS, K_PLUS, Synapse, Trace
    from neuro.model.synapses.delays import DelayRule
    from neuro.model.synapses.lessons import Growth, Lesson, TrialEnd
    from neuro.model.synapses.modulated import Modulated
    from neuro.program.backend import Backend, Engine, EngineCounts, Outcome, Problem, Spikes, Trial
    from neuro.program.program import Program

_HOMES = {
    "neuro.chips.description": (
        "Chip",
        "Figure",
        "Mesh",
    ),
    "neuro.core.errors": ("ModelError",),
    "neuro.core.quantities": (
        "Value",
        "quantity",
    ),
    "neuro.core.registry": ("register",),
    "neuro.events._events": ("Events",),
    "neuro.events.filters": ("Filter", "Sieve"),
    "neuro.events.formats": (
        "Damage",
        "Format",
        "Piece",
        "Reader",
        "Seeker",
        "Unsavable",
        "in_order",
        "refuse",
    ),
    "neuro.kernels.jit": (
        "allocating",
        "inner",
        "kernel",
    ),
    "neuro.model.distributions": ("Distribution",),
    "neuro.model.neurons.base": (
        "Generator",
        "Neuron",
        "State",
    ),
    "neuro.model.neurons.integrators": (
        "advance",
        "fehlberg",
        "finite_exp",
        "is_still",
        "rows",
        "runge_kutta",
        "step_adaptively",
        "step_evenly",
        "step_whole",
    ),
    "neuro.model.neurons.propagators": (
        "from_alpha",
        "from_constant",
        "from_exponential",
        "leak",
    ),
    "neuro.model.rules": ("Rule",),
    "neuro.model.space": ("Profile",),
    "neuro.model.synapses.base": (
        "K_MINUS",
        "K_PLUS",
        "Synapse",
        "Trace",
    ),
    "neuro.model.synapses.delays": ("DelayRule",),
    "neuro.model.synapses.lessons": (
        "Growth",
        "Lesson",
        "TrialEnd",
    ),
    "neuro.model.synapses.modulated": ("Modulated",),
    "neuro.program.backend": (
        "Backend",
        "Engine",
        "EngineCounts",
        "Outcome",
        "Problem",
        "Spikes",
        "Trial",
    ),
    "neuro.program.program": ("Program",),
}

__all__ = [
    "K_MINUS",
    "K_PLUS",
    "Backend",
    "Chip",
    "Damage",
    "DelayRule",
    "Distribution",
    "Engine",
    "EngineCounts",
    "Events",
    "Figure",
    "Filter",
    "Format",
    "Generator",
    "Growth",
    "Lesson",
    "Mesh",
    "ModelError",
    "Modulated",
    "Neuron",
    "Outcome",
    "Piece",
    "Problem",
    "Profile",
    "Program",
    "Reader",
    "Rule",
    "Seeker",
    "Sieve",
    "Spikes",
    "State",
    "Synapse",
    "Trace",
    "Trial",
    "TrialEnd",
    "Unsavable",
    "Value",
    "advance",
    "allocating",
    "fehlberg",
    "finite_exp",
    "from_alpha",
    "from_constant",
    "from_exponential",
    "in_order",
    "inner",
    "is_still",
    "kernel",
    "leak",
    "quantity",
    "refuse",
    "register",
    "rows",
    "runge_kutta",
    "step_adaptively",
    "step_evenly",
    "step_whole",
]

if not TYPE_CHECKING:
    __getattr__, __dir__ = lazily(__name__, _HOMES)
