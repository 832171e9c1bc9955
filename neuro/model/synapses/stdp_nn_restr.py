"""STDP of nearest neighbours, restricted to those that follow each other."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from neuro.core.quantities import quantity
from neuro.model.neurons.base import State
from neuro.model.synapses.base import Trace
from neuro.model.synapses.bounds import WeightDependent, constants as constants, depressed, potentiated


@dataclass(frozen=True, kw_only=True, eq=False)
class stdp_nn_restr(WeightDependent):
    """STDP in which each spike pairs only with its immediate neighbour of the other side.

    Of the post spikes between two pre spikes the first potentiates, and the last depresses at the second pre spike.
    NEST acts as if a pre spike had come at time 0: `pre_at_start` does so, too.
    Source: NEST 3.10, `stdp_nn_restr_synapse`; Morrison, Diesmann & Gerstner, Biol. Cybern. 98:459, 2008, fig. 7C.
    """

    equation: ClassVar[str] = (
        "first post since a pre: w += lambda Wmax (1 - w/Wmax)^mu_plus k+; "
        "pre after a post: w -= alpha lambda Wmax (w/Wmax)^mu_minus k-; "
        "k = exp(-t/tau), t since the last spike of a side"
    )
    source: ClassVar[str] = "NEST 3.10 stdp_nn_restr_synapse; Morrison et al., Biol. Cybern. 98:459, 2008"
    learns: ClassVar[str] = "pairs"
    pre: ClassVar[tuple[Trace, ...]] = (Trace("tau_plus", nearest=True, starts="pre_at_start"),)
    post: ClassVar[tuple[Trace, ...]] = (Trace("tau_minus", nearest=True),)
    states: ClassVar[tuple[State, ...]] = (
        State("answered", "", "whether a post spike came since the last pre spike", hidden=True),
    )

    pre_at_start: bool = quantity(False, "", "begin as if a pre spike had come at time 0", kind="boolean")


def on_post(y, e, c, pre, post):
    """Potentiate, if it is the first since the last pre spike."""
    if y[1, e] == 0.0:
        y[0, e] = potentiated(y[0, e], pre[0], c)
        y[1, e] = 1.0


def on_pre(y, e, c, pre, post):
    """Depress, if a post spike came since the last pre spike."""
    if y[1, e] != 0.0:
        y[0, e] = depressed(y[0, e], post[0], c)
        y[1, e] = 0.0
