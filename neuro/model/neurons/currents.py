"""Leaky neurons whose input goes into synaptic currents, integrated exactly."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call", check-untyped-defs=False
from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from neuro.core.quantities import Value, quantity
from neuro.model.neurons.base import Neuron, State
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
THETA = 4
D_EX, D_IN = 4, 5
TH_1, TH_2, TH = 4, 5, 6
"""Rows of the states; those after the first four belong to one model."""

# In a step: P33, what is left of V; P11, of a current; P32, mV per pA of a current; P30, of a constant one. These are
# NEST's names. CHARGE: mV that 1 pA can still add.
V_TH, V_RESET, E_L, P33, P30, I_E, R, GAIN, P32_EX, P32_IN, P11_EX, P11_IN, CHARGE_EX, CHARGE_IN = range(14)
FALL, MOST = 14, 15
THETA_PLUS, FADE = 14, 15
V_MIN, H, P31_EX, P31_IN, C_M, TAU_EX, TAU_IN = *range(14, 19), CHARGE_EX, CHARGE_IN
FADE_1, FADE_2, ALPHA_1, ALPHA_2 = range(14, 18)
"""Constants; those after the first fourteen belong to one model, and `iaf_psc_alpha` has no charges."""

STATES = (
    State("V_m", "mV", "membrane potential"),
    State("I_syn_ex", "pA", "excitatory synaptic current"),
    State("I_syn_in", "pA", "inhibitory synaptic current"),
    State("refractory", "steps", "steps left to hold", hidden=True),
)


def set_decays(c, h, tau_m, c_m, tau_ex, tau_in):
    """Set the constants by which V and the currents change in a step of h ms."""
    c[P33], c[P30], c[GAIN] = leak(tau_m, h), from_constant(tau_m, c_m, h), tau_m / c_m
    c[P32_EX], c[P32_IN] = from_exponential(tau_m, tau_ex, c_m, h), from_exponential(tau_m, tau_in, c_m, h)
    c[P11_EX], c[P11_IN] = math.exp(-h / tau_ex), math.exp(-h / tau_in)
    c[CHARGE_EX], c[CHARGE_IN] = tau_ex / c_m, tau_in / c_m


def set_leaky(p, h, c):
    """Set the constants of a model whose parameters begin with those of `LeakyWithCurrents`."""
    c[V_TH], c[V_RESET], c[E_L], c[I_E], c[R] = p[6], p[5], p[4], p[7], round(p[3] / h)
    set_decays(c, h, p[1], p[2], p[8], p[9])


def highest_with_currents(s, c, i_0, i):
    """A bound of V_m while no input arrives: its relaxation, and all the charge that positive currents still carry."""
    top = highest(s[V_M, i], c[E_L], c[GAIN], c[I_E] + i_0[i])
    return top + (max(s[I_EX, i], 0.0) * c[CHARGE_EX] + max(s[I_IN, i], 0.0) * c[CHARGE_IN])


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
    states: ClassVar[tuple[State, ...]] = STATES
    filters: ClassVar[Mapping[str, tuple[str, str]]] = {
        "ex": ("I_syn_ex", "tau_syn_ex"),
        "in": ("I_syn_in", "tau_syn_in"),
    }
    collects: ClassVar[tuple[str, ...]] = ("I_syn_ex", "I_syn_in")
    fixed: ClassVar[tuple[str, ...]] = ("reset_by_subtraction",)

    reset_by_subtraction: bool = quantity(False, "", FALLS, kind="boolean")

    def constants(p, h, c):
        """Fill `c` for a step of h ms; `p` is tau_minus, then the parameters above in order."""
        set_leaky(p, h, c)
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
        """V cannot reach V_th."""
        for i in range(lo, hi):
            if s[REFRACTORY, i] != 0.0 or not highest_with_currents(s, c, i_0, i) < c[V_TH]:
                return False
        return True


@dataclass(frozen=True, kw_only=True, eq=False)
class cuba_lif(iaf_psc_exp):
    """As `iaf_psc_exp`, but input moves V_m in the step in which it arrives, not from the next step on.

    The current comes first, then V_m with it, as in Norse's, snnTorch's and spikingjelly's neurons of NIR's type
    CubaLIF, and in Loihi's compartments. So a recurrent synapse takes one step here as there.
    Source: Pedersen et al., Nat. Commun. 15:8122, 2024; Davies et al., IEEE Micro 38:82, 2018.
    """

    source: ClassVar[str] = "Pedersen et al., Nat. Commun. 15:8122, 2024, CubaLIF"
    filters: ClassVar[Mapping[str, tuple[str, str]]] = {}
    collects: ClassVar[tuple[str, ...]] = ()
    fixed: ClassVar[tuple[str, ...]] = ("reset_by_subtraction", "max_spikes")

    max_spikes: int = quantity(
        1, "", "most spikes of a step, if V_m falls and stays at V_th", kind="integer", at_least=1, at_most=255
    )

    @staticmethod
    def check_steps(parameters: Mapping[str, Any], resolution: float) -> None:
        """Refuse several spikes in a step without a fall."""
        check_fall("cuba_lif", parameters)

    def constants(p, h, c):
        """Fill `c` for a step of h ms: those of `iaf_psc_exp`, and the most spikes of a step."""
        set_leaky(p, h, c)
        c[FALL], c[MOST] = fall_of(p[10], p[6], p[5]), p[11]

    def step(s, c, x, i_0, lo, hi, fired):
        """One step: the currents with the input, then V with them, then the threshold."""
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
        """Reset V and hold it; the currents go on."""
        s[V_M, i] = after_spike(s[V_M, i], c[V_TH], c[V_RESET], c[FALL], c[MOST])
        s[REFRACTORY, i] = c[R]

    def catch_up(s, p, c, i_0, lo, hi, h, n):
        """Advance n steps at once; `p` is as in `constants`.

        In `iaf_psc_exp` a step moves V by the currents before the step, so n steps of h equal one step of n h. Here
        each step moves V by the currents after it, which are smaller by the factor exp(-h/tau_syn).
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
    states: ClassVar[tuple[State, ...]] = (*STATES, State("theta", "mV", "rise of the threshold"))

    theta_plus: Value = quantity(0.05, "mV", "rise of the threshold at a spike", arrays=True)
    tau_theta: Value = quantity(1e7, "ms", "decay of the threshold's rise", above=0, arrays=True)

    def constants(p, h, c):
        """Fill `c` for a step of h ms; `p` is tau_minus, then the parameters above in order."""
        set_leaky(p, h, c)
        c[THETA_PLUS], c[FADE] = p[10], math.exp(-h / p[11])

    def step(s, c, x, i_0, lo, hi, fired):
        """V with the old currents, then the currents and the input, then the threshold, which always decays."""
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
        """V cannot reach V_th; theta only nears 0."""
        for i in range(lo, hi):
            if s[REFRACTORY, i] != 0.0 or not highest_with_currents(s, c, i_0, i) < c[V_TH] + min(s[THETA, i], 0.0):
                return False
        return True


