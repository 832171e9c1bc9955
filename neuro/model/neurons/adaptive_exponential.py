"""Adaptive exponential neurons, whose V_m may be reset within a step.

The states of a model are V_m, w, two synaptic states that decay exponentially, and the hidden states below.

Source: NEST 3.10, `aeif_cond_exp` and `aeif_psc_exp`.
"""

# mypy: disable-error-code="no-untyped-def,no-untyped-call", check-untyped-defs=False
from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from neuro.core.quantities import Value, quantity
from neuro.model.neurons.base import Resting, State
from neuro.model.neurons.integrators import (
    MOST_STEPS,
    advance,
    are_at_rest,
    fehlberg,
    finite_exp,
    rows,
    runge_kutta,
    step_whole,
)

VISIBLE_STATES = (State("V_m", "mV", "membrane potential"), State("w", "pA", "adaptation current"))
HIDDEN = (
    State("refractory", "steps", "remaining refractory steps", hidden=True),
    State("size", "ms", "adaptive step, 0 for a whole step of the grid", hidden=True),
)
V_M, W, G_EX, G_IN, REFRACTORY, SIZE = range(6)
I_EX, I_IN = G_EX, G_IN
V_TH, V_RESET, V_FIRE, B, R, H, TOLERANCE, SUBSTEPS, BY_C, G_L, E_L, DELTA_T, A, BY_TAU_W, V_PEAK = range(15)
RATE_EX, RATE_IN, I_E, E_EX, E_IN = range(15, 20)
# V_FIRE, the potential of a spike, is V_peak, or V_th if Delta_T is 0.

rkf45, rkf45_by_slope = fehlberg(4, 2), fehlberg(4, 2, by_slope=True)
rk4, (take, put) = runge_kutta(4, 2), rows(4)
MAX_SPIKES = 255
"""Largest number of spikes of a neuron in a step of the grid."""


def set_constants(p, h, c):
    """Set the constants for a step of h ms. `p` begins with tau_minus and the parameters of `AdaptiveExponential`."""
    c[BY_C], c[G_L], c[R], c[E_L], c[V_RESET], c[V_TH] = 1.0 / p[1], p[2], round(p[3] / h), p[4], p[5], p[6]
    c[V_FIRE], c[V_PEAK] = p[7] if p[8] > 0.0 else p[6], p[7]
    c[DELTA_T], c[A], c[B], c[BY_TAU_W], c[H] = p[8], p[9], p[10], 1.0 / p[11], h
    c[RATE_EX], c[RATE_IN] = -1.0 / p[12], -1.0 / p[13]
    c[I_E], c[TOLERANCE], c[SUBSTEPS] = p[14], p[15], p[16]


def membrane_derivatives(v, w, constants, current):
    """Return the derivatives of V_m and w outside refractoriness."""
    by_c, g_l, e_l, v_th, delta_t, a, by_tau_w = constants
    upswing = 0.0 if delta_t == 0.0 else g_l * delta_t * finite_exp((v - v_th) / delta_t)
    return (current + upswing - g_l * (v - e_l) - w) * by_c, (a * (v - e_l) - w) * by_tau_w


def membrane_constants(c):
    """Return the argument `constants` of `membrane_derivatives`."""
    return c[BY_C], c[G_L], c[E_L], c[V_TH], c[DELTA_T], c[A], c[BY_TAU_W]


def step_and_reset(rates, system, s, c, i_0, lo, hi, fired):
    """Advance a step of the grid, with a spike test after each step of the integrator, as in NEST."""
    if c[SUBSTEPS] == 0.0:
        step_adaptively(rates, system, s, c, i_0, lo, hi, fired)
    else:
        step_evenly(rates, system, s, c, i_0, lo, hi, fired)
    for i in range(lo, hi):
        s[REFRACTORY, i] -= s[REFRACTORY, i] != 0.0


def step_adaptively(rates, system, s, c, i_0, lo, hi, fired):
    """Advance a step by RKF45, trying a whole step first.

    A whole step whose error is below the absolute tolerance is accepted for every slope, which is enough for most
    neurons. Shorter steps have the tolerance that is also relative to the slope.
    """
    h, tolerance = c[H], c[TOLERANCE]
    step_whole(rkf45, take, put, rates, system, s, c, i_0, lo, hi, h, SIZE, tolerance, fired)
    for i in range(lo, hi):
        if not fired[i]:
            fired[i] = reset(s, c, i)
            continue
        t, size, spikes, n_steps = 0.0, s[SIZE, i], 0, 0
        while t < h:
            y, p = take(s, i), system(s, c, i_0, i)
            y, t, size = advance(rkf45_by_slope, rates, y, p, t, h, size, tolerance)
            n_steps += 1
            if n_steps == MOST_STEPS:
                y, t, size = rkf45_by_slope(rates, y, p, math.nan)[0], h, 0.0
            put(s, i, y)
            spikes += reset(s, c, i)
        s[SIZE, i] = size
        fired[i] = min(spikes, MAX_SPIKES)


