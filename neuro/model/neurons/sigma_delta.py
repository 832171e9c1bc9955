"""A neuron that sums the messages it receives, and sends the changes of a function of the sum."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from neuro.core.quantities import Value, quantity
from neuro.model.neurons.base import State
from neuro.model.neurons.graded import PAYLOAD_STATE, Encoding, send_change, stays_silent


@dataclass(frozen=True, kw_only=True, eq=False)
class sigma_delta(Encoding):
    """Sigma-delta neuron: sums what arrives, and sends a message when its activation has changed by vth.

    sigma is the sum of all input, so that messages need to carry differences only; y = max(sigma + bias, 0) with
    `relu`, else sigma + bias. `vth` and `bias` are in units of 2^(spike_exp + state_exp). lava: SigmaDelta, whose
    act_mode RELU is `relu: true` and UNIT `relu: false`. Source: lava 0.10, proc/sdn.
    """

    equation: ClassVar[str] = (
        "sigma' = sigma + sum w p; y = max(sigma' + bias, 0); delta = y - act + residue; sends delta at |delta| >= vth"
    )
    source: ClassVar[str] = "lava 0.10 SigmaDelta; O'Connor & Welling, arXiv:1611.02024, 2016"
    states: ClassVar[tuple[State, ...]] = (
        State("sigma", "", "sum of all input"),
        State("act", "", "activation"),
        State("residue", "", "change that was not sent"),
        State("error", "", "sum of changes since the last message, with cum_error"),
        PAYLOAD_STATE,
    )

    bias: Value = quantity(0.0, "", "added to the sum", arrays=True)
    relu: bool = quantity(True, "", "activation: the sum where it is above 0, else the sum", kind="boolean")


SIGMA, ACT = 0, 1
VTH, GRAIN, CUM, BIAS, RELU = range(5)


def constants(p, h, c):
    """Fill `c`; `p` is tau_minus, vth, spike_exp, state_exp, cum_error, bias, relu."""
    unit = 2.0 ** (p[2] + p[3])
    c[VTH], c[GRAIN], c[CUM], c[BIAS], c[RELU] = p[1] * unit, 2.0 ** p[3], p[4], p[5] * unit, p[6]


def step(s, c, x, i_0, lo, hi, fired):
    """Sum, activate, send the change."""
    vth, grain, cumulative, bias, relu = c[VTH], c[GRAIN], c[CUM], c[BIAS], c[RELU]
    for i in range(lo, hi):
        s[SIGMA, i] += x[0, i]
        y = s[SIGMA, i] + bias
        if relu != 0.0 and y < 0.0:
            y = 0.0
        fired[i] = send_change(s, ACT, i, y, vth, grain, cumulative) != 0.0


def fire(s, c, i):
    """Nothing: `step` has sent."""


def quiet(s, c, i_0, lo, hi):
    """Without input the activation stays, so what was not sent is not sent either, unless errors add up."""
    for i in range(lo, hi):
        y = s[SIGMA, i] + c[BIAS]
        y = 0.0 if c[RELU] != 0.0 and y < 0.0 else y
        if not stays_silent(s, ACT, i, y, c[VTH], c[CUM]):
            return False
    return True
