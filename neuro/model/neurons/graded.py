"""What neurons that send payloads share: the base of their classes, and the code of differences."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from neuro.core.quantities import Value, quantity
from neuro.model.neurons.base import Neuron, State

PAYLOAD_STATE = State("payload", "", "what the last step sent, 0 where it sent nothing")


@dataclass(frozen=True, kw_only=True, eq=False)
class Graded(Neuron):
    """Base of the neurons whose spikes carry payloads: whole numbers of any sign."""

    graded: ClassVar[bool] = True
    resets_in_step: ClassVar[bool] = True
    takes_current: ClassVar[bool] = False


@dataclass(frozen=True, kw_only=True, eq=False)
class Encoding(Graded):
    """Base of the neurons that send a value when it has changed enough.

    With y the new value and act that of the step before: delta = y - act + residue; what is sent is delta if
    |delta| >= vth, else 0; residue is what was not sent. With `cum_error` the sum of delta since the last message is
    compared in place of delta. States are in units of 2^-(spike_exp + state_exp), so vth stands for
    vth 2^(spike_exp + state_exp) of them, and a message is in units of 2^state_exp, rounded down.
    """

    vth: Value = quantity(0.0, "", "change that is sent", at_least=0, arrays=True)
    spike_exp: int = quantity(0, "", "exponent of messages", kind="integer", at_least=0, at_most=15)
    state_exp: int = quantity(0, "", "exponent of states", kind="integer", at_least=0, at_most=15)
    cum_error: bool = quantity(False, "", "compare the sum of changes with vth", kind="boolean")


def sent_of(delta, error, vth, grain):
    """What of a change is sent, in units of the state, and the payload; `error` is what is compared with vth."""
    out = delta if abs(error) >= vth else 0.0
    return out, math.floor(out / grain)
