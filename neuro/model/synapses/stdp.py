"""Pairwise spike-timing-dependent plasticity."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from neuro.model.synapses.bounds import WeightDependent, constants as constants, depressed, potentiated


@dataclass(frozen=True, kw_only=True, eq=False)
class stdp(WeightDependent):
    """STDP of all pairs of spikes, between additive (mu = 0) and multiplicative (mu = 1).

    Additive: mu_plus = mu_minus = 0. Soft bounds: both 1. Van Rossum: mu_plus = 0, mu_minus = 1. Guetig: both between.
    The weight changes at pre spikes. Wmax below 0 makes the synapse inhibitory.
    Source: NEST 3.10, `stdp_synapse`; Guetig et al., J. Neurosci. 23:3697, 2003; van Rossum, Bi & Turrigiano,
    J. Neurosci. 20:8812, 2000; Morrison, Diesmann & Gerstner, Biol. Cybern. 98:459, 2008.
    """

    equation: ClassVar[str] = (
        "post: w += lambda Wmax (1 - w/Wmax)^mu_plus K+; pre: w -= alpha lambda Wmax (w/Wmax)^mu_minus K-"
    )
    source: ClassVar[str] = "NEST 3.10 stdp_synapse; Guetig et al., J. Neurosci. 23:3697, 2003"
    learns: ClassVar[str] = "pairs"


def on_post(y, e, c, pre, post):
    """Potentiate, up to Wmax."""
    y[0, e] = potentiated(y[0, e], pre[0], c)


def on_pre(y, e, c, pre, post):
    """Depress, down to 0."""
    y[0, e] = depressed(y[0, e], post[0], c)
