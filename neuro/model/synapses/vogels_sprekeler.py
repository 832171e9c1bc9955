"""Symmetric plasticity of inhibitory synapses."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from neuro.core.quantities import Value, quantity
from neuro.model.synapses.base import OF_EACH, Synapse, Trace
from neuro.model.synapses.bounds import within


@dataclass(frozen=True, kw_only=True, eq=False)
class vogels_sprekeler(Synapse):
    """Near coincidences of either order strengthen a synapse, each pre spike weakens it: so it holds the post rate.

    That rate is alpha / (2 tau). Wmax is below 0 for an inhibitory synapse. K- has the target's own tau_minus, which is
    tau in the paper. Source: NEST 3.10, `vogels_sprekeler_synapse`; Vogels, Sprekeler, Zenke, Clopath & Gerstner,
    Science 334:1569, 2011.
    """

    equation: ClassVar[str] = "post: |w| += eta K+; pre: |w| += eta (K- - alpha)"
    source: ClassVar[str] = "NEST 3.10 vogels_sprekeler_synapse; Vogels et al., Science 334:1569, 2011"
    learns: ClassVar[str] = "pairs"
    pre: ClassVar[tuple[Trace, ...]] = (Trace("tau"),)
    width: ClassVar[int] = 3

    tau: float = quantity(20.0, "ms", "time constant of K+", above=0)
    eta: Value = quantity(0.001, "", "step size, in the unit of the weight", at_least=0, of_value=True, **OF_EACH)
    alpha: Value = quantity(
        0.12, "", "depression by a pre spike, in steps: 2 tau times the rate to hold", at_least=0, **OF_EACH
    )
    Wmax: Value = quantity(
        -100.0,
        "",
        "largest weight, in the unit of the weight; below 0 it inhibits",
        nonzero=True,
        of_value=True,
        **OF_EACH,
    )


ETA, DEPRESSION, W_MAX = range(3)


def constants(p, h, c):
    """Step sizes of the sign of Wmax, and Wmax."""
    c[ETA], c[DEPRESSION] = math.copysign(p[1], p[3]), math.copysign(p[1] * p[2], p[3])
    c[W_MAX] = p[3]


def on_post(y, e, c, pre, post):
    """Strengthen, up to Wmax."""
    y[0, e] = within(y[0, e] + c[ETA] * pre[0], c[W_MAX])


def on_pre(y, e, c, pre, post):
    """Strengthen, up to Wmax; then weaken, down to 0."""
    y[0, e] = within(within(y[0, e] + c[ETA] * post[0], c[W_MAX]) - c[DEPRESSION], c[W_MAX])
