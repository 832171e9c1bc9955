"""A threshold without a state: it sends what arrives."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from neuro.core.quantities import Value, quantity
from neuro.model.neurons.base import State
from neuro.model.neurons.graded import PAYLOAD_STATE, Graded


@dataclass(frozen=True, kw_only=True, eq=False)
class graded_vector(Graded):
    """Sends the input of a step, rounded down, where its magnitude exceeds vth; with `relu` where it exceeds vth.

    lava: GradedVec, with `relu` GradedReluVec. Source: lava 0.10, proc/graded.
    """

    equation: ClassVar[str] = "a = sum w p; sends a at |a| > vth"
    source: ClassVar[str] = "lava 0.10 GradedVec, GradedReluVec"
    states: ClassVar[tuple[State, ...]] = (PAYLOAD_STATE,)

    vth: Value = quantity(0.0, "", "input that is not sent", at_least=0, arrays=True)
    relu: bool = quantity(False, "", "send no negative input", kind="boolean")


SENT = 0
VTH, RELU = range(2)


def constants(p, h, c):
    """Fill `c`; `p` is tau_minus, vth, relu."""
    c[VTH], c[RELU] = p[1], p[2]


def step(s, c, x, i_0, lo, hi, fired):
    """Send what arrives."""
    for i in range(lo, hi):
        a = x[0, i]
        size = a if c[RELU] != 0.0 else abs(a)
        s[SENT, i] = math.floor(a) if size > c[VTH] else 0
        fired[i] = s[SENT, i] != 0.0


def fire(s, c, i):
    """Nothing: `step` has sent."""


def quiet(s, c, i_0, lo, hi):
    """Without input nothing is sent."""
    sent = 0
    for i in range(lo, hi):
        sent += s[SENT, i] != 0.0
    return sent == 0
