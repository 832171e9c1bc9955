"""What NEST calls our models, and what of them it does not show."""

from __future__ import annotations

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
    "spike_generator": "spike_train_injector",
    "dc_generator": "dc_generator",
}
"""Our models and NEST's. An injector is a node as neurons are: it may be the source of plastic synapses."""

SYNAPSES = {"static": "static_synapse_lbl", "stdp": "stdp_synapse_lbl", "stdp_dopa": "stdp_dopamine_synapse_lbl"}
"""Our models and NEST's, of the kind whose synapses bear a label."""

STATES = {"static": ("weight",), "stdp": ("weight", "Kplus"), "stdp_dopa": ("weight", "c", "n", "Kplus")}
"""What of their synapses can be read, in NEST's words."""

UNREADABLE = frozenset({"I_syn_ex", "I_syn_in", "dI_syn_ex", "dI_syn_in"})
"""States that NEST neither shows nor sets between two steps: currents it records, a step late, slopes not at all."""

RK4 = "rk4_substeps"
"""Our parameter that NEST has not: what it integrates, it integrates by RKF45."""

TICKS_PER_MS = 1000
"""NEST's clock ticks in microseconds."""

ENDLESS = 1e200
"""What stands for an infinite tau_m, with which NEST's propagators are no numbers."""

SYNAPSE_MODELS = 430
"""Copies of synapse models that one network may have; NEST 3.10 holds 511, 77 of them its own."""
