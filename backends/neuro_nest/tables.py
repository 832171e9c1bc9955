"""NEST's names of models and synapses, the limits of NEST, and its clock."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from neuro.core.clock import Clock

NODES = {
    "iaf_psc_delta": "iaf_psc_delta",
    "iaf_psc_exp": "iaf_psc_exp",
    "iaf_psc_alpha": "iaf_psc_alpha",
    "izhikevich": "izhikevich",
    "aeif_cond_exp": "aeif_cond_exp",
    "aeif_psc_exp": "aeif_psc_exp",
    "hh_psc_alpha": "hh_psc_alpha",
    "iaf_cond_alpha": "iaf_cond_alpha",
    "mat2_psc_exp": "mat2_psc_exp",
    "iaf_cond_exp": "iaf_cond_exp",
    "parrot_neuron": "parrot_neuron",
    "poisson_generator": "spike_train_injector",
    "inhomogeneous_poisson_generator": "spike_train_injector",
    "sinusoidal_poisson_generator": "spike_train_injector",
    "gamma_sup_generator": "spike_train_injector",
    "spike_generator": "spike_train_injector",
    "spike_train": "spike_train_injector",
    "dc_generator": "dc_generator",
    "step_current_generator": "step_current_generator",
    "ac_generator": "ac_generator",
    "noise_generator": "step_current_generator",
}
"""NEST's name of each of our models. An injector is a node like a neuron, so it may have plastic synapses."""

DEVICE = "spike_generator"
"""NEST model of the devices beside injectors, for static synapses: a device sends with the weights at emission."""

RECEPTORS_OF_CURRENTS = {("iaf_psc_exp", "ex"): 1}
"""NEST's number of each receptor that accepts a current, by model and our name of the receptor."""

SYNAPSES = {
    "static": "static_synapse_lbl",
    "stdp": "stdp_synapse_lbl",
    **{
        name: f"{name}_synapse_lbl"
        for name in ("stdp_nn_symm", "stdp_nn_restr", "stdp_nn_pre_centered", "stdp_triplet", "vogels_sprekeler")
    },
    "stdp_pl_hom": "stdp_pl_synapse_hom_lbl",
    "tsodyks2": "tsodyks2_synapse_lbl",
    "stdp_dopa": "stdp_dopamine_synapse_lbl",
}
"""NEST's name of each of our synapse models, in the variant with labelled synapses."""

STATES = {
    "static": ("weight",),
    "stdp": ("weight", "Kplus"),
    **dict.fromkeys(("stdp_nn_symm", "stdp_nn_restr", "stdp_nn_pre_centered", "vogels_sprekeler"), ("weight",)),
    "stdp_triplet": ("weight", "Kplus"),
    "stdp_pl_hom": ("weight", "Kplus"),
    "tsodyks2": ("weight", "u", "x"),
    "stdp_dopa": ("weight", "c", "n", "Kplus"),
}
"""Readable states of the synapses of each model, by NEST's names."""

SHARED = frozenset({"stdp_pl_hom"})
"""Rules whose parameters NEST stores in the synapse model, not in synapses. Each projection has a copy of the model."""

FIXED_TRUE = frozenset({"pre_at_start"})
"""Boolean parameters of rules that NEST lacks. NEST behaves as if these parameters were true."""

OF_TARGET = frozenset({"tau_minus_triplet"})
"""Parameters of rules that NEST stores in the postsynaptic neuron."""

UNREADABLE = frozenset({"I_syn_ex", "I_syn_in", "dI_syn_ex", "dI_syn_in"})
"""States that NEST neither shows nor sets between two steps. Currents are recorded a step late, slopes not at all."""

RK4 = "rk4_substeps"
"""A parameter that NEST lacks, because it always integrates by RKF45."""

LACKING = (RK4, "reset_by_subtraction", "max_spikes", "threshold_rises")
"""Parameters that NEST lacks, and which are not passed to it."""

TICKS_PER_MS = 1000
"""Ticks of NEST's clock per ms: a tick is a microsecond."""

LARGE_TAU = 1e200
"""Value that replaces an infinite tau_m, with which NEST's propagators would be NaN."""

SYNAPSE_MODELS = 430
"""Largest number of copies of synapse models in a network. NEST 3.10 holds 511 models, 77 of them its own."""


MS_PER_TICK = 1 / TICKS_PER_MS


class NestClock(Clock):
    """A clock whose times in ms equal those of NEST's `Time::get_ms` bit for bit: ticks times the length of a tick.

    NEST compares `min_delay` with its own number, and some decimal numbers are smaller: 700 ticks of 0.001 ms are
    0.7000000000000001 ms, so a delay of 0.7 ms would be less than one step. All times passed to NEST are computed here.
    """

    def __init__(self, resolution: float) -> None:
        super().__init__(resolution)
        self._ticks = round(resolution * TICKS_PER_MS)

    def ms(self, step: int) -> float:
        """Return the time of a step in ms."""
        return MS_PER_TICK * (step * self._ticks)

    def array_ms(self, steps: NDArray[np.int64]) -> NDArray[np.float64]:
        """Return the times of steps in ms."""
        return np.multiply(steps.astype(np.int64) * self._ticks, MS_PER_TICK, dtype=np.float64)
