"""Integrate-and-fire with linear leak and delta-shaped input."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from neuro.core.quantities import Value, quantity
from neuro.model.neurons.base import Resting, State


@dataclass(frozen=True, kw_only=True, eq=False)
class iaf_linear_leak(Resting):
    """Integrate-and-fire neuron that leaks at a constant rate; input makes V_m jump by its weight in mV.

    V_m goes towards E_L by `leak` mV each ms, from above and from below, and stays there: a current moves it away only
    if it exceeds C_m `leak`. Input that arrives while refractory is lost.
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
        State("refractory", "steps", "steps left to hold", hidden=True),
    )

    leak: Value = quantity(1.0, "mV/ms", "rate at which V_m goes towards E_L", at_least=0, arrays=True)
    C_m: Value = quantity(250.0, "pF", "membrane capacity", above=0, arrays=True)
    t_ref: Value = quantity(2.0, "ms", "refractory period", at_least=0, arrays=True)
    E_L: Value = quantity(-70.0, "mV", "resting potential", arrays=True)
    V_reset: Value = quantity(-70.0, "mV", "potential after a spike", arrays=True)
    V_th: Value = quantity(-55.0, "mV", "threshold; .inf: it only integrates", infinite=True, arrays=True)
    I_e: Value = quantity(0.0, "pA", "constant current", arrays=True)


V_M, REFRACTORY = range(2)
V_TH, V_RESET, E_L, LEAK, PER_PA, I_E, R = range(7)


def constants(p, h, c):
    """Fill `c` for a step of h ms; `p` is tau_minus, then the parameters above in order."""
    c[V_TH], c[V_RESET], c[E_L] = p[6], p[5], p[4]
    c[LEAK] = p[1] * h
    c[PER_PA] = h / p[2]
    c[I_E] = p[7]
    c[R] = round(p[3] / h)


def leaked(v, e_l, leak, push):
    """V after a step without input, whose leak is `leak` mV and whose current alone would move V by `push` mV."""
    above, below = push - leak, push + leak  # how far V goes on either side of E_L
    left = 1.0  # of the step, once V is at E_L
    if v > e_l:
        if v + above >= e_l:
            return v + above
        left += (v - e_l) / above
    elif v < e_l:
        if v + below <= e_l:
            return v + below
        left -= (e_l - v) / below
    return e_l + left * (max(above, 0.0) + min(below, 0.0))


def driven(c, i_0, lo, hi):
    """Whether a current acts on any of some neurons."""
    some = 0
    for i in range(lo, hi):
        some |= c[I_E] + i_0[i] != 0.0
    return some != 0


def step(s, c, x, i_0, lo, hi, fired):
    """One step: V, then the input, then the threshold."""
    if not driven(c, i_0, lo, hi):  # as below, without a branch for each neuron
        e_l, leak, v_th = c[E_L], c[LEAK], c[V_TH]
        for i in range(lo, hi):
            held, v = s[REFRACTORY, i], s[V_M, i]
            down, up = v - leak, v + leak
            left = (down if down > e_l else e_l) if v > e_l else (up if up < e_l else e_l)
            v = left + x[0, i] if held == 0.0 else v
            s[V_M, i] = v
            s[REFRACTORY, i] = 0.0 if held == 0.0 else held - 1.0
            fired[i] = v >= v_th
        return
    for i in range(lo, hi):
        if s[REFRACTORY, i] == 0.0:
            s[V_M, i] = leaked(s[V_M, i], c[E_L], c[LEAK], c[PER_PA] * (c[I_E] + i_0[i])) + x[0, i]
        else:
            s[REFRACTORY, i] -= 1.0
        fired[i] = s[V_M, i] >= c[V_TH]


def fire(s, c, i):
    """Reset V and hold it."""
    s[V_M, i] = c[V_RESET]
    s[REFRACTORY, i] = c[R]


def quiet(s, c, i_0, lo, hi):
    """A step changes nothing: V rests, and no rounding tells how long it did."""
    for i in range(lo, hi):
        v = s[V_M, i]
        if s[REFRACTORY, i] != 0.0 or v >= c[V_TH]:
            return False
        if leaked(v, c[E_L], c[LEAK], c[PER_PA] * (c[I_E] + i_0[i])) != v:
            return False
    return True
