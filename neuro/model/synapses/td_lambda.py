"""Learning by temporal-difference errors with eligibility over moves, along what a synapse gave to spikes."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from neuro.core.quantities import quantity
from neuro.model.neurons.base import State
from neuro.model.synapses.base import Trace
from neuro.model.synapses.moves import MoveRule


@dataclass(frozen=True, kw_only=True, eq=False)
class td_lambda(MoveRule):
    """A critic's rule: the error n of a move teaches the synapses that brought its neuron to spike, now and before.

    A pre spike adds 1 to x, which decays with `tau`, best that of the neuron's membrane. At a post spike e grows by x.
    When the signal sets n: w += eta n z, then z = decay z + e and e = 0. So n acts on all moves but the last, whose
    outcome is not known yet; at the end of an episode it is set a second time. `decay` is the discount of the reward
    times lambda; z below `x_min` is 0. The weight is within Wmin and Wmax at all times.

    Source: Sutton & Barto, Reinforcement Learning, 2nd ed., 2018, section 12.2 (TD(lambda)), with the spike-triggered
    eligibility of Fremaux, Sprekeler & Gerstner, PLoS Comput. Biol. 9:e1003024, 2013, eq. 17.
    """

    equation: ClassVar[str] = "e += x at post spikes; at a signal n: w += eta n z, z = decay z + e, e = 0"
    source: ClassVar[str] = "Sutton & Barto 2018, section 12.2; Fremaux et al., PLoS Comput. Biol. 9:e1003024, 2013"
    pre: ClassVar[tuple[Trace, ...]] = (Trace("tau"),)
    ordered: ClassVar[tuple[tuple[str, str], ...]] = (("Wmin", "Wmax"),)
    states: ClassVar[tuple[State, ...]] = (
        State("e", "", "eligibility gathered in the present move"),
        State("z", "", "eligibility of the moves before, which a signal teaches"),
    )

    tau: float = quantity(10.0, "ms", "time constant of the pre trace", above=0)
    eta: float = quantity(0.01, "", "learning rate, in the unit of the weight", at_least=0, of_value=True)
    decay: float = quantity(0.9, "", "what is left of z from one move to the next", at_least=0, at_most=1)
    Wmin: float = quantity(-100.0, "", "smallest weight, in the unit of the weight", of_value=True)
    Wmax: float = quantity(100.0, "", "largest weight, in the unit of the weight", of_value=True)


ETA, DECAY, W_MIN, W_MAX, LEAST = range(5)
WEIGHT, E, Z = range(3)


def constants(p, h, c):
    """Learning rate, decay over a move, bounds; `p` is x_min, then the parameters above in order."""
    c[ETA], c[DECAY], c[W_MIN], c[W_MAX], c[LEAST] = p[2], p[3], p[4], p[5], p[0]


def gather(y, e, c, pre, spikes, seen, gate):
    """What the pre spikes gave to the potential is counted at post spikes."""
    y[E, e] += gate * spikes * pre[0]


def teach(y, e, c, n):
    """The error moves the weight along z, which then takes over the present move."""
    w = y[WEIGHT, e] + c[ETA] * n * y[Z, e]
    y[WEIGHT, e] = min(max(w, c[W_MIN]), c[W_MAX])
    z = c[DECAY] * y[Z, e] + y[E, e]
    y[Z, e] = z if abs(z) >= c[LEAST] else 0.0
    y[E, e] = 0.0
