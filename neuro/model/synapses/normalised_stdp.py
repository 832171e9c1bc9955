"""STDP of first spikes, without reward, by neurons with a limited sum of weights, for trials."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from neuro.core.quantities import quantity
from neuro.model.synapses.base import Synapse
from neuro.model.synapses.lessons import Lesson, TrialEnd


@dataclass(frozen=True, kw_only=True, eq=False)
class normalised_stdp(Synapse):
    """At the end of a trial the inputs of the neuron that decided change, and then its weights are scaled to a sum.

    A weight grows by A_plus (1 - w) where the input arrived before the decision or with it and changes by A_minus w
    elsewhere, taken relative to [Wmin, Wmax]; then all weights of the neuron are multiplied by one factor, so that
    their sum is `total`, and cut at the bounds. It needs no labels: `neuro.assign_labels` finds afterwards for what
    each neuron stands.

    Source: the bounds, of which each slows down what moves towards it, Rubin et al., Phys. Rev. Lett. 86:364, 2001; the
    sum, which is theirs for 784 inputs, Diehl & Cook, Front. Comput. Neurosci. 9:99, 2015. The rates are ours.
    """

    equation: ClassVar[str] = "dw = A_plus (1 - w) or A_minus w by whether the input came; w *= total / sum w"
    source: ClassVar[str] = (
        "Rubin et al., Phys. Rev. Lett. 86:364, 2001; Diehl & Cook, Front. Comput. Neurosci. 9:99, 2015"
    )
    learns: ClassVar[str] = "trials"
    ordered: ClassVar[tuple[tuple[str, str], ...]] = (("Wmin", "Wmax"),)
    supervised: ClassVar[bool] = False

    A_plus: float = quantity(0.05, "", "rate where the input came before the decision", at_least=0, at_most=1)
    A_minus: float = quantity(-0.01, "", "rate elsewhere", at_least=-1, at_most=0)
    total: float = quantity(
        78.0, "", "sum of the weights of a neuron, in the unit of the weight", above=0, of_value=True
    )
    Wmin: float = quantity(0.0, "", "smallest weight, in the unit of the weight", at_least=0, of_value=True)
    Wmax: float = quantity(1.0, "", "largest weight, in the unit of the weight", of_value=True)

    def lessons(self, end: TrialEnd) -> tuple[Lesson, ...]:
        """The neuron that decided."""
        return (Lesson(end.winner, end.tick, 1.0),) if end.winner >= 0 else ()


A_PLUS, A_MINUS, TOTAL, W_MIN, W_MAX = range(5)


def constants(p, h, c):
    """The constants are the parameters."""
    c[:5] = p[:5]


def teach(w, since, lesson, c):
    """New weight of one input of the neuron that decided."""
    return w + c[A_PLUS] * (c[W_MAX] - w) if since >= 0.0 else w + c[A_MINUS] * (w - c[W_MIN])


def settle(w, since, total, c):
    """The same weight after those of all inputs, which have the sum `total`, are scaled; all 0 stay so."""
    return min(c[W_MAX], max(c[W_MIN], w * c[TOTAL] / total)) if total > 0.0 else w
