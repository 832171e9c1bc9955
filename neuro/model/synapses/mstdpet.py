"""Reward-modulated STDP with an eligibility trace."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from neuro.core.quantities import quantity
from neuro.model.neurons.base import State
from neuro.model.synapses.base import Modulated
from neuro.model.synapses.bounds import within


@dataclass(frozen=True, kw_only=True, eq=False)
class mstdpet(Modulated):
    """Spike pairs leave an eligibility z; the weight moves while the reward n differs from its baseline b.

    A signal sets n, which stays until it is set again: to b after a moment of reward. If it stays long, a pair moves
    the weight by gamma (n - b) A_plus K+ or -gamma (n - b) A_minus K- in all. Integration is exact; the weight is
    within 0 and Wmax at all times. Source: Florian, Neural Comput. 19:1468, 2007 (MSTDPET).
    """

    equation: ClassVar[str] = "w' = gamma (n - b) z; tau_z z' = -z + A_plus K+ (post) - A_minus K- (pre)"
    source: ClassVar[str] = "Florian, Neural Comput. 19:1468, 2007"
    states: ClassVar[tuple[State, ...]] = (State("z", "1/ms", "eligibility trace"),)

    tau_plus: float = quantity(20.0, "ms", "time constant of K+", above=0)
    A_plus: float = quantity(1.0, "", "eligibility of a pre-post pair")
    A_minus: float = quantity(1.0, "", "eligibility lost by a post-pre pair")
    tau_z: float = quantity(25.0, "ms", "time constant of the eligibility", above=0)
    gamma: float = quantity(0.1, "", "learning rate, in the unit of the weight", of_value=True)
    b: float = quantity(0.0, "", "baseline of the reward")
    Wmax: float = quantity(
        100.0, "", "largest weight, in the unit of the weight; below 0 it inhibits", nonzero=True, of_value=True
    )


TAU_PLUS, A_PLUS, A_MINUS, TAU_Z, GAMMA, B, W_MAX, H = range(8)


def constants(p, h, c):
    """The parameters and the step."""
    c[:H] = p[:H]
    c[H] = h


def on_post(y, e, c, pre, post):
    """A pre-post pair raises the eligibility."""
    y[1, e] += c[A_PLUS] * pre[0] / c[TAU_Z]


def on_pre(y, e, c, pre, post):
    """A post-pre pair lowers it."""
    y[1, e] -= c[A_MINUS] * post[0] / c[TAU_Z]


def advance(y, e, c, begin, end, n, grid):
    """Integrate from step `begin` to `end`; n is held, so the weight moves one way and is clipped at the end."""
    z, passed = y[1, e], (end - begin) * c[H] / c[TAU_Z]
    y[0, e] = within(y[0, e] - c[GAMMA] * (n - c[B]) * z * c[TAU_Z] * math.expm1(-passed), c[W_MAX])
    y[1, e] = z * math.exp(-passed)
