"""Describe a spiking network once; run it on a fast simulator or on an emulated chip."""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from neuro.core.lazy import PublicModules, public_names
from neuro.core.version import VERSION

__version__ = VERSION

if sys.platform == "win32":
    raise ImportError("neuro runs on Linux and macOS: on Windows install it in WSL 2, whose system is Linux")

if TYPE_CHECKING:
    from neuro import (
        chips as chips,
        coding as coding,
        compare as compare,
        events as events,
        live as live,
        plots as plots,
        realtime as realtime,
        results as results,
    )
    from neuro.core.errors import ModelError as ModelError
    from neuro.core.registry import register as register
    from neuro.model.distributions import lognormal as lognormal, normal as normal, uniform as uniform
    from neuro.model.equations import equations as equations
    from neuro.model.language import load as load
    from neuro.model.network import Network as Network
    from neuro.model.neurons.builtin import *  # noqa: F403
    from neuro.model.parts import (
        Readout as Readout,
        Trials as Trials,
        World as World,
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
        from_file as from_file,
        grid as grid,
        one_to_one as one_to_one,
        pairs as pairs,
        pairwise_bernoulli as pairwise_bernoulli,
        symmetric_pairwise_bernoulli as symmetric_pairwise_bernoulli,
    )
    from neuro.model.sources import (
        computed as computed,
        like as like,
        population as population,
        schedule as schedule,
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
    from neuro.model.synapses.builtin import *  # noqa: F403
    from neuro.model.views import View as View
    from neuro.model.wiring.edges import shuffled as shuffled
    from neuro.model.wiring.neurons import neuron_table as neuron_table
    from neuro.program.backend import OverflowWarning as OverflowWarning
    from neuro.program.counts import Counts as Counts
    from neuro.realtime.closed_loop import ClosedLoop as ClosedLoop, closed_loop as closed_loop
    from neuro.run.compiled import (
        ApproximationWarning as ApproximationWarning,
        ModelWarning as ModelWarning,
        compile as compile,
    )
    from neuro.run.copies import Copies as Copies
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
    from neuro.run.stepper import Stepper as Stepper
    from neuro.run.trials import TrialCounts as TrialCounts, TrialResults as TrialResults
    from neuro_doctor.diagnosis import Diagnosis as Diagnosis
    from neuro_doctor.doctor import doctor as doctor
    from neuro_doctor.findings import Finding as Finding
    from neuro_exchange.c_code.export import CCode as CCode, save_c as save_c
    from neuro_exchange.netx import from_netx as from_netx
    from neuro_exchange.nir.exporting import to_nir as to_nir
    from neuro_exchange.nir.importing import check_nir as check_nir, from_nir as from_nir
    from neuro_exchange.nir.torch_modules import from_torch as from_torch
    from neuro_exchange.pynn.read import from_pynn as from_pynn
    from neuro_exchange.pynn.write import to_pynn as to_pynn
    from neuro_exchange.sonata import save_sonata as save_sonata
    from neuro_exchange.verdict import Verdict as Verdict, Verdicts as Verdicts
    from neuro_predict.predict import Predictions as Predictions, predict as predict
    from neuro_sweeps.execute import sweep as sweep, tune as tune, tuned as tuned
    from neuro_sweeps.function import Pruned as Pruned, report_step as report_step
    from neuro_sweeps.table import SweepTable as SweepTable
    from neuro_sweeps.trials import TuneTable as TuneTable


def _registered(name: str) -> object:
    """Return the third-party model, synapse, rule or distribution with a name, or None."""
    from neuro.model.language.loader import TABLES

    return next((table[name] for table in TABLES.values() if name in table), None)


if not TYPE_CHECKING:
    sys.meta_path.insert(0, PublicModules())
    __getattr__, __dir__, __all__ = public_names(__name__, __file__, _registered)
