"""The current-based leaky integrate-and-fire compartment of Loihi 1, in its own registers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from neuro.core.quantities import Value, quantity
from neuro.model.neurons.base import Neuron, State


@dataclass(frozen=True, kw_only=True, eq=False)
class loihi_lif(Neuron):
    """A compartment of Loihi 1; every parameter is a register.

    Each step, in this order, all in integers and truncated towards 0:
    x <- sum of the arriving weights, 22-bit two's complement;
    u <- u (4096 - (du + 1)) / 4096 + x, 24-bit two's complement;
    v <- v (4096 - dv) / 4096 + (u + bias_mant 2^bias_exp, 24-bit two's complement), clipped to +-(2^23 - 1);
    a spike where v > 64 vth, then v is 0 and stays so for refractory - 1 steps while u goes on.
    A spike emitted in step k over a delay of D steps changes u in step k + D: the delay register holds D - 1.

    Source: Davies et al., IEEE Micro 38(1):82, 2018; Michaelis et al., Front. Neuroinform. 16:1015624, 2022.
    """

    equation: ClassVar[str] = (
        "u' = u (4095 - du)/4096 + sum W; v' = v (4096 - dv)/4096 + u' + bias; spike at v > 64 vth"
    )
    source: ClassVar[str] = "Davies et al., IEEE Micro 38(1):82, 2018; traces of lava, nengo-loihi and Brian2Loihi"
    states: ClassVar[tuple[State, ...]] = (
        State("v", "", "voltage register"),
        State("u", "", "current register"),
    )
    chip: ClassVar[str] = "loihi"

    du: Value = quantity(409, "", "decay of the current", whole=True, at_least=0, at_most=4095, arrays=True)
    dv: Value = quantity(409, "", "decay of the voltage", whole=True, at_least=0, at_most=4095, arrays=True)
    vth: Value = quantity(100, "", "threshold mantissa", whole=True, at_least=0, at_most=131071, arrays=True)
    bias_mant: Value = quantity(0, "", "bias mantissa", whole=True, at_least=-4096, at_most=4095, arrays=True)
    bias_exp: Value = quantity(0, "", "bias exponent", whole=True, at_least=0, at_most=7, arrays=True)
    refractory: Value = quantity(1, "", "refractory period", whole=True, at_least=1, at_most=64, arrays=True)
