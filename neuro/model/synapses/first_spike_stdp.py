"""STDP of first spikes, without reward, for trials."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from neuro.core.quantities import quantity
from neuro.model.synapses.base import Synapse
from neuro.model.synapses.bounds import softly
from neuro.model.synapses.lessons import Lesson, TrialEnd


@dataclass(frozen=True, kw_only=True, eq=False)
class first_spike_stdp(Synapse):
    """At the end of a trial the inputs of the neuron that decided change by A w (1 - w), whatever the label.

    A is A_plus where the input arrived before the decision or with it, A_minus elsewhere. Weights are taken relative to
    [Wmin, Wmax]. It needs no labels: `neuro.assign_labels` finds afterwards for what each neuron stands.

    Source: Masquelier & Thorpe, PLoS Comput. Biol. 3:e31, 2007; the rates are those of Kheradpisheh et al., Neural
    Networks 99:56, 2018.
    """

    equation: ClassVar[str] = "dw = A w (1 - w), A by whether the input came before the decision"
    source: ClassVar[str] = "Masquelier & Thorpe, PLoS Comput. Biol. 3:e31, 2007"
    learns: ClassVar[str] = "trials"
    ordered: ClassVar[tuple[tuple[str, str], ...]] = (("Wmin", "Wmax"),)
    supervised: ClassVar[bool] = False

    A_plus: float = quantity(0.004, "", "rate where the input came before the decision")
    A_minus: float = quantity(-0.003, "", "rate elsewhere")
    Wmin: float = quantity(0.0, "", "smallest weight, in the unit of the weight", of_value=True)
    Wmax: float = quantity(1.0, "", "largest weight, in the unit of the weight", of_value=True)

    def lessons(self, end: TrialEnd) -> tuple[Lesson, ...]:
        """The neuron that decided."""
        return (Lesson(end.winner, end.tick, 1.0),) if end.winner >= 0 else ()


A_PLUS, A_MINUS, W_MIN, W_MAX = range(4)


def constants(p, h, c):
    """The constants are the parameters."""
    c[:4] = p[:4]


def teach(w, since, lesson, c):
    """New weight of one input of the neuron that decided."""
    return softly(w, c[A_PLUS] if since >= 0.0 else c[A_MINUS], c[W_MIN], c[W_MAX])
