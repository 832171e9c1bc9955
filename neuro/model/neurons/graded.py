"""Neurons whose spikes carry payloads."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call", check-untyped-defs=False
from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from neuro.core.quantities import Value, quantity
from neuro.model.neurons.base import Neuron, State

PAYLOAD_STATE = State("payload", "", "what the last step sent, 0 where it sent nothing")

SENT, ACT, RESIDUE, ERROR, SIGMA = range(5)
SUM = 1
"""Rows of the states; the payload is the first."""

VTH, GRAIN, CUM, BIAS, RELU = range(5)
UNIT = 3
DIVISOR = 1
"""Constants; those of a line may stand for another of another model."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Graded(Neuron):
    """Base of the neurons whose spikes carry payloads: whole numbers of any sign."""

    states: ClassVar[tuple[State, ...]] = (PAYLOAD_STATE,)
    graded: ClassVar[bool] = True
    resets_in_step: ClassVar[bool] = True
    takes_current: ClassVar[bool] = False

    def fire(s, c, i):
        """Nothing is left to do: `step` has sent."""

    def quiet(s, c, i_0, lo, hi):
        """Without a state and input nothing is sent."""
        sent = 0
        for i in range(lo, hi):
            sent += s[SENT, i] != 0.0
        return sent == 0


@dataclass(frozen=True, kw_only=True, eq=False)
class Encoding(Graded):
    """Base of the neurons that send a value when it has changed enough.

    With y the new value and act that of the step before: delta = y - act + residue; what is sent is delta if
    |delta| >= vth, else 0; residue is what was not sent. With `cum_error` the sum of delta since the last message is
    compared in place of delta. States are in units of 2^-(spike_exp + state_exp), so vth stands for
    vth 2^(spike_exp + state_exp) of them, and a message is in units of 2^state_exp, rounded down.
    """

    states: ClassVar[tuple[State, ...]] = (
        PAYLOAD_STATE,
        State("act", "", "value of the last step: the input, or the activation"),
        State("residue", "", "change that was not sent"),
        State("error", "", "sum of changes since the last message, with cum_error"),
    )

    vth: Value = quantity(0.0, "", "change that is sent", at_least=0, arrays=True)
    spike_exp: int = quantity(0, "", "exponent of messages", kind="integer", at_least=0, at_most=15)
    state_exp: int = quantity(0, "", "exponent of states", kind="integer", at_least=0, at_most=15)
    cum_error: bool = quantity(False, "", "compare the sum of changes with vth", kind="boolean")


def send_change(s, i, y, vth, grain, cumulative):
    """Send what of the change to `y` is to be sent, and return the payload."""
    delta = y - s[ACT, i] + s[RESIDUE, i]
    compared = s[ERROR, i] + delta if cumulative != 0.0 else delta
    out = delta if abs(compared) >= vth else 0.0
    s[ERROR, i] = compared if cumulative != 0.0 and out == 0.0 else 0.0
    s[RESIDUE, i] = delta - out
    s[ACT, i] = y
    s[SENT, i] = math.floor(out / grain)
    return s[SENT, i]


def stays_silent(s, i, y, vth, cumulative):
    """Return whether nothing is sent, and no state changes, as long as the value is `y`."""
    rest = s[RESIDUE, i]
    return y == s[ACT, i] and abs(rest) < vth and (cumulative == 0.0 or rest == 0.0) and s[SENT, i] == 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class graded_vector(Graded):
    """Sends the input of a step, rounded down, where its magnitude exceeds vth; with `relu` where it exceeds vth.

    lava: GradedVec, with `relu` GradedReluVec. Source: lava 0.10, proc/graded.
    """

    equation: ClassVar[str] = "a = sum w p; sends a at |a| > vth"
    source: ClassVar[str] = "lava 0.10 GradedVec, GradedReluVec"

    vth: Value = quantity(0.0, "", "input that is not sent", at_least=0, arrays=True)
    relu: bool = quantity(False, "", "send no negative input", kind="boolean")

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