def step_evenly(rates, system, s, c, i_0, lo, hi, fired):
    """Advance a step by a fixed number of RK4 steps."""
    h = c[H] / c[SUBSTEPS]
    for i in range(lo, hi):
        fired[i] = 0
    for _ in range(int(c[SUBSTEPS])):
        for i in range(lo, hi):
            put(s, i, rk4(rates, take(s, i), system(s, c, i_0, i), h))
        for i in range(lo, hi):
            fired[i] = min(fired[i] + reset(s, c, i), MAX_SPIKES)


def reset(s, c, i):
    """Hold V_m during refractoriness, and reset V_m at a spike. Return 1 if the neuron spiked, else 0."""
    v, w, refractory_left = s[V_M, i], s[W, i], s[REFRACTORY, i]
    v_reset, b, r = c[V_RESET], c[B], c[R]
    is_refractory = refractory_left != 0.0
    spiked = v >= c[V_FIRE] and not is_refractory
    s[V_M, i] = v_reset if is_refractory or spiked else v
    s[W, i] = w + b if spiked else w
    # The counter decreases by 1 at the end of this step of the grid.
    s[REFRACTORY, i] = (0.0 if r == 0.0 else r + 1.0) if spiked else refractory_left
    return int(spiked)


def is_quiet(rates, system, s, c, i_0, lo, hi):
    """Return whether the neurons are at rest, so that a step without input changes no state."""
    h, substeps = c[H], c[SUBSTEPS]
    return are_at_rest(rkf45, rk4, take, rates, system, s, c, i_0, lo, hi, h, substeps, REFRACTORY, SIZE, c[V_FIRE])


@dataclass(frozen=True, kw_only=True, eq=False)
class AdaptiveExponential(Resting):
    """Base of the adaptive exponential neurons, with their common parameters."""

    receptors: ClassVar[int] = 2
    resets_in_step: ClassVar[bool] = True

    C_m: Value = quantity(281.0, "pF", "membrane capacity", above=0, arrays=True)
    g_L: Value = quantity(30.0, "nS", "leak conductance", at_least=0, arrays=True)
    t_ref: Value = quantity(0.0, "ms", "refractory period", at_least=0, arrays=True)
    E_L: Value = quantity(-70.6, "mV", "leak reversal potential", arrays=True)
    V_reset: Value = quantity(-60.0, "mV", "potential after a spike", arrays=True)
    V_th: Value = quantity(-50.4, "mV", "potential at which the upstroke of a spike begins", arrays=True)
    V_peak: Value = quantity(0.0, "mV", "potential at which a spike is detected", arrays=True)
    Delta_T: Value = quantity(2.0, "mV", "slope factor of the upstroke", at_least=0, arrays=True)
    a: Value = quantity(4.0, "nS", "subthreshold adaptation", arrays=True)
    b: Value = quantity(80.5, "pA", "spike-triggered adaptation", arrays=True)
    tau_w: Value = quantity(144.0, "ms", "time constant of adaptation", above=0, arrays=True)
    tau_syn_ex: Value = quantity(0.2, "ms", "time constant of excitatory input", above=0, arrays=True)
    tau_syn_in: Value = quantity(2.0, "ms", "time constant of inhibitory input", above=0, arrays=True)
    I_e: Value = quantity(0.0, "pA", "constant current", arrays=True)
    gsl_error_tol: Value = quantity(
        1e-6, "", "tolerance of RKF45, absolute and relative to the slope", above=0, arrays=True
    )
    rk4_substeps: int = quantity(0, "", "RK4 steps per step of the grid; 0: RKF45", kind="integer", at_least=0)

    def constants(p, h, c):
        """Fill `c` for a step of h ms. `p` is tau_minus, followed by the parameters above in order."""
        set_constants(p, h, c)

    def fire(s, c, i):
        """Do nothing, because `step` resets the neuron."""


def rates_of_conductances(y, p):
    """Return the derivatives of V_m, w, g_ex and g_in.

    V_m is limited to V_peak, and replaced by V_reset during refractoriness.
    """
    v, w, g_ex, g_in = y
    constants, v_peak, v_reset, e_ex, e_in, rate_ex, rate_in, current, is_refractory = p
    v = v_reset if is_refractory else (v if v < v_peak else v_peak)
    v_slope, w_slope = membrane_derivatives(v, w, constants, current - g_ex * (v - e_ex) - g_in * (v - e_in))
    return 0.0 if is_refractory else v_slope, w_slope, rate_ex * g_ex, rate_in * g_in


