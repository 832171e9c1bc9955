"""How far a pair moves a weight that has a bound: by a power of the distance to it (Guetig et al., 2003)."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from neuro.core.quantities import Value, quantity
from neuro.model.synapses.base import OF_EACH, Synapse
from neuro.model.synapses.within import within


@dataclass(frozen=True, kw_only=True, eq=False)
class WeightDependent(Synapse):
    """Parameters of rules between additive (mu = 0) and multiplicative (mu = 1), with soft bounds."""

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
