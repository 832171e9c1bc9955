"""Describe a spiking network once; run it on a fast simulator or on an emulated chip."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from neuro import chips, coding, compare, events
    from neuro.core.errors import ModelError
    from neuro.model.distributions import lognormal, normal, uniform
    from neuro.model.language import load
    from neuro.model.network import Network, Trials, dropout, labels, reward, winner_take_all
    from neuro.model.neurons import (
        dc_generator,
        iaf_psc_alpha,
        iaf_psc_delta,
        iaf_psc_exp,
        izhikevich,
        loihi_lif,
        parrot_neuron,
        poisson_generator,
        spike_generator,
        spinnaker_lif,
    )
    from neuro.model.rules import (
        all_to_all,
        fixed_indegree,
        fixed_outdegree,
        grid,
        one_to_one,
        pairs,
        pairwise_bernoulli,
    )
    from neuro.model.synapses import loihi_learning, loihi_static, r_stdp, static, stdp, stdp_dopa
    from neuro.program.backend import OverflowWarning
    from neuro.run.simulation import ApproximationWarning, Simulation, compile

__version__ = "0.1.0"

_HOMES = {
    "neuro.model.distributions": ("lognormal", "normal", "uniform"),
    "neuro.program.backend": ("OverflowWarning",),
    "neuro.core.errors": ("ModelError",),
    "neuro.model.language": ("load",),
    "neuro.model.network": ("Network", "Trials", "dropout", "labels", "reward", "winner_take_all"),
    "neuro.model.neurons": (
        "dc_generator",
        "iaf_psc_alpha",
        "iaf_psc_delta",
        "iaf_psc_exp",
        "izhikevich",
        "loihi_lif",
        "parrot_neuron",
        "poisson_generator",
        "spike_generator",
        "spinnaker_lif",
    ),
    "neuro.model.rules": (
        "all_to_all",
        "fixed_indegree",
        "fixed_outdegree",
        "grid",
        "one_to_one",
        "pairs",
        "pairwise_bernoulli",
    ),
    "neuro.run.simulation": ("ApproximationWarning", "Simulation", "compile"),
    "neuro.model.synapses": ("loihi_learning", "loihi_static", "r_stdp", "static", "stdp", "stdp_dopa"),
}
_MODULES = ("chips", "coding", "compare", "events")
_HOME = {name: module for module, names in _HOMES.items() for name in names}

__all__ = [
    "ApproximationWarning",
    "ModelError",
    "Network",
    "OverflowWarning",
    "Simulation",
    "Trials",
    "__version__",
    "all_to_all",
    "chips",
    "coding",
    "compare",
    "compile",
    "dc_generator",
    "dropout",
    "events",
    "fixed_indegree",
    "fixed_outdegree",
    "grid",
    "iaf_psc_alpha",
    "iaf_psc_delta",
    "iaf_psc_exp",
    "izhikevich",
    "labels",
    "load",
    "lognormal",
    "loihi_learning",
    "loihi_lif",
    "loihi_static",
    "normal",
    "one_to_one",
    "pairs",
    "pairwise_bernoulli",
    "parrot_neuron",
    "poisson_generator",
    "r_stdp",
    "reward",
    "spike_generator",
    "spinnaker_lif",
    "static",
    "stdp",
    "stdp_dopa",
    "uniform",
    "winner_take_all",
]


def __getattr__(name: str) -> Any:
    if name in _MODULES:
        return import_module(f"neuro.{name}")
    if name not in _HOME:
        if not name.startswith("_"):
            from neuro.model.neurons import MODELS
            from neuro.model.synapses import SYNAPSES

            if name in MODELS or name in SYNAPSES:
                return MODELS.get(name) or SYNAPSES[name]
        raise AttributeError(f"module 'neuro' has no attribute '{name}'")
    value = getattr(import_module(_HOME[name]), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(__all__)
