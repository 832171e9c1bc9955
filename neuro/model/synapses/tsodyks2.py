"""Short-term plasticity: depression and facilitation of what a synapse releases."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from neuro.core.quantities import Value, quantity
from neuro.model.neurons.base import State
from neuro.model.synapses.base import OF_EACH, Synapse, Trace


@dataclass(frozen=True, kw_only=True, eq=False)
class tsodyks2(Synapse):
    """A pre spike releases the share u of the resources x that are left: w u x is sent, and w stays as it is.

    Between spikes x recovers towards 1 and u falls towards 0; u and x are shown as of the last pre spike. At first x is
    1 and u is U; in NEST itself u begins at 0.5 if nothing else is said, whatever U is.
    Source: NEST 3.10, `tsodyks2_synapse`; Maass & Markram, Neural Networks 15:155, 2002.
    """

    equation: ClassVar[str] = (
        "pre, t after the last: x = 1 + (x - x u - 1) exp(-t/tau_rec), u = U + u (1 - U) exp(-t/tau_fac); sends w u x"
    )
    source: ClassVar[str] = "NEST 3.10 tsodyks2_synapse; Maass & Markram, Neural Networks 15:155, 2002"
    learns: ClassVar[str] = "pairs"
    pre: ClassVar[tuple[Trace, ...]] = (Trace("tau_rec", nearest=True), Trace("tau_fac", nearest=True))
    post: ClassVar[tuple[Trace, ...]] = ()
    width: ClassVar[int] = 1
    states: ClassVar[tuple[State, ...]] = (
        State("u", "", "share of the resources that a spike releases"),
        State("x", "", "share of the resources that is left"),
    )

    U: Value = quantity(0.5, "", "what a spike adds to u, of what is missing to 1", at_least=0, at_most=1, **OF_EACH)
    tau_rec: float = quantity(800.0, "ms", "time constant of recovery", above=0)
    tau_fac: float = quantity(0.0, "ms", "time constant of facilitation; with 0 there is none", at_least=0)

    @staticmethod
    def initial(parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Rested: u is U and x is 1."""
        return {"u": parameters["U"], "x": 1.0}


def constants(p, h, c):
    """U is all."""
    c[0] = p[0]


def on_post(y, e, c, pre, post):
    """A post spike changes nothing."""


def on_pre(y, e, c, pre, post):
    """Recover since the last spike; the first one finds the synapse rested."""
    u, x = y[1, e], y[2, e]
    y[2, e] = 1.0 + (x - x * u - 1.0) * pre[0]
    y[1, e] = c[0] + u * (1.0 - c[0]) * pre[1]


def sent(y, e, c):
    """What is released."""
    return y[0, e] * y[1, e] * y[2, e]
