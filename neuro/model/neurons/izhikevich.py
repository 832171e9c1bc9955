"""Izhikevich's simple model."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from neuro.core.quantities import Value, quantity
from neuro.model.neurons.base import Neuron, State


@dataclass(frozen=True, kw_only=True, eq=False)
class izhikevich(Neuron):
    """Izhikevich's two-variable neuron, forward Euler on the old values; input makes V_m jump by its weight in mV.

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

    a: Value = quantity(0.02, "", "rate of recovery, 1/ms", arrays=True)
    b: Value = quantity(0.2, "", "sensitivity of recovery to V_m", arrays=True)
    c: Value = quantity(-65.0, "mV", "V_m after a spike", arrays=True)
    d: Value = quantity(8.0, "mV", "jump of U_m at a spike", arrays=True)
    I_e: Value = quantity(0.0, "pA", "constant current", arrays=True)
    V_th: Value = quantity(30.0, "mV", "threshold (peak)", arrays=True)
    V_min: Value = quantity(-math.inf, "mV", "lowest potential", infinite=True, arrays=True)

    @staticmethod
    def initial(parameters: Mapping[str, Any]) -> dict[str, Any]:
        """V_m = -65 mV and U_m = b V_m, as in the paper."""
        return {"V_m": -65.0, "U_m": -65.0 * parameters["b"]}


V_M, U_M = range(2)
V_TH, A, B, C, D, I_E, V_MIN, H = range(8)


def constants(p, h, c):
    """Fill `c` for a step of h ms; `p` is tau_minus, then the parameters above in order."""
    c[V_TH], c[A], c[B], c[C], c[D], c[I_E], c[V_MIN], c[H] = p[6], p[1], p[2], p[3], p[4], p[5], p[7], h


def step(s, c, x, i_0, lo, hi, fired):
    """One Euler step of both variables from their old values, then the threshold."""
    v_th, a, b, i_e, v_min, h = c[V_TH], c[A], c[B], c[I_E], c[V_MIN], c[H]
    for i in range(lo, hi):
        v, u = s[V_M, i], s[U_M, i]
        new = v + h * (0.04 * v * v + 5.0 * v + 140.0 - u + i_0[i] + i_e) + x[0, i]
        new = v_min if new < v_min else new
        s[V_M, i] = new
        s[U_M, i] = u + h * a * (b * v - u)
        fired[i] = new >= v_th


def fire(s, c, i):
    """Reset V_m to c and raise U_m by d."""
    s[V_M, i] = c[C]
    s[U_M, i] += c[D]


def quiet(s, c, i_0, lo, hi):
    """At rest: a step without input leaves every bit where it is."""
    for i in range(lo, hi):
        v, u = s[V_M, i], s[U_M, i]
        new = v + c[H] * (0.04 * v * v + 5.0 * v + 140.0 - u + i_0[i] + c[I_E])
        if new != v or u + c[H] * c[A] * (c[B] * v - u) != u or v >= c[V_TH]:
            return False
    return True
