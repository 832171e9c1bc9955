"""Leaky integrate-and-fire with alpha-shaped synaptic currents."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from neuro.core.quantities import Value, quantity
from neuro.model.neurons.base import State
from neuro.model.neurons.propagators import Leaky, from_alpha, from_constant, from_exponential, highest, leak


@dataclass(frozen=True, kw_only=True, eq=False)
class iaf_psc_alpha(Leaky):
    """Leaky integrate-and-fire neuron; a spike starts an alpha-shaped current that peaks at its weight in pA.

    Positive weights go to the excitatory current, negative ones to the inhibitory.
    Source: NEST 3.10, `iaf_psc_alpha`; Rotter & Diesmann, Biol. Cybern. 81:381, 1999.
    """

    equation: ClassVar[str] = (
        "C_m V_m' = -C_m (V_m - E_L)/tau_m + I_syn_ex + I_syn_in + I; "
        "I_syn = sum w e t/tau_syn exp(-t/tau_syn); spike at V_m >= V_th"
    )
    source: ClassVar[str] = "NEST 3.10 iaf_psc_alpha; Rotter & Diesmann, Biol. Cybern. 81:381, 1999"
    weight_unit: ClassVar[str] = "pA"
    states: ClassVar[tuple[State, ...]] = (
        State("V_m", "mV", "membrane potential"),
        State("I_syn_ex", "pA", "excitatory synaptic current"),
        State("I_syn_in", "pA", "inhibitory synaptic current"),
        State("dI_syn_ex", "pA/ms", "slope of the excitatory current"),
        State("dI_syn_in", "pA/ms", "slope of the inhibitory current"),
        State("refractory", "steps", "steps left to hold", hidden=True),
    )
    receptors: ClassVar[int] = 2
    linear: ClassVar[bool] = True

    V_min: Value = quantity(-math.inf, "mV", "lowest potential", infinite=True, arrays=True)
    I_e: Value = quantity(0.0, "pA", "constant current", arrays=True)
    tau_syn_ex: Value = quantity(2.0, "ms", "time constant of the excitatory current", above=0, arrays=True)
    tau_syn_in: Value = quantity(2.0, "ms", "time constant of the inhibitory current", above=0, arrays=True)


V_M, I_EX, I_IN, D_EX, D_IN, REFRACTORY = range(6)
V_TH, V_RESET, E_L, V_MIN, P33, P30, I_E, R, GAIN, H = range(10)
P31_EX, P31_IN, P32_EX, P32_IN, P11_EX, P11_IN, TAU_EX, TAU_IN, C_M = range(10, 19)


def constants(p, h, c):
    """Fill `c` for a step of h ms; `p` is tau_minus, then the parameters above in order."""
    tau_m, c_m, tau_ex, tau_in = p[1], p[2], p[9], p[10]
    c[V_TH], c[V_RESET], c[E_L], c[V_MIN] = p[6], p[5], p[4], p[7]
    c[P33] = leak(tau_m, h)
    c[P30] = from_constant(tau_m, c_m, h)
    c[I_E] = p[8]
    c[R] = round(p[3] / h)
    c[GAIN] = tau_m / c_m
    c[H] = h
    c[P31_EX] = from_alpha(tau_m, tau_ex, c_m, h)
    c[P31_IN] = from_alpha(tau_m, tau_in, c_m, h)
    c[P32_EX] = from_exponential(tau_m, tau_ex, c_m, h)
    c[P32_IN] = from_exponential(tau_m, tau_in, c_m, h)
    c[P11_EX] = math.exp(-h / tau_ex)
    c[P11_IN] = math.exp(-h / tau_in)
    c[TAU_EX], c[TAU_IN], c[C_M] = tau_ex, tau_in, c_m


def step(s, c, x, i_0, lo, hi, fired):
    """One step: V with the old currents, then the currents and the input, then the threshold."""
    v_th, e_l, v_min, p33, p30, i_e, h = c[V_TH], c[E_L], c[V_MIN], c[P33], c[P30], c[I_E], c[H]
    p31_ex, p31_in, p32_ex, p32_in = c[P31_EX], c[P31_IN], c[P32_EX], c[P32_IN]
    p11_ex, p11_in = c[P11_EX], c[P11_IN]
    rise_ex, rise_in = math.e / c[TAU_EX], math.e / c[TAU_IN]
    for i in range(lo, hi):
        held = s[REFRACTORY, i]
        i_ex, i_in, d_ex, d_in = s[I_EX, i], s[I_IN, i], s[D_EX, i], s[D_IN, i]
        v = e_l + p33 * (s[V_M, i] - e_l) + p30 * (i_e + i_0[i])
        v += p31_ex * d_ex + p32_ex * i_ex + p31_in * d_in + p32_in * i_in
        v = v_min if v < v_min else v
        v = v if held == 0.0 else s[V_M, i]
        s[V_M, i] = v
        s[I_EX, i] = h * p11_ex * d_ex + p11_ex * i_ex
        s[I_IN, i] = h * p11_in * d_in + p11_in * i_in
        s[D_EX, i] = p11_ex * d_ex + rise_ex * x[0, i]
        s[D_IN, i] = p11_in * d_in + rise_in * x[1, i]
        s[REFRACTORY, i] = 0.0 if held == 0.0 else held - 1.0
        fired[i] = v >= v_th


def fire(s, c, i):
    """Reset V and hold it; the currents go on."""
    s[V_M, i] = c[V_RESET]
    s[REFRACTORY, i] = c[R]


def quiet(s, c, i_0, lo, hi):
    """V stays below its relaxation plus all the charge that the positive currents still carry, and V_min is not met."""
    for i in range(lo, hi):
        drive = c[I_E] + i_0[i]
        top = highest(s[V_M, i], c[E_L], c[GAIN], drive)
        bottom = -highest(-s[V_M, i], -c[E_L], c[GAIN], -drive)
        tau = c[TAU_EX]
        top += (max(s[I_EX, i], 0.0) * tau + max(s[D_EX, i], 0.0) * tau * tau) / c[C_M]
        bottom += (min(s[I_EX, i], 0.0) * tau + min(s[D_EX, i], 0.0) * tau * tau) / c[C_M]
        tau = c[TAU_IN]
        top += (max(s[I_IN, i], 0.0) * tau + max(s[D_IN, i], 0.0) * tau * tau) / c[C_M]
        bottom += (min(s[I_IN, i], 0.0) * tau + min(s[D_IN, i], 0.0) * tau * tau) / c[C_M]
        if s[REFRACTORY, i] != 0.0 or not top < c[V_TH] or bottom < c[V_MIN]:
            return False
    return True
