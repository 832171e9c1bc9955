"""Rules of spikes that a temporal-difference error teaches."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call", check-untyped-defs=False
from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from neuro.core.quantities import quantity
from neuro.model.neurons.base import State
from neuro.model.synapses.base import Modulated, Trace

TAU_M, TAU_S, TAU_KAPPA, TAU_RISE, ETA, W_MIN, W_MAX, H = range(8)
WEIGHT, Z, RISE, M, S = range(5)


@dataclass(frozen=True, kw_only=True, eq=False)
class td_ltp(Modulated):
    """The weight moves with the error n along what the synapse gave to recent spikes of its post neuron.

    At a post spike it gave eps: the potential, of peak below 1, by the pre spikes since the post spike before. The
    eligibility z is eps smoothed by kappa, a difference of exponentials of area 1. A signal sets n, which stays until
    it is set again. `tau_m` and `tau_s` are best those of the neuron (tau_m and tau_syn_ex of `srm0`), and `tau_kappa`
    and `tau_rise` those by which the critic reads its rate. Integration is exact; the weight is within Wmin and Wmax
    at all times.

    Source: Fremaux, Sprekeler & Gerstner, PLoS Comput. Biol. 9:e1003024, 2013 (TD-LTP).
    """

    equation: ClassVar[str] = (
        "w' = eta n z; z = (eps at post spikes) * kappa, "
        "eps(t) = exp(-t/tau_m) - exp(-t/tau_s) summed over the pre spikes since the last post spike, "
        "kappa(t) = (exp(-t/tau_kappa) - exp(-t/tau_rise)) / (tau_kappa - tau_rise)"
    )
    source: ClassVar[str] = "Fremaux, Sprekeler & Gerstner, PLoS Comput. Biol. 9:e1003024, 2013"
    pre: ClassVar[tuple[Trace, ...]] = (Trace("tau_m"), Trace("tau_s"))
    post: ClassVar[tuple[Trace, ...]] = (Trace(""),)
    ordered: ClassVar[tuple[tuple[str, str], ...]] = (("tau_s", "tau_m"), ("tau_rise", "tau_kappa"), ("Wmin", "Wmax"))
    states: ClassVar[tuple[State, ...]] = (
        State("z", "1/ms", "eligibility trace"),
        State("rise", "1/ms", "the part of kappa that fades with tau_rise", hidden=True),
        State("m", "", "pre trace of tau_m just after the last post spike", hidden=True),
        State("s", "", "pre trace of tau_s just after the last post spike", hidden=True),
    )

    tau_m: float = quantity(20.0, "ms", "time constant of the membrane", above=0)
    tau_s: float = quantity(5.0, "ms", "time constant of the synaptic current, shorter", above=0)
    tau_kappa: float = quantity(200.0, "ms", "time constant of the eligibility", above=0)
    tau_rise: float = quantity(50.0, "ms", "time constant of its rise, shorter", above=0)
    eta: float = quantity(1.0, "", "learning rate, in the unit of the weight", at_least=0, of_value=True)
    Wmin: float = quantity(0.0, "", "smallest weight, in the unit of the weight", of_value=True)
    Wmax: float = quantity(100.0, "", "largest weight, in the unit of the weight", of_value=True)

    def constants(p, h, c):
        """The parameters and the step."""
        c[:H] = p[:H]
        c[H] = h

    def on_post(y, e, c, pre, post):
        """What the pre spikes since the last post spike gave begins to be eligible; z itself is continuous."""
        m = pre[0] - y[M, e] * math.exp(-post[0] / c[TAU_M])
        s = pre[1] - y[S, e] * math.exp(-post[0] / c[TAU_S])
        y[RISE, e] += (m - s) / (c[TAU_KAPPA] - c[TAU_RISE])
        y[M, e], y[S, e] = pre[0], pre[1]

    def on_pre(y, e, c, pre, post):
        """Nothing is learnt; the traces remember."""

    def advance(y, e, c, begin, end, n, grid):
        """Integrate from step `begin` to `end`; z is never below 0, so w moves one way and is clipped at the end."""
        passed, rise = (end - begin) * c[H], y[RISE, e]
        decay, fall = y[Z, e] + rise, rise
        lost, risen = math.expm1(-passed / c[TAU_KAPPA]), math.expm1(-passed / c[TAU_RISE])
        moved = c[ETA] * n * (fall * c[TAU_RISE] * risen - decay * c[TAU_KAPPA] * lost)
        y[WEIGHT, e] = min(max(y[WEIGHT, e] + moved, c[W_MIN]), c[W_MAX])
        y[RISE, e] = rise * (1.0 + risen)
        y[Z, e] = decay * (1.0 + lost) - y[RISE, e]


MOVE, RATE = range(2)
E, E_LAST, E_BEFORE = range(1, 4)


@dataclass(frozen=True, kw_only=True, eq=False)
class td_moves(Modulated):
    """The weight moves with the error n of a move along what the synapse gave to the spikes of its neuron in that move.

    Time is cut into moves of `move` ms, from 0 on, rounded to steps. At each post spike eps, the potential by all pre
    spikes, is added to the e of the present move. How good a move was is known when the next one has ended, from the
    value of the state that it led to. So e is kept for two moves, and n, which a signal sets after each, acts on it
    in the third: w changes by eta n e. `tau_m` and `tau_s` are best those of the neuron (tau_m and tau_syn_ex of
    `srm0`). The weight is within Wmin and Wmax at all times.

    Source: the actor and the critic of Fremaux, Sprekeler & Gerstner, PLoS Comput. Biol. 9:e1003024, 2013, in moves;
    the error is that of Sutton & Barto, Reinforcement Learning, 2nd ed., eq. 6.5.
    """

    equation: ClassVar[str] = (
        "w' = eta n e / move, e: of the move before the last, the sum of eps at post spikes, "
        "eps(t) = exp(-t/tau_m) - exp(-t/tau_s) summed over the pre spikes"
    )
    source: ClassVar[str] = "after Fremaux, Sprekeler & Gerstner, PLoS Comput. Biol. 9:e1003024, 2013"
    pre: ClassVar[tuple[Trace, ...]] = (Trace("tau_m"), Trace("tau_s"))
    post: ClassVar[tuple[Trace, ...]] = ()
    ordered: ClassVar[tuple[tuple[str, str], ...]] = (("tau_s", "tau_m"), ("Wmin", "Wmax"))
    states: ClassVar[tuple[State, ...]] = (
        State("e", "", "eligibility of the present move"),
        State("e_last", "", "that of the last move"),
        State("e_before", "", "that of the move before it, which is taught"),
    )

    tau_m: float = quantity(10.0, "ms", "time constant of the membrane", above=0)
    tau_s: float = quantity(2.0, "ms", "time constant of the synaptic current, shorter", above=0)
    move: float = quantity(100.0, "ms", "length of a move", above=0)
    eta: float = quantity(0.01, "", "learning rate, in the unit of the weight", at_least=0, of_value=True)
    Wmin: float = quantity(0.0, "", "smallest weight, in the unit of the weight", of_value=True)
    Wmax: float = quantity(100.0, "", "largest weight, in the unit of the weight", of_value=True)

    def constants(p, h, c):
        """Steps of a move, learning rate of a step, bounds."""
        c[MOVE] = max(1.0, round(p[2] / h))
        c[RATE] = p[3] / c[MOVE]
        c[W_MIN], c[W_MAX] = p[4], p[5]

    def on_post(y, e, c, pre, post):
        """What the pre spikes give to the potential is counted at a post spike."""
        y[E, e] += pre[0] - pre[1]

    def on_pre(y, e, c, pre, post):
        """Nothing is learnt; the traces remember."""

    def advance(y, e, c, begin, end, n, grid):
        """Move by move from step `begin` to `end`. The spikes that arrive in the last step of a move belong to it."""
        step = begin
        while step < end and (y[E, e] != 0.0 or y[E_LAST, e] != 0.0 or y[E_BEFORE, e] != 0.0):
            into = step % c[MOVE]
            if into == 0.0:
                y[E_BEFORE, e], y[E_LAST, e], y[E, e] = y[E_LAST, e], y[E, e], 0.0
            steps = min(c[MOVE] - into, end - step)
            w = y[WEIGHT, e] + c[RATE] * n * y[E_BEFORE, e] * steps
            y[WEIGHT, e] = min(max(w, c[W_MIN]), c[W_MAX])
            step += steps
