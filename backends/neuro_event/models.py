"""The models that the compiled loop knows, in the order of their numbers: those listed when this is first imported."""

from __future__ import annotations

from neuro.model.neurons import NEURONS as LISTED
from neuro.model.neurons import Neuron
from neuro.model.synapses import SYNAPSES, Synapse, r_stdp
from neuro.program.backend import Problem
from neuro.program.program import Population, Program, Projection

NEURONS: tuple[type[Neuron], ...] = tuple(LISTED)
RULES: tuple[type[Synapse], ...] = tuple(s for s in SYNAPSES.values() if s.learns == "pairs")
MODULATED_RULES = tuple(rule for rule in RULES if rule.modulated)


def unknown(program: Program) -> list[Problem]:
    """A problem for each part whose model has no number: its code is not in the loop."""
    cells = [p for p in program.populations if isinstance(p.model, Neuron) and not p.model.chip]
    wires = [p for p in program.projections if not p.synapse.chip]
    return [
        *(
            _problem(f"population '{p.name}': {p.model.name}", "neurons", p)
            for p in cells
            if type(p.model) not in NEURONS
        ),
        *(_problem(f"projection '{p.name}': {p.synapse.name}", "synapses", p) for p in wires if not _runs(p.synapse)),
    ]


def _runs(synapse: Synapse) -> bool:
    if synapse.learns == "trials":
        return synapse.arithmetic is r_stdp.arithmetic
    return not synapse.learns or type(synapse) in RULES


def _problem(what: str, package: str, part: Population | Projection) -> Problem:
    way_out = f"enter it in {package.upper()} of neuro.{package} before"
    return Problem(True, what, "it was not listed when this backend was first used", way_out, part.origin)