@dataclass(frozen=True, kw_only=True, eq=False)
class graded_product(Graded):
    """Sends the product of the inputs of a step, divided by 2^exp and rounded down, where its magnitude exceeds vth.

    A synapse names the receptor, first or second. On loihi2 the product has 32 bits before it is divided.
    lava: Prod. Source: lava 0.10, proc/prodneuron.
    """

    equation: ClassVar[str] = "a = floor((sum w p of first) (sum w p of second) / 2^exp); sends a at |a| > vth"
    source: ClassVar[str] = "lava 0.10 ProdNeuron"
    receptors: ClassVar[int] = 2
    receptor_names: ClassVar[tuple[str, ...]] = ("first", "second")
    signed: ClassVar[bool] = False

    vth: Value = quantity(0.0, "", "product that is not sent", at_least=0, arrays=True)
    exp: int = quantity(0, "", "exponent of the divisor", kind="integer", at_least=0, at_most=31)

    def constants(p, h, c):
        """Fill `c`; `p` is tau_minus, vth, exp."""
        c[VTH], c[DIVISOR] = p[1], 2.0 ** p[2]

    def step(s, c, x, i_0, lo, hi, fired):
        """Send the product of what arrives."""
        for i in range(lo, hi):
            a = math.floor(x[0, i] * x[1, i] / c[DIVISOR])
            s[SENT, i] = a if abs(a) > c[VTH] else 0
            fired[i] = s[SENT, i] != 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class delta_encoder(Encoding):
    """Sends a message when the input of a step differs by vth from that of the step before.

    y is what arrives in a step, times 2^(spike_exp + state_exp): input that stays must arrive in every step. lava:
    Delta. Source: lava 0.10, proc/sdn.
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
        """Without input the value is 0, and stays so."""
        for i in range(lo, hi):
            silent = stays_silent(s, i, 0.0, c[VTH], c[CUM])
            if not silent:
                return False
        return True


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
    states: ClassVar[tuple[State, ...]] = (*Encoding.states, State("sigma", "", "sum of all input"))

    bias: Value = quantity(0.0, "", "added to the sum", arrays=True)
    relu: bool = quantity(True, "", "activation: the sum where it is above 0, else the sum", kind="boolean")

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
            fired[i] = send_change(s, i, y, vth, grain, cumulative) != 0.0

    def quiet(s, c, i_0, lo, hi):
        """Without input the activation stays, so what was not sent is not sent either, unless errors add up."""
        for i in range(lo, hi):
            y = s[SIGMA, i] + c[BIAS]
            y = 0.0 if c[RELU] != 0.0 and y < 0.0 else y
            if not stays_silent(s, i, y, c[VTH], c[CUM]):
                return False
        return True


@dataclass(frozen=True, kw_only=True, eq=False)
class sigma_decoder(Graded):
    """Sums what arrives, and sends the sum, rounded down, in every step in which it is not 0.

    It turns differences back into values. lava: Sigma. Source: lava 0.10, proc/sdn.
    """

    equation: ClassVar[str] = "sigma' = sigma + sum w p; sends sigma' in every step"
    source: ClassVar[str] = "lava 0.10 Sigma"
    states: ClassVar[tuple[State, ...]] = (PAYLOAD_STATE, State("sigma", "", "sum of all input"))

    def constants(p, h, c):
        """There are none."""

    def step(s, c, x, i_0, lo, hi, fired):
        """Sum, and send the sum."""
        for i in range(lo, hi):
            s[SUM, i] += x[0, i]
            s[SENT, i] = math.floor(s[SUM, i])
            fired[i] = s[SENT, i] != 0.0

    def quiet(s, c, i_0, lo, hi):
        """A sum whose whole part is 0 is not sent."""
        sent = 0
        for i in range(lo, hi):
            sent += s[SENT, i] != 0.0 or math.floor(s[SUM, i]) != 0
        return sent == 0
