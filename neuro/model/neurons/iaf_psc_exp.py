"""Leaky integrate-and-fire with exponential synaptic currents."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar

from neuro.core.quantities import quantity
from neuro.model.neurons.base import State
from neuro.model.neurons.propagators import (
    FALL as FALLS,
    LeakyWithCurrents,
    after_spike,
    fall_of,
    from_constant,
    from_exponential,
    highest,
    leak,
)


@dataclass(frozen=True, kw_only=True, eq=False)
class iaf_psc_exp(LeakyWithCurrents):
    """Leaky integrate-and-fire neuron; a spike adds its weight in pA to a current that decays exponentially.

    Positive weights go to the excitatory current, negative ones to the inhibitory.
    Source: NEST 3.10, `iaf_psc_exp`; Tsodyks, Uziel & Markram, J. Neurosci. 20:RC50, 2000.
    """

    equation: ClassVar[str] = (
        "C_m V_m' = -C_m (V_m - E_L)/tau_m + I_syn_ex + I_syn_in + I; I_syn' = -I_syn/tau_syn; spike at V_m >= V_th"
    )
    source: ClassVar[str] = "NEST 3.10 iaf_psc_exp; Tsodyks et al., J. Neurosci. 20:RC50, 2000"
    states: ClassVar[tuple[State, ...]] = (
        State("V_m", "mV", "membrane potential"),
        State("I_syn_ex", "pA", "excitatory synaptic current"),
        State("I_syn_in", "pA", "inhibitory synaptic current"),
        State("refractory", "steps", "steps left to hold", hidden=True),
    )
    filters: ClassVar[Mapping[str, tuple[str, str]]] = {
        "ex": ("I_syn_ex", "tau_syn_ex"),
        "in": ("I_syn_in", "tau_syn_in"),
    }
    collects: ClassVar[tuple[str, ...]] = ("I_syn_ex", "I_syn_in")
    fixed: ClassVar[tuple[str, ...]] = ("reset_by_subtraction",)

    reset_by_subtraction: bool = quantity(False, "", FALLS, kind="boolean")


V_M, I_EX, I_IN, REFRACTORY = range(4)
# In a step: P33, what is left of V; P11, of a current; P32, mV per pA of a current; P30, of a constant one. These are
# NEST's names. CHARGE: mV that 1 pA can still add.
V_TH, V_RESET, E_L, P33, P30, I_E, R, GAIN, P32_EX, P32_IN, P11_EX, P11_IN, CHARGE_EX, CHARGE_IN, FALL = range(15)


def constants(p, h, c):
    """Fill `c` for a step of h ms; `p` is tau_minus, then the parameters above in order."""
    tau_m, c_m, tau_ex, tau_in = p[1], p[2], p[8], p[9]
    c[V_TH], c[V_RESET], c[E_L] = p[6], p[5], p[4]
    c[P33] = leak(tau_m, h)
    c[P30] = from_constant(tau_m, c_m, h)
    c[I_E] = p[7]
    c[R] = round(p[3] / h)
    c[GAIN] = tau_m / c_m
    c[P32_EX] = from_exponential(tau_m, tau_ex, c_m, h)
    c[P32_IN] = from_exponential(tau_m, tau_in, c_m, h)
    c[P11_EX] = math.exp(-h / tau_ex)
    c[P11_IN] = math.exp(-h / tau_in)
    c[CHARGE_EX] = tau_ex / c_m
    c[CHARGE_IN] = tau_in / c_m
    c[FALL] = fall_of(p[10], p[6], p[5])


def step(s, c, x, i_0, lo, hi, fired):
    """One step: V with the old currents, then the currents and the input, then the threshold."""
    v_th, e_l, p33, p30, i_e = c[V_TH], c[E_L], c[P33], c[P30], c[I_E]
    p32_ex, p32_in, p11_ex, p11_in = c[P32_EX], c[P32_IN], c[P11_EX], c[P11_IN]
    if c[FALL] != 0.0:  # as below, but what is left of V may be at the threshold, and is none while it is held
        for i in range(lo, hi):
            refractory_left, i_ex, i_in = s[REFRACTORY, i], s[I_EX, i], s[I_IN, i]
            v = e_l + p33 * (s[V_M, i] - e_l) + p32_ex * i_ex + p32_in * i_in + p30 * (i_e + i_0[i])
            v = v if refractory_left == 0.0 else s[V_M, i]
            s[V_M, i] = v
            s[I_EX, i] = i_ex * p11_ex + x[0, i]
            s[I_IN, i] = i_in * p11_in + x[1, i]
            s[REFRACTORY, i] = 0.0 if refractory_left == 0.0 else refractory_left - 1.0
            fired[i] = v >= v_th and refractory_left == 0.0
        return
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
        fired[i] = v >= v_th


def fire(s, c, i):
    """Reset V and hold it; the currents go on."""
    s[V_M, i] = after_spike(s[V_M, i], c[V_TH], c[V_RESET], c[FALL], 1.0)
    s[REFRACTORY, i] = c[R]


def quiet(s, c, i_0, lo, hi):
    """Whether V cannot reach V_th: a bound is V or its steady state plus all that positive currents can still add."""
    for i in range(lo, hi):
        top = highest(s[V_M, i], c[E_L], c[GAIN], c[I_E] + i_0[i])
        top += max(s[I_EX, i], 0.0) * c[CHARGE_EX] + max(s[I_IN, i], 0.0) * c[CHARGE_IN]
        if s[REFRACTORY, i] != 0.0 or not top < c[V_TH]:
            return False
    return True
