"""STDP gated by dopamine."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call"
from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from neuro.core.errors import ModelError
from neuro.core.quantities import quantity
from neuro.model.neurons.base import State
from neuro.model.synapses.base import Modulated

TABLE = 1024
"""Steps over which the decays of c and n are kept in a table; beyond it they are computed."""


@dataclass(frozen=True, kw_only=True, eq=False)
class stdp_dopa(Modulated):
    """Spike pairs leave an eligibility c; the weight moves while dopamine n differs from its baseline b.

    Dopamine comes either from the spikes of a population (`dopamine`; each adds 1/tau_n to n of every
    post neuron, or of its own with `dopamine_rule` one_to_one) or from a signal (`signal`; sets n).
    Clipping to [Wmin, Wmax] happens at events and on the grid of `deliver_interval` x the smallest delay
    of the network. Source: NEST 3.10, `stdp_dopamine_synapse`; Izhikevich, Cereb. Cortex 17:2443, 2007;
    Potjans, Morrison & Diesmann, Front. Comput. Neurosci. 4:141, 2010.
    """

    equation: ClassVar[str] = "w' = c (n - b); c' = -c/tau_c + A_plus K+ (post) - A_minus K- (pre); n' = -n/tau_n"
    source: ClassVar[str] = "NEST 3.10 stdp_dopamine_synapse; Potjans et al., Front. Comput. Neurosci. 4:141, 2010"
    states: ClassVar[tuple[State, ...]] = (State("c", "", "eligibility trace"),)
    width: ClassVar[int] = 10 + 4 * TABLE

    tau_plus: float = quantity(20.0, "ms", "time constant of K+", above=0)
    A_plus: float = quantity(1.0, "", "eligibility of a pre-post pair")
    A_minus: float = quantity(1.5, "", "eligibility lost by a post-pre pair")
    tau_c: float = quantity(1000.0, "ms", "time constant of the eligibility", above=0)
    tau_n: float = quantity(200.0, "ms", "time constant of dopamine", above=0)
    b: float = quantity(0.0, "1/ms", "dopamine baseline")
    Wmin: float = quantity(0.0, "", "smallest weight, in the unit of the weight", of_value=True)
    Wmax: float = quantity(200.0, "", "largest weight, in the unit of the weight", of_value=True)
    deliver_interval: int = quantity(1, "", "delivery grid in smallest delays", kind="integer", at_least=1)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.measured and self.Wmin > self.Wmax:
            raise ModelError(f"stdp_dopa.Wmin = {self.Wmin:g}: expected at most Wmax = {self.Wmax:g}", path=("Wmin",))


TAU_PLUS, A_PLUS, A_MINUS, TAU_C, TAU_N, B, W_MIN, W_MAX, H, TAU = range(10)
DECAYS = 10


def constants(p, h, c):
    """The parameters, the step, T = tau_c tau_n / (tau_c + tau_n), and the decays over 0, 1, ... steps."""
    c[:8] = p[:8]
    c[H] = h
    c[TAU] = p[TAU_C] * p[TAU_N] / (p[TAU_C] + p[TAU_N])
    for k in range(TABLE):
        at = DECAYS + 4 * k
        c[at], c[at + 1], c[at + 2], c[at + 3] = decays(c, k)


def decays(c, steps):
    """What is left of c and of n after some steps, and what is lost of c and of c n: exact however small."""
    at = -steps * c[H]
    return math.exp(at / c[TAU_C]), math.exp(at / c[TAU_N]), -math.expm1(at / c[TAU_C]), -math.expm1(at / c[TAU])


def on_post(y, e, c, pre, post):
    """A pre-post pair raises the eligibility."""
    y[1, e] += c[A_PLUS] * pre[0]


def on_pre(y, e, c, pre, post):
    """A post-pre pair lowers it."""
    y[1, e] -= c[A_MINUS] * post[0]


def advance(y, e, c, begin, end, n, grid):
    """Integrate w and c exactly from step `begin` to `end`; clip where w turns and at the end.

    w turns where n crosses b. NEST clips at delivery points only, so the cell of the grid that holds the
    crossing is added as a whole.
    """
    at = begin
    b = c[B]
    if b != 0.0 and n / b > 1.0:
        crossing = begin + c[TAU_N] * math.log(n / b) / c[H]
        if crossing < end:
            cell = math.floor(crossing / grid) * grid
            for bound in (cell, cell + grid):
                if at < bound < end:
                    n = drift(y, e, c, int(bound - at), n)
                    at = bound
    drift(y, e, c, int(end - at), n)


def drift(y, e, c, steps, n):
    """Integrate over some steps in which n - b keeps its sign; return n at their end."""
    if steps < TABLE:
        at = DECAYS + 4 * steps
        left_c, left_n, lost_c, lost_both = c[at], c[at + 1], c[at + 2], c[at + 3]
    else:
        left_c, left_n, lost_c, lost_both = decays(c, steps)
    eligibility = y[1, e]
    gain = n * c[TAU] * lost_both - c[B] * c[TAU_C] * lost_c
    y[0, e] = min(c[W_MAX], max(c[W_MIN], y[0, e] + eligibility * gain))
    y[1, e] = eligibility * left_c
    return n * left_n
