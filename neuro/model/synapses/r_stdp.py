"""Reward-modulated STDP of first spikes, for trials."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from neuro.core.quantities import quantity
from neuro.model.synapses.base import Synapse
from neuro.model.synapses.bounds import softly
from neuro.model.synapses.lessons import Growth, Lesson, TrialEnd


@dataclass(frozen=True, kw_only=True, eq=False)
class r_stdp(Synapse):
    """At the end of a trial the inputs of the neuron that decided change by A w (1 - w).

    Reward: A is Ar_plus where the input arrived before the decision and Ar_minus elsewhere. Punishment:
    Ap_minus before, Ap_plus elsewhere. On punishment and on silence every weight of the right label's maps
    grows by epsilon; with `rescue` their best-excited neuron is rewarded instead, as if it had decided.
    Weights are taken relative to [Wmin, Wmax].

    Source: Mosca, MSc thesis, 2020, eqs 126-128, of which eq. 127 is read as its text says; `rescue` is this
    project's. The rule extends Mozafari et al., IEEE Trans. Neural Netw. Learn. Syst. 29:6178, 2018.
    """

    equation: ClassVar[str] = "dw = A w (1 - w), A by outcome and by whether the input came before the decision"
    source: ClassVar[str] = "Mosca, MSc thesis, 2020, eqs 126-128; Mozafari et al., IEEE TNNLS 29:6178, 2018"
    learns: ClassVar[str] = "trials"
    ordered: ClassVar[tuple[tuple[str, str], ...]] = (("Wmin", "Wmax"),)

    Ar_plus: float = quantity(0.075, "", "rate on reward, input before the decision")
    Ar_minus: float = quantity(-0.025, "", "rate on reward, other inputs")
    Ap_plus: float = quantity(0.005, "", "rate on punishment, other inputs")
    Ap_minus: float = quantity(-0.04, "", "rate on punishment, input before the decision")
    epsilon: float = quantity(0.0002, "", "growth of the right label's weights on punishment and silence", at_least=0)
    rescue: bool = quantity(False, "", "reward the right label's best-excited neuron instead", kind="boolean")
    Wmin: float = quantity(0.0, "", "smallest weight, in the unit of the weight", of_value=True)
    Wmax: float = quantity(1.0, "", "largest weight, in the unit of the weight", of_value=True)

    def lessons(self, end: TrialEnd) -> list[Lesson | Growth]:
        """The neuron that decided; after a mistake or silence also the right label's maps."""
        lessons: list[Lesson | Growth] = []
        if end.reward:
            lessons.append(Lesson(end.winner, end.tick, end.reward))
        if end.hit:
            return lessons
        if self.rescue:
            best = end.best_excited()
            if best >= 0:
                lessons.append(Lesson(best, end.tick if end.tick >= 0 else end.ticks - 1, 1.0))
        elif self.epsilon > 0.0:
            lessons.append(Growth(end.maps))
        return lessons


AR_PLUS, AR_MINUS, AP_PLUS, AP_MINUS, EPSILON, RESCUE, W_MIN, W_MAX = range(8)


def constants(p, h, c):
    """The constants are the parameters."""
    c[:8] = p[:8]


def teach(w, since, lesson, c):
    """New weight of one input of a rewarded or punished neuron; at the decision counts as before it."""
    if lesson > 0.0:
        rate = c[AR_PLUS] if since >= 0.0 else c[AR_MINUS]
    else:
        rate = c[AP_MINUS] if since >= 0.0 else c[AP_PLUS]
    return softly(w, rate, c[W_MIN], c[W_MAX])


def encourage(w, c):
    """New weight of one input of a map of the right label after a wrong or silent trial (eq. 128)."""
    return min(c[W_MAX], max(c[W_MIN], w + (c[W_MAX] - c[W_MIN]) * c[EPSILON]))
