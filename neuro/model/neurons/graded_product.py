"""The product of two inputs, without a state."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from neuro.core.quantities import Value, quantity
from neuro.model.neurons.base import State
from neuro.model.neurons.graded import PAYLOAD_STATE, Graded
from neuro.model.neurons.graded_vector import SENT, fire as fire, quiet as quiet


@dataclass(frozen=True, kw_only=True, eq=False)
class graded_product(Graded):
    """Sends the product of the inputs of a step, divided by 2^exp and rounded down, where its magnitude exceeds vth.

    A synapse names the receptor, first or second. On loihi2 the product has 32 bits before it is divided.
    lava: Prod. Source: lava 0.10, proc/prodneuron.
    """

    equation: ClassVar[str] = "a = floor((sum w p of first) (sum w p of second) / 2^exp); sends a at |a| > vth"
    source: ClassVar[str] = "lava 0.10 ProdNeuron"
    states: ClassVar[tuple[State, ...]] = (PAYLOAD_STATE,)
    receptors: ClassVar[int] = 2
    receptor_names: ClassVar[tuple[str, ...]] = ("first", "second")
    signed: ClassVar[bool] = False

    vth: Value = quantity(0.0, "", "product that is not sent", at_least=0, arrays=True)
    exp: int = quantity(0, "", "exponent of the divisor", kind="integer", at_least=0, at_most=31)


VTH, DIVISOR = range(2)


def constants(p, h, c):
    """Fill `c`; `p` is tau_minus, vth, exp."""
    c[VTH], c[DIVISOR] = p[1], 2.0 ** p[2]


def step(s, c, x, i_0, lo, hi, fired):
    """Send the product of what arrives."""
    for i in range(lo, hi):
        a = math.floor(x[0, i] * x[1, i] / c[DIVISOR])
        s[SENT, i] = a if abs(a) > c[VTH] else 0
        fired[i] = s[SENT, i] != 0.0
