"""Leaky integrate-and-fire with exponential synaptic currents and a threshold that keeps the rate (homeostasis)."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from neuro.core.quantities import Value, quantity
from neuro.model.neurons.base import State
from neuro.model.neurons.iaf_psc_exp import constants as constants_without_theta, iaf_psc_exp
from neuro.model.neurons.propagators import LeakyWithCurrents, highest


@dataclass(frozen=True, kw_only=True, eq=False)
class iaf_psc_exp_adaptive_threshold(LeakyWithCurrents):
    """Leaky integrate-and-fire neuron; a spike adds its weight in pA to a current that decays exponentially.

    Positive weights go to the excitatory current, negative ones to the inhibitory. Each spike raises the threshold
    V_th + theta by `theta_plus`, and theta decays slowly, so neurons that fire more than others grow harder to fire:
    the mean of theta is theta_plus x tau_theta x rate. A group ranks its neurons by V_m - V_th, without theta.

    Source: Diehl & Cook, Front. Comput. Neurosci. 9:99, 2015, section 2.2; the rest as `iaf_psc_exp`.
    """

    equation: ClassVar[str] = (
        "C_m V_m' = -C_m (V_m - E_L)/tau_m + I_syn_ex + I_syn_in + I; I_syn' = -I_syn/tau_syn; "
        "theta' = -theta/tau_theta; at V_m >= V_th + theta: V_m = V_reset, theta += theta_plus"
    )
    source: ClassVar[str] = "Diehl & Cook, Front. Comput. Neurosci. 9:99, 2015"
    states: ClassVar[tuple[State, ...]] = (
        *iaf_psc_exp.states[:3],
        State("theta", "mV", "rise of the threshold"),
        *iaf_psc_exp.states[3:],
    )

    theta_plus: Value = quantity(0.05, "mV", "rise of the threshold at a spike", arrays=True)
    tau_theta: Value = quantity(1e7, "ms", "decay of the threshold's rise", above=0, arrays=True)


V_M, I_EX, I_IN, THETA, REFRACTORY = range(5)
V_TH, V_RESET, E_L, P33, P30, I_E, R, GAIN, P32_EX, P32_IN, P11_EX, P11_IN, CHARGE_EX, CHARGE_IN = range(14)
THETA_PLUS, FADE = range(14, 16)


def constants(p, h, c):
    """Fill `c` for a step of h ms; `p` is tau_minus, then the parameters above in order."""
    constants_without_theta(p, h, c)
    c[THETA_PLUS], c[FADE] = p[10], math.exp(-h / p[11])


def step(s, c, x, i_0, lo, hi, fired):
    """One step: V with the old currents, then the currents and the input, then the threshold, which decays always."""
    v_th, e_l, p33, p30, i_e = c[V_TH], c[E_L], c[P33], c[P30], c[I_E]
    p32_ex, p32_in, p11_ex, p11_in, fade = c[P32_EX], c[P32_IN], c[P11_EX], c[P11_IN], c[FADE]
    for i in range(lo, hi):
        held = s[REFRACTORY, i]
        i_ex = s[I_EX, i]
        i_in = s[I_IN, i]
        v = e_l + p33 * (s[V_M, i] - e_l) + p32_ex * i_ex + p32_in * i_in + p30 * (i_e + i_0[i])
        v = v if held == 0.0 else s[V_M, i]
        s[V_M, i] = v
        s[I_EX, i] = i_ex * p11_ex + x[0, i]
        s[I_IN, i] = i_in * p11_in + x[1, i]
        s[REFRACTORY, i] = 0.0 if held == 0.0 else held - 1.0
        theta = fade * s[THETA, i]
        s[THETA, i] = theta
        fired[i] = held == 0.0 and v >= v_th + theta


def fire(s, c, i):
    """Reset V, hold it, and raise the threshold; the currents go on."""
    s[V_M, i] = c[V_RESET]
    s[THETA, i] += c[THETA_PLUS]
    s[REFRACTORY, i] = c[R]


def quiet(s, c, i_0, lo, hi):
    """V stays below its relaxation plus all the charge that the positive currents still carry; theta only nears 0."""
    for i in range(lo, hi):
        top = highest(s[V_M, i], c[E_L], c[GAIN], c[I_E] + i_0[i])
        top += max(s[I_EX, i], 0.0) * c[CHARGE_EX] + max(s[I_IN, i], 0.0) * c[CHARGE_IN]
        if s[REFRACTORY, i] != 0.0 or not top < c[V_TH] + min(s[THETA, i], 0.0):
            return False
    return True
