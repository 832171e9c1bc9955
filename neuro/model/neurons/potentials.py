"""Neurons whose input makes the membrane potential jump, and a neuron that repeats its input."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call", check-untyped-defs=False
from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from neuro.core.quantities import Value, quantity
from neuro.model.neurons.base import Neuron, Resting, State
from neuro.model.neurons.propagators import (
    FALL as FALLS,
    Leaky,
    after_spike,
    check_fall,
    fall_of,
    from_constant,
    highest,
    leak,
    spikes_in,
)

V_M, REFRACTORY, HELD = range(3)
U_M = 1
"""Rows of the states. U_M belongs to `izhikevich`."""

V_TH, V_RESET, E_L, V_MIN, I_E, R = range(6)
P33, P30, GAIN, KEEP, FALL, MOST, RISES = range(6, 13)
LEAK, PER_PA = 6, 7
A, B, C, D, H = range(6, 11)
"""Indices of the constants. Each line after the first belongs to one model."""


def step_falling(s, c, x, i_0, lo, hi, fired):
    """Advance one step of neurons that are reset by subtraction.

    V_m may be at the threshold or above even after a reset, but a refractory neuron does not fire.
    """
    v_th, e_l, v_min, p33, p30, i_e = c[V_TH], c[E_L], c[V_MIN], c[P33], c[P30], c[I_E]
    keep, fall, most, rises = c[KEEP], c[FALL], c[MOST], c[RISES]
    for i in range(lo, hi):
        refractory_left = s[REFRACTORY, i]
        threshold = v_th + fall if rises != 0.0 and s[V_M, i] >= v_th else v_th
        if refractory_left == 0.0:
            v = e_l + p33 * (s[V_M, i] - e_l) + p30 * (i_e + i_0[i]) + x[0, i] + s[HELD, i]
            s[V_M, i] = max(v, v_min)
            s[HELD, i] = 0.0
            fired[i] = spikes_in(v, threshold, fall, most)
        else:
            s[HELD, i] += keep * x[0, i] * p33**refractory_left
            s[REFRACTORY, i] = refractory_left - 1.0
            fired[i] = 0


@dataclass(frozen=True, kw_only=True, eq=False)
class iaf_psc_delta(Leaky):
    """Leaky integrate-and-fire neuron whose input makes V_m jump by its weight in mV.

    An infinite `tau_m` removes the leak. Source: NEST 3.10, `iaf_psc_delta`; Rotter & Diesmann 1999.
    """

    equation: ClassVar[str] = "V_m' = -(V_m - E_L)/tau_m + I/C_m + sum w delta(t - t_spike); spike at V_m >= V_th"
    source: ClassVar[str] = "NEST 3.10 iaf_psc_delta; Rotter & Diesmann, Biol. Cybern. 81:381, 1999"
    weight_unit: ClassVar[str] = "mV"
    states: ClassVar[tuple[State, ...]] = (
        State("V_m", "mV", "membrane potential"),
        State("refractory", "steps", "remaining refractory steps", hidden=True),
        State("held_input", "mV", "input collected during refractoriness", hidden=True),
    )
    linear: ClassVar[bool] = True
    fixed: ClassVar[tuple[str, ...]] = ("reset_by_subtraction", "max_spikes", "threshold_rises")

    V_min: Value = quantity(-math.inf, "mV", "lowest potential", infinite=True, arrays=True)
    I_e: Value = quantity(0.0, "pA", "constant current", arrays=True)
    refractory_input: bool = quantity(
        False, "", "whether input during refractoriness is applied, with decay, when it ends", kind="boolean"
    )
    reset_by_subtraction: bool = quantity(False, "", FALLS, kind="boolean")
    max_spikes: int = quantity(
        1,
        "",
        "largest number of spikes per step; after a reset by subtraction V_m may still be at V_th or above",
        kind="integer",
        at_least=1,
        at_most=255,
    )

    threshold_rises: bool = quantity(
        False,
        "",
        "whether the threshold of a step is V_th + (V_th - V_reset) if V_m is at V_th or above before the step",
        kind="boolean",
    )

    @staticmethod
    def check_steps(parameters: Mapping[str, Any], resolution: float) -> None:
        """Raise an error for several spikes per step without a reset by subtraction."""
        check_fall("iaf_psc_delta", parameters)

    def constants(p, h, c):
        """Fill `c` for a step of h ms. `p` is tau_minus, followed by the parameters above in order."""
        c[V_TH], c[V_RESET], c[E_L], c[V_MIN], c[I_E], c[R] = p[6], p[5], p[4], p[7], p[8], round(p[3] / h)
        c[P33], c[P30], c[GAIN] = leak(p[1], h), from_constant(p[1], p[2], h), p[1] / p[2]
        c[KEEP], c[FALL], c[MOST], c[RISES] = p[9], fall_of(p[10], p[6], p[5]), p[11], p[12]

    def step(s, c, x, i_0, lo, hi, fired):
        """Advance V_m, add the input, then test the threshold."""
        v_th, e_l, v_min, p33, p30, i_e = c[V_TH], c[E_L], c[V_MIN], c[P33], c[P30], c[I_E]
        if c[FALL] != 0.0:
            step_falling(s, c, x, i_0, lo, hi, fired)
        elif c[KEEP] == 0.0:
            for i in range(lo, hi):
                refractory_left = s[REFRACTORY, i]
                v = e_l + p33 * (s[V_M, i] - e_l) + p30 * (i_e + i_0[i]) + x[0, i]
                v = v_min if v < v_min else v
                v = v if refractory_left == 0.0 else s[V_M, i]
                s[V_M, i] = v
                s[REFRACTORY, i] = 0.0 if refractory_left == 0.0 else refractory_left - 1.0
                fired[i] = v >= v_th
        else:
            for i in range(lo, hi):
                refractory_left = s[REFRACTORY, i]
                if refractory_left == 0.0:
                    v = e_l + p33 * (s[V_M, i] - e_l) + p30 * (i_e + i_0[i]) + x[0, i] + s[HELD, i]
                    s[V_M, i] = max(v, v_min)
                    s[HELD, i] = 0.0
                else:
                    s[HELD, i] += x[0, i] * p33**refractory_left
                    s[REFRACTORY, i] = refractory_left - 1.0
                fired[i] = s[V_M, i] >= v_th

    def fire(s, c, i):
        """Reset V_m and begin refractoriness."""
        s[V_M, i] = after_spike(s[V_M, i], c[V_TH], c[V_RESET], c[FALL], c[MOST])
        s[REFRACTORY, i] = c[R]

    def quiet(s, c, i_0, lo, hi):
        """Return whether V_m cannot reach V_th. V_m relaxes towards E_L + tau_m I / C_m."""
        for i in range(lo, hi):
            top = highest(s[V_M, i], c[E_L], c[GAIN], c[I_E] + i_0[i])
            if s[REFRACTORY, i] != 0.0 or s[HELD, i] != 0.0 or not top < c[V_TH]:
                return False
        return True


def after_leak(v, e_l, leak, push):
    """Return V_m after a step without input.

    In a step the leak moves V_m towards `e_l` by `leak` mV, and the current alone would change V_m by `push` mV.
    """
    above, below = push - leak, push + leak  # change of V_m per step above and below E_L
    remaining = 1.0  # share of the step after V_m has reached E_L
    if v > e_l:
        if v + above >= e_l:
            return v + above
        remaining += (v - e_l) / above
    elif v < e_l:
        if v + below <= e_l:
            return v + below
        remaining -= (e_l - v) / below
    return e_l + remaining * (max(above, 0.0) + min(below, 0.0))


def has_current(c, i_0, lo, hi):
    """Return whether a current acts on any of the neurons."""
    any_driven = 0
    for i in range(lo, hi):
        any_driven |= c[I_E] + i_0[i] != 0.0
    return any_driven != 0


@dataclass(frozen=True, kw_only=True, eq=False)
class iaf_linear_leak(Resting):
    """Integrate-and-fire neuron with a constant leak. Input makes V_m jump by its weight in mV.

    V_m moves towards E_L by `leak` mV per ms, from above and from below, and stays there. A current moves V_m away only
    if it exceeds C_m `leak`. Input during refractoriness is lost.
    Source: Fusi & Mattia 1999, whose V_m has a floor at E_L = 0.
    """

    equation: ClassVar[str] = (
        "V_m' = -leak sgn(V_m - E_L) + I/C_m + sum w delta(t - t_spike), "
        "V_m' = 0 at V_m = E_L if |I| <= C_m leak; spike at V_m >= V_th"
    )
    source: ClassVar[str] = "Fusi & Mattia, Neural Comput. 11:633, 1999"
    weight_unit: ClassVar[str] = "mV"
    states: ClassVar[tuple[State, ...]] = (
        State("V_m", "mV", "membrane potential"),
        State("refractory", "steps", "remaining refractory steps", hidden=True),
    )

    leak: Value = quantity(1.0, "mV/ms", "rate at which V_m moves towards E_L", at_least=0, arrays=True)
    C_m: Value = quantity(250.0, "pF", "membrane capacity", above=0, arrays=True)
    t_ref: Value = quantity(2.0, "ms", "refractory period", at_least=0, arrays=True)
    E_L: Value = quantity(-70.0, "mV", "resting potential", arrays=True)
    V_reset: Value = quantity(-70.0, "mV", "potential after a spike", arrays=True)
    V_th: Value = quantity(-55.0, "mV", "threshold; .inf: no spikes", infinite=True, arrays=True)
    I_e: Value = quantity(0.0, "pA", "constant current", arrays=True)

    def constants(p, h, c):
        """Fill `c` for a step of h ms. `p` is tau_minus, followed by the parameters above in order."""
        c[V_TH], c[V_RESET], c[E_L], c[I_E], c[R] = p[6], p[5], p[4], p[7], round(p[3] / h)
        c[LEAK], c[PER_PA] = p[1] * h, h / p[2]

    def step(s, c, x, i_0, lo, hi, fired):
        """Advance V_m, add the input, then test the threshold."""
        if not has_current(c, i_0, lo, hi):  # the same as below, without a branch per neuron
            e_l, leak, v_th = c[E_L], c[LEAK], c[V_TH]
            for i in range(lo, hi):
                refractory_left, v = s[REFRACTORY, i], s[V_M, i]
                down, up = v - leak, v + leak
                relaxed = (down if down > e_l else e_l) if v > e_l else (up if up < e_l else e_l)
                v = relaxed + x[0, i] if refractory_left == 0.0 else v
                s[V_M, i] = v
                s[REFRACTORY, i] = 0.0 if refractory_left == 0.0 else refractory_left - 1.0
                fired[i] = v >= v_th
            return
        for i in range(lo, hi):
            if s[REFRACTORY, i] == 0.0:
                s[V_M, i] = after_leak(s[V_M, i], c[E_L], c[LEAK], c[PER_PA] * (c[I_E] + i_0[i])) + x[0, i]
            else:
                s[REFRACTORY, i] -= 1.0
            fired[i] = s[V_M, i] >= c[V_TH]

    def fire(s, c, i):
        """Reset V_m and begin refractoriness."""
        s[V_M, i] = c[V_RESET]
        s[REFRACTORY, i] = c[R]

    def quiet(s, c, i_0, lo, hi):
        """Return whether a step changes nothing, because V_m is at rest."""
        for i in range(lo, hi):
            v = s[V_M, i]
            if s[REFRACTORY, i] != 0.0 or v >= c[V_TH]:
                return False
            if after_leak(v, c[E_L], c[LEAK], c[PER_PA] * (c[I_E] + i_0[i])) != v:
                return False
        return True


@dataclass(frozen=True, kw_only=True, eq=False)
class izhikevich(Neuron):
    """Izhikevich's neuron with two variables, integrated by forward Euler. Input makes V_m jump by its weight in mV.

    Source: Izhikevich, IEEE Trans. Neural Networks 14:1569, 2003; NEST 3.10, `izhikevich` with
    `consistent_integration`.
    """

    equation: ClassVar[str] = (
        "V_m' = 0.04 V_m^2 + 5 V_m + 140 - U_m + I; U_m' = a (b V_m - U_m); at V_m >= V_th: V_m = c, U_m += d"
    )
    source: ClassVar[str] = "Izhikevich, IEEE Trans. Neural Networks 14:1569, 2003; NEST 3.10 izhikevich"
    weight_unit: ClassVar[str] = "mV"
    states: ClassVar[tuple[State, ...]] = (
        State("V_m", "mV", "membrane potential"),
        State("U_m", "mV", "recovery variable"),
    )

    a: Value = quantity(0.02, "", "rate of recovery in 1/ms", arrays=True)
    b: Value = quantity(0.2, "", "sensitivity of recovery to V_m", arrays=True)
    c: Value = quantity(-65.0, "mV", "V_m after a spike", arrays=True)
    d: Value = quantity(8.0, "mV", "jump of U_m at a spike", arrays=True)
    I_e: Value = quantity(0.0, "pA", "constant current", arrays=True)
    V_th: Value = quantity(30.0, "mV", "threshold (peak)", arrays=True)
    V_min: Value = quantity(-math.inf, "mV", "lowest potential", infinite=True, arrays=True)

    @staticmethod
    def initial(parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Return V_m = -65 mV and U_m = b V_m, as in the paper."""
        return {"V_m": -65.0, "U_m": -65.0 * parameters["b"]}

    def constants(p, h, c):
        """Fill `c` for a step of h ms. `p` is tau_minus, followed by the parameters above in order."""
        c[V_TH], c[A], c[B], c[C], c[D], c[I_E], c[V_MIN], c[H] = p[6], p[1], p[2], p[3], p[4], p[5], p[7], h

    def step(s, c, x, i_0, lo, hi, fired):
        """Advance both variables by an Euler step from their old values, then test the threshold."""
        v_th, a, b, i_e, v_min, h = c[V_TH], c[A], c[B], c[I_E], c[V_MIN], c[H]
        for i in range(lo, hi):
            v, u = s[V_M, i], s[U_M, i]
            new = v + h * (0.04 * v * v + 5.0 * v + 140.0 - u + i_0[i] + i_e) + x[0, i]
            new = v_min if new < v_min else new
            s[V_M, i] = new
            s[U_M, i] = u + h * a * (b * v - u)
            fired[i] = new >= v_th

    def fire(s, c, i):
        """Set V_m to c and add d to U_m."""
        s[V_M, i] = c[C]
        s[U_M, i] += c[D]

    def quiet(s, c, i_0, lo, hi):
        """Return whether the neurons are at rest, so that a step without input changes no state."""
        for i in range(lo, hi):
            v, u = s[V_M, i], s[U_M, i]
            new = v + c[H] * (0.04 * v * v + 5.0 * v + 140.0 - u + i_0[i] + c[I_E])
            if new != v or u + c[H] * c[A] * (c[B] * v - u) != u or v >= c[V_TH]:
                return False
        return True


@dataclass(frozen=True, kw_only=True, eq=False)
class parrot_neuron(Neuron):
    """Neuron that repeats incoming spikes with their multiplicity. Weights have no effect. Source: NEST 3.10."""

    equation: ClassVar[str] = "emits at t the spikes that arrive at t"
    source: ClassVar[str] = "NEST 3.10 parrot_neuron"
    relay: ClassVar[bool] = True

    def constants(p, h, c):
        """Do nothing, because a parrot has no constants."""

    def step(s, c, x, i_0, lo, hi, fired):
        """Fire if a spike arrived."""
        for i in range(lo, hi):
            fired[i] = x[0, i] > 0.0

    def fire(s, c, i):
        """Do nothing, because a parrot has no states."""

    def quiet(s, c, i_0, lo, hi):
        """Return true, because only input makes a parrot fire."""
        return True
