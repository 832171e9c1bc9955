"""Synapses that release by chance and keep what reward followed."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from neuro.core.quantities import quantity
from neuro.model.neurons.base import State
from neuro.model.synapses.base import Modulated, Trace


@dataclass(frozen=True, kw_only=True, eq=False)
class hedonistic(Modulated):
    """A pre spike releases transmitter with probability p = 1 / (1 + exp(-q_0 - q - z)); then the weight is sent.

    An available synapse that releases gains 1 - p of eligibility c and is refractory until it recovers, at the rate
    1/tau_r; one that fails loses p. Each pre spike then adds Delta_z to the calcium z. The reward n that a signal sets,
    less its baseline b, moves q along c; the weight stays. So `sim.save` keeps what is learnt, `sim.network` does not.
    A parrot_neuron hears failures, too, as it hears all spikes whatever their weight.
    Source: Seung, Neuron 40:1063, 2003.
    """

    equation: ClassVar[str] = (
        "q' = eta (n - b) c; c' = -c/tau_c + 1 - p (release), - p (failure); z' = -z/tau_z + Delta_z (pre)"
    )
    source: ClassVar[str] = "Seung, Neuron 40:1063, 2003"
    pre: ClassVar[tuple[Trace, ...]] = (Trace(""),)
    post: ClassVar[tuple[Trace, ...]] = ()
    draws: ClassVar[bool] = True
    states: ClassVar[tuple[State, ...]] = (
        State("q", "", "release parameter, as far as it is learnt"),
        State("c", "", "eligibility trace"),
        State("z", "", "calcium"),
        State("released", "", "1 if the last pre spike released, else 0"),
        State("refractory", "", "1 from a release until it recovers", hidden=True),
    )

    q_0: float = quantity(0.0, "", "release parameter without learning")
    eta: float = quantity(0.01, "1/ms", "learning rate")
    b: float = quantity(0.0, "", "baseline of the reward")
    tau_c: float = quantity(20.0, "ms", "time constant of the eligibility", above=0)
    Delta_z: float = quantity(0.0, "", "calcium of a pre spike")
    tau_z: float = quantity(50.0, "ms", "time constant of the calcium", above=0)
    tau_r: float = quantity(10.0, "ms", "mean time to recover from a release", above=0)


Q_0, ETA, B, TAU_C, DELTA_Z, TAU_Z, TAU_R, H = range(8)
WEIGHT, Q, C, Z, RELEASED, REFRACTORY = range(6)


def constants(p, h, c):
    """The parameters and the step."""
    c[:H] = p[:H]
    c[H] = h


def on_post(y, e, c, pre, post):
    """A post spike does nothing."""


def on_pre(y, e, c, pre, post, u):
    """Recover, release or fail by one random number. Recovery has no memory: the time since the last spike says it."""
    p = 0.5 * (1.0 + math.tanh(0.5 * (c[Q_0] + y[Q, e] + y[Z, e])))
    y[Z, e] += c[DELTA_Z]
    y[RELEASED, e] = 0.0
    if y[REFRACTORY, e] == 1.0:
        recovers = -math.expm1(-pre[0] / c[TAU_R])
        if u >= recovers:
            return
        u /= recovers  # uniform again
    if u < p:
        y[C, e] += 1.0 - p
        y[RELEASED, e] = y[REFRACTORY, e] = 1.0
    else:
        y[C, e] -= p
        y[REFRACTORY, e] = 0.0


def sent(y, e, c):
    """The weight, if there was a release."""
    return y[WEIGHT, e] * y[RELEASED, e]


def advance(y, e, c, begin, end, n, grid):
    """Integrate exactly from step `begin` to `end`, in which n is held."""
    passed = (end - begin) * c[H]
    y[Q, e] -= c[ETA] * (n - c[B]) * y[C, e] * c[TAU_C] * math.expm1(-passed / c[TAU_C])
    y[C, e] *= math.exp(-passed / c[TAU_C])
    y[Z, e] *= math.exp(-passed / c[TAU_Z])
