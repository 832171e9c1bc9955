"""A neuron that sends the changes of its input."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from neuro.model.neurons.base import State
from neuro.model.neurons.graded import PAYLOAD_STATE, Encoding, send_change, stays_silent


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
    states: ClassVar[tuple[State, ...]] = (
        State("act", "", "input of the last step"),
        State("residue", "", "change that was not sent"),
        State("error", "", "sum of changes since the last message, with cum_error"),
        PAYLOAD_STATE,
    )


ACT = 0
VTH, GRAIN, CUM, UNIT = range(4)


def constants(p, h, c):
    """Fill `c`; `p` is tau_minus, vth, spike_exp, state_exp, cum_error."""
    unit = 2.0 ** (p[2] + p[3])
    c[VTH], c[GRAIN], c[CUM], c[UNIT] = p[1] * unit, 2.0 ** p[3], p[4], unit


def step(s, c, x, i_0, lo, hi, fired):
    """Send the change of the input."""
    vth, grain, cumulative, unit = c[VTH], c[GRAIN], c[CUM], c[UNIT]
    for i in range(lo, hi):
        y = x[0, i] * unit
        fired[i] = send_change(s, ACT, i, y, vth, grain, cumulative) != 0.0


def fire(s, c, i):
    """Nothing: `step` has sent."""


def quiet(s, c, i_0, lo, hi):
    """Without input the value is 0, and stays so."""
    for i in range(lo, hi):
        silent = stays_silent(s, ACT, i, 0.0, c[VTH], c[CUM])
        if not silent:
            return False
    return True
