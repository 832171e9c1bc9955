"""The models that are compiled into the loop, in the order of their numbers; those of strangers have entries."""

from __future__ import annotations

from neuro.model.neurons import NEURONS as OWN
from neuro.model.neurons import Neuron
from neuro.model.synapses import Synapse, r_stdp, stdp, stdp_dopa
from neuro.program.backend import Problem
from neuro.program.program import Program

NEURONS: tuple[type[Neuron], ...] = OWN
RULES: tuple[type[Synapse], ...] = (stdp, stdp_dopa)
MODULATED_RULES = tuple(rule for rule in RULES if rule.modulated)


def unknown(program: Program) -> list[Problem]:
    """A problem for each part whose model has no number: its code is not in the loop."""
    return [
        Problem(
            True,
            f"projection '{p.name}': {p.synapse.name}",
            "its code is not in the compiled loop",
            "run it on backend 'reference'",
            p.origin,
        )
        for p in program.projections
        if not p.synapse.chip and not _runs(p.synapse)
    ]


def _runs(synapse: Synapse) -> bool:
    if synapse.learns == "trials":
        return synapse.arithmetic is r_stdp.arithmetic
    return not synapse.learns or type(synapse) in RULES
