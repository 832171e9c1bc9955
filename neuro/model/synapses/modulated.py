"""Rules of spike pairs or of transmitter release whose eligibility traces are modulated by dopamine or reward."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call", check-untyped-defs=False
from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from neuro.core.errors import ModelError
from neuro.core.quantities import quantity
from neuro.model.neurons.base import State
from neuro.model.synapses.base import Modulated, Trace
from neuro.model.synapses.pairs import within

TABLE = 1024
"""Number of steps for which the decays of c and n are tabulated. The decay over more steps is computed each time."""
TAU_PLUS, A_PLUS, A_MINUS, TAU_C, TAU_N, B, W_MIN, W_MAX, H, TAU, C_MIN = range(11)
GAMMA, TAU_Z, SOFT = 3, 4, 10
Q_0, ETA, DELTA_Z, TAU_R = 1, 2, 6, 7
"""Indices of the constants.

The first line belongs to `stdp_dopa`, the second to `mstdpet`, the third to `hedonistic`.
"""

DECAYS = 11
"""Index of the first constant of the table, which has four numbers for each number of steps, see `decays`."""


def decays(c, steps):
    """Return the shares of c and n that remain after some steps, and the shares of c and of c n that are lost.

    The lost shares are accurate even if they are near 0.
    """
    minus_time = -steps * c[H]
    return (
        math.exp(minus_time / c[TAU_C]),
        math.exp(minus_time / c[TAU_N]),
        -math.expm1(minus_time / c[TAU_C]),
        -math.expm1(minus_time / c[TAU]),
    )


def drift(y, e, c, steps, n):
    """Integrate over some steps in which the sign of n - b does not change. Return n at the end."""
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


@dataclass(frozen=True, kw_only=True, eq=False)
class stdp_dopa(Modulated):
    """STDP with an eligibility trace c. The weight changes while dopamine n differs from its baseline b.

    Dopamine comes either from the spikes of a population (`dopamine`) or from a signal that sets n (`signal`). With
    `dopamine` each spike adds 1/tau_n to n of every post neuron, or of the neuron with the same index with
    `dopamine_rule` one_to_one. Weights are clipped to [Wmin, Wmax] at events and on the grid of `deliver_interval` x
    the smallest delay of the network. With c_min = 0 the eligibility has one sign, as on SpiNNaker. Both signs of c
    change the weight, as in eqs 107 to 109 of Mosca, MSc thesis, 2020. The text of the thesis requires c > 0; c_min = 0
    is the nearest setting.
    Source: NEST 3.10, `stdp_dopamine_synapse`; Izhikevich, Cereb. Cortex 17:2443, 2007; Potjans, Morrison & Diesmann,
    Front. Comput. Neurosci. 4:141, 2010.
    """

    equation: ClassVar[str] = "w' = c (n - b); c' = -c/tau_c + A_plus K+ (post) - A_minus K- (pre); n' = -n/tau_n"
    source: ClassVar[str] = "NEST 3.10 stdp_dopamine_synapse; Potjans et al., Front. Comput. Neurosci. 4:141, 2010"
    states: ClassVar[tuple[State, ...]] = (State("c", "", "eligibility trace"),)
    width: ClassVar[int] = DECAYS + 4 * TABLE

    tau_plus: float = quantity(20.0, "ms", "time constant of K+", above=0)
    A_plus: float = quantity(1.0, "", "increase of the eligibility by a pre-post pair")
    A_minus: float = quantity(1.5, "", "decrease of the eligibility by a post-pre pair")
    tau_c: float = quantity(1000.0, "ms", "time constant of the eligibility", above=0)
    tau_n: float = quantity(200.0, "ms", "time constant of dopamine", above=0)
    b: float = quantity(0.0, "1/ms", "dopamine baseline")
    Wmin: float = quantity(0.0, "", "smallest weight, in the unit of the weight", of_value=True)
    Wmax: float = quantity(200.0, "", "largest weight, in the unit of the weight", of_value=True)
    deliver_interval: int = quantity(
        1, "", "interval of the delivery grid, in smallest delays", kind="integer", at_least=1
    )
    c_min: float = quantity(-math.inf, "", "lower bound of the eligibility", at_most=0, infinite=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.measured and self.Wmin > self.Wmax:
            raise ModelError(f"stdp_dopa.Wmin = {self.Wmin:g}: expected at most Wmax = {self.Wmax:g}", path=("Wmin",))

    def constants(p, h, c):
        """Fill `c` with the parameters, the step, T = tau_c tau_n / (tau_c + tau_n), and the decays over 0, 1, ...

        steps.
        """
        c[:8] = p[:8]
        c[H], c[C_MIN] = h, p[9]
        c[TAU] = p[TAU_C] * p[TAU_N] / (p[TAU_C] + p[TAU_N])
        for k in range(TABLE):
            at = DECAYS + 4 * k
            c[at], c[at + 1], c[at + 2], c[at + 3] = decays(c, k)

    def on_post(y, e, c, pre, post):
        """Increase the eligibility by a pre-post pair."""
        y[1, e] = max(y[1, e] + c[A_PLUS] * pre[0], c[C_MIN])

    def on_pre(y, e, c, pre, post):
        """Decrease the eligibility by a post-pre pair, down to c_min."""
        y[1, e] = max(y[1, e] - c[A_MINUS] * post[0], c[C_MIN])

    def advance(y, e, c, begin, end, n, grid):
        """Integrate w and c exactly from step `begin` to `end`, with clipping at the turning point of w and at the end.

        w turns when n crosses b. NEST clips at points of the delivery grid only, so the interval of the grid that
        contains the crossing is integrated as a whole.
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


