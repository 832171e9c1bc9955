"""The models that are compiled into the loop, in the order of their numbers; those of strangers have entries."""

from __future__ import annotations

from neuro.model.neurons import NEURONS as OWN
from neuro.model.neurons import Neuron
from neuro.model.synapses import Synapse, stdp, stdp_dopa

NEURONS: tuple[type[Neuron], ...] = OWN
RULES: tuple[type[Synapse], ...] = (stdp, stdp_dopa)
MODULATED_RULES = tuple(rule for rule in RULES if rule.modulated)
