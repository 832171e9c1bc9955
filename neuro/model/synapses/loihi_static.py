"""A synapse of Loihi 1 that keeps its weight, in its own registers."""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from neuro.core.quantities import quantity
from neuro.model.synapses.base import Synapse

SIGN_MODES = ("mixed", "excitatory", "inhibitory")


@dataclass(frozen=True, kw_only=True, eq=False)
class loihi_static(Synapse):
    """Adds 64 floor(m 2^weight_exp) to the current register; the weight of the projection is the mantissa m.

    Mixed: m from -256 to 254 in steps of 2; excitatory: 0 to 255; inhibitory: -255 to 0. With fewer weight bits the
    lowest are dropped (towards 0), one more in mixed mode. What is added is clipped to +-(2^21 - 64). The weight that
    is read back, what is added / (64 2^weight_exp), has lost these bits; the mantissa is its register.

    Source: Michaelis et al., Front. Neuroinform. 16:1015624, 2022, which shifts each weight and reports a match with
    the chip.
    """

    equation: ClassVar[str] = "sends 64 floor(m 2^weight_exp)"
    source: ClassVar[str] = "Davies et al., IEEE Micro 38(1):82, 2018; Michaelis et al., Front. Neuroinform. 16, 2022"
    chip: ClassVar[str] = "loihi"

    weight_exp: int = quantity(0, "", "weight exponent", kind="integer", at_least=-8, at_most=7)
    num_weight_bits: int = quantity(8, "", "bits of a weight", kind="integer", at_least=1, at_most=8)
    sign_mode: str = quantity("mixed", "", "which signs the weights have", kind="word", words=SIGN_MODES)
