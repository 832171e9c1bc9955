"""Leaky integrate-and-fire neurons with synaptic currents, integrated exactly."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call", check-untyped-defs=False
from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from neuro.core.quantities import Value, quantity
from neuro.model.neurons.base import State
from neuro.model.neurons.propagators import (
    FALL as FALLS,
    Leaky,
    LeakyWithCurrents,
    after_spike,
    check_fall,
    fall_of,
    from_alpha,
    from_constant,
    from_exponential,
    highest,
    leak,
    spikes_in,
)

V_M, I_EX, I_IN, REFRACTORY = range(4)
D_EX, D_IN = 4, 5
"""Rows of the states. D_EX and D_IN belong to `iaf_psc_alpha`."""

# Propagators of a step have the names of NEST. P33 is the decay factor of V_m, P11 that of a synaptic current. P32, P31
# and P30 are the mV that a synaptic current of 1 pA, a slope of 1 pA/ms and a constant current of 1 pA add in a step.
# CHARGE is the mV that a synaptic current of 1 pA adds until it has decayed.
V_TH, V_RESET, E_L, P33, P30, I_E, R, GAIN, P32_EX, P32_IN, P11_EX, P11_IN, CHARGE_EX, CHARGE_IN = range(14)
FALL, MOST = 14, 15
V_MIN, H, P31_EX, P31_IN, C_M, TAU_EX, TAU_IN = *range(14, 19), CHARGE_EX, CHARGE_IN
"""Indices of the constants. The last line belongs to `iaf_psc_alpha`, which uses the places of CHARGE for time
constants."""

STATES = (
    State("V_m", "mV", "membrane potential"),
    State("I_syn_ex", "pA", "excitatory synaptic current"),
    State("I_syn_in", "pA", "inhibitory synaptic current"),
    State("refractory", "steps", "remaining refractory steps", hidden=True),
)


def set_decays(c, h, tau_m, c_m, tau_ex, tau_in):
    """Set the propagators of V_m and the currents for a step of h ms."""
    c[P33], c[P30], c[GAIN] = leak(tau_m, h), from_constant(tau_m, c_m, h), tau_m / c_m
    c[P32_EX], c[P32_IN] = from_exponential(tau_m, tau_ex, c_m, h), from_exponential(tau_m, tau_in, c_m, h)
    c[P11_EX], c[P11_IN] = math.exp(-h / tau_ex), math.exp(-h / tau_in)
    c[CHARGE_EX], c[CHARGE_IN] = tau_ex / c_m, tau_in / c_m


def set_leaky(p, h, c):
    """Set the constants of a model whose parameters begin with those of `LeakyWithCurrents`."""
    c[V_TH], c[V_RESET], c[E_L], c[I_E], c[R] = p[6], p[5], p[4], p[7], round(p[3] / h)
    set_decays(c, h, p[1], p[2], p[8], p[9])


def highest_with_currents(s, c, i_0, i):
    """Return an upper bound of V_m without input: its relaxation plus the remaining charge of the positive currents."""
    top = highest(s[V_M, i], c[E_L], c[GAIN], c[I_E] + i_0[i])
    return top + (max(s[I_EX, i], 0.0) * c[CHARGE_EX] + max(s[I_IN, i], 0.0) * c[CHARGE_IN])


@dataclass(frozen=True, kw_only=True, eq=False)
class iaf_psc_exp(LeakyWithCurrents):
    """Leaky integrate-and-fire neuron. A spike adds its weight in pA to a current that decays exponentially.

    Positive weights go to the excitatory current, negative weights to the inhibitory current.
    Source: NEST 3.10, `iaf_psc_exp`; Tsodyks, Uziel & Markram, J. Neurosci. 20:RC50, 2000.
    """

    equation: ClassVar[str] = (
        "C_m V_m' = -C_m (V_m - E_L)/tau_m + I_syn_ex + I_syn_in + I; I_syn' = -I_syn/tau_syn; spike at V_m >= V_th"
    )
    source: ClassVar[str] = "NEST 3.10 iaf_psc_exp; Tsodyks et al., J. Neurosci. 20:RC50, 2000"
    states: ClassVar[tuple[State, ...]] = STATES
    filters: ClassVar[Mapping[str, tuple[str, str]]] = {
        "ex": ("I_syn_ex", "tau_syn_ex"),
        "in": ("I_syn_in", "tau_syn_in"),
    }
    collects: ClassVar[tuple[str, ...]] = ("I_syn_ex", "I_syn_in")
    fixed: ClassVar[tuple[str, ...]] = ("reset_by_subtraction",)

    reset_by_subtraction: bool = quantity(False, "", FALLS, kind="boolean")

    def constants(p, h, c):
        """Fill `c` for a step of h ms. `p` is tau_minus, followed by the parameters above in order."""
        set_leaky(p, h, c)
        c[FALL] = fall_of(p[10], p[6], p[5])

    def step(s, c, x, i_0, lo, hi, fired):
        """Advance V_m with the currents before the step, then the currents and their input, then test the threshold."""
        v_th, e_l, p33, p30, i_e = c[V_TH], c[E_L], c[P33], c[P30], c[I_E]
        p32_ex, p32_in, p11_ex, p11_in = c[P32_EX], c[P32_IN], c[P11_EX], c[P11_IN]
        # After a reset by subtraction V_m may still be above the threshold, so refractory neurons must not fire.
        if c[FALL] != 0.0:
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
        """Reset V_m and begin refractoriness. The currents are not reset."""
        s[V_M, i] = after_spike(s[V_M, i], c[V_TH], c[V_RESET], c[FALL], 1.0)
        s[REFRACTORY, i] = c[R]

    def quiet(s, c, i_0, lo, hi):
        """Return whether V_m cannot reach V_th."""
        for i in range(lo, hi):
            if s[REFRACTORY, i] != 0.0 or not highest_with_currents(s, c, i_0, i) < c[V_TH]:
                return False
        return True


@dataclass(frozen=True, kw_only=True, eq=False)
class cuba_lif(iaf_psc_exp):
    """Like `iaf_psc_exp`, but input changes V_m in the step of arrival instead of the next step.

    The currents are updated before V_m, as in the neurons of Norse, snnTorch and spikingjelly for NIR's type CubaLIF
    and in Loihi's compartments. A recurrent synapse thus has a delay of one step in all of these tools.
    Source: Pedersen et al., Nat. Commun. 15:8122, 2024; Davies et al., IEEE Micro 38:82, 2018.
    """

    source: ClassVar[str] = "Pedersen et al., Nat. Commun. 15:8122, 2024, CubaLIF"
    filters: ClassVar[Mapping[str, tuple[str, str]]] = {}
    collects: ClassVar[tuple[str, ...]] = ()
    fixed: ClassVar[tuple[str, ...]] = ("reset_by_subtraction", "max_spikes")

    max_spikes: int = quantity(
        1,
        "",
        "largest number of spikes per step; after a reset by subtraction V_m may still be at V_th or above",
        kind="integer",
        at_least=1,
        at_most=255,
    )

    @staticmethod
    def check_steps(parameters: Mapping[str, Any], resolution: float) -> None:
        """Raise an error for several spikes per step without a reset by subtraction."""
        check_fall("cuba_lif", parameters)

    def constants(p, h, c):
        """Fill `c` with the constants of `iaf_psc_exp` for a step of h ms and the largest number of spikes per step."""
        set_leaky(p, h, c)
        c[FALL], c[MOST] = fall_of(p[10], p[6], p[5]), p[11]

    def step(s, c, x, i_0, lo, hi, fired):
        """Advance the currents and add the input, then advance V_m, then test the threshold."""
        v_th, e_l, p33, p30, i_e, fall, most = c[V_TH], c[E_L], c[P33], c[P30], c[I_E], c[FALL], c[MOST]
        p32_ex, p32_in, p11_ex, p11_in = c[P32_EX], c[P32_IN], c[P11_EX], c[P11_IN]
        for i in range(lo, hi):
            i_ex = s[I_EX, i] * p11_ex + x[0, i]
            i_in = s[I_IN, i] * p11_in + x[1, i]
            s[I_EX, i] = i_ex
            s[I_IN, i] = i_in
            if s[REFRACTORY, i] == 0.0:
                v = e_l + p33 * (s[V_M, i] - e_l) + p32_ex * i_ex + p32_in * i_in + p30 * (i_e + i_0[i])
                s[V_M, i] = v
                fired[i] = v >= v_th if most == 1.0 else spikes_in(v, v_th, fall, most)
            else:
                s[REFRACTORY, i] -= 1.0
                fired[i] = 0

    def fire(s, c, i):
        """Reset V_m and begin refractoriness. The currents are not reset."""
        s[V_M, i] = after_spike(s[V_M, i], c[V_TH], c[V_RESET], c[FALL], c[MOST])
        s[REFRACTORY, i] = c[R]

    def catch_up(s, p, c, i_0, lo, hi, h, n):
        """Advance n steps at once. `p` is the same as in `constants`.

        In `iaf_psc_exp` a step changes V_m by the currents before the step, so n steps of h equal one step of n h. In
        this model each step changes V_m by the currents after the step, which are smaller by the factor
        exp(-h/tau_syn).
        """
        set_leaky(p, n * h, c)
        e_l, p33, p30, i_e, p11_ex, p11_in = c[E_L], c[P33], c[P30], c[I_E], c[P11_EX], c[P11_IN]
        p32_ex, p32_in = c[P32_EX] * math.exp(-h / p[8]), c[P32_IN] * math.exp(-h / p[9])
        for i in range(lo, hi):
            i_ex, i_in = s[I_EX, i], s[I_IN, i]
            s[V_M, i] = e_l + p33 * (s[V_M, i] - e_l) + p32_ex * i_ex + p32_in * i_in + p30 * (i_e + i_0[i])
            s[I_EX, i] = i_ex * p11_ex
            s[I_IN, i] = i_in * p11_in


@dataclass(frozen=True, kw_only=True, eq=False)
class iaf_psc_alpha(Leaky):
    """Leaky integrate-and-fire neuron. A spike starts an alpha-shaped current whose peak is its weight in pA.

    Positive weights go to the excitatory current, negative weights to the inhibitory current.
    Source: NEST 3.10, `iaf_psc_alpha`; Rotter & Diesmann, Biol. Cybern. 81:381, 1999.
    """

    equation: ClassVar[str] = (
        "C_m V_m' = -C_m (V_m - E_L)/tau_m + I_syn_ex + I_syn_in + I; "
        "I_syn = sum w e t/tau_syn exp(-t/tau_syn); spike at V_m >= V_th"
    )
    source: ClassVar[str] = "NEST 3.10 iaf_psc_alpha; Rotter & Diesmann, Biol. Cybern. 81:381, 1999"
    weight_unit: ClassVar[str] = "pA"
    states: ClassVar[tuple[State, ...]] = (
        *STATES,
        State("dI_syn_ex", "pA/ms", "slope of the excitatory current"),
        State("dI_syn_in", "pA/ms", "slope of the inhibitory current"),
    )
    receptors: ClassVar[int] = 2
    linear: ClassVar[bool] = True

    V_min: Value = quantity(-math.inf, "mV", "lowest potential", infinite=True, arrays=True)
    I_e: Value = quantity(0.0, "pA", "constant current", arrays=True)
    tau_syn_ex: Value = quantity(2.0, "ms", "time constant of the excitatory current", above=0, arrays=True)
    tau_syn_in: Value = quantity(2.0, "ms", "time constant of the inhibitory current", above=0, arrays=True)

    def constants(p, h, c):
        """Fill `c` for a step of h ms. `p` is tau_minus, followed by the parameters above in order."""
        tau_m, c_m, tau_ex, tau_in = p[1], p[2], p[9], p[10]
        c[V_TH], c[V_RESET], c[E_L], c[V_MIN], c[I_E], c[R] = p[6], p[5], p[4], p[7], p[8], round(p[3] / h)
        set_decays(c, h, tau_m, c_m, tau_ex, tau_in)
        c[P31_EX], c[P31_IN] = from_alpha(tau_m, tau_ex, c_m, h), from_alpha(tau_m, tau_in, c_m, h)
        c[H], c[TAU_EX], c[TAU_IN], c[C_M] = h, tau_ex, tau_in, c_m

    def step(s, c, x, i_0, lo, hi, fired):
        """Advance V_m with the currents before the step, then the currents and their input, then test the threshold."""
        v_th, e_l, v_min, p33, p30, i_e, h = c[V_TH], c[E_L], c[V_MIN], c[P33], c[P30], c[I_E], c[H]
        p31_ex, p31_in, p32_ex, p32_in = c[P31_EX], c[P31_IN], c[P32_EX], c[P32_IN]
        p11_ex, p11_in = c[P11_EX], c[P11_IN]
        rise_ex, rise_in = math.e / c[TAU_EX], math.e / c[TAU_IN]
        for i in range(lo, hi):
            refractory_left = s[REFRACTORY, i]
            i_ex, i_in, d_ex, d_in = s[I_EX, i], s[I_IN, i], s[D_EX, i], s[D_IN, i]
            v = e_l + p33 * (s[V_M, i] - e_l) + p30 * (i_e + i_0[i])
            v += p31_ex * d_ex + p32_ex * i_ex + p31_in * d_in + p32_in * i_in
            v = v_min if v < v_min else v
            v = v if refractory_left == 0.0 else s[V_M, i]
            s[V_M, i] = v
            s[I_EX, i] = h * p11_ex * d_ex + p11_ex * i_ex
            s[I_IN, i] = h * p11_in * d_in + p11_in * i_in
            s[D_EX, i] = p11_ex * d_ex + rise_ex * x[0, i]
            s[D_IN, i] = p11_in * d_in + rise_in * x[1, i]
            s[REFRACTORY, i] = 0.0 if refractory_left == 0.0 else refractory_left - 1.0
            fired[i] = v >= v_th

    def fire(s, c, i):
        """Reset V_m and begin refractoriness. The currents are not reset."""
        s[V_M, i] = c[V_RESET]
        s[REFRACTORY, i] = c[R]

    def quiet(s, c, i_0, lo, hi):
        """Return whether V_m can neither reach V_th nor V_min.

        The bounds of V_m are its relaxation plus the remaining charge of the positive or of the negative currents.
        """
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
