"""Hodgkin-Huxley neuron with alpha-shaped synaptic currents."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call", check-untyped-defs=False
from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from neuro.core.errors import ModelError
from neuro.core.quantities import Value, quantity
from neuro.model.neurons.base import Neuron, State
from neuro.model.neurons.integrators import (
    are_at_rest,
    fehlberg,
    finite_exp,
    rows,
    runge_kutta,
    step_adaptively,
    step_evenly,
)

V_M, ACT_M, INACT_H, ACT_N, I_EX, I_IN, D_EX, D_IN, REFRACTORY, SIZE, V_BEFORE = range(11)
BY_C, G_NA, G_K, G_L, E_NA, E_K, E_L, RATE_EX, RATE_IN, JUMP_EX, JUMP_IN, I_E, R, H, SUBSTEPS = range(15)
TOLERANCE = 1e-3
RESTING = -65.0
LONGEST, ROUNDING = 0.05, 1e-9
"""The longest stable step of RK4 in ms, and the rounding error of a quotient of two times."""
rkf45, rk4, (take, put) = fehlberg(8), runge_kutta(8), rows(8)


def opening_rates(v):
    """Return the opening rate alpha and the closing rate beta of m, then of h, then of n, in 1/ms."""
    return (
        linear_over_exponential(v + 40.0),
        4.0 * finite_exp(-(v + 65.0) / 18.0),
        0.07 * finite_exp(-(v + 65.0) / 20.0),
        1.0 / (1.0 + finite_exp(-(v + 35.0) / 10.0)),
        0.1 * linear_over_exponential(v + 55.0),
        0.125 * finite_exp(-(v + 65.0) / 80.0),
    )


def linear_over_exponential(u):
    """Return 0.1 u / (1 - exp(-u / 10)). Its limit at u = 0 is 1."""
    e = finite_exp(-0.1 * u)
    return 1.0 if e == 1.0 else 0.1 * u / (1.0 - e)


def rates(y, p):
    """Return the derivatives of V_m, m, h, n, the currents and their slopes."""
    v, m, h, n, i_ex, i_in, d_ex, d_in = y
    by_c, g_na, g_k, g_l, e_na, e_k, e_l, rate_ex, rate_in, current = p
    alpha_m, beta_m, alpha_h, beta_h, alpha_n, beta_n = opening_rates(v)
    i_na = g_na * m * m * m * h * (v - e_na)
    i_k = g_k * n * n * n * n * (v - e_k)
    return (
        (current + i_ex + i_in - i_na - i_k - g_l * (v - e_l)) * by_c,
        alpha_m * (1.0 - m) - beta_m * m,
        alpha_h * (1.0 - h) - beta_h * h,
        alpha_n * (1.0 - n) - beta_n * n,
        d_ex + rate_ex * i_ex,
        d_in + rate_in * i_in,
        rate_ex * d_ex,
        rate_in * d_in,
    )


def system(s, c, i_0, i):
    """Return the argument `p` of `rates`."""
    potentials = c[E_NA], c[E_K], c[E_L]
    return c[BY_C], c[G_NA], c[G_K], c[G_L], *potentials, c[RATE_EX], c[RATE_IN], c[I_E] + i_0[i]


@dataclass(frozen=True, kw_only=True, eq=False)
class hh_psc_alpha(Neuron):
    """Hodgkin-Huxley neuron of the squid axon. A spike starts an alpha-shaped current whose peak is its weight in pA.

    The neuron spikes when V_m has passed a maximum above 0 mV, at most once in `t_ref`. A spike resets no variable. The
    integrator is NEST's adaptive RKF45 with an error of at most 1e-3 per step. `rk4_substeps` selects RK4 instead, with
    this number of steps per step of the grid. RK4 steps of 0.025 ms are accurate; steps above 0.05 ms are unstable and
    refused.

    Source: NEST 3.10, `hh_psc_alpha`; Hodgkin & Huxley, J. Physiol. 117:500, 1952.
    """

    equation: ClassVar[str] = (
        "C_m V_m' = -g_Na m^3 h (V_m - E_Na) - g_K n^4 (V_m - E_K) - g_L (V_m - E_L) + I_syn_ex + I_syn_in + I; "
        "x' = alpha_x(V_m) (1 - x) - beta_x(V_m) x for x = m, h, n; I_syn = sum w e t/tau_syn exp(-t/tau_syn)"
    )
    source: ClassVar[str] = "NEST 3.10 hh_psc_alpha; Hodgkin & Huxley, J. Physiol. 117:500, 1952"
    weight_unit: ClassVar[str] = "pA"
    states: ClassVar[tuple[State, ...]] = (
        State("V_m", "mV", "membrane potential"),
        State("Act_m", "", "activation m of sodium", at_least=0.0, at_most=1.0),
        State("Inact_h", "", "inactivation h of sodium", at_least=0.0, at_most=1.0),
        State("Act_n", "", "activation n of potassium", at_least=0.0, at_most=1.0),
        State("I_syn_ex", "pA", "excitatory synaptic current"),
        State("I_syn_in", "pA", "inhibitory synaptic current"),
        State("dI_syn_ex", "pA/ms", "slope of the excitatory current"),
        State("dI_syn_in", "pA/ms", "slope of the inhibitory current"),
        State("refractory", "steps", "remaining refractory steps", hidden=True),
        State("size", "ms", "adaptive step, 0 for a whole step of the grid", hidden=True),
        State("V_before", "mV", "membrane potential before the step", hidden=True),
    )
    receptors: ClassVar[int] = 2

    C_m: Value = quantity(100.0, "pF", "membrane capacity", above=0, arrays=True)
    g_Na: Value = quantity(12000.0, "nS", "peak conductance of sodium", at_least=0, arrays=True)
    g_K: Value = quantity(3600.0, "nS", "peak conductance of potassium", at_least=0, arrays=True)
    g_L: Value = quantity(30.0, "nS", "leak conductance", at_least=0, arrays=True)
    E_Na: Value = quantity(50.0, "mV", "reversal potential of sodium", arrays=True)
    E_K: Value = quantity(-77.0, "mV", "reversal potential of potassium", arrays=True)
    E_L: Value = quantity(-54.402, "mV", "leak reversal potential", arrays=True)
    t_ref: Value = quantity(2.0, "ms", "shortest interval between two spikes", at_least=0, arrays=True)
    tau_syn_ex: Value = quantity(0.2, "ms", "time constant of the excitatory current", above=0, arrays=True)
    tau_syn_in: Value = quantity(2.0, "ms", "time constant of the inhibitory current", above=0, arrays=True)
    I_e: Value = quantity(0.0, "pA", "constant current", arrays=True)
    rk4_substeps: int = quantity(0, "", "RK4 steps per step of the grid; 0: RKF45", kind="integer", at_least=0)

    @staticmethod
    def initial(parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Return V_m = -65 mV, and m, h and n at their steady state, as in NEST."""
        rates_at_rest = opening_rates(RESTING)
        values = [alpha / (alpha + beta) for alpha, beta in zip(rates_at_rest[::2], rates_at_rest[1::2], strict=True)]
        return {"V_m": RESTING, **dict(zip(("Act_m", "Inact_h", "Act_n"), values, strict=True))}

    @staticmethod
    def check_steps(parameters: Mapping[str, Any], resolution: float) -> None:
        """Raise an error for RK4 steps above 0.05 ms, which are unstable."""
        substeps = int(parameters["rk4_substeps"][0]) if "rk4_substeps" in parameters else 0
        fewest = math.ceil(resolution / LONGEST - ROUNDING)
        if 0 < substeps < fewest:
            raise ModelError(
                f"hh_psc_alpha.rk4_substeps = {substeps}: steps of {resolution / substeps:g} ms are unstable: "
                f"expected at most {LONGEST:g} ms",
                hint=f"write rk4_substeps={fewest}, or 0 for RKF45",
                path=("hh_psc_alpha", "rk4_substeps"),
            )

    def constants(p, h, c):
        """Fill `c` for a step of h ms. `p` is tau_minus, followed by the parameters above in order."""
        c[BY_C], c[G_NA], c[G_K], c[G_L] = 1.0 / p[1], p[2], p[3], p[4]
        c[E_NA], c[E_K], c[E_L], c[R] = p[5], p[6], p[7], round(p[8] / h)
        c[RATE_EX], c[RATE_IN] = -1.0 / p[9], -1.0 / p[10]
        c[JUMP_EX], c[JUMP_IN] = math.e / p[9], math.e / p[10]
        c[I_E], c[SUBSTEPS], c[H] = p[11], p[12], h

    def step(s, c, x, i_0, lo, hi, fired):
        """Advance all variables, add the input, then test whether V_m has passed its maximum."""
        for i in range(lo, hi):
            s[V_BEFORE, i] = s[V_M, i]
        if c[SUBSTEPS] == 0.0:
            step_adaptively(rkf45, take, put, rates, system, s, c, i_0, lo, hi, c[H], SIZE, TOLERANCE, fired)
        else:
            step_evenly(rk4, take, put, rates, system, s, c, i_0, lo, hi, c[H], c[SUBSTEPS])
        jump_ex, jump_in = c[JUMP_EX], c[JUMP_IN]
        for i in range(lo, hi):
            s[D_EX, i] += jump_ex * x[0, i]
            s[D_IN, i] += jump_in * x[1, i]
            free = s[REFRACTORY, i] == 0.0
            s[REFRACTORY, i] -= not free
            fired[i] = free and s[V_M, i] >= 0.0 and s[V_BEFORE, i] > s[V_M, i]

    def fire(s, c, i):
        """Begin refractoriness. No variable is reset."""
        s[REFRACTORY, i] = c[R]

    def quiet(s, c, i_0, lo, hi):
        """Return whether the neurons are at rest."""
        h, substeps = c[H], c[SUBSTEPS]
        return are_at_rest(rkf45, rk4, take, rates, system, s, c, i_0, lo, hi, h, substeps, REFRACTORY, SIZE, 0.0)
