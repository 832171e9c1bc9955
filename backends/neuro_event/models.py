"""Models of which more is known than any model has to keep."""

from __future__ import annotations

from neuro.model.neurons import Neuron, iaf_psc_alpha, iaf_psc_delta, iaf_psc_exp, izhikevich, parrot_neuron
from neuro.model.synapses import Synapse, stdp, stdp_dopa

NEURONS: tuple[type[Neuron], ...] = (parrot_neuron, iaf_psc_delta, iaf_psc_exp, iaf_psc_alpha, izhikevich)
"""Their steps take items of the input and of the current only, and write for each neuron whether it fired."""

RULES: tuple[type[Synapse], ...] = (stdp, stdp_dopa)
"""Their traces are those that `plastic` keeps; those of all others are kept as `own_rules` has them."""
