"""Reward-modulated STDP of first spikes with rates that follow the share of mistakes, for trials."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from neuro.core.quantities import quantity
from neuro.model.synapses.base import Synapse
from neuro.model.synapses.bounds import softly


@dataclass(frozen=True, kw_only=True, eq=False)
class mozafari(Synapse):
    """At the end of a trial the inputs of the neuron that decided change by s A w (1 - w).

    Reward: A is Ar_plus where the input arrived before the decision or with it and Ar_minus elsewhere, and s is
    `misses`. Punishment: Ap_minus before, Ap_plus elsewhere, and s is `hits`. Silence teaches nothing. The two shares
    are those of the last batch of trials, set between batches by `sim.set`: a network that is mostly right hardly
    learns from rewards, one that is mostly wrong hardly from punishments. Weights are taken relative to [Wmin, Wmax].

    Source: Mozafari et al., IEEE Trans. Neural Netw. Learn. Syst. 29:6178, 2018; Mosca, MSc thesis, 2020, eqs 120 and
    121, of which eq. 121 is read as eq. 127 of `r_stdp`.
    """

    equation: ClassVar[str] = "dw = s A w (1 - w), s = N_miss/N on reward, N_hit/N on punishment"
    source: ClassVar[str] = "Mozafari et al., IEEE TNNLS 29:6178, 2018"
    learns: ClassVar[str] = "trials"
    ordered: ClassVar[tuple[tuple[str, str], ...]] = (("Wmin", "Wmax"),)

    Ar_plus: float = quantity(0.004, "", "rate on reward, input before the decision")
    Ar_minus: float = quantity(-0.003, "", "rate on reward, other inputs")
    Ap_plus: float = quantity(0.0005, "", "rate on punishment, other inputs")
    Ap_minus: float = quantity(-0.004, "", "rate on punishment, input before the decision")
    misses: float = quantity(1.0, "", "share of wrong decisions in the last batch", at_least=0, at_most=1)
    hits: float = quantity(1.0, "", "share of right decisions in the last batch", at_least=0, at_most=1)
    Wmin: float = quantity(0.0, "", "smallest weight, in the unit of the weight", of_value=True)
    Wmax: float = quantity(1.0, "", "largest weight, in the unit of the weight", of_value=True)


AR_PLUS, AR_MINUS, AP_PLUS, AP_MINUS, MISSES, HITS, W_MIN, W_MAX = range(8)


def constants(p, h, c):
    """The constants are the parameters."""
    c[:8] = p[:8]


def teach(w, since, lesson, c):
    """New weight of one input of the neuron that decided."""
    if lesson > 0.0:
        rate = c[MISSES] * (c[AR_PLUS] if since >= 0.0 else c[AR_MINUS])
    else:
        rate = c[HITS] * (c[AP_MINUS] if since >= 0.0 else c[AP_PLUS])
    return softly(w, rate, c[W_MIN], c[W_MAX])
