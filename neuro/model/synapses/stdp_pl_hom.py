"""STDP with a power law of potentiation."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from neuro.core.quantities import quantity
from neuro.model.synapses.base import Synapse


@dataclass(frozen=True, kw_only=True, eq=False)
class stdp_pl_hom(Synapse):
    """STDP of all pairs that potentiates by a power of the weight and depresses by a share of it, without upper bound.

    Weights are at least 0; one of 0 stays. Source: NEST 3.10, `stdp_pl_synapse_hom`; Morrison, Aertsen & Diesmann,
    Neural Comput. 19:1437, 2007.
    """

    equation: ClassVar[str] = "post: w += lambda w^mu K+; pre: w -= alpha lambda w K-"
    source: ClassVar[str] = "NEST 3.10 stdp_pl_synapse_hom; Morrison et al., Neural Comput. 19:1437, 2007"
    learns: ClassVar[str] = "pairs"

    tau_plus: float = quantity(20.0, "ms", "time constant of K+", above=0)
    lambda_: float = quantity(0.1, "", "step size", at_least=0)
    alpha: float = quantity(1.0, "", "depression relative to potentiation", at_least=0)
    mu: float = quantity(0.4, "", "power of the weight by which it is potentiated", at_least=0)

    def bounds(self) -> tuple[float, float]:
        """A power of a weight below 0 is NaN."""
        return 0.0, math.inf


LAMBDA, DEPRESSION, MU = range(3)


def constants(p, h, c):
    """The steps of one pair of either order, and the power."""
    c[LAMBDA], c[DEPRESSION], c[MU] = p[1], p[1] * p[2], p[3]


def on_post(y, e, c, pre, post):
    """Potentiate by a power of the weight."""
    y[0, e] += c[LAMBDA] * y[0, e] ** c[MU] * pre[0]


def on_pre(y, e, c, pre, post):
    """Depress by a share of the weight, down to 0."""
    y[0, e] = max(0.0, y[0, e] - c[DEPRESSION] * y[0, e] * post[0])
