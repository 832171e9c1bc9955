"""A soft winner-take-all circuit: asked for a choice, exactly one of its neurons spikes, drawn by softmax of V_m."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from neuro.core.quantities import quantity
from neuro.model.neurons.base import Neuron, State
from neuro.model.neurons.propagators import leak


@dataclass(frozen=True, kw_only=True, eq=False)
class soft_wta(Neuron):
    """Neurons that compete: a spike to the receptor `ask` makes one of those that it reaches spike.

    Input to `ex` makes V_m jump by its weight in mV; V_m leaks towards 0 and is not reset. In a step in which neurons
    are asked, neuron k of them spikes with probability p_k = exp(V_k / Delta_V) / sum_j exp(V_j / Delta_V): the first
    to spike of point processes with rates exp(V / Delta_V) under a common inhibition that sets their sum. State `p`
    is that probability, 0 in other steps, for rules that learn by (S - p) x. A population is one circuit of at most
    64 neurons.

    Source: Nessler, Pfeiffer, Buesing & Maass, PLoS Comput. Biol. 9:e1003037, 2013, eqs. 2 to 4.
    """

    equation: ClassVar[str] = (
        "V_m' = -V_m/tau_m + sum w delta(t - t_spike); where asked, one spike: p_k = exp(V_k/Delta_V) / sum_j "
        "exp(V_j/Delta_V)"
    )
    source: ClassVar[str] = "Nessler, Pfeiffer, Buesing & Maass, PLoS Comput. Biol. 9:e1003037, 2013"
    weight_unit: ClassVar[str] = "mV"
    states: ClassVar[tuple[State, ...]] = (
        State("V_m", "mV", "membrane potential, relative to rest"),
        State("p", "", "probability with which the last step made it spike", follows=True),
    )
    receptors: ClassVar[int] = 2
    receptor_names: ClassVar[tuple[str, ...]] = ("ex", "ask")
    signed: ClassVar[bool] = False
    takes_current: ClassVar[bool] = False
    linear: ClassVar[bool] = True
    draws: ClassVar[bool] = True
    most: ClassVar[int] = 64

    tau_m: float = quantity(10.0, "ms", "membrane time constant", above=0)
    Delta_V: float = quantity(1.0, "mV", "rise of V_m that makes a neuron e times as likely", above=0)


V_M, P = range(2)
P33, PER_DELTA_V = range(2)


def constants(p, h, c):
    """Fill `c` for a step of h ms; `p` is tau_minus, tau_m, Delta_V."""
    c[P33], c[PER_DELTA_V] = leak(p[1], h), 1.0 / p[2]


def step(s, c, x, i_0, lo, hi, fired, u):
    """One step of the whole circuit: V and its input, then the choice among those that are asked."""
    p33, per_delta_v = c[P33], c[PER_DELTA_V]
    top, asked = -math.inf, 0
    for i in range(lo, hi):
        s[V_M, i] = p33 * s[V_M, i] + x[0, i]
        s[P, i] = 0.0
        fired[i] = 0
        if x[1, i] > 0.0:
            top = max(top, s[V_M, i])
            asked += 1
    if asked == 0:
        return
    total = 0.0
    for i in range(lo, hi):
        if x[1, i] > 0.0:
            # Relative to the largest: no exponential overflows.
            s[P, i] = math.exp((s[V_M, i] - top) * per_delta_v)
            total += s[P, i]
    # The number drawn for the first neuron decides; the others' are not used.
    left, last = u[lo], lo
    chosen = False
    for i in range(lo, hi):
        if s[P, i] > 0.0:
            s[P, i] /= total
            last = i
            if not chosen and left < s[P, i]:
                fired[i], chosen = 1, True
            left -= s[P, i]
    if not chosen:  # the probabilities add up to a little less than 1
        fired[last] = 1


def fire(s, c, i):
    """A choice leaves V_m as it is."""


def quiet(s, c, i_0, lo, hi):
    """No neuron spikes without input; a probability is still to be cleared."""
    some = False
    for i in range(lo, hi):
        some |= s[P, i] != 0.0
    return not some
