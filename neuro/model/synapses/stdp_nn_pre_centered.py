"""STDP of nearest neighbours, centred on the pre spike."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from neuro.model.neurons.base import State
from neuro.model.synapses.base import Trace
from neuro.model.synapses.bounds import WeightDependent, constants as constants, depressed, potentiated


@dataclass(frozen=True, kw_only=True, eq=False)
class stdp_nn_pre_centered(WeightDependent):
    """STDP in which each pre spike pairs with the post spike before it and with the one after it.

    So the first post spike after some pre spikes pairs with all of them, and sets K+ back to 0.
    Source: NEST 3.10, `stdp_nn_pre_centered_synapse`; Morrison, Diesmann & Gerstner, Biol. Cybern. 98:459, 2008,
    fig. 7B.
    """

    equation: ClassVar[str] = (
        "post: w += lambda Wmax (1 - w/Wmax)^mu_plus K+, K+ = 0; "
        "pre: w -= alpha lambda Wmax (w/Wmax)^mu_minus k-, K+ += 1; k- = exp(-t/tau_minus), t since the last post spike"
    )
    source: ClassVar[str] = "NEST 3.10 stdp_nn_pre_centered_synapse; Morrison et al., Biol. Cybern. 98:459, 2008"
    learns: ClassVar[str] = "pairs"
    pre: ClassVar[tuple[Trace, ...]] = (Trace("tau_plus", nearest=True),)
    post: ClassVar[tuple[Trace, ...]] = (Trace("tau_minus", nearest=True),)
    states: ClassVar[tuple[State, ...]] = (
        State("unanswered", "", "K+ just after the last pre spike, of those since the last post spike", hidden=True),
    )


def on_post(y, e, c, pre, post):
    """Potentiate by the pre spikes since the last post spike; `pre` is what is left of K+ since the last of them."""
    y[0, e] = potentiated(y[0, e], y[1, e] * pre[0], c)
    y[1, e] = 0.0


def on_pre(y, e, c, pre, post):
    """Depress by the last post spike."""
    y[0, e] = depressed(y[0, e], post[0], c)
    y[1, e] = y[1, e] * pre[0] + 1.0
