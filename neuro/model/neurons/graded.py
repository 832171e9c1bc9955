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


def send_change(s, first, i, y, vth, grain, cumulative):
    """Send what of the change to `y` is to be sent, and return the payload.

    From row `first` on, `s` has the value of the last step, the residue, the error and the payload.
    """
    act, residue, error, sent = first, first + 1, first + 2, first + 3
    delta = y - s[act, i] + s[residue, i]
    compared = s[error, i] + delta if cumulative != 0.0 else delta
    out = delta if abs(compared) >= vth else 0.0
    s[error, i] = compared if cumulative != 0.0 and out == 0.0 else 0.0
    s[residue, i] = delta - out
    s[act, i] = y
    s[sent, i] = math.floor(out / grain)
    return s[sent, i]


def stays_silent(s, first, i, y, vth, cumulative):
    """Whether nothing is sent, and no state changes, as long as the value is `y`; `first` as of `send_change`."""
    rest = s[first + 1, i]
    return y == s[first, i] and abs(rest) < vth and (cumulative == 0.0 or rest == 0.0) and s[first + 3, i] == 0.0
