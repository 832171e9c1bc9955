"""Describe a spiking network once; run it on a fast simulator or on an emulated chip."""

from __future__ import annotations

from typing import TYPE_CHECKING

from neuro.core.lazy import lazily
from neuro.core.version import VERSION

__version__ = VERSION

if TYPE_CHECKING:
    from neuro import chips, coding, compare, events, results
    from neuro.core.errors import ModelError
    from neuro.core.registry import register
    from neuro.model.distributions import lognormal, normal, uniform
    from neuro.model.equations import equations
    from neuro.model.language import load
    from neuro.model.network import Network
    from neuro.model.neurons import (
        aeif_cond_exp,
        aeif_psc_exp,
        dc_generator,
        encode,
        hh_psc_alpha,
        iaf_cond_alpha,
        iaf_cond_exp,
        iaf_linear_leak,
        iaf_psc_alpha,
        iaf_psc_delta,
        iaf_psc_exp,
        iaf_psc_exp_adaptive_threshold,
        izhikevich,
        loihi_lif,
        mat2_psc_exp,
        parrot_neuron,
        poisson_generator,
        spike_generator,
        spinnaker_lif,
        srm0,
    )
    from neuro.model.parts import Trials, dropout, labels, lateral_reset, local_winners, reward, winner_take_all
    from neuro.model.rules import (
        all_to_all,
        fixed_indegree,
        fixed_outdegree,
        grid,
        one_to_one,
        pairs,
        pairwise_bernoulli,
    )
    from neuro.model.synapses import (
        first_spike_stdp,
        hedonistic,
        loihi_learning,
        loihi_static,
        mozafari,
        mstdpet,
        normalised_stdp,
        r_stddp,
        r_stdp,
        static,
        stddp,
        stdp,
        stdp_dopa,
        stdp_literal,
        stdp_nn_pre_centered,
        stdp_nn_restr,
        stdp_nn_symm,
        stdp_pl_hom,
        stdp_triplet,
        td_ltp,
        td_moves,
        tempotron,
        tsodyks2,
        vogels_sprekeler,
    )
    from neuro.model.views import View
    from neuro.program.backend import OverflowWarning
    from neuro.program.counts import Counts
    from neuro.run.assignment import assign_labels, read_labels
    from neuro.run.modulators import reward_error, td_error, td_error_rate
    from neuro.run.normalise import normalise
    from neuro.run.simulation import ApproximationWarning, ModelWarning, Simulation, compile
    from neuro.run.trials import TrialCounts, TrialResults

_HOMES = {
    "neuro.chips": (),
    "neuro.coding": (),
    "neuro.compare": (),
    "neuro.events": (),
    "neuro.results": (),
    "neuro.core.errors": ("ModelError",),
    "neuro.core.registry": ("register",),
    "neuro.model.distributions": ("lognormal", "normal", "uniform"),
    "neuro.model.equations": ("equations",),
    "neuro.model.language": ("load",),
    "neuro.model.network": ("Network",),
    "neuro.model.neurons": (
        "dc_generator",
        "encode",
        "mat2_psc_exp",
        "iaf_psc_exp_adaptive_threshold",
        "iaf_cond_alpha",
        "hh_psc_alpha",
        "aeif_psc_exp",
        "aeif_cond_exp",
        "iaf_cond_exp",
        "iaf_linear_leak",
        "iaf_psc_alpha",
        "iaf_psc_delta",
        "iaf_psc_exp",
        "izhikevich",
        "loihi_lif",
        "parrot_neuron",
        "poisson_generator",
        "spike_generator",
        "spinnaker_lif",
        "srm0",
    ),
    "neuro.model.parts": (
        "Trials",
        "dropout",
        "labels",
        "lateral_reset",
        "local_winners",
        "reward",
        "winner_take_all",
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
    "neuro.model.synapses": (
        "loihi_learning",
        "loihi_static",
        "first_spike_stdp",
        "hedonistic",
        "mozafari",
        "mstdpet",
        "normalised_stdp",
        "r_stddp",
        "r_stdp",
        "static",
        "stddp",
        "stdp",
        "stdp_dopa",
        "stdp_literal",
        "stdp_nn_pre_centered",
        "stdp_nn_restr",
        "stdp_nn_symm",
        "stdp_pl_hom",
        "stdp_triplet",
        "td_ltp",
        "td_moves",
        "tsodyks2",
        "vogels_sprekeler",
        "tempotron",
    ),
    "neuro.model.views": ("View",),
    "neuro.program.backend": ("OverflowWarning",),
    "neuro.program.counts": ("Counts",),
    "neuro.run.assignment": ("assign_labels", "read_labels"),
    "neuro.run.modulators": ("reward_error", "td_error", "td_error_rate"),
    "neuro.run.normalise": ("normalise",),
    "neuro.run.trials": ("TrialCounts", "TrialResults"),
    "neuro.run.simulation": ("ApproximationWarning", "ModelWarning", "Simulation", "compile"),
}

__all__ = [
    "ApproximationWarning",
    "Counts",
    "ModelError",
    "ModelWarning",
    "Network",
    "OverflowWarning",
    "Simulation",
    "TrialCounts",
    "TrialResults",
    "Trials",
    "View",
    "__version__",
    "aeif_cond_exp",
    "aeif_psc_exp",
    "all_to_all",
    "assign_labels",
    "chips",
    "coding",
    "compare",
    "compile",
    "dc_generator",
    "dropout",
    "encode",
    "equations",
    "events",
    "first_spike_stdp",
    "fixed_indegree",
    "fixed_outdegree",
    "grid",
    "hedonistic",
    "hh_psc_alpha",
    "iaf_cond_alpha",
    "iaf_cond_exp",
    "iaf_linear_leak",
    "iaf_psc_alpha",
    "iaf_psc_delta",
    "iaf_psc_exp",
    "iaf_psc_exp_adaptive_threshold",
    "izhikevich",
    "labels",
    "lateral_reset",
    "load",
    "local_winners",
    "lognormal",
    "loihi_learning",
    "loihi_lif",
    "loihi_static",
    "mat2_psc_exp",
    "mozafari",
    "mstdpet",
    "normal",
    "normalise",
    "normalised_stdp",
    "one_to_one",
    "pairs",
    "pairwise_bernoulli",
    "parrot_neuron",
    "poisson_generator",
    "r_stddp",
    "r_stdp",
    "read_labels",
    "register",
    "results",
    "reward",
    "reward_error",
    "spike_generator",
    "spinnaker_lif",
    "srm0",
    "static",
    "stddp",
    "stdp",
    "stdp_dopa",
    "stdp_literal",
    "stdp_nn_pre_centered",
    "stdp_nn_restr",
    "stdp_nn_symm",
    "stdp_pl_hom",
    "stdp_triplet",
    "td_error",
    "td_error_rate",
    "td_ltp",
    "td_moves",
    "tempotron",
    "tsodyks2",
    "uniform",
    "vogels_sprekeler",
    "winner_take_all",
]


def _registered(name: str) -> object:
    """A model, synapse, rule or distribution of a stranger."""
    from neuro.model.language.choices import TABLES

    return next((table[name] for table in TABLES.values() if name in table), None)


if not TYPE_CHECKING:
    __getattr__, __dir__ = lazily(__name__, _HOMES, _registered)
