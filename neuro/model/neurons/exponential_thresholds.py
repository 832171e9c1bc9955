"""Leaky neurons with synaptic currents and a threshold that rises at a spike and decays exponentially."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call", check-untyped-defs=False
from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from neuro.core.quantities import Value, quantity
from neuro.model.neurons.base import Neuron, State
from neuro.model.neurons.currents import (
    E_L,
    I_E,
    I_EX,
    I_IN,
    P11_EX,
    P11_IN,
    P30,
    P32_EX,
    P32_IN,
    P33,
    REFRACTORY,
    STATES,
    V_M,
    V_RESET,
    V_TH,
    R,
    highest_with_currents,
    set_decays,
    set_leaky,
)
from neuro.model.neurons.propagators import LeakyWithCurrents

THETA = 4
TH_1, TH_2, TH = 4, 5, 6
"""Rows of the states that follow the four rows of `neuro.model.neurons.currents`. Each line belongs to one model."""

THETA_PLUS, FADE = 14, 15
FADE_1, FADE_2, ALPHA_1, ALPHA_2 = range(14, 18)
"""Indices of the constants that follow the fourteen of `neuro.model.neurons.currents`. Each line is for one model."""


@dataclass(frozen=True, kw_only=True, eq=False)
class iaf_psc_exp_adaptive_threshold(LeakyWithCurrents):
    """Leaky integrate-and-fire neuron with an adaptive threshold, for unsupervised learning.

    A received spike adds its weight in pA to a current that decays exponentially: the excitatory current, or the
    inhibitory current if the weight is negative. Each emitted spike raises the threshold V_th + theta by `theta_plus`.
    theta decays slowly, so neurons that fire more often than others become less excitable: the mean of theta is
    theta_plus x tau_theta x rate. A group ranks its neurons by V_m - V_th, without theta.

    Source: Diehl & Cook, Front. Comput. Neurosci. 9:99, 2015, section 2.2. The other dynamics are those of
    `iaf_psc_exp`.
    """

    equation: ClassVar[str] = (
        "C_m V_m' = -C_m (V_m - E_L)/tau_m + I_syn_ex + I_syn_in + I; I_syn' = -I_syn/tau_syn; "
        "theta' = -theta/tau_theta; at V_m >= V_th + theta: V_m = V_reset, theta += theta_plus"
    )
    source: ClassVar[str] = "Diehl & Cook, Front. Comput. Neurosci. 9:99, 2015"
    states: ClassVar[tuple[State, ...]] = (*STATES, State("theta", "mV", "rise of the threshold"))

    theta_plus: Value = quantity(0.05, "mV", "rise of the threshold per spike", arrays=True)
    tau_theta: Value = quantity(1e7, "ms", "time constant of the threshold's rise", above=0, arrays=True)

    def constants(p, h, c):
        """Fill `c` for a step of h ms. `p` is tau_minus, followed by the parameters above in order."""
        set_leaky(p, h, c)
        c[THETA_PLUS], c[FADE] = p[10], math.exp(-h / p[11])

    def step(s, c, x, i_0, lo, hi, fired):
        """Advance V_m with the currents before the step, then the currents and theta, then test the threshold.

        theta also decays during refractoriness.
        """
        v_th, e_l, p33, p30, i_e = c[V_TH], c[E_L], c[P33], c[P30], c[I_E]
        p32_ex, p32_in, p11_ex, p11_in, fade = c[P32_EX], c[P32_IN], c[P11_EX], c[P11_IN], c[FADE]
        for i in range(lo, hi):
            refractory_left = s[REFRACTORY, i]
            i_ex = s[I_EX, i]
            i_in = s[I_IN, i]
            v = e_l + p33 * (s[V_M, i] - e_l) + p32_ex * i_ex + p32_in * i_in + p30 * (i_e + i_0[i])
            v = v if refractory_left == 0.0 else s[V_M, i]
            s[V_M, i] = v
            s[I_EX, i] = i_ex * p11_ex + x[0, i]
            s[I_IN, i] = i_in * p11_in + x[1, i]
            s[REFRACTORY, i] = 0.0 if refractory_left == 0.0 else refractory_left - 1.0
            theta = fade * s[THETA, i]
            s[THETA, i] = theta
            fired[i] = refractory_left == 0.0 and v >= v_th + theta

    def fire(s, c, i):
        """Reset V_m, begin refractoriness, and raise the threshold. The currents are not reset."""
        s[V_M, i] = c[V_RESET]
        s[THETA, i] += c[THETA_PLUS]
        s[REFRACTORY, i] = c[R]

    def quiet(s, c, i_0, lo, hi):
        """Return whether V_m cannot reach the threshold. A positive theta only falls, a negative one only rises."""
        for i in range(lo, hi):
            if s[REFRACTORY, i] != 0.0 or not highest_with_currents(s, c, i_0, i) < c[V_TH] + min(s[THETA, i], 0.0):
                return False
        return True


@dataclass(frozen=True, kw_only=True, eq=False)
class mat2_psc_exp(Neuron):
    """Multi-timescale adaptive threshold (MAT) neuron with exponential currents.

    An emitted spike raises V_th and does not reset V_m.

    V_th relaxes to `omega` with two time constants. The neuron spikes at most once in `t_ref`. A received spike
    adds its weight in pA to the excitatory current, or to the inhibitory current if the weight is negative. The
    integration is exact.

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
        *STATES,
        State("V_th_alpha_1", "mV", "fast part of the threshold"),
        State("V_th_alpha_2", "mV", "slow part of the threshold"),
        State("V_th", "mV", "threshold", follows=True),
    )
    receptors: ClassVar[int] = 2
    linear: ClassVar[bool] = True

    tau_m: Value = quantity(5.0, "ms", "membrane time constant", above=0, arrays=True)
    C_m: Value = quantity(100.0, "pF", "membrane capacity", above=0, arrays=True)
    t_ref: Value = quantity(2.0, "ms", "shortest interval between two spikes", at_least=0, arrays=True)
    E_L: Value = quantity(-70.0, "mV", "resting potential", arrays=True)
    I_e: Value = quantity(0.0, "pA", "constant current", arrays=True)
    tau_syn_ex: Value = quantity(1.0, "ms", "time constant of the excitatory current", above=0, arrays=True)
    tau_syn_in: Value = quantity(3.0, "ms", "time constant of the inhibitory current", above=0, arrays=True)
    tau_1: Value = quantity(10.0, "ms", "time constant of the threshold's fast part", above=0, arrays=True)
    tau_2: Value = quantity(200.0, "ms", "time constant of the threshold's slow part", above=0, arrays=True)
    alpha_1: Value = quantity(37.0, "mV", "rise of the fast part per spike", arrays=True)
    alpha_2: Value = quantity(2.0, "mV", "rise of the slow part per spike", arrays=True)
    omega: Value = quantity(-51.0, "mV", "threshold at rest", arrays=True)

    @staticmethod
    def initial(parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Return V_m = E_L and V_th = omega."""
        return {"V_m": parameters["E_L"], "V_th": parameters["omega"]}

    def constants(p, h, c):
        """Fill `c` for a step of h ms. `p` is tau_minus, followed by the parameters above in order."""
        c[V_TH], c[E_L], c[I_E], c[R] = p[12], p[4], p[5], round(p[3] / h)
        set_decays(c, h, p[1], p[2], p[6], p[7])
        c[FADE_1], c[FADE_2], c[ALPHA_1], c[ALPHA_2] = math.exp(-h / p[8]), math.exp(-h / p[9]), p[10], p[11]

    def step(s, c, x, i_0, lo, hi, fired):
        """Advance V_m with the currents before the step, then the threshold and the currents, then test it."""
        e_l, p33, p30, i_e, omega = c[E_L], c[P33], c[P30], c[I_E], c[V_TH]
        p32_ex, p32_in, p11_ex, p11_in = c[P32_EX], c[P32_IN], c[P11_EX], c[P11_IN]
        fade_1, fade_2 = c[FADE_1], c[FADE_2]
        for i in range(lo, hi):
            i_ex, i_in = s[I_EX, i], s[I_IN, i]
            v = e_l + p33 * (s[V_M, i] - e_l) + p32_ex * i_ex + p32_in * i_in + p30 * (i_e + i_0[i])
            th_1, th_2 = fade_1 * s[TH_1, i], fade_2 * s[TH_2, i]
            v_th = omega + th_2 + th_1
            s[V_M, i], s[TH_1, i], s[TH_2, i], s[TH, i] = v, th_1, th_2, v_th
            s[I_EX, i] = i_ex * p11_ex + x[0, i]
            s[I_IN, i] = i_in * p11_in + x[1, i]
            free = s[REFRACTORY, i] == 0.0
            s[REFRACTORY, i] -= not free
            fired[i] = free and v >= v_th

    def fire(s, c, i):
        """Raise the threshold. V_m is not reset."""
        s[TH_1, i] += c[ALPHA_1]
        s[TH_2, i] += c[ALPHA_2]
        s[TH, i] = c[V_TH] + s[TH_2, i] + s[TH_1, i]
        s[REFRACTORY, i] = c[R]

    def quiet(s, c, i_0, lo, hi):
        """Return whether V_m cannot reach the lowest future threshold."""
        for i in range(lo, hi):
            lowest = c[V_TH] + min(s[TH_1, i], 0.0) + min(s[TH_2, i], 0.0)
            if s[REFRACTORY, i] != 0.0 or not highest_with_currents(s, c, i_0, i) < lowest:
                return False
        return True
