"""Describe a spiking network once; run it on a fast simulator or on an emulated chip."""

from __future__ import annotations

from typing import TYPE_CHECKING

from neuro.core.lazy import public_names
from neuro.core.version import VERSION

__version__ = VERSION

if TYPE_CHECKING:
    from neuro import (
        chips as chips,
        coding as coding,
        compare as compare,
        events as events,
        plots as plots,
        results as results,
    )
    from neuro.core.errors import ModelError as ModelError
    from neuro.core.registry import register as register
    from neuro.model.distributions import lognormal as lognormal, normal as normal, uniform as uniform
    from neuro.model.equations import equations as equations
    from neuro.model.language import load as load
    from neuro.model.network import Network as Network
    from neuro.model.neurons import (
        ac_generator as ac_generator,
        aeif_cond_exp as aeif_cond_exp,
        aeif_psc_exp as aeif_psc_exp,
        dc_generator as dc_generator,
        encode as encode,
        event_camera as event_camera,
        gamma_sup_generator as gamma_sup_generator,
        hh_psc_alpha as hh_psc_alpha,
        iaf_cond_alpha as iaf_cond_alpha,
        iaf_cond_exp as iaf_cond_exp,
        iaf_linear_leak as iaf_linear_leak,
        iaf_psc_alpha as iaf_psc_alpha,
        iaf_psc_delta as iaf_psc_delta,
        iaf_psc_exp as iaf_psc_exp,
        iaf_psc_exp_adaptive_threshold as iaf_psc_exp_adaptive_threshold,
        inhomogeneous_poisson_generator as inhomogeneous_poisson_generator,
        izhikevich as izhikevich,
        loihi_lif as loihi_lif,
        mat2_psc_exp as mat2_psc_exp,
        noise_generator as noise_generator,
        parrot_neuron as parrot_neuron,
        poisson_generator as poisson_generator,
        pp_psc_delta as pp_psc_delta,
        sinusoidal_poisson_generator as sinusoidal_poisson_generator,
        soft_wta as soft_wta,
        spike_generator as spike_generator,
        spike_train as spike_train,
        spinnaker_lif as spinnaker_lif,
        srm0 as srm0,
        step_current_generator as step_current_generator,
    )
    from neuro.model.parts import (
        Trials as Trials,
        dropout as dropout,
        labels as labels,
        lateral_reset as lateral_reset,
        local_winners as local_winners,
        reward as reward,
        winner_take_all as winner_take_all,
    )
    from neuro.model.rules import (
        all_to_all as all_to_all,
        distance_dependent as distance_dependent,
        fixed_indegree as fixed_indegree,
        fixed_outdegree as fixed_outdegree,
        fixed_total_number as fixed_total_number,
        grid as grid,
        one_to_one as one_to_one,
        pairs as pairs,
        pairwise_bernoulli as pairwise_bernoulli,
        symmetric_pairwise_bernoulli as symmetric_pairwise_bernoulli,
    )
    from neuro.model.space import (
        box as box,
        circular as circular,
        exponential as exponential,
        gaussian as gaussian,
        linear as linear,
        of_distance as of_distance,
        rectangular as rectangular,
    )
    from neuro.model.synapses import (
        first_spike_stdp as first_spike_stdp,
        hedonistic as hedonistic,
        loihi_learning as loihi_learning,
        loihi_static as loihi_static,
        mozafari as mozafari,
        mstdpet as mstdpet,
        normalised_stdp as normalised_stdp,
        r_stddp as r_stddp,
        r_stdp as r_stdp,
        reinforce as reinforce,
        static as static,
        stddp as stddp,
        stdp as stdp,
        stdp_dopa as stdp_dopa,
        stdp_literal as stdp_literal,
        stdp_nn_pre_centered as stdp_nn_pre_centered,
        stdp_nn_restr as stdp_nn_restr,
        stdp_nn_symm as stdp_nn_symm,
        stdp_pl_hom as stdp_pl_hom,
        stdp_triplet as stdp_triplet,
        td_lambda as td_lambda,
        td_ltp as td_ltp,
        td_moves as td_moves,
        tempotron as tempotron,
        tsodyks2 as tsodyks2,
        vogels_sprekeler as vogels_sprekeler,
    )
    from neuro.model.views import View as View
    from neuro.program.backend import OverflowWarning as OverflowWarning
    from neuro.program.counts import Counts as Counts
    from neuro.run.compiled import (
        ApproximationWarning as ApproximationWarning,
        ModelWarning as ModelWarning,
        compile as compile,
    )
    from neuro.run.copies import Copies as Copies, Stepper as Stepper
    from neuro.run.learning_tools import (
        assign_labels as assign_labels,
        normalise as normalise,
        read_labels as read_labels,
        reward_error as reward_error,
        td_error as td_error,
        td_error_rate as td_error_rate,
    )
    from neuro.run.ports import Port as Port
    from neuro.run.simulation import Simulation as Simulation
    from neuro.run.trials import TrialCounts as TrialCounts, TrialResults as TrialResults
    from neuro.sweeps.calling import sweep as sweep
    from neuro.sweeps.steps import Pruned as Pruned, report_step as report_step
    from neuro.sweeps.table import SweepTable as SweepTable
    from neuro.sweeps.tuning.calling import tune as tune, tuned as tuned
    from neuro.sweeps.tuning.table import TuneTable as TuneTable


def _registered(name: str) -> object:
    """A third-party model, synapse, rule or distribution."""
    from neuro.model.language.choices import TABLES

    return next((table[name] for table in TABLES.values() if name in table), None)


if not TYPE_CHECKING:
    __getattr__, __dir__, __all__ = public_names(__name__, __file__, _registered)