def softly_changed(w, change, w_max):
    """Return the solution of w' = s (1 - s) u with s = w / w_max, where `change` is the integral of u.

    The change is added to logit(s) = log(s / (1 - s)). A weight at a bound does not change.
    """
    s, total = w / w_max, change / w_max
    if s <= 0.0 or s >= 1.0:
        return within(w, w_max)
    decay = math.exp(-abs(total))
    return w_max * s / (s + (1.0 - s) * decay) if total > 0.0 else w_max * s * decay / (1.0 - s + s * decay)


@dataclass(frozen=True, kw_only=True, eq=False)
class mstdpet(Modulated):
    """STDP with an eligibility trace z. The weight changes while the reward n differs from its baseline b.

    A signal sets n, which is constant until it is set again, e.g. to b after a momentary reward. If n is constant for
    long, a pair changes the weight in total by gamma (n - b) A_plus K+ or -gamma (n - b) A_minus K-. Integration is
    exact, and the weight is always within 0 and Wmax. With `soft` gamma is multiplied by s (1 - s), s = w / Wmax, so
    that changes become smaller towards both bounds, and a weight at a bound does not change.

    With n = R in one step and b in all others, the rule is alpha(w) (R - b) delta(t - t_f) e of Vasilaki et al., where
    alpha is gamma times the step, with `soft` a function of the weight.

    Source: Florian, Neural Comput. 19:1468, 2007 (MSTDPET); Vasilaki et al., PLoS Comput. Biol. 5:e1000586, 2009, as in
    Mosca, MSc thesis, 2020, eq. 116. Eq. 116 does not specify alpha; s (1 - s) is the factor in eq. 126.
    """

    equation: ClassVar[str] = (
        "w' = gamma (n - b) z (or times s (1 - s), s = w/Wmax); tau_z z' = -z + A_plus K+ (post) - A_minus K- (pre)"
    )
    source: ClassVar[str] = (
        "Florian, Neural Comput. 19:1468, 2007; Vasilaki et al., PLoS Comput. Biol. 5:e1000586, 2009"
    )
    states: ClassVar[tuple[State, ...]] = (State("z", "1/ms", "eligibility trace"),)

    tau_plus: float = quantity(20.0, "ms", "time constant of K+", above=0)
    A_plus: float = quantity(1.0, "", "increase of the eligibility by a pre-post pair")
    A_minus: float = quantity(1.0, "", "decrease of the eligibility by a post-pre pair")
    tau_z: float = quantity(25.0, "ms", "time constant of the eligibility", above=0)
    gamma: float = quantity(0.1, "", "learning rate, in the unit of the weight", of_value=True)
    b: float = quantity(0.0, "", "baseline of the reward")
    Wmax: float = quantity(
        100.0, "", "largest weight, in the unit of the weight; negative if inhibitory", nonzero=True, of_value=True
    )
    soft: bool = quantity(False, "", "whether learning slows down near 0 and Wmax", kind="boolean")

    def constants(p, h, c):
        """Fill `c` with the parameters and the step."""
        c[A_PLUS], c[A_MINUS], c[TAU_Z], c[GAMMA], c[B], c[W_MAX], c[H] = p[1], p[2], p[3], p[4], p[5], p[6], h
        c[SOFT] = p[7]

    def on_post(y, e, c, pre, post):
        """Increase the eligibility by a pre-post pair."""
        y[1, e] += c[A_PLUS] * pre[0] / c[TAU_Z]

    def on_pre(y, e, c, pre, post):
        """Decrease the eligibility by a post-pre pair."""
        y[1, e] -= c[A_MINUS] * post[0] / c[TAU_Z]

    def advance(y, e, c, begin, end, n, grid):
        """Integrate from step `begin` to `end`.

        n is constant, so the weight changes in one direction and is clipped at the end.
        """
        z, elapsed = y[1, e], (end - begin) * c[H] / c[TAU_Z]
        change = -c[GAMMA] * (n - c[B]) * z * c[TAU_Z] * math.expm1(-elapsed)
        y[0, e] = softly_changed(y[0, e], change, c[W_MAX]) if c[SOFT] != 0.0 else within(y[0, e] + change, c[W_MAX])
        y[1, e] = z * math.exp(-elapsed)


