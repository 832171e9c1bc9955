"""Pairwise spike-timing-dependent plasticity."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from neuro.core.quantities import quantity
from neuro.model.synapses.base import Synapse


@dataclass(frozen=True, kw_only=True, eq=False)
class stdp(Synapse):
    """STDP between additive (mu = 0) and multiplicative (mu = 1); the weight changes at pre spikes.

    Source: NEST 3.10, `stdp_synapse`; Guetig et al., J. Neurosci. 23:3697, 2003; Morrison, Diesmann &
    Gerstner, Biol. Cybern. 98:459, 2008.
    """

    equation: ClassVar[str] = (
        "post: w += lambda Wmax (1 - w/Wmax)^mu_plus K+; pre: w -= alpha lambda Wmax (w/Wmax)^mu_minus K-"
    )
    source: ClassVar[str] = "NEST 3.10 stdp_synapse; Guetig et al., J. Neurosci. 23:3697, 2003"
    learns: ClassVar[str] = "pairs"

    tau_plus: float = quantity(20.0, "ms", "time constant of K+", above=0)
    lambda_: float = quantity(0.01, "", "step size", at_least=0)
    alpha: float = quantity(1.0, "", "depression relative to potentiation", at_least=0)
    mu_plus: float = quantity(1.0, "", "weight dependence of potentiation", at_least=0)
    mu_minus: float = quantity(1.0, "", "weight dependence of depression", at_least=0)
    Wmax: float = quantity(100.0, "", "largest weight, in the unit of the weight", above=0)


TAU_PLUS, LAMBDA, ALPHA, MU_PLUS, MU_MINUS, W_MAX = range(6)


def constants(p, h, c):
    """The constants are the parameters."""
    c[:6] = p[:6]


def on_post(y, e, c, pre, post):
    """Potentiate, up to Wmax."""
    w_max = c[W_MAX]
    share = 1.0 - y[0, e] / w_max
    mu = c[MU_PLUS]
    factor = 1.0 if mu == 0.0 else (share if mu == 1.0 else share**mu)
    y[0, e] = min(w_max, y[0, e] + w_max * c[LAMBDA] * factor * pre[0])


def on_pre(y, e, c, pre, post):
    """Depress, down to 0."""
    w_max = c[W_MAX]
    share = y[0, e] / w_max
    mu = c[MU_MINUS]
    factor = 1.0 if mu == 0.0 else (share if mu == 1.0 else share**mu)
    y[0, e] = max(0.0, y[0, e] - w_max * c[ALPHA] * c[LAMBDA] * factor * post[0])
