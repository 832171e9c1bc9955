"""Neurons that send payloads with their spikes."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call", check-untyped-defs=False
from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from neuro.core.quantities import Value, quantity
from neuro.model.neurons.base import Neuron, State

PAYLOAD_STATE = State("payload", "", "payload sent in the last step, 0 without a spike")

SENT, ACT, RESIDUE, ERROR, SIGMA = range(5)
SUM = 1
"""Rows of the states. Row 0, SENT, is the payload. SUM belongs to `sigma_decoder`."""

VTH, GRAIN, CUM, BIAS, RELU = range(5)
UNIT = 3
DIVISOR = 1
"""Indices of the constants. Models may use the same index for different constants."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Graded(Neuron):
    """Base of the neurons whose spikes carry payloads, which are whole numbers of any sign."""

    states: ClassVar[tuple[State, ...]] = (PAYLOAD_STATE,)
    graded: ClassVar[bool] = True
    resets_in_step: ClassVar[bool] = True
    takes_current: ClassVar[bool] = False

    def fire(s, c, i):
        """Do nothing, because `step` sends the payload."""

    def quiet(s, c, i_0, lo, hi):
        """Return whether no payload is sent. Without input, neurons of this class send nothing."""
        n_sending = 0
        for i in range(lo, hi):
            n_sending += s[SENT, i] != 0.0
        return n_sending == 0


@dataclass(frozen=True, kw_only=True, eq=False)
class Encoding(Graded):
    """Base of the neurons that send a value only after it has changed by a threshold.

    With the new value y and the value `act` of the last step, delta = y - act + residue. The neuron sends delta if
    |delta| >= vth, and 0 otherwise. The residue is the part of delta that was not sent. With `cum_error` the sum of
    delta since the last message is compared with vth, instead of delta. States are integers on a chip: a value v is
    stored as v 2^(spike_exp + state_exp), and vth is scaled in the same way. The payload is delta / 2^state_exp,
    rounded down.
    """

    states: ClassVar[tuple[State, ...]] = (
        PAYLOAD_STATE,
        State("act", "", "input or activation of the last step"),
        State("residue", "", "change that was not sent"),
        State("error", "", "sum of changes since the last message, with cum_error"),
    )

    vth: Value = quantity(0.0, "", "smallest change that is sent", at_least=0, arrays=True)
    spike_exp: int = quantity(0, "", "exponent of messages", kind="integer", at_least=0, at_most=15)
    state_exp: int = quantity(0, "", "exponent of states", kind="integer", at_least=0, at_most=15)
    cum_error: bool = quantity(False, "", "compare the sum of changes with vth", kind="boolean")


def send_change(s, i, y, vth, grain, cumulative):
    """Send the change of the value to `y` if the change reaches `vth`. Return the payload, in units of `grain`."""
    delta = y - s[ACT, i] + s[RESIDUE, i]
    compared = s[ERROR, i] + delta if cumulative != 0.0 else delta
    out = delta if abs(compared) >= vth else 0.0
    s[ERROR, i] = compared if cumulative != 0.0 and out == 0.0 else 0.0
    s[RESIDUE, i] = delta - out
    s[ACT, i] = y
    s[SENT, i] = math.floor(out / grain)
    return s[SENT, i]


def stays_silent(s, i, y, vth, cumulative):
    """Return whether neuron i sends nothing and keeps its state while the value is `y`."""
    residue = s[RESIDUE, i]
    return y == s[ACT, i] and abs(residue) < vth and (cumulative == 0.0 or residue == 0.0) and s[SENT, i] == 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class graded_vector(Graded):
    """Neuron that sends the input of a step, rounded down, if its magnitude exceeds vth.

    With `relu` the input itself must exceed vth.

    In lava: GradedVec, and with `relu` GradedReluVec. Source: lava 0.10, proc/graded.
    """

    equation: ClassVar[str] = "a = sum w p; sends a at |a| > vth"
    source: ClassVar[str] = "lava 0.10 GradedVec, GradedReluVec"

    vth: Value = quantity(0.0, "", "largest input that is not sent", at_least=0, arrays=True)
    relu: bool = quantity(False, "", "whether negative input is not sent", kind="boolean")

    def constants(p, h, c):
        """Fill `c`; `p` is tau_minus, vth, relu."""
        c[VTH], c[RELU] = p[1], p[2]

    def step(s, c, x, i_0, lo, hi, fired):
        """Send the input."""
        for i in range(lo, hi):
            a = x[0, i]
            size = a if c[RELU] != 0.0 else abs(a)
            s[SENT, i] = math.floor(a) if size > c[VTH] else 0
            fired[i] = s[SENT, i] != 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class graded_product(Graded):
    """Neuron that sends the product of two inputs if its magnitude exceeds vth.

    The product is divided by 2^exp and rounded down. A synapse names the receptor, first or second. On loihi2 the
    product has 32 bits before the division. In lava: Prod. Source: lava 0.10, proc/prodneuron.
    """

    equation: ClassVar[str] = "a = floor((sum w p of first) (sum w p of second) / 2^exp); sends a at |a| > vth"
    source: ClassVar[str] = "lava 0.10 ProdNeuron"
    receptors: ClassVar[int] = 2
    receptor_names: ClassVar[tuple[str, ...]] = ("first", "second")
    signed: ClassVar[bool] = False

    vth: Value = quantity(0.0, "", "largest product that is not sent", at_least=0, arrays=True)
    exp: int = quantity(0, "", "exponent of the divisor", kind="integer", at_least=0, at_most=31)

    def constants(p, h, c):
        """Fill `c`; `p` is tau_minus, vth, exp."""
        c[VTH], c[DIVISOR] = p[1], 2.0 ** p[2]

    def step(s, c, x, i_0, lo, hi, fired):
        """Send the product of the inputs."""
        for i in range(lo, hi):
            a = math.floor(x[0, i] * x[1, i] / c[DIVISOR])
            s[SENT, i] = a if abs(a) > c[VTH] else 0
            fired[i] = s[SENT, i] != 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class delta_encoder(Encoding):
    """Neuron that sends the change of the input when the input has changed by vth since the last step.

    The value y is the input of a step times 2^(spike_exp + state_exp). A constant value must therefore arrive in every
    step. In lava: Delta. Source: lava 0.10, proc/sdn.
    """

    equation: ClassVar[str] = (
        "y = 2^(spike_exp + state_exp) sum w p; delta = y - act + residue; sends delta at |delta| >= vth"
    )
    source: ClassVar[str] = "lava 0.10 Delta"

    def constants(p, h, c):
        """Fill `c`; `p` is tau_minus, vth, spike_exp, state_exp, cum_error."""
        unit = 2.0 ** (p[2] + p[3])
        c[VTH], c[GRAIN], c[CUM], c[UNIT] = p[1] * unit, 2.0 ** p[3], p[4], unit

    def step(s, c, x, i_0, lo, hi, fired):
        """Send the change of the input."""
        vth, grain, cumulative, unit = c[VTH], c[GRAIN], c[CUM], c[UNIT]
        for i in range(lo, hi):
            y = x[0, i] * unit
            fired[i] = send_change(s, i, y, vth, grain, cumulative) != 0.0

    def quiet(s, c, i_0, lo, hi):
        """Return whether the neurons are silent. Without input the value remains 0."""
        for i in range(lo, hi):
            silent = stays_silent(s, i, 0.0, c[VTH], c[CUM])
            if not silent:
                return False
        return True


