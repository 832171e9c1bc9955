"""Leaky integrate-and-fire neurons with conductance-based synapses."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call", check-untyped-defs=False
from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from neuro.core.quantities import Value, quantity
from neuro.model.neurons.base import Resting, State
from neuro.model.neurons.integrators import are_at_rest, fehlberg, rows, runge_kutta, step_adaptively, step_evenly

V_M, G_EX, G_IN, REFRACTORY, SIZE = range(5)
D_EX, D_IN, REFRACTORY_5, SIZE_5 = range(3, 7)
"""Rows of the states. Names with D or 5 belong to `iaf_cond_alpha`, which has five variables instead of three."""

V_TH, V_RESET, G_L, E_L, E_EX, E_IN, RATE_EX, RATE_IN, I_E, BY_C, R, H, SUBSTEPS, JUMP_EX, JUMP_IN = range(15)
TOLERANCE = 1e-3
rkf45, rk4, (take, put) = fehlberg(3, 2), runge_kutta(3, 2), rows(3)
rkf_5, rk_5, (take_5, put_5) = fehlberg(5), runge_kutta(5), rows(5)


def rates(y, p):
    """Return the derivatives of V_m, g_ex and g_in, with V_m limited to V_th."""
    v, g_ex, g_in = y
    g_l, e_l, e_ex, e_in, v_th, by_c, rate_ex, rate_in, current = p
    v = v if v < v_th else v_th
    slope = (current + g_l * e_l + g_ex * e_ex + g_in * e_in) * by_c - (g_l + g_ex + g_in) * by_c * v
    return slope, rate_ex * g_ex, rate_in * g_in


def system(s, c, i_0, i):
    """Return the argument `p` of `rates`."""
    return system_of_membrane(c, i_0, i, s[REFRACTORY, i] != 0.0)


def rates_5(y, p):
    """Return the derivatives of V_m, the conductances and their slopes, with V_m limited to V_th."""
    v, g_ex, g_in, d_ex, d_in = y
    slope, fade_ex, fade_in = rates((v, g_ex, g_in), p)
    rate_ex, rate_in = p[6], p[7]
    return slope, d_ex + fade_ex, d_in + fade_in, rate_ex * d_ex, rate_in * d_in


def system_5(s, c, i_0, i):
    """Return the argument `p` of `rates_5`."""
    return system_of_membrane(c, i_0, i, s[REFRACTORY_5, i] != 0.0)


def system_of_membrane(c, i_0, i, is_refractory):
    """Return the constants of the derivatives. During refractoriness the derivative of V_m is 0."""
    by_c = c[BY_C]
    by_c = 0.0 if is_refractory else by_c
    return c[G_L], c[E_L], c[E_EX], c[E_IN], c[V_TH], by_c, c[RATE_EX], c[RATE_IN], c[I_E] + i_0[i]


def hold_or_fire(s, c, lo, hi, refractory, fired):
    """Keep V_m at V_reset for refractory neurons, and test the threshold of the others.

    `refractory` is the row of the states that counts the remaining refractory steps.
    """
    v_th, v_reset = c[V_TH], c[V_RESET]
    for i in range(lo, hi):
        v, steps_left = s[V_M, i], s[refractory, i]
        is_refractory = steps_left != 0.0
        s[V_M, i] = v_reset if is_refractory else v
        s[refractory, i] = steps_left - 1.0 if is_refractory else 0.0
        fired[i] = v >= v_th and not is_refractory


@dataclass(frozen=True, kw_only=True, eq=False)
class iaf_cond_exp(Resting):
    """Leaky integrate-and-fire neuron. A spike adds its weight in nS to a conductance that decays exponentially.

    Positive weights open the excitatory conductance. Negative weights open the inhibitory conductance by their absolute
    value. The integrator is NEST's adaptive RKF45 with an error of at most 1e-3 per step. `rk4_substeps` selects RK4
    instead, which is faster, with this number of steps per step of the grid.

    Source: NEST 3.10, `iaf_cond_exp`; Meffin et al., J. Comput. Neurosci. 16:159, 2004.
    """

    equation: ClassVar[str] = (
        "C_m V_m' = -g_L (V_m - E_L) - g_ex (V_m - E_ex) - g_in (V_m - E_in) + I; "
        "g' = -g/tau_syn + sum |w| delta(t - t_spike); spike at V_m >= V_th"
    )
    source: ClassVar[str] = "NEST 3.10 iaf_cond_exp; Meffin et al., J. Comput. Neurosci. 16:159, 2004"
    weight_unit: ClassVar[str] = "nS"
    states: ClassVar[tuple[State, ...]] = (
        State("V_m", "mV", "membrane potential"),
        State("g_ex", "nS", "excitatory conductance", at_least=0.0),
        State("g_in", "nS", "inhibitory conductance", at_least=0.0),
        State("refractory", "steps", "remaining refractory steps", hidden=True),
        State("size", "ms", "adaptive step, 0 for a whole step of the grid", hidden=True),
    )
    receptors: ClassVar[int] = 2
    conductances: ClassVar[tuple[str, ...]] = ("ex", "in")

    C_m: Value = quantity(250.0, "pF", "membrane capacity", above=0, arrays=True)
    g_L: Value = quantity(16.6667, "nS", "leak conductance", at_least=0, arrays=True)
    t_ref: Value = quantity(2.0, "ms", "refractory period", at_least=0, arrays=True)
    E_L: Value = quantity(-70.0, "mV", "leak reversal potential", arrays=True)
    E_ex: Value = quantity(0.0, "mV", "excitatory reversal potential", arrays=True)
    E_in: Value = quantity(-85.0, "mV", "inhibitory reversal potential", arrays=True)
    V_reset: Value = quantity(-60.0, "mV", "potential after a spike", arrays=True)
    V_th: Value = quantity(-55.0, "mV", "threshold", arrays=True)
    tau_syn_ex: Value = quantity(0.2, "ms", "time constant of the excitatory conductance", above=0, arrays=True)
    tau_syn_in: Value = quantity(2.0, "ms", "time constant of the inhibitory conductance", above=0, arrays=True)
    I_e: Value = quantity(0.0, "pA", "constant current", arrays=True)
    rk4_substeps: int = quantity(0, "", "RK4 steps per step of the grid; 0: RKF45", kind="integer", at_least=0)

    def constants(p, h, c):
        """Fill `c` for a step of h ms. `p` is tau_minus, followed by the parameters above in order."""
        c[BY_C], c[G_L], c[R] = 1.0 / p[1], p[2], round(p[3] / h)
        c[E_L], c[E_EX], c[E_IN], c[V_RESET], c[V_TH] = p[4], p[5], p[6], p[7], p[8]
        c[RATE_EX], c[RATE_IN], c[I_E] = -1.0 / p[9], -1.0 / p[10], p[11]
        c[SUBSTEPS], c[H] = p[12], h
        c[JUMP_EX], c[JUMP_IN] = math.e / p[9], math.e / p[10]

    def step(s, c, x, i_0, lo, hi, fired):
        """Advance V_m and the conductances, add the input, then test the threshold."""
        if c[SUBSTEPS] == 0.0:
            step_adaptively(rkf45, take, put, rates, system, s, c, i_0, lo, hi, c[H], SIZE, TOLERANCE, fired)
        else:
            step_evenly(rk4, take, put, rates, system, s, c, i_0, lo, hi, c[H], c[SUBSTEPS])
        for i in range(lo, hi):
            s[G_EX, i] += x[0, i]
            s[G_IN, i] -= x[1, i]
        hold_or_fire(s, c, lo, hi, REFRACTORY, fired)

    def fire(s, c, i):
        """Reset V_m and begin refractoriness. The conductances are not reset."""
        s[V_M, i] = c[V_RESET]
        s[REFRACTORY, i] = c[R]

    def quiet(s, c, i_0, lo, hi):
        """Return whether the neurons are at rest."""
        h, substeps = c[H], c[SUBSTEPS]
        return are_at_rest(rkf45, rk4, take, rates, system, s, c, i_0, lo, hi, h, substeps, REFRACTORY, SIZE, c[V_TH])


@dataclass(frozen=True, kw_only=True, eq=False)
class iaf_cond_alpha(iaf_cond_exp):
    """Leaky integrate-and-fire neuron. A spike opens an alpha-shaped conductance whose peak is its weight in nS.

    Positive weights open the excitatory conductance. Negative weights open the inhibitory conductance by their absolute
    value. The integrator is NEST's adaptive RKF45 with an error of at most 1e-3 per step. `rk4_substeps` selects RK4
    instead, which is faster, with this number of steps per step of the grid.

    Source: NEST 3.10, `iaf_cond_alpha`; Meffin et al., J. Comput. Neurosci. 16:159, 2004.
    """

    equation: ClassVar[str] = (
        "C_m V_m' = -g_L (V_m - E_L) - g_ex (V_m - E_ex) - g_in (V_m - E_in) + I; "
        "g = sum |w| e t/tau_syn exp(-t/tau_syn); spike at V_m >= V_th"
    )
    source: ClassVar[str] = "NEST 3.10 iaf_cond_alpha; Meffin et al., J. Comput. Neurosci. 16:159, 2004"
    states: ClassVar[tuple[State, ...]] = (
        *iaf_cond_exp.states[:3],
        State("dg_ex", "nS/ms", "slope of the excitatory conductance"),
        State("dg_in", "nS/ms", "slope of the inhibitory conductance"),
        *iaf_cond_exp.states[3:],
    )

    def step(s, c, x, i_0, lo, hi, fired):
        """Advance V_m and the conductances, add the input, then test the threshold."""
        if c[SUBSTEPS] == 0.0:
            step_adaptively(rkf_5, take_5, put_5, rates_5, system_5, s, c, i_0, lo, hi, c[H], SIZE_5, TOLERANCE, fired)
        else:
            step_evenly(rk_5, take_5, put_5, rates_5, system_5, s, c, i_0, lo, hi, c[H], c[SUBSTEPS])
        jump_ex, jump_in = c[JUMP_EX], c[JUMP_IN]
        for i in range(lo, hi):
            s[D_EX, i] += jump_ex * x[0, i]
            s[D_IN, i] -= jump_in * x[1, i]
        hold_or_fire(s, c, lo, hi, REFRACTORY_5, fired)

    def fire(s, c, i):
        """Reset V_m and begin refractoriness. The conductances are not reset."""
        s[V_M, i] = c[V_RESET]
        s[REFRACTORY_5, i] = c[R]

    def quiet(s, c, i_0, lo, hi):
        """Return whether the neurons are at rest."""
        h, n, top = c[H], c[SUBSTEPS], c[V_TH]
        return are_at_rest(rkf_5, rk_5, take_5, rates_5, system_5, s, c, i_0, lo, hi, h, n, REFRACTORY_5, SIZE_5, top)
