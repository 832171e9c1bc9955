"""A point process with leaky integration of delta-shaped input: spikes at random, at a rate that V_m sets."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from neuro.core.quantities import Value, quantity
from neuro.model.neurons.base import Neuron, State
from neuro.model.neurons.propagators import from_constant, leak


@dataclass(frozen=True, kw_only=True, eq=False)
class pp_psc_delta(Neuron):
    """Point process neuron: V_m integrates its input with a leak, and spikes are drawn at a rate that depends on V_m.

    Input makes V_m jump by its weight in mV. The rate in Hz is c_1 V_m + c_2 exp(c_3 V_m), 0 where that is negative.
    After a spike it is silent for `dead_time`; V_m goes on. Each spike raises the threshold E_sfa by `q_sfa`, which
    decays: the rate is that of V_m - E_sfa, so spikes become more regular. State `p` is the probability with which the
    last step made it spike, for rules that read it. NEST's lists of several adaptations and its random dead times are
    not part of it.

    Source: NEST 3.10, `pp_psc_delta`; Gerstner & Kistler, Spiking Neuron Models, 2002, section 5.3.
    """

    equation: ClassVar[str] = (
        "V_m' = -V_m/tau_m + (I_e + I)/C_m + sum w delta(t - t_spike); E_sfa' = -E_sfa/tau_sfa, + q_sfa at a spike; "
        "spike with probability 1 - exp(-h max(0, c_1 V + c_2 exp(c_3 V))), V = V_m - E_sfa"
    )
    source: ClassVar[str] = "NEST 3.10 pp_psc_delta; Gerstner & Kistler, Spiking Neuron Models, 2002, section 5.3"
    weight_unit: ClassVar[str] = "mV"
    states: ClassVar[tuple[State, ...]] = (
        State("V_m", "mV", "membrane potential, relative to rest"),
        State("p", "", "probability with which the last step made it spike", follows=True),
        State("refractory", "steps", "steps left without a spike", hidden=True),
        State("E_sfa", "mV", "adaptation of the threshold"),
    )
    draws: ClassVar[bool] = True

    tau_m: Value = quantity(10.0, "ms", "membrane time constant", above=0, arrays=True)
    C_m: Value = quantity(250.0, "pF", "membrane capacity", above=0, arrays=True)
    dead_time: Value = quantity(1.0, "ms", "time after a spike without another, at least a step", above=0, arrays=True)
    with_reset: bool = quantity(True, "", "whether a spike sets V_m to 0", kind="boolean")
    c_1: Value = quantity(0.0, "Hz/mV", "slope of the linear part of the rate", arrays=True)
    c_2: Value = quantity(1.238, "Hz", "factor of the exponential part of the rate", arrays=True)
    c_3: Value = quantity(0.25, "1/mV", "exponent of the exponential part", arrays=True)
    I_e: Value = quantity(0.0, "pA", "constant current", arrays=True)
    tau_sfa: Value = quantity(34.0, "ms", "time constant of the adaptation", above=0, arrays=True)
    q_sfa: Value = quantity(0.0, "mV", "rise of the threshold at a spike", arrays=True)


V_M, P, REFRACTORY, E_SFA = range(4)
P33, P30, I_E, C_1, C_2, C_3, H, R, RESET, Q33, Q_SFA = range(11)

LARGEST = 500.0
"""Of the exponent of the rate: e^500 spikes a step are as certain as any more, and a double."""


def constants(p, h, c):
    """Fill `c` for a step of h ms; `p` is tau_minus, then the parameters above in order."""
    c[P33], c[P30], c[I_E] = leak(p[1], h), from_constant(p[1], p[2], h), p[8]
    c[C_1], c[C_2], c[C_3], c[H] = p[5], p[6], p[7], h / 1000.0
    c[R], c[RESET] = max(1.0, round(p[3] / h)), p[4]
    c[Q33], c[Q_SFA] = leak(p[9], h), p[10]


def step(s, c, x, i_0, lo, hi, fired, u):
    """One step: V and its input, then the draw; dead time counts down, and V goes on meanwhile."""
    p33, p30, i_e, c_1, c_2, c_3, h = c[P33], c[P30], c[I_E], c[C_1], c[C_2], c[C_3], c[H]
    q33 = c[Q33]
    constant = c_3 == 0.0  # spares an exponential
    for i in range(lo, hi):
        v = p30 * (i_0[i] + i_e) + p33 * s[V_M, i] + x[0, i]
        s[V_M, i] = v
        s[E_SFA, i] *= q33
        v -= s[E_SFA, i]
        free = s[REFRACTORY, i] == 0.0
        s[REFRACTORY, i] -= not free
        rate = c_1 * v + (c_2 if constant else c_2 * math.exp(min(c_3 * v, LARGEST)))
        p = -math.expm1(-rate * h) if free and rate > 0.0 else 0.0
        s[P, i] = p
        fired[i] = u[i] < p


def fire(s, c, i):
    """Begin the dead time, raise the threshold, and reset V where that is asked for."""
    s[REFRACTORY, i] = c[R]
    s[E_SFA, i] += c[Q_SFA]
    if c[RESET] != 0.0:
        s[V_M, i] = 0.0


def quiet(s, c, i_0, lo, hi):
    """Never: a draw may make it spike in any step."""
    return False
