"""Leaky integrate-and-fire with delta-shaped input."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
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
    after_spike,
    check_fall,
    fall_of,
    from_constant,
    highest,
    leak,
    spikes_in,
)


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
        State("refractory", "steps", "steps left to hold", hidden=True),
        State("held_input", "mV", "input gathered while refractory", hidden=True),
    )
    linear: ClassVar[bool] = True
    fixed: ClassVar[tuple[str, ...]] = ("reset_by_subtraction", "max_spikes", "threshold_rises")

    V_min: Value = quantity(-math.inf, "mV", "lowest potential", infinite=True, arrays=True)
    I_e: Value = quantity(0.0, "pA", "constant current", arrays=True)
    refractory_input: bool = quantity(False, "", "keep input that arrives while refractory", kind="boolean")
    reset_by_subtraction: bool = quantity(False, "", FALLS, kind="boolean")
    max_spikes: int = quantity(
        1, "", "most spikes of a step, if V_m falls and stays at V_th", kind="integer", at_least=1, at_most=255
    )

    threshold_rises: bool = quantity(
        False, "", "while V_m stays at V_th after it fell, a spike needs V_th - V_reset more", kind="boolean"
    )

    @staticmethod
    def check_steps(parameters: Mapping[str, Any], resolution: float) -> None:
        """Refuse several spikes in a step without a fall."""
        check_fall("iaf_psc_delta", parameters)


V_M, REFRACTORY, HELD = range(3)
V_TH, V_RESET, E_L, V_MIN, P33, P30, I_E, R, GAIN, KEEP, FALL, MOST, RISES = range(13)


def constants(p, h, c):
    """Fill `c` for a step of h ms; `p` is tau_minus, then the parameters above in order."""
    tau_m, c_m = p[1], p[2]
    c[V_TH], c[V_RESET], c[E_L], c[V_MIN] = p[6], p[5], p[4], p[7]
    c[P33] = leak(tau_m, h)
    c[P30] = from_constant(tau_m, c_m, h)
    c[I_E] = p[8]
    c[R] = round(p[3] / h)
    c[GAIN] = tau_m / c_m
    c[KEEP] = p[9]
    c[FALL] = fall_of(p[10], p[6], p[5])
    c[MOST] = p[11]
    c[RISES] = p[12]


def step(s, c, x, i_0, lo, hi, fired):
    """One step: V, then the input, then the threshold."""
    v_th, e_l, v_min, p33, p30, i_e = c[V_TH], c[E_L], c[V_MIN], c[P33], c[P30], c[I_E]
    if c[FALL] != 0.0:
        step_falling(s, c, x, i_0, lo, hi, fired)
    elif c[KEEP] == 0.0:
        for i in range(lo, hi):
            held = s[REFRACTORY, i]
            v = e_l + p33 * (s[V_M, i] - e_l) + p30 * (i_e + i_0[i]) + x[0, i]
            v = v_min if v < v_min else v
            v = v if held == 0.0 else s[V_M, i]
            s[V_M, i] = v
            s[REFRACTORY, i] = 0.0 if held == 0.0 else held - 1.0
            fired[i] = v >= v_th
    else:
        for i in range(lo, hi):
            held = s[REFRACTORY, i]
            if held == 0.0:
                v = e_l + p33 * (s[V_M, i] - e_l) + p30 * (i_e + i_0[i]) + x[0, i] + s[HELD, i]
                s[V_M, i] = max(v, v_min)
                s[HELD, i] = 0.0
            else:
                s[HELD, i] += x[0, i] * p33**held
                s[REFRACTORY, i] = held - 1.0
            fired[i] = s[V_M, i] >= v_th


def step_falling(s, c, x, i_0, lo, hi, fired):
    """The same where V falls at a spike: what is left may reach the threshold again, but not while it is held."""
    v_th, e_l, v_min, p33, p30, i_e = c[V_TH], c[E_L], c[V_MIN], c[P33], c[P30], c[I_E]
    keep, fall, most, rises = c[KEEP], c[FALL], c[MOST], c[RISES]
    for i in range(lo, hi):
        held = s[REFRACTORY, i]
        needed = v_th + fall if rises != 0.0 and s[V_M, i] >= v_th else v_th
        if held == 0.0:
            v = e_l + p33 * (s[V_M, i] - e_l) + p30 * (i_e + i_0[i]) + x[0, i] + s[HELD, i]
            s[V_M, i] = max(v, v_min)
            s[HELD, i] = 0.0
            fired[i] = spikes_in(v, needed, fall, most)
        else:
            s[HELD, i] += keep * x[0, i] * p33**held
            s[REFRACTORY, i] = held - 1.0
            fired[i] = 0


def fire(s, c, i):
    """Reset V and hold it."""
    s[V_M, i] = after_spike(s[V_M, i], c[V_TH], c[V_RESET], c[FALL], c[MOST])
    s[REFRACTORY, i] = c[R]


def quiet(s, c, i_0, lo, hi):
    """Without input V goes from where it is towards E_L + tau_m I / C_m and not beyond."""
    for i in range(lo, hi):
        top = highest(s[V_M, i], c[E_L], c[GAIN], c[I_E] + i_0[i])
        if s[REFRACTORY, i] != 0.0 or s[HELD, i] != 0.0 or not top < c[V_TH]:
            return False
    return True
