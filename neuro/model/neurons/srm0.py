"""Gerstner's spike response model, simplified: potentials of spikes sent and received are added."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from neuro.core.quantities import Value, quantity
from neuro.model.neurons.base import Resting, State
from neuro.model.neurons.propagators import from_constant, from_exponential, leak


@dataclass(frozen=True, kw_only=True, eq=False)
class srm0(Resting):
    """Spike response model: V_m is the sum of the responses to spikes received and of the after-potential.

    A spike received adds its weight in pA to a current that decays exponentially: the excitatory, or the inhibitory
    where it is negative. A spike sent adds -eta_0 exp(-t/tau_m): of the last spike alone, or of all where
    `eta_sum`; the rest of V_m goes on. It spikes at most once in `t_ref`.

    With `lambda_0` above 0 it has escape noise: no sharp threshold, but a rate of spikes that grows with V_m - V_th.

    Source: Gerstner & Kistler, Spiking Neuron Models, 2002, sections 4.2.3 and 5.3.
    """

    equation: ClassVar[str] = (
        "V_m = E_L + eta + (responses to I_syn_ex + I_syn_in + I); eta(t) = -eta_0 exp(-(t - t_spike)/tau_m); "
        "spike at V_m >= V_th, or where lambda_0 > 0 with probability 1 - exp(-h lambda_0 exp((V_m - V_th)/Delta_V))"
    )
    source: ClassVar[str] = "Gerstner & Kistler, Spiking Neuron Models, 2002, sections 4.2.3 and 5.3"
    weight_unit: ClassVar[str] = "pA"
    states: ClassVar[tuple[State, ...]] = (
        State("V_m", "mV", "membrane potential"),
        State("I_syn_ex", "pA", "excitatory synaptic current"),
        State("I_syn_in", "pA", "inhibitory synaptic current"),
        State("eta", "mV", "after-potential, a part of V_m"),
        State("refractory", "steps", "steps left without another spike", hidden=True),
    )
    receptors: ClassVar[int] = 2
    linear: ClassVar[bool] = True
    draws: ClassVar[bool] = True

    tau_m: Value = quantity(10.0, "ms", "membrane time constant", above=0, arrays=True)
    C_m: Value = quantity(250.0, "pF", "membrane capacity", above=0, arrays=True)
    t_ref: Value = quantity(2.0, "ms", "shortest time between two spikes", at_least=0, arrays=True)
    E_L: Value = quantity(-70.0, "mV", "resting potential", arrays=True)
    V_th: Value = quantity(-55.0, "mV", "threshold", arrays=True)
    eta_0: Value = quantity(15.0, "mV", "depth of the after-potential just after a spike", arrays=True)
    eta_sum: bool = quantity(False, "", "add the after-potentials of all spikes, not the last alone", kind="boolean")
    I_e: Value = quantity(0.0, "pA", "constant current", arrays=True)
    tau_syn_ex: Value = quantity(2.0, "ms", "decay of the excitatory current", above=0, arrays=True)
    tau_syn_in: Value = quantity(2.0, "ms", "decay of the inhibitory current", above=0, arrays=True)
    lambda_0: Value = quantity(0.0, "Hz", "rate of spikes at V_th; 0: a sharp threshold", at_least=0, arrays=True)
    Delta_V: Value = quantity(2.0, "mV", "rise of V_m that makes the rate e-fold", above=0, arrays=True)

    @staticmethod
    def caution(parameters: Mapping[str, Any], resolution: float) -> str:
        """A current that drives V_m over V_th in spite of the last after-potential makes every step a spike."""
        p = parameters
        last = (p["eta_sum"] == 0) & (p["lambda_0"] == 0) & (p["t_ref"] < resolution)
        over = p["E_L"] + p["I_e"] * p["tau_m"] / p["C_m"] - p["eta_0"] * np.exp(-resolution / p["tau_m"]) - p["V_th"]
        if not np.any(last & (over >= 0.0)):
            return ""
        return "I_e drives V_m beyond V_th + eta_0 and t_ref is 0: it fires in every step; set t_ref or eta_sum"


V_M, I_EX, I_IN, ETA, REFRACTORY = range(5)
V_TH, E_L, P33, P30, I_E, R, GAIN, P32_EX, P32_IN, P11_EX, P11_IN, CHARGE_EX, CHARGE_IN = range(13)
ETA_0, ETA_SUM, HAZARD, PER_DELTA_V = range(13, 17)

LARGEST = 500.0
"""Of the exponent of the rate: e^500 spikes a step are as certain as any more, and a double."""


def constants(p, h, c):
    """Fill `c` for a step of h ms; `p` is tau_minus, then the parameters above in order."""
    tau_m, c_m, tau_ex, tau_in = p[1], p[2], p[9], p[10]
    c[V_TH], c[E_L], c[I_E], c[R] = p[5], p[4], p[8], round(p[3] / h)
    c[P33], c[P30], c[GAIN] = leak(tau_m, h), from_constant(tau_m, c_m, h), tau_m / c_m
    c[P32_EX], c[P32_IN] = from_exponential(tau_m, tau_ex, c_m, h), from_exponential(tau_m, tau_in, c_m, h)
    c[P11_EX], c[P11_IN] = math.exp(-h / tau_ex), math.exp(-h / tau_in)
    c[CHARGE_EX], c[CHARGE_IN] = tau_ex / c_m, tau_in / c_m
    c[ETA_0], c[ETA_SUM] = p[6], p[7]
    c[HAZARD], c[PER_DELTA_V] = p[11] * h / 1000.0, 1.0 / p[12]


def step(s, c, x, i_0, lo, hi, fired, u):
    """One step: V with the old currents, then the currents and the input, then the threshold or the draw."""
    v_th, e_l, p33, p30, i_e = c[V_TH], c[E_L], c[P33], c[P30], c[I_E]
    p32_ex, p32_in, p11_ex, p11_in = c[P32_EX], c[P32_IN], c[P11_EX], c[P11_IN]
    hazard, per_delta_v = c[HAZARD], c[PER_DELTA_V]
    for i in range(lo, hi):
        i_ex, i_in = s[I_EX, i], s[I_IN, i]
        v = e_l + p33 * (s[V_M, i] - e_l) + p32_ex * i_ex + p32_in * i_in + p30 * (i_e + i_0[i])
        s[V_M, i] = v
        s[I_EX, i] = i_ex * p11_ex + x[0, i]
        s[I_IN, i] = i_in * p11_in + x[1, i]
        s[ETA, i] *= p33
        free = s[REFRACTORY, i] == 0.0
        s[REFRACTORY, i] -= not free
        if hazard > 0.0:
            spikes = hazard * math.exp(min((v - v_th) * per_delta_v, LARGEST))
            fired[i] = free and u[i] < -math.expm1(-spikes)
        else:
            fired[i] = free and v >= v_th


def fire(s, c, i):
    """Begin an after-potential, which takes the place of the one before or joins it."""
    eta = s[ETA, i] * c[ETA_SUM] - c[ETA_0]
    s[V_M, i] += eta - s[ETA, i]
    s[ETA, i] = eta
    s[REFRACTORY, i] = c[R]


def quiet(s, c, i_0, lo, hi):
    """V stays below its relaxation plus all the charge that the positive currents still carry; no escape."""
    for i in range(lo, hi):
        top = max(s[V_M, i], c[E_L] + c[GAIN] * (c[I_E] + i_0[i]))
        top += max(s[I_EX, i], 0.0) * c[CHARGE_EX] + max(s[I_IN, i], 0.0) * c[CHARGE_IN]
        if c[HAZARD] > 0.0 or s[REFRACTORY, i] != 0.0 or not top < c[V_TH]:
            return False
    return True
