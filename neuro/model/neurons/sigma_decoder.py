"""A neuron that sends the sum of all that it has received."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from neuro.model.neurons.base import State
from neuro.model.neurons.graded import PAYLOAD_STATE, Graded


@dataclass(frozen=True, kw_only=True, eq=False)
class sigma_decoder(Graded):
    """Sums what arrives, and sends the sum, rounded down, in every step in which it is not 0.

    It turns differences back into values. lava: Sigma. Source: lava 0.10, proc/sdn.
    """

    equation: ClassVar[str] = "sigma' = sigma + sum w p; sends sigma' in every step"
    source: ClassVar[str] = "lava 0.10 Sigma"
    states: ClassVar[tuple[State, ...]] = (State("sigma", "", "sum of all input"), PAYLOAD_STATE)


SIGMA, SENT = range(2)


def constants(p, h, c):
    """There are none."""


def step(s, c, x, i_0, lo, hi, fired):
    """Sum, and send the sum."""
    for i in range(lo, hi):
        s[SIGMA, i] += x[0, i]
        s[SENT, i] = math.floor(s[SIGMA, i])
        fired[i] = s[SENT, i] != 0.0


def fire(s, c, i):
    """Nothing: `step` has sent."""


def quiet(s, c, i_0, lo, hi):
    """A sum whose whole part is 0 is not sent."""
    sent = 0
    for i in range(lo, hi):
        sent += s[SENT, i] != 0.0 or math.floor(s[SIGMA, i]) != 0
    return sent == 0
