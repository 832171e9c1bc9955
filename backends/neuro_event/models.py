"""The models that are compiled into the loop, in the order of their numbers; all others have entries of their own."""

from __future__ import annotations

from neuro.model.neurons import Neuron, iaf_psc_alpha, iaf_psc_delta, iaf_psc_exp, izhikevich, parrot_neuron
from neuro.model.synapses import Synapse, stdp, stdp_dopa

NEURONS: tuple[type[Neuron], ...] = (parrot_neuron, iaf_psc_delta, iaf_psc_exp, iaf_psc_alpha, izhikevich)
RULES: tuple[type[Synapse], ...] = (stdp, stdp_dopa)
MODULATED_RULES = tuple(rule for rule in RULES if rule.modulated)
