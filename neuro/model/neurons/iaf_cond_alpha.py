"""Leaky integrate-and-fire with alpha-shaped conductances."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from neuro.model.neurons.base import State
from neuro.model.neurons.iaf_cond_exp import TOLERANCE, constants as constants_of_exp, hold_or_fire, iaf_cond_exp
from neuro.model.neurons.integrators import are_at_rest, fehlberg, rows, runge_kutta, step_adaptively, step_evenly


@dataclass(frozen=True, kw_only=True, eq=False)
class iaf_cond_alpha(iaf_cond_exp):
    """Leaky integrate-and-fire neuron; a spike opens an alpha-shaped conductance that peaks at its weight in nS.

    Positive weights open the excitatory conductance, negative ones the inhibitory, by their absolute value. Integrated
    by NEST's adaptive RKF45, of which no step errs by more than 1e-3; with `rk4_substeps` by so many steps of RK4 in
    each step of the grid, which is faster.

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


V_M, G_EX, G_IN, D_EX, D_IN, REFRACTORY, SIZE = range(7)
V_TH, V_RESET, G_L, E_L, E_EX, E_IN, RATE_EX, RATE_IN, I_E, BY_C, R, H, SUBSTEPS, JUMP_EX, JUMP_IN = range(15)

rkf45, rk4, (take, put) = fehlberg(5), runge_kutta(5), rows(5)


def constants(p, h, c):
    """Fill `c` for a step of h ms; `p` is tau_minus, then the parameters above in order."""
    constants_of_exp(p, h, c)
    c[JUMP_EX], c[JUMP_IN] = math.e / p[9], math.e / p[10]


def rates(y, p):
    """Derivatives of V_m, the conductances and their slopes; V_m counts as V_th where it is above."""
    v, g_ex, g_in, d_ex, d_in = y
    g_l, e_l, e_ex, e_in, v_th, by_c, rate_ex, rate_in, current = p
    v = v if v < v_th else v_th
    slope = (current + g_l * e_l + g_ex * e_ex + g_in * e_in) * by_c - (g_l + g_ex + g_in) * by_c * v
    return slope, d_ex + rate_ex * g_ex, d_in + rate_in * g_in, rate_ex * d_ex, rate_in * d_in


def system(s, c, i_0, i):
    """What `rates` needs; nothing moves V_m while it is held."""
    by_c, held = c[BY_C], s[REFRACTORY, i] != 0.0
    by_c = 0.0 if held else by_c
    return c[G_L], c[E_L], c[E_EX], c[E_IN], c[V_TH], by_c, c[RATE_EX], c[RATE_IN], c[I_E] + i_0[i]


def step(s, c, x, i_0, lo, hi, fired):
    """One step: V and the conductances, then the input, then the threshold."""
    if c[SUBSTEPS] == 0.0:
        step_adaptively(rkf45, take, put, rates, system, s, c, i_0, lo, hi, c[H], SIZE, TOLERANCE, fired)
    else:
        step_evenly(rk4, take, put, rates, system, s, c, i_0, lo, hi, c[H], c[SUBSTEPS])
    jump_ex, jump_in = c[JUMP_EX], c[JUMP_IN]
    for i in range(lo, hi):
        s[D_EX, i] += jump_ex * x[0, i]
        s[D_IN, i] -= jump_in * x[1, i]
    hold_or_fire(s, c, lo, hi, REFRACTORY, fired)


def fire(s, c, i):
    """Reset V and hold it; the conductances go on."""
    s[V_M, i] = c[V_RESET]
    s[REFRACTORY, i] = c[R]


def quiet(s, c, i_0, lo, hi):
    """At rest."""
    h, substeps = c[H], c[SUBSTEPS]
    return are_at_rest(rkf45, rk4, take, rates, system, s, c, i_0, lo, hi, h, substeps, REFRACTORY, SIZE, c[V_TH])
