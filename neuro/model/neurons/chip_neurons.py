"""Neurons whose parameters are registers of a chip. Their integer arithmetic is in the backend of the chip."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from neuro.core.errors import ModelError, here
from neuro.core.quantities import Value, quantity
from neuro.model.neurons.base import Neuron, State

LARGEST = 2**31 - 1
FRACTION = 2**32 - 1
"""The largest signed register, and the largest unsigned one, of 32 bits."""


def register(default: int, doc: str, low: int = -LARGEST, high: int = LARGEST) -> Any:
    """Return a parameter for a register: a whole number from `low` to `high`, for all neurons or per neuron."""
    return quantity(default, "", doc, whole=True, at_least=low, at_most=high, arrays=True)


@dataclass(frozen=True, kw_only=True, eq=False)
class loihi_lif(Neuron):
    """Compartment of Loihi 1. Every parameter is a register.

    Each step computes, in this order, in integers and truncated towards 0:
    x <- sum of the incoming weights, 22-bit two's complement;
    u <- u (4096 - (du + 1)) / 4096 + x, 24-bit two's complement;
    v <- v (4096 - dv) / 4096 + (u + bias_mant 2^bias_exp, 24-bit two's complement), clipped to +-(2^23 - 1).
    At v > 64 vth the neuron spikes. Then v is 0 for refractory - 1 steps, in which u still changes.
    A spike emitted in step k with a delay of D steps changes u in step k + D: the delay register holds D - 1.

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

    du: Value = register(409, "decay of the current", 0, 4095)
    dv: Value = register(409, "decay of the voltage", 0, 4095)
    vth: Value = register(100, "threshold mantissa", 0, 131071)
    bias_mant: Value = register(0, "bias mantissa", -4096, 4095)
    bias_exp: Value = register(0, "bias exponent", 0, 7)
    refractory: Value = register(1, "refractory period", 1, 64)


@dataclass(frozen=True, kw_only=True, eq=False)
class Loihi2Neuron(Neuron):
    """Base of the neurons of Loihi 2 with a current and a voltage. Every parameter is a register.

    Each step computes, in this order, in integers, with t(y) = y / 4096 truncated towards 0:
    u = v = 0 in steps k, counted from 1, for which `reset_interval` is not 0 and divides k - reset_offset;
    u <- t(u (4095 - du)) + 64 a, where a is the input; u wraps at 24 bits to the range -2^23 + 1 to 2^23;
    v <- t(v (4096 - dv)) + u + bias_mant 2^bias_exp, clipped to +-(2^23 - 1).
    """

    source: ClassVar[str] = "lava 0.10 LIF, TernaryLIF, LIFReset, fixed point"
    states: ClassVar[tuple[State, ...]] = (
        State("v", "", "voltage register"),
        State("u", "", "current register"),
    )
    chip: ClassVar[str] = "loihi2"

    du: Value = register(409, "decay of the current", -1, 4095)
    dv: Value = register(409, "decay of the voltage", 0, 4096)
    bias_mant: Value = register(0, "bias mantissa", -4096, 4095)
    bias_exp: Value = register(0, "bias exponent", 0, 7)
    reset_interval: int = quantity(0, "", "steps between resets; 0: no resets", kind="integer", at_least=0)
    reset_offset: int = quantity(0, "", "first step with a reset", kind="integer", at_least=0)


@dataclass(frozen=True, kw_only=True, eq=False)
class loihi2_lif(Loihi2Neuron):
    """Leaky integrate-and-fire neuron of Loihi 2. In lava: LIF, and with `reset_interval` LIFReset.

    At v > 64 vth the neuron spikes and v is set to 0. The input is explained in `loihi2_static`. A spike emitted in
    step k with a delay of D steps changes u in step k + D: the delay register holds D - 1.
    """

    equation: ClassVar[str] = (
        "u' = u (4095 - du)/4096 + 64 a; v' = v (4096 - dv)/4096 + u' + bias; spike at v' > 64 vth"
    )

    vth: Value = register(100, "threshold mantissa", 0, 131071)


@dataclass(frozen=True, kw_only=True, eq=False)
class loihi2_ternary_lif(Loihi2Neuron):
    """Leaky integrate-and-fire neuron of Loihi 2 with two thresholds. In lava: TernaryLIF.

    The neuron sends the payload 1 at v > 64 vth_hi and -1 at v < 64 vth_lo. Then v is set to 0.
    """

    equation: ClassVar[str] = (
        "u' = u (4095 - du)/4096 + 64 a; v' = v (4096 - dv)/4096 + u' + bias; sends 1 at v' > 64 vth_hi, "
        "-1 at v' < 64 vth_lo"
    )
    graded: ClassVar[bool] = True

    vth_hi: Value = register(100, "upper threshold mantissa", -131071, 131071)
    vth_lo: Value = register(-100, "lower threshold mantissa", -131071, 131071)

    def __post_init__(self) -> None:
        super().__post_init__()
        low, high = self.vth_lo, self.vth_hi
        if isinstance(low, (int, float)) and isinstance(high, (int, float)) and low > high:
            message = f"{self.name}: vth_lo = {low:g} above vth_hi = {high:g}"
            raise ModelError(f"{message}: expected at most vth_hi", path=("vth_lo",), where=here())


@dataclass(frozen=True, kw_only=True, eq=False)
class Loihi2Resonator(Neuron):
    """Base of the resonators of Loihi 2, whose state is a complex number that rotates and decays.

    Every parameter is a register.

    Each step computes in integers, with t(y) = y / 4096 truncated towards 0, and with a_real and a_imag, the inputs of
    the two receptors:
    real <- t(cos_decay real) - t(sin_decay imag) + a_real 2^state_exp, and
    imag <- t(sin_decay real) + t(cos_decay imag) + a_imag 2^state_exp, both clipped to +-(2^23 - 1).
    """

    states: ClassVar[tuple[State, ...]] = (State("real", "", "real register"), State("imag", "", "imaginary register"))
    receptors: ClassVar[int] = 2
    receptor_names: ClassVar[tuple[str, ...]] = ("real", "imag")
    signed: ClassVar[bool] = False
    resets_in_step: ClassVar[bool] = True
    chip: ClassVar[str] = "loihi2"

    cos_decay: Value = register(3900, "decay times cosine", -4096, 4096)
    sin_decay: Value = register(1000, "decay times sine", -4096, 4096)
    vth: Value = quantity(100, "", "threshold, times 2^state_exp", at_least=0, at_most=131071, arrays=True)
    state_exp: int = quantity(6, "", "exponent of the states", kind="integer", at_least=0, at_most=7)


@dataclass(frozen=True, kw_only=True, eq=False)
class loihi2_rf(Loihi2Resonator):
    """Resonator without reset that fires when its phase passes 0 with a real part of at least vth. In lava: RF.

    Synapses (`static`) name the receptor, real or imag.
    """

    equation: ClassVar[str] = "z' = decay e^(i phase) z + 2^state_exp a; spike at real' >= vth, imag' >= 0 > imag"
    source: ClassVar[str] = "lava 0.10 RF, fixed point; Izhikevich, Neural Netw. 14:883, 2001"


@dataclass(frozen=True, kw_only=True, eq=False)
class loihi2_rf_iz(Loihi2Resonator):
    """Resonator that fires at imag >= vth. Then real becomes 0, and imag becomes the threshold minus 1. In lava: RF_IZ.

    Synapses (`static`) name the receptor, real or imag.
    """

    equation: ClassVar[str] = "z' = decay e^(i phase) z + 2^state_exp a; spike at imag' >= vth, then z = i (vth - 1)"
    source: ClassVar[str] = "lava 0.10 RF_IZ, fixed point; Izhikevich, Neural Netw. 14:883, 2001"


@dataclass(frozen=True, kw_only=True, eq=False)
class spinnaker_lif(Neuron):
    """Leaky integrate-and-fire neuron of SpiNNaker. Every parameter is a register.

    Values are s16.15 (value x 32768), decays are unsigned 0.32. Each tick computes:
    g <- g decay + (slot << shift) init per receptor, where slot is its input in the ring buffer, at most 65535;
    alpha = (g_exc - g_inh + i_offset) r_m + v_rest; v <- alpha - exp_tc (alpha - v), outside refractoriness only.
    At v >= v_thresh the neuron spikes, and v is v_reset for t_refract ticks.
    A weight is a 16-bit word of the ring buffer. Negative weights go to the inhibitory receptor. A spike emitted in
    tick t with a delay of d ticks is added to the slot of tick t + d.

    Source: the sources of sPyNNaker and spinn_common (Rhodes et al., Front. Neurosci. 12:816, 2018).
    """

    equation: ClassVar[str] = "v' = alpha - exp_tc (alpha - v), alpha = (g_exc - g_inh + i_offset) r_m + v_rest"
    source: ClassVar[str] = "sPyNNaker, neuron core; Rhodes et al., Front. Neurosci. 12:816, 2018"
    states: ClassVar[tuple[State, ...]] = (
        State("v", "", "voltage register, s16.15 mV"),
        State("g_exc", "", "excitatory input of the tick, s16.15 nA"),
        State("g_inh", "", "inhibitory input of the tick, s16.15 nA"),
    )
    receptors: ClassVar[int] = 2
    chip: ClassVar[str] = "spinnaker"

    v_rest: Value = register(-2129920, "resting potential")
    v_reset: Value = register(-2129920, "potential after a spike")
    v_thresh: Value = register(-1638400, "threshold")
    v_init: Value = register(-2129920, "v at tick 0")
    i_offset: Value = register(0, "constant current")
    r_m: Value = register(655360, "membrane resistance", 0, LARGEST)
    exp_tc: Value = register(31170, "decay of v per tick", 0, 32768)
    t_refract: Value = register(2, "refractory ticks", 0, LARGEST)
    exc_decay: Value = register(3516421808, "decay of g_exc per tick", 0, FRACTION)
    exc_init: Value = register(3892727436, "factor on excitatory input", 0, FRACTION)
    inh_decay: Value = register(3516421808, "decay of g_inh per tick", 0, FRACTION)
    inh_init: Value = register(3892727436, "factor on inhibitory input", 0, FRACTION)
    exc_shift: int = quantity(3, "", "left shift of excitatory slots", kind="integer", at_least=0, at_most=15)
    inh_shift: int = quantity(3, "", "left shift of inhibitory slots", kind="integer", at_least=0, at_most=15)

    @staticmethod
    def initial(parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Return v = v_init."""
        return {"v": parameters["v_init"]}