@dataclass(frozen=True, kw_only=True, eq=False)
class iaf_psc_alpha(Leaky):
    """Leaky integrate-and-fire neuron; a spike starts an alpha-shaped current that peaks at its weight in pA.

    Positive weights go to the excitatory current, negative ones to the inhibitory.
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
        """Fill `c` for a step of h ms; `p` is tau_minus, then the parameters above in order."""
        tau_m, c_m, tau_ex, tau_in = p[1], p[2], p[9], p[10]
        c[V_TH], c[V_RESET], c[E_L], c[V_MIN], c[I_E], c[R] = p[6], p[5], p[4], p[7], p[8], round(p[3] / h)
        set_decays(c, h, tau_m, c_m, tau_ex, tau_in)
        c[P31_EX], c[P31_IN] = from_alpha(tau_m, tau_ex, c_m, h), from_alpha(tau_m, tau_in, c_m, h)
        c[H], c[TAU_EX], c[TAU_IN], c[C_M] = h, tau_ex, tau_in, c_m

    def step(s, c, x, i_0, lo, hi, fired):
        """One step: V with the old currents, then the currents and the input, then the threshold."""
        v_th, e_l, v_min, p33, p30, i_e, h = c[V_TH], c[E_L], c[V_MIN], c[P33], c[P30], c[I_E], c[H]
        p31_ex, p31_in, p32_ex, p32_in = c[P31_EX], c[P31_IN], c[P32_EX], c[P32_IN]
        p11_ex, p11_in = c[P11_EX], c[P11_IN]
        rise_ex, rise_in = math.e / c[TAU_EX], math.e / c[TAU_IN]
        for i in range(lo, hi):
            held = s[REFRACTORY, i]
            i_ex, i_in, d_ex, d_in = s[I_EX, i], s[I_IN, i], s[D_EX, i], s[D_IN, i]
            v = e_l + p33 * (s[V_M, i] - e_l) + p30 * (i_e + i_0[i])
            v += p31_ex * d_ex + p32_ex * i_ex + p31_in * d_in + p32_in * i_in
            v = v_min if v < v_min else v
            v = v if held == 0.0 else s[V_M, i]
            s[V_M, i] = v
            s[I_EX, i] = h * p11_ex * d_ex + p11_ex * i_ex
            s[I_IN, i] = h * p11_in * d_in + p11_in * i_in
            s[D_EX, i] = p11_ex * d_ex + rise_ex * x[0, i]
            s[D_IN, i] = p11_in * d_in + rise_in * x[1, i]
            s[REFRACTORY, i] = 0.0 if held == 0.0 else held - 1.0
            fired[i] = v >= v_th

    def fire(s, c, i):
        """Reset V and hold it; the currents go on."""
        s[V_M, i] = c[V_RESET]
        s[REFRACTORY, i] = c[R]

    def quiet(s, c, i_0, lo, hi):
        """V stays below its relaxation plus the charge that the positive currents carry, and V_min is not met."""
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
        *STATES,
        State("V_th_alpha_1", "mV", "fast part of the threshold"),
        State("V_th_alpha_2", "mV", "slow part of the threshold"),
        State("V_th", "mV", "threshold", follows=True),
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

    def constants(p, h, c):
        """Fill `c` for a step of h ms; `p` is tau_minus, then the parameters above in order."""
        c[V_TH], c[E_L], c[I_E], c[R] = p[12], p[4], p[5], round(p[3] / h)
        set_decays(c, h, p[1], p[2], p[6], p[7])
        c[FADE_1], c[FADE_2], c[ALPHA_1], c[ALPHA_2] = math.exp(-h / p[8]), math.exp(-h / p[9]), p[10], p[11]

    def step(s, c, x, i_0, lo, hi, fired):
        """One step: V with the old currents, the threshold, then the currents and the input, then the test."""
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
        """Raise the threshold; V goes on."""
        s[TH_1, i] += c[ALPHA_1]
        s[TH_2, i] += c[ALPHA_2]
        s[TH, i] = c[V_TH] + s[TH_2, i] + s[TH_1, i]
        s[REFRACTORY, i] = c[R]

    def quiet(s, c, i_0, lo, hi):
        """V cannot reach the lowest threshold to come."""
        for i in range(lo, hi):
            lowest = c[V_TH] + min(s[TH_1, i], 0.0) + min(s[TH_2, i], 0.0)
            if s[REFRACTORY, i] != 0.0 or not highest_with_currents(s, c, i_0, i) < lowest:
                return False
        return True