WEIGHT, Q, C, Z, RELEASED, REFRACTORY = range(6)


@dataclass(frozen=True, kw_only=True, eq=False)
class hedonistic(Modulated):
    """Synapse that releases transmitter, and so sends its weight, with a learnt probability.

    The probability of a release at a pre spike is p = 1 / (1 + exp(-q_0 - q - z)).

    A release adds 1 - p to the eligibility c, and the synapse is refractory until it recovers, at the rate 1/tau_r. A
    failure to release subtracts p from c. Each pre spike then adds Delta_z to the calcium z. A signal sets the reward
    n, and q changes by eta (n - b) c, where b is the baseline of the reward. The weight does not change, so `sim.save`
    stores what the synapse learns and `sim.network` does not. A parrot_neuron also repeats failures, because spikes of
    weight 0 are repeated too.
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
        State("q", "", "learnt part of the release parameter"),
        State("c", "", "eligibility trace"),
        State("z", "", "calcium"),
        State("released", "", "1 if the last pre spike released, else 0"),
        State("refractory", "", "1 from a release until recovery", hidden=True),
    )

    q_0: float = quantity(0.0, "", "release parameter without learning")
    eta: float = quantity(0.01, "1/ms", "learning rate")
    b: float = quantity(0.0, "", "baseline of the reward")
    tau_c: float = quantity(20.0, "ms", "time constant of the eligibility", above=0)
    Delta_z: float = quantity(0.0, "", "increase of the calcium per pre spike")
    tau_z: float = quantity(50.0, "ms", "time constant of the calcium", above=0)
    tau_r: float = quantity(10.0, "ms", "mean recovery time after a release", above=0)

    def constants(p, h, c):
        """Fill `c` with the parameters and the step."""
        c[Q_0], c[ETA], c[B], c[TAU_C], c[DELTA_Z], c[TAU_Z], c[TAU_R] = p[:7]
        c[H] = h

    def on_post(y, e, c, pre, post):
        """Do nothing."""

    def on_pre(y, e, c, pre, post, u):
        """Recover, release or fail by one random number. Recovery depends on the time since the last pre spike only."""
        p = 0.5 * (1.0 + math.tanh(0.5 * (c[Q_0] + y[Q, e] + y[Z, e])))
        y[Z, e] += c[DELTA_Z]
        y[RELEASED, e] = 0.0
        if y[REFRACTORY, e] == 1.0:
            recovers = -math.expm1(-pre[0] / c[TAU_R])
            if u >= recovers:
                return
            u /= recovers  # given u < recovers, the quotient is uniform in [0, 1)
        if u < p:
            y[C, e] += 1.0 - p
            y[RELEASED, e] = y[REFRACTORY, e] = 1.0
        else:
            y[C, e] -= p
            y[REFRACTORY, e] = 0.0

    def sent(y, e, c):
        """Return the weight after a release, else 0."""
        return y[WEIGHT, e] * y[RELEASED, e]

    def advance(y, e, c, begin, end, n, grid):
        """Integrate exactly from step `begin` to `end`, with constant n."""
        elapsed = (end - begin) * c[H]
        y[Q, e] -= c[ETA] * (n - c[B]) * y[C, e] * c[TAU_C] * math.expm1(-elapsed / c[TAU_C])
        y[C, e] *= math.exp(-elapsed / c[TAU_C])
        y[Z, e] *= math.exp(-elapsed / c[TAU_Z])