@dataclass(frozen=True, kw_only=True, eq=False)
class sigma_delta(Encoding):
    """Sigma-delta neuron: a sum of all input, whose change is sent as soon as the change reaches vth.

    sigma is the sum of all input, so messages only need to carry differences. With `relu` y = max(sigma + bias, 0),
    otherwise y = sigma + bias. `vth` and `bias` are in units of 2^(spike_exp + state_exp). In lava: SigmaDelta, with
    act_mode RELU for `relu: true` and UNIT for `relu: false`. Source: lava 0.10, proc/sdn.
    """

    equation: ClassVar[str] = (
        "sigma' = sigma + sum w p; y = max(sigma' + bias, 0); delta = y - act + residue; sends delta at |delta| >= vth"
    )
    source: ClassVar[str] = "lava 0.10 SigmaDelta; O'Connor & Welling, arXiv:1611.02024, 2016"
    states: ClassVar[tuple[State, ...]] = (*Encoding.states, State("sigma", "", "sum of all input"))

    bias: Value = quantity(0.0, "", "constant added to the sum", arrays=True)
    relu: bool = quantity(True, "", "whether a negative sum is replaced by 0", kind="boolean")

    def constants(p, h, c):
        """Fill `c`; `p` is tau_minus, vth, spike_exp, state_exp, cum_error, bias, relu."""
        unit = 2.0 ** (p[2] + p[3])
        c[VTH], c[GRAIN], c[CUM], c[BIAS], c[RELU] = p[1] * unit, 2.0 ** p[3], p[4], p[5] * unit, p[6]

    def step(s, c, x, i_0, lo, hi, fired):
        """Add the input, compute the activation, and send its change."""
        vth, grain, cumulative, bias, relu = c[VTH], c[GRAIN], c[CUM], c[BIAS], c[RELU]
        for i in range(lo, hi):
            s[SIGMA, i] += x[0, i]
            y = s[SIGMA, i] + bias
            if relu != 0.0 and y < 0.0:
                y = 0.0
            fired[i] = send_change(s, i, y, vth, grain, cumulative) != 0.0

    def quiet(s, c, i_0, lo, hi):
        """Return whether the neurons are silent.

        Without input the activation is constant, so only changes that were not sent may add up.
        """
        for i in range(lo, hi):
            y = s[SIGMA, i] + c[BIAS]
            y = 0.0 if c[RELU] != 0.0 and y < 0.0 else y
            if not stays_silent(s, i, y, c[VTH], c[CUM]):
                return False
        return True


@dataclass(frozen=True, kw_only=True, eq=False)
class sigma_decoder(Graded):
    """Neuron that sums its input, and sends the sum, rounded down, in every step with a sum other than 0.

    This neuron converts differences back to values. In lava: Sigma. Source: lava 0.10, proc/sdn.
    """

    equation: ClassVar[str] = "sigma' = sigma + sum w p; sends sigma' in every step"
    source: ClassVar[str] = "lava 0.10 Sigma"
    states: ClassVar[tuple[State, ...]] = (PAYLOAD_STATE, State("sigma", "", "sum of all input"))

    def constants(p, h, c):
        """Do nothing, because the model has no constants."""

    def step(s, c, x, i_0, lo, hi, fired):
        """Add the input and send the sum."""
        for i in range(lo, hi):
            s[SUM, i] += x[0, i]
            s[SENT, i] = math.floor(s[SUM, i])
            fired[i] = s[SENT, i] != 0.0

    def quiet(s, c, i_0, lo, hi):
        """Return whether nothing is sent. A sum between 0 and 1 is not sent."""
        n_sending = 0
        for i in range(lo, hi):
            n_sending += s[SENT, i] != 0.0 or math.floor(s[SUM, i]) != 0
        return n_sending == 0
