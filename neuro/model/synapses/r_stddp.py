"""Reward-modulated learning of delays by first spikes, for trials."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from neuro.core.quantities import quantity
from neuro.model.synapses.base import DelayRule


@dataclass(frozen=True, kw_only=True, eq=False)
class r_stddp(DelayRule):
    """At the end of a trial the delays of the inputs of the neuron that decided change by A d; weights stay.

    Reward: A is Ar_plus where the input arrived before the decision or with it and Ar_minus elsewhere. Punishment:
    Ap_minus before, Ap_plus elsewhere. After silence nothing changes. What contributed to a right decision comes
    earlier from then on, so Ar_plus < 0 < Ar_minus, and the other way round after a wrong one: with the signs of rates
    of weights the rule unlearns.

    Source: Mosca, MSc thesis, 2020, eq. 131; the signs, and that arrivals count and not emissions, are choices measured
    to learn.
    """

    equation: ClassVar[str] = "dd = A d, A by outcome and by whether the input came before the decision"
    source: ClassVar[str] = "Mosca, MSc thesis, 2020, eq. 131"
    learns: ClassVar[str] = "trials"

    d_min: float = quantity(1.0, "ms", "shortest delay; from near 0 none comes back soon", above=0)
    d_max: float = quantity(20.0, "ms", "longest delay; fixed, as it says how much may be under way", above=0)
    Ar_plus: float = quantity(-0.05, "", "rate on reward, input before the decision")
    Ar_minus: float = quantity(0.05, "", "rate on reward, other inputs")
    Ap_plus: float = quantity(-0.02, "", "rate on punishment, other inputs")
    Ap_minus: float = quantity(0.1, "", "rate on punishment, input before the decision")


D_MIN, D_MAX, AR_PLUS, AR_MINUS, AP_PLUS, AP_MINUS = range(6)


def constants(p, h, c):
    """The constants are the parameters."""
    c[:6] = p[:6]


def teach(d, since, lesson, c):
    """New delay of one input of a rewarded or punished neuron; at the decision counts as before it."""
    if lesson > 0.0:
        rate = c[AR_PLUS] if since >= 0.0 else c[AR_MINUS]
    else:
        rate = c[AP_MINUS] if since >= 0.0 else c[AP_PLUS]
    return min(c[D_MAX], max(c[D_MIN], d + rate * d))
