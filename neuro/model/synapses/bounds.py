"""Bounds of weights: hard ones, soft ones, and those to which the distance says how far a pair moves a weight."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from neuro.core.quantities import Value, quantity
from neuro.model.synapses.base import OF_EACH, Synapse


@dataclass(frozen=True, kw_only=True, eq=False)
class WeightDependent(Synapse):
    """Parameters of rules between additive (mu = 0) and multiplicative (mu = 1): Guetig et al., 2003."""

    width: ClassVar[int] = 6

    tau_plus: float = quantity(20.0, "ms", "time constant of K+", above=0)
    lambda_: Value = quantity(0.01, "", "step size", at_least=0, **OF_EACH)
    alpha: Value = quantity(1.0, "", "depression relative to potentiation", at_least=0, **OF_EACH)
    mu_plus: Value = quantity(1.0, "", "weight dependence of potentiation", at_least=0, **OF_EACH)
    mu_minus: Value = quantity(1.0, "", "weight dependence of depression", at_least=0, **OF_EACH)
    Wmax: Value = quantity(
        100.0,
        "",
        "largest weight, in the unit of the weight; below 0 it inhibits",
        nonzero=True,
        of_value=True,
        **OF_EACH,
    )


TAU_PLUS, LAMBDA, ALPHA, MU_PLUS, MU_MINUS, W_MAX = range(6)


def constants(p, h, c):
    """The constants are the parameters."""
    c[:6] = p[:6]


def power(share, mu):
    """A share of Wmax to a power above 0; the common one costs nothing."""
    return share if mu == 1.0 else share**mu


def potentiated(w, k, c):
    """A weight after a potentiation by k, up to Wmax."""
    w_max, mu = c[W_MAX], c[MU_PLUS]
    dependence = 1.0 if mu == 0.0 else power(1.0 - w / w_max, mu)
    return within(w + w_max * c[LAMBDA] * dependence * k, w_max)


def depressed(w, k, c):
    """A weight after a depression by k, down to 0."""
    w_max, mu = c[W_MAX], c[MU_MINUS]
    dependence = 1.0 if mu == 0.0 else power(w / w_max, mu)
    return within(w - w_max * c[ALPHA] * c[LAMBDA] * dependence * k, w_max)


def within(w, w_max):
    """A weight between 0 and `w_max`, which is below 0 where the synapse inhibits."""
    return min(max(w, 0.0), w_max) if w_max > 0.0 else max(min(w, 0.0), w_max)


def softly(w, rate, w_min, w_max):
    """A weight after a change by rate w (1 - w), relative to its bounds."""
    span = w_max - w_min
    share = (w - w_min) / span
    return min(w_max, max(w_min, w + span * rate * share * (1.0 - share)))