def system_of_conductances(s, c, i_0, i):
    """Return the argument `p` of `rates_of_conductances`."""
    current, is_refractory = c[I_E] + i_0[i], s[REFRACTORY, i] != 0.0
    return (
        membrane_constants(c),
        c[V_PEAK],
        c[V_RESET],
        c[E_EX],
        c[E_IN],
        c[RATE_EX],
        c[RATE_IN],
        current,
        is_refractory,
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class aeif_cond_exp(AdaptiveExponential):
    """Adaptive exponential neuron. A spike adds its weight in nS to a conductance that decays exponentially.

    Positive weights open the excitatory conductance. Negative weights open the inhibitory conductance by their absolute
    value. The integrator is NEST's adaptive RKF45 with an error of at most `gsl_error_tol` (1 + |h y'|) per step.
    `rk4_substeps` selects RK4 instead, with this number of steps per step of the grid. V_m is tested and reset after
    each step of the integrator, so a neuron may emit several spikes, at most 255, in a step of the grid. With `Delta_T`
    0 there is no exponential term, and the neuron spikes at V_th.

    Source: NEST 3.10, `aeif_cond_exp`; Brette & Gerstner, J. Neurophysiol. 94:3637, 2005.
    """

    equation: ClassVar[str] = (
        "C_m V_m' = -g_L (V_m - E_L) + g_L Delta_T exp((V_m - V_th)/Delta_T) - w - g_ex (V_m - E_ex) "
        "- g_in (V_m - E_in) + I; tau_w w' = a (V_m - E_L) - w; g' = -g/tau_syn + sum |w_syn| delta(t - t_spike); "
        "at V_m >= V_peak: V_m = V_reset, w += b"
    )
    source: ClassVar[str] = "NEST 3.10 aeif_cond_exp; Brette & Gerstner, J. Neurophysiol. 94:3637, 2005"
    weight_unit: ClassVar[str] = "nS"
    states: ClassVar[tuple[State, ...]] = (
        *VISIBLE_STATES,
        State("g_ex", "nS", "excitatory conductance", at_least=0.0),
        State("g_in", "nS", "inhibitory conductance", at_least=0.0),
        *HIDDEN,
    )
    conductances: ClassVar[tuple[str, ...]] = ("ex", "in")

    E_ex: Value = quantity(0.0, "mV", "excitatory reversal potential", arrays=True)
    E_in: Value = quantity(-85.0, "mV", "inhibitory reversal potential", arrays=True)

    def constants(p, h, c):
        """Fill `c` for a step of h ms. `p` is tau_minus, followed by the parameters above in order."""
        set_constants(p, h, c)
        c[E_EX], c[E_IN] = p[17], p[18]

    def step(s, c, x, i_0, lo, hi, fired):
        """Advance one step, including resets, then add the input."""
        step_and_reset(rates_of_conductances, system_of_conductances, s, c, i_0, lo, hi, fired)
        for i in range(lo, hi):
            s[G_EX, i] += x[0, i]
            s[G_IN, i] -= x[1, i]

    def quiet(s, c, i_0, lo, hi):
        """Return whether the neurons are at rest."""
        return is_quiet(rates_of_conductances, system_of_conductances, s, c, i_0, lo, hi)


def rates_of_currents(y, p):
    """Return the derivatives of V_m, w and the currents.

    V_m is limited to V_peak, and replaced by V_reset during refractoriness.
    """
    v, w, i_ex, i_in = y
    constants, v_peak, v_reset, rate_ex, rate_in, current, is_refractory = p
    v = v_reset if is_refractory else (v if v < v_peak else v_peak)
    v_slope, w_slope = membrane_derivatives(v, w, constants, current + i_ex + i_in)
    return 0.0 if is_refractory else v_slope, w_slope, rate_ex * i_ex, rate_in * i_in


def system_of_currents(s, c, i_0, i):
    """Return the argument `p` of `rates_of_currents`."""
    current, is_refractory = c[I_E] + i_0[i], s[REFRACTORY, i] != 0.0
    return membrane_constants(c), c[V_PEAK], c[V_RESET], c[RATE_EX], c[RATE_IN], current, is_refractory


@dataclass(frozen=True, kw_only=True, eq=False)
class aeif_psc_exp(AdaptiveExponential):
    """Adaptive exponential neuron. A spike adds its weight in pA to a current that decays exponentially.

    Positive weights go to the excitatory current, negative weights to the inhibitory current. The integrator is NEST's
    adaptive RKF45 with an error of at most `gsl_error_tol` (1 + |h y'|) per step. `rk4_substeps` selects RK4 instead,
    with this number of steps per step of the grid. V_m is tested and reset after each step of the integrator, so a
    neuron may emit several spikes, at most 255, in a step of the grid. With `Delta_T` 0 there is no exponential term,
    and the neuron spikes at V_th.

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
        *VISIBLE_STATES,
        State("I_syn_ex", "pA", "excitatory synaptic current"),
        State("I_syn_in", "pA", "inhibitory synaptic current"),
        *HIDDEN,
    )

    def step(s, c, x, i_0, lo, hi, fired):
        """Advance one step, including resets, then add the input."""
        step_and_reset(rates_of_currents, system_of_currents, s, c, i_0, lo, hi, fired)
        for i in range(lo, hi):
            s[I_EX, i] += x[0, i]
            s[I_IN, i] += x[1, i]

    def quiet(s, c, i_0, lo, hi):
        """Return whether the neurons are at rest."""
        return is_quiet(rates_of_currents, system_of_currents, s, c, i_0, lo, hi)
