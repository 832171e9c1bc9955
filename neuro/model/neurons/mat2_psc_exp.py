"""A leaky neuron whose threshold adapts on two time scales and whose potential is not reset."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from neuro.core.quantities import Value, quantity
from neuro.model.neurons.base import Neuron, State
from neuro.model.neurons.propagators import from_constant, from_exponential, leak


@dataclass(frozen=True, kw_only=True, eq=False)
class mat2_psc_exp(Neuron):
    """Multi-timescale adaptive threshold (MAT) neuron with exponential currents: a spike raises V_th and leaves V_m.

    V_th relaxes to `omega` with two time constants. It spikes at most once in `t_ref`. A spike adds its weight in pA
    to the excitatory current, or to the inhibitory where it is negative. Integrated exactly.

    Source: NEST 3.10, `mat2_psc_exp`; Kobayashi et al., Front. Comput. Neurosci. 3:9, 2009.
    """

    equation: ClassVar[str] = (
        "C_m V_m' = -C_m (V_m - E_L)/tau_m + I_syn_ex + I_syn_in + I; I_syn' = -I_syn/tau_syn; "
        "V_th = omega + V_th_alpha_1 + V_th_alpha_2, "
        "which decay with tau_1 and tau_2; at V_m >= V_th they grow by alpha_1 and alpha_2"
    )
    source: ClassVar[str] = "NEST 3.10 mat2_psc_exp; Kobayashi et al., Front. Comput. Neurosci. 3:9, 2009"
    weight_unit: ClassVar[str] = "pA"
    states: ClassVar[tuple[State, ...]] = (
        State("V_m", "mV", "membrane potential"),
        State("I_syn_ex", "pA", "excitatory synaptic current"),
        State("I_syn_in", "pA", "inhibitory synaptic current"),
        State("V_th_alpha_1", "mV", "fast part of the threshold"),
        State("V_th_alpha_2", "mV", "slow part of the threshold"),
        State("V_th", "mV", "threshold", follows=True),
        State("refractory", "steps", "steps left without another spike", hidden=True),
    )
    receptors: ClassVar[int] = 2
    linear: ClassVar[bool] = True

    tau_m: Value = quantity(5.0, "ms", "membrane time constant", above=0, arrays=True)
    C_m: Value = quantity(100.0, "pF", "membrane capacity", above=0, arrays=True)
    t_ref: Value = quantity(2.0, "ms", "shortest time between two spikes", at_least=0, arrays=True)
    E_L: Value = quantity(-70.0, "mV", "resting potential", arrays=True)
    I_e: Value = quantity(0.0, "pA", "constant current", arrays=True)
    tau_syn_ex: Value = quantity(1.0, "ms", "decay of the excitatory current", above=0, arrays=True)
    tau_syn_in: Value = quantity(3.0, "ms", "decay of the inhibitory current", above=0, arrays=True)
    tau_1: Value = quantity(10.0, "ms", "decay of the threshold's fast part", above=0, arrays=True)
    tau_2: Value = quantity(200.0, "ms", "decay of the threshold's slow part", above=0, arrays=True)
    alpha_1: Value = quantity(37.0, "mV", "rise of the fast part at a spike", arrays=True)
    alpha_2: Value = quantity(2.0, "mV", "rise of the slow part at a spike", arrays=True)
    omega: Value = quantity(-51.0, "mV", "threshold at rest", arrays=True)

    @staticmethod
    def initial(parameters: Mapping[str, Any]) -> dict[str, Any]:
        """V_m starts at E_L, V_th at omega."""
        return {"V_m": parameters["E_L"], "V_th": parameters["omega"]}


V_M, I_EX, I_IN, TH_1, TH_2, V_TH, REFRACTORY = range(7)
OMEGA, E_L, P33, P30, I_E, R, GAIN, P32_EX, P32_IN, P11_EX, P11_IN, CHARGE_EX, CHARGE_IN = range(13)
FADE_1, FADE_2, ALPHA_1, ALPHA_2 = range(13, 17)


def constants(p, h, c):
    """Fill `c` for a step of h ms; `p` is tau_minus, then the parameters above in order."""
    tau_m, c_m, tau_ex, tau_in = p[1], p[2], p[6], p[7]
    c[R], c[E_L], c[I_E], c[OMEGA] = round(p[3] / h), p[4], p[5], p[12]
    c[P33], c[P30], c[GAIN] = leak(tau_m, h), from_constant(tau_m, c_m, h), tau_m / c_m
    c[P32_EX], c[P32_IN] = from_exponential(tau_m, tau_ex, c_m, h), from_exponential(tau_m, tau_in, c_m, h)
    c[P11_EX], c[P11_IN] = math.exp(-h / tau_ex), math.exp(-h / tau_in)
    c[CHARGE_EX], c[CHARGE_IN] = tau_ex / c_m, tau_in / c_m
    c[FADE_1], c[FADE_2], c[ALPHA_1], c[ALPHA_2] = math.exp(-h / p[8]), math.exp(-h / p[9]), p[10], p[11]


def step(s, c, x, i_0, lo, hi, fired):
    """One step: V with the old currents, the threshold, then the currents and the input, then the test."""
    e_l, p33, p30, i_e, omega = c[E_L], c[P33], c[P30], c[I_E], c[OMEGA]
    p32_ex, p32_in, p11_ex, p11_in, fade_1, fade_2 = c[P32_EX], c[P32_IN], c[P11_EX], c[P11_IN], c[FADE_1], c[FADE_2]
    for i in range(lo, hi):
        i_ex, i_in = s[I_EX, i], s[I_IN, i]
        v = e_l + p33 * (s[V_M, i] - e_l) + p32_ex * i_ex + p32_in * i_in + p30 * (i_e + i_0[i])
        th_1, th_2 = fade_1 * s[TH_1, i], fade_2 * s[TH_2, i]
        v_th = omega + th_2 + th_1
        s[V_M, i], s[TH_1, i], s[TH_2, i], s[V_TH, i] = v, th_1, th_2, v_th
        s[I_EX, i] = i_ex * p11_ex + x[0, i]
        s[I_IN, i] = i_in * p11_in + x[1, i]
        free = s[REFRACTORY, i] == 0.0
        s[REFRACTORY, i] -= not free
        fired[i] = free and v >= v_th


def fire(s, c, i):
    """Raise the threshold; V goes on."""
    s[TH_1, i] += c[ALPHA_1]
    s[TH_2, i] += c[ALPHA_2]
    s[V_TH, i] = c[OMEGA] + s[TH_2, i] + s[TH_1, i]
    s[REFRACTORY, i] = c[R]


def quiet(s, c, i_0, lo, hi):
    """V stays below its relaxation plus all the charge that the positive currents still carry; V_th is never lower."""
    for i in range(lo, hi):
        top = max(s[V_M, i], c[E_L] + c[GAIN] * (c[I_E] + i_0[i]))
        top += max(s[I_EX, i], 0.0) * c[CHARGE_EX] + max(s[I_IN, i], 0.0) * c[CHARGE_IN]
        lowest = c[OMEGA] + min(s[TH_1, i], 0.0) + min(s[TH_2, i], 0.0)
        if s[REFRACTORY, i] != 0.0 or not top < lowest:
            return False
    return True
