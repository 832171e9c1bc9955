"""The adaptive exponential neuron with exponentially decaying synaptic currents."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from neuro.core.quantities import Value, quantity
from neuro.model.neurons.adaptive_exponential import (
    HIDDEN,
    REFRACTORY,
    SHOWN,
    SUBSTEPS,
    TOLERANCE,
    V_PEAK,
    V_RESET,
    AdaptiveExponential,
    fire as fire,
    flowing,
    is_quiet,
    membrane,
    of_membrane,
    step_and_reset,
)
from neuro.model.neurons.base import State


@dataclass(frozen=True, kw_only=True, eq=False)
class aeif_psc_exp(AdaptiveExponential):
    """Adaptive exponential neuron; a spike adds its weight in pA to a current that decays exponentially.

    Positive weights go to the excitatory current, negative ones to the inhibitory. Integrated by NEST's adaptive RKF45,
    of which no step errs by more than `gsl_error_tol` (1 + |h y'|); with `rk4_substeps` by so many steps of RK4 in each
    step of the grid. V_m is tested and reset after each step of the integrator, so several spikes, at most 255, may
    leave in a step of the grid. With `Delta_T` 0 there is no upswing, and it spikes at V_th.

    Source: NEST 3.10, `aeif_psc_exp`; Brette & Gerstner, J. Neurophysiol. 94:3637, 2005.
    """

    equation: ClassVar[str] = (
        "C_m V_m' = -g_L (V_m - E_L) + g_L Delta_T exp((V_m - V_th)/Delta_T) - w + I_syn_ex + I_syn_in "
        "+ I; tau_w w' = a (V_m - E_L) - w; I_syn' = -I_syn/tau_syn + sum w_syn delta(t - t_spike); "
        "at V_m >= V_peak: V_m = V_reset, w += b"
    )
    source: ClassVar[str] = "NEST 3.10 aeif_psc_exp; Brette & Gerstner, J. Neurophysiol. 94:3637, 2005"
    weight_unit: ClassVar[str] = "pA"
    states: ClassVar[tuple[State, ...]] = (
        *SHOWN,
        State("I_syn_ex", "pA", "excitatory synaptic current"),
        State("I_syn_in", "pA", "inhibitory synaptic current"),
        *HIDDEN,
    )

    tau_syn_ex: Value = quantity(0.2, "ms", "decay of the excitatory current", above=0, arrays=True)
    tau_syn_in: Value = quantity(2.0, "ms", "decay of the inhibitory current", above=0, arrays=True)
    I_e: Value = quantity(0.0, "pA", "constant current", arrays=True)
    gsl_error_tol: Value = quantity(
        1e-6, "", "error of a step of RKF45, absolute and relative to slope", above=0, arrays=True
    )
    rk4_substeps: int = quantity(0, "", "steps of RK4 in a step of the grid, 0: RKF45", kind="integer", at_least=0)


V_M, W, I_EX, I_IN = range(4)
RATE_EX, RATE_IN, I_E = range(15, 18)


def constants(p, h, c):
    """Fill `c` for a step of h ms; `p` is tau_minus, then the parameters above in order."""
    membrane(p, h, c)
    c[RATE_EX], c[RATE_IN] = -1.0 / p[12], -1.0 / p[13]
    c[I_E], c[TOLERANCE], c[SUBSTEPS] = p[14], p[15], p[16]


def rates(y, p):
    """Derivatives of V_m, w and the currents; V_m counts as V_peak where it is above, as V_reset while it is held."""
    v, w, i_ex, i_in = y
    fixed, v_peak, v_reset, rate_ex, rate_in, current, held = p
    v = v_reset if held else (v if v < v_peak else v_peak)
    v_slope, w_slope = flowing(v, w, fixed, current + i_ex + i_in)
    return 0.0 if held else v_slope, w_slope, rate_ex * i_ex, rate_in * i_in


def system(s, c, i_0, i):
    """What `rates` needs."""
    current, held = c[I_E] + i_0[i], s[REFRACTORY, i] != 0.0
    return of_membrane(c), c[V_PEAK], c[V_RESET], c[RATE_EX], c[RATE_IN], current, held


def step(s, c, x, i_0, lo, hi, fired):
    """One step, with the resets in it, then the input."""
    step_and_reset(rates, system, s, c, i_0, lo, hi, fired)
    for i in range(lo, hi):
        s[I_EX, i] += x[0, i]
        s[I_IN, i] += x[1, i]


def quiet(s, c, i_0, lo, hi):
    """At rest."""
    return is_quiet(rates, system, s, c, i_0, lo, hi)
