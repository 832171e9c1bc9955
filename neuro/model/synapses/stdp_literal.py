"""STDP in which a pair changes the weight by a share of it, without an upper bound."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from neuro.core.quantities import quantity
from neuro.model.synapses.base import Synapse


@dataclass(frozen=True, kw_only=True, eq=False)
class stdp_literal(Synapse):
    """Multiplicative STDP read literally, w (1 + dw), of all pairs: a weight of 0 stays, and nothing bounds it above.

    `stdp` with mu_plus = mu_minus = 1 is the multiplicative rule with soft bounds.
    Source: Mosca, MSc thesis, 2020, eq. 19.
    """

    equation: ClassVar[str] = "post: w *= 1 + lambda K+; pre: w *= max(0, 1 - alpha lambda K-)"
    source: ClassVar[str] = "Mosca, MSc thesis, 2020, eqs 16 and 19"
    learns: ClassVar[str] = "pairs"

    tau_plus: float = quantity(20.0, "ms", "time constant of K+", above=0)
    lambda_: float = quantity(0.01, "", "step size", at_least=0)
    alpha: float = quantity(1.0, "", "depression relative to potentiation", at_least=0)


LAMBDA, DEPRESSION = range(2)


def constants(p, h, c):
    """The steps by one pair of either order."""
    c[LAMBDA], c[DEPRESSION] = p[1], p[1] * p[2]


def on_post(y, e, c, pre, post):
    """Potentiate by a share of the weight."""
    y[0, e] *= 1.0 + c[LAMBDA] * pre[0]


def on_pre(y, e, c, pre, post):
    """Depress by a share of the weight, down to 0."""
    y[0, e] *= max(0.0, 1.0 - c[DEPRESSION] * post[0])
