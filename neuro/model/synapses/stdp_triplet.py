"""Plasticity by triplets of spikes."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from neuro.core.quantities import Value, quantity
from neuro.model.synapses.base import K_MINUS, K_PLUS, OF_EACH, Synapse, Trace
from neuro.model.synapses.bounds import within


@dataclass(frozen=True, kw_only=True, eq=False)
class stdp_triplet(Synapse):
    """STDP by pairs and triplets, all to all: each side has a fast trace and a slow one.

    The slow ones, K+3 and K-3, are those just before the spike. The defaults are the fit to data from visual cortex.
    Wmax below 0 makes the synapse inhibitory. Source: NEST 3.10, `stdp_triplet_synapse`, where tau_minus_triplet
    belongs to the neuron; Pfister & Gerstner, J. Neurosci. 26:9673, 2006.
    """

    equation: ClassVar[str] = (
        "post: |w| += K+ (Aplus + Aplus_triplet K-3); pre: |w| -= K- (Aminus + Aminus_triplet K+3)"
    )
    source: ClassVar[str] = "NEST 3.10 stdp_triplet_synapse; Pfister & Gerstner, J. Neurosci. 26:9673, 2006"
    learns: ClassVar[str] = "pairs"
    pre: ClassVar[tuple[Trace, ...]] = (K_PLUS, Trace("tau_plus_triplet"))
    post: ClassVar[tuple[Trace, ...]] = (K_MINUS, Trace("tau_minus_triplet"))
    width: ClassVar[int] = 5

    tau_plus: float = quantity(16.8, "ms", "time constant of K+", above=0)
    tau_plus_triplet: float = quantity(101.0, "ms", "time constant of K+3", above=0)
    tau_minus_triplet: float = quantity(125.0, "ms", "time constant of K-3", above=0)
    Aplus: Value = quantity(
        5e-10, "", "potentiation by a pair, in the unit of the weight", at_least=0, of_value=True, **OF_EACH
    )
    Aplus_triplet: Value = quantity(
        6.2e-3, "", "potentiation by a triplet, likewise", at_least=0, of_value=True, **OF_EACH
    )
    Aminus: Value = quantity(7e-3, "", "depression by a pair, likewise", at_least=0, of_value=True, **OF_EACH)
    Aminus_triplet: Value = quantity(
        2.3e-4, "", "depression by a triplet, likewise", at_least=0, of_value=True, **OF_EACH
    )
    Wmax: Value = quantity(
        100.0, "", "largest weight, in the unit of the weight", nonzero=True, of_value=True, **OF_EACH
    )


A_PLUS, A_PLUS_TRIPLET, A_MINUS, A_MINUS_TRIPLET, W_MAX = range(5)


def constants(p, h, c):
    """Step sizes of the sign of Wmax, and Wmax."""
    for k in range(4):
        c[k] = math.copysign(p[3 + k], p[7])
    c[W_MAX] = p[7]


def on_post(y, e, c, pre, post):
    """Potentiate, up to Wmax."""
    y[0, e] = within(y[0, e] + pre[0] * (c[A_PLUS] + c[A_PLUS_TRIPLET] * post[1]), c[W_MAX])


def on_pre(y, e, c, pre, post):
    """Depress, down to 0."""
    y[0, e] = within(y[0, e] - post[0] * (c[A_MINUS] + c[A_MINUS_TRIPLET] * pre[1]), c[W_MAX])
