"""Rules that a temporal-difference error teaches, in continuous time or from move to move of an agent.

A `MoveRule` gathers eligibility, which a signal teaches.

Beside `constants`, the class of such a rule, or its module, has

    gather(y, e, c, pre, spikes, seen, gate)    what a step of the post neuron adds to the eligibility of synapse e
    teach(y, e, c, n)                           what the signal n of the post neuron does at the end of a move

In `y`, row 0 is the weight, the others are the states. `gather` is asked after each step, of the synapses whose pre
traces are not 0, where the neuron has spiked (`spikes`, how often) or the state that the rule `sees` is not 0; it must
do nothing where both are 0. `teach` is asked when the signal is set, of the synapses with a state that is not 0.
"""

# mypy: disable-error-code="no-untyped-def,no-untyped-call", check-untyped-defs=False
from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

from neuro.core.quantities import quantity
from neuro.core.registry import OfModule
from neuro.model.neurons.base import State
from neuro.model.synapses.base import Modulated, Synapse, Trace

GATHERING = {"constants": 3, "gather": 7, "teach": 4}
"""The functions of such a rule and how many arguments each takes."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MoveRule(Synapse):
    """Base of rules that gather eligibility while an agent moves, and are taught by a signal at the end of each move.

    A signal acts at the moment at which it is set, once, on the eligibility that was gathered up to then; it is not
    held. States of the synapses can be set, so an episode ends with `sim.set(part, z=0.0, e=0.0)`. Spikes take one
    step, so that a neuron's spike teaches the synapses whose input it has just had. A source all of whose traces are
    below `x_min` counts as silent: its traces are 0.

    Class attributes:
        sees: the state of the post neuron that `gather` reads, as the step has left it; "" for none.
    """

    learns: ClassVar[str] = "moves"
    sees: ClassVar[str] = ""
    post: ClassVar[tuple[Trace, ...]] = ()
    arithmetic: ClassVar[OfModule] = OfModule(("gather", "teach"))

    signal: str | None = quantity(None, "", "the signal that teaches", kind="name")
    gate: str | None = quantity(
        None, "", "a signal that is held and says how much is gathered, one value a neuron; 1 without", kind="name"
    )
    receptor: str | None = quantity(
        None, "", "the target's receptor that spikes go to; by the sign of the weight if not said", kind="receptor"
    )
    x_min: float = quantity(
        1e-3, "", "pre trace below which a source counts as silent, and eligibility below which it is 0", above=0
    )


TAU_M, TAU_S, TAU_KAPPA, TAU_RISE, ETA, W_MIN, W_MAX, H = range(8)
DECAY, LEAST = range(2)
MOVE, RATE = range(2)
"""Constants; the first are those of `td_ltp`."""

WEIGHT, E, Z = range(3)
E_LAST, E_BEFORE = range(2, 4)
ELIGIBILITY, RISE, M, S = range(1, 5)
"""Rows of the states of `td_lambda`, `td_moves` and `td_ltp`."""


@dataclass(frozen=True, kw_only=True, eq=False)
class td_lambda(MoveRule):
    """A critic's rule: the error n of a move teaches the synapses that brought its neuron to spike, now and before.

    A pre spike adds 1 to x, which decays with `tau`, best that of the neuron's membrane. At a post spike e grows by x.
    When the signal sets n: w += eta n z, then z = decay z + e and e = 0. So n acts on all moves but the last, whose
    outcome is not known yet; at the end of an episode it is set a second time. `decay` is the discount of the reward
    times lambda; z below `x_min` is 0. The weight is within Wmin and Wmax at all times.

    Source: Sutton & Barto, Reinforcement Learning, 2nd ed., 2018, section 12.2 (TD(lambda)), with the spike-triggered
    eligibility of Fremaux, Sprekeler & Gerstner, PLoS Comput. Biol. 9:e1003024, 2013, eq. 17.
    """

    equation: ClassVar[str] = "e += x at post spikes; at a signal n: w += eta n z, z = decay z + e, e = 0"
    source: ClassVar[str] = "Sutton & Barto 2018, section 12.2; Fremaux et al., PLoS Comput. Biol. 9:e1003024, 2013"
    pre: ClassVar[tuple[Trace, ...]] = (Trace("tau"),)
    ordered: ClassVar[tuple[tuple[str, str], ...]] = (("Wmin", "Wmax"),)
    states: ClassVar[tuple[State, ...]] = (
        State("e", "", "eligibility gathered in the present move"),
        State("z", "", "eligibility of the moves before, which a signal teaches"),
    )

    tau: float = quantity(10.0, "ms", "time constant of the pre trace", above=0)
    eta: float = quantity(0.01, "", "learning rate, in the unit of the weight", at_least=0, of_value=True)
    decay: float = quantity(0.9, "", "what is left of z from one move to the next", at_least=0, at_most=1)
    Wmin: float = quantity(-100.0, "", "smallest weight, in the unit of the weight", of_value=True)
    Wmax: float = quantity(100.0, "", "largest weight, in the unit of the weight", of_value=True)

    def constants(p, h, c):
        """Learning rate, decay over a move, bounds; `p` is x_min, then the parameters above in order."""
        c[ETA], c[DECAY], c[W_MIN], c[W_MAX], c[LEAST] = p[2], p[3], p[4], p[5], p[0]

    def gather(y, e, c, pre, spikes, seen, gate):
        """What the pre spikes gave to the potential is counted at post spikes."""
        y[E, e] += gate * spikes * pre[0]

    def teach(y, e, c, n):
        """The error moves the weight along z, which then takes over the present move."""
        w = y[WEIGHT, e] + c[ETA] * n * y[Z, e]
        y[WEIGHT, e] = min(max(w, c[W_MIN]), c[W_MAX])
        z = c[DECAY] * y[Z, e] + y[E, e]
        y[Z, e] = z if abs(z) >= c[LEAST] else 0.0
        y[E, e] = 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class reinforce(td_lambda):
    """An actor's rule: as `td_lambda`, but e grows by (S - p) x in each step.

    S is whether the neuron spikes in the step, and p the probability with which it does, a state of its model
    (`soft_wta`, `pp_psc_delta`): a spike that was not expected counts in full, one that was sure not at all. In the
    mean over draws that is the gradient of the log probability of the spikes with respect to the weight.

    Source: Williams, Machine Learning 8:229, 1992 (characteristic eligibility); for spikes Pfister, Toyoizumi, Barber
    & Gerstner, Neural Comput. 18:1318, 2006.
    """

    equation: ClassVar[str] = "e += (S - p) x in each step; at a signal n: w += eta n z, z = decay z + e, e = 0"
    source: ClassVar[str] = "Williams, Machine Learning 8:229, 1992; Pfister et al., Neural Comput. 18:1318, 2006"
    sees: ClassVar[str] = "p"

    def gather(y, e, c, pre, spikes, seen, gate):
        """What was done less what was expected."""
        y[E, e] += gate * (spikes - seen) * pre[0]


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
        decay, fall = y[ELIGIBILITY, e] + rise, rise
        lost, risen = math.expm1(-passed / c[TAU_KAPPA]), math.expm1(-passed / c[TAU_RISE])
        moved = c[ETA] * n * (fall * c[TAU_RISE] * risen - decay * c[TAU_KAPPA] * lost)
        y[WEIGHT, e] = min(max(y[WEIGHT, e] + moved, c[W_MIN]), c[W_MAX])
        y[RISE, e] = rise * (1.0 + risen)
        y[ELIGIBILITY, e] = decay * (1.0 + lost) - y[RISE, e]


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
