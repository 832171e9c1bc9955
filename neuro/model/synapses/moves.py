"""Temporal-difference rules, in continuous time or from move to move of an agent.

A `MoveRule` collects eligibility, and a signal applies it to the weights. Beside `constants`, the class of the rule or
its module has

    gather(y, e, c, pre, spikes, state, gate)   add the contribution of a step to the eligibility of synapse e
    teach(y, e, c, n)                           apply the signal n of the post neuron at the end of a move

In `y`, row 0 is the weight and the other rows are the states. `gather` is called after each step for the synapses with
pre traces other than 0 whose post neuron has spiked (`spikes` times) or has a state `sees` other than 0. `gather` must
do nothing if both are 0. `teach` is called when the signal is set, for the synapses with a state other than 0.
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
"""Functions of a `MoveRule`, and their numbers of arguments."""


@dataclass(frozen=True, kw_only=True, eq=False)
class MoveRule(Synapse):
    """Base of rules that collect eligibility while an agent moves, and apply a signal at the end of each move.

    A signal acts once, at the time at which it is set, on the eligibility collected until then. States of the synapses
    can be set, so an episode ends with `sim.set(part, z=0.0, e=0.0)`. Delays are one step, so a spike of a neuron
    applies to the synapses whose input has just arrived. A source whose traces are all below `x_min` counts as silent,
    and its traces are set to 0.

    Class attributes:
        sees: the state of the post neuron that `gather` gets as `state`, after the step; "" for none.
    """

    learns: ClassVar[str] = "moves"
    sees: ClassVar[str] = ""
    post: ClassVar[tuple[Trace, ...]] = ()
    arithmetic: ClassVar[OfModule] = OfModule(("gather", "teach"))

    signal: str | None = quantity(None, "", "the signal that teaches", kind="name")
    gate: str | None = quantity(
        None, "", "signal with a factor per neuron on the collected eligibility; 1 if not given", kind="name"
    )
    receptor: str | None = quantity(
        None, "", "receptor of the target; by default the sign of the weight chooses", kind="receptor"
    )
    x_min: float = quantity(
        1e-3, "", "pre trace below which a source counts as silent, and eligibility below which it is set to 0", above=0
    )


TAU_M, TAU_S, TAU_KAPPA, TAU_RISE, ETA, W_MIN, W_MAX, H = range(8)
DECAY, LEAST = range(2)
MOVE, RATE = range(2)
"""Indices of the constants of `td_ltp`, `td_lambda` and `td_moves`. ETA, W_MIN and W_MAX belong to all three."""

WEIGHT, E, Z = range(3)
E_LAST, E_BEFORE = range(2, 4)
ELIGIBILITY, RISE, M, S = range(1, 5)
"""Rows of the states of `td_lambda`, `td_moves` and `td_ltp`."""


@dataclass(frozen=True, kw_only=True, eq=False)
class td_lambda(MoveRule):
    """TD(lambda) for a critic: the error n of a move changes the weights of synapses that contributed to spikes.

    A pre spike adds 1 to x, which decays with `tau`, preferably the time constant of the neuron's membrane. A post
    spike increases e by x. When the signal sets n, w += eta n z, then z = decay z + e and e = 0. n thus acts on all
    moves except the last, whose outcome is not known yet. At the end of an episode the signal is set a second time.
    `decay` is the discount of the reward times lambda. z below `x_min` is set to 0. The weight is always within Wmin
    and Wmax.

    Source: Sutton & Barto, Reinforcement Learning, 2nd ed., 2018, section 12.2 (TD(lambda)), with the spike-triggered
    eligibility of Fremaux, Sprekeler & Gerstner, PLoS Comput. Biol. 9:e1003024, 2013, eq. 17.
    """

    equation: ClassVar[str] = "e += x at post spikes; at a signal n: w += eta n z, z = decay z + e, e = 0"
    source: ClassVar[str] = "Sutton & Barto 2018, section 12.2; Fremaux et al., PLoS Comput. Biol. 9:e1003024, 2013"
    pre: ClassVar[tuple[Trace, ...]] = (Trace("tau"),)
    ordered: ClassVar[tuple[tuple[str, str], ...]] = (("Wmin", "Wmax"),)
    states: ClassVar[tuple[State, ...]] = (
        State("e", "", "eligibility of the current move"),
        State("z", "", "eligibility of the earlier moves, to which a signal applies"),
    )

    tau: float = quantity(10.0, "ms", "time constant of the pre trace", above=0)
    eta: float = quantity(0.01, "", "learning rate, in the unit of the weight", at_least=0, of_value=True)
    decay: float = quantity(0.9, "", "factor on z from one move to the next", at_least=0, at_most=1)
    Wmin: float = quantity(-100.0, "", "smallest weight, in the unit of the weight", of_value=True)
    Wmax: float = quantity(100.0, "", "largest weight, in the unit of the weight", of_value=True)

    def constants(p, h, c):
        """Fill `c` with learning rate, decay per move and bounds. `p` is x_min, then the parameters above in order."""
        c[ETA], c[DECAY], c[W_MIN], c[W_MAX], c[LEAST] = p[2], p[3], p[4], p[5], p[0]

    def gather(y, e, c, pre, spikes, state, gate):
        """Add the pre trace, the contribution of the pre spikes to the potential, at post spikes."""
        y[E, e] += gate * spikes * pre[0]

    def teach(y, e, c, n):
        """Change the weight along z, then add the eligibility of the current move to z."""
        w = y[WEIGHT, e] + c[ETA] * n * y[Z, e]
        y[WEIGHT, e] = min(max(w, c[W_MIN]), c[W_MAX])
        z = c[DECAY] * y[Z, e] + y[E, e]
        y[Z, e] = z if abs(z) >= c[LEAST] else 0.0
        y[E, e] = 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class reinforce(td_lambda):
    """Policy gradient for an actor: like `td_lambda`, but e increases by (S - p) x in each step.

    S is whether the neuron spikes in the step, and p the probability of a spike, a state of the neuron model
    (`soft_wta`, `pp_psc_delta`). A spike with a small p changes e by almost x, and a spike with p = 1 does not change
    e. The mean over random spikes is the gradient of the log probability of the spikes with respect to the weight.

    Source: Williams, Machine Learning 8:229, 1992 (characteristic eligibility); for spikes Pfister, Toyoizumi, Barber
    & Gerstner, Neural Comput. 18:1318, 2006.
    """

    equation: ClassVar[str] = "e += (S - p) x in each step; at a signal n: w += eta n z, z = decay z + e, e = 0"
    source: ClassVar[str] = "Williams, Machine Learning 8:229, 1992; Pfister et al., Neural Comput. 18:1318, 2006"
    sees: ClassVar[str] = "p"

    def gather(y, e, c, pre, spikes, state, gate):
        """Add the difference between the spikes and their probability, times the pre trace."""
        y[E, e] += gate * (spikes - state) * pre[0]


@dataclass(frozen=True, kw_only=True, eq=False)
class td_ltp(Modulated):
    """TD-LTP in continuous time: the error n changes the weight along the eligibility z of recent post spikes.

    At a post spike, eps is the potential (with a peak below 1) caused by the pre spikes since the last post spike. The
    eligibility z is eps smoothed by kappa, a difference of exponentials with area 1. A signal sets n, which is constant
    until it is set again. `tau_m` and `tau_s` are preferably those of the neuron (tau_m and tau_syn_ex of `srm0`), and
    `tau_kappa` and `tau_rise` those of the critic's rate estimate. Integration is exact, and the weight is always
    within Wmin and Wmax.

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
        State("rise", "1/ms", "part of kappa that decays with tau_rise", hidden=True),
        State("m", "", "pre trace with tau_m at the last post spike", hidden=True),
        State("s", "", "pre trace with tau_s at the last post spike", hidden=True),
    )

    tau_m: float = quantity(20.0, "ms", "time constant of the membrane", above=0)
    tau_s: float = quantity(5.0, "ms", "time constant of the synaptic current, shorter than tau_m", above=0)
    tau_kappa: float = quantity(200.0, "ms", "decay time constant of the eligibility", above=0)
    tau_rise: float = quantity(50.0, "ms", "rise time constant of the eligibility, shorter than tau_kappa", above=0)
    eta: float = quantity(1.0, "", "learning rate, in the unit of the weight", at_least=0, of_value=True)
    Wmin: float = quantity(0.0, "", "smallest weight, in the unit of the weight", of_value=True)
    Wmax: float = quantity(100.0, "", "largest weight, in the unit of the weight", of_value=True)

    def constants(p, h, c):
        """Fill `c` with the parameters and the step."""
        c[:H] = p[:H]
        c[H] = h

    def on_post(y, e, c, pre, post):
        """Start the eligibility of the pre spikes since the last post spike. z itself is continuous."""
        m = pre[0] - y[M, e] * math.exp(-post[0] / c[TAU_M])
        s = pre[1] - y[S, e] * math.exp(-post[0] / c[TAU_S])
        y[RISE, e] += (m - s) / (c[TAU_KAPPA] - c[TAU_RISE])
        y[M, e], y[S, e] = pre[0], pre[1]

    def on_pre(y, e, c, pre, post):
        """Do nothing, because the traces hold the pre spikes."""

    def advance(y, e, c, begin, end, n, grid):
        """Integrate from step `begin` to `end`. z >= 0, so w changes in one direction and is clipped at the end."""
        elapsed, rise = (end - begin) * c[H], y[RISE, e]
        decay, fall = y[ELIGIBILITY, e] + rise, rise
        decay_change, rise_change = math.expm1(-elapsed / c[TAU_KAPPA]), math.expm1(-elapsed / c[TAU_RISE])
        change = c[ETA] * n * (fall * c[TAU_RISE] * rise_change - decay * c[TAU_KAPPA] * decay_change)
        y[WEIGHT, e] = min(max(y[WEIGHT, e] + change, c[W_MIN]), c[W_MAX])
        y[RISE, e] = rise * (1.0 + rise_change)
        y[ELIGIBILITY, e] = decay * (1.0 + decay_change) - y[RISE, e]


@dataclass(frozen=True, kw_only=True, eq=False)
class td_moves(Modulated):
    """TD learning in moves of fixed length: the error n of a move changes the weight along the move's eligibility.

    Time is divided into moves of `move` ms, rounded to steps. At each post spike eps, the potential caused by all pre
    spikes, is added to the e of the current move. The error of a move depends on the value of the state that the move
    leads to, so it is known only at the end of the next move. e is therefore kept for two more moves. A signal sets n
    after each move, and in the second move after that of e, w changes by eta n e. `tau_m` and `tau_s` are preferably
    those of the neuron (tau_m and tau_syn_ex of `srm0`). The weight is always within Wmin and Wmax.

    Source: the actor and the critic of Fremaux, Sprekeler & Gerstner, PLoS Comput. Biol. 9:e1003024, 2013, in moves;
    the error is that of Sutton & Barto, Reinforcement Learning, 2nd ed., eq. 6.5.
    """

    equation: ClassVar[str] = (
        "w' = eta n e / move, e: sum of eps at post spikes in the move before the last, "
        "eps(t) = exp(-t/tau_m) - exp(-t/tau_s) summed over the pre spikes"
    )
    source: ClassVar[str] = "after Fremaux, Sprekeler & Gerstner, PLoS Comput. Biol. 9:e1003024, 2013"
    pre: ClassVar[tuple[Trace, ...]] = (Trace("tau_m"), Trace("tau_s"))
    post: ClassVar[tuple[Trace, ...]] = ()
    ordered: ClassVar[tuple[tuple[str, str], ...]] = (("tau_s", "tau_m"), ("Wmin", "Wmax"))
    states: ClassVar[tuple[State, ...]] = (
        State("e", "", "eligibility of the current move"),
        State("e_last", "", "eligibility of the last move"),
        State("e_before", "", "eligibility of the move before the last, to which n applies"),
    )

    tau_m: float = quantity(10.0, "ms", "time constant of the membrane", above=0)
    tau_s: float = quantity(2.0, "ms", "time constant of the synaptic current, shorter than tau_m", above=0)
    move: float = quantity(100.0, "ms", "length of a move", above=0)
    eta: float = quantity(0.01, "", "learning rate, in the unit of the weight", at_least=0, of_value=True)
    Wmin: float = quantity(0.0, "", "smallest weight, in the unit of the weight", of_value=True)
    Wmax: float = quantity(100.0, "", "largest weight, in the unit of the weight", of_value=True)

    def constants(p, h, c):
        """Fill `c` with steps per move, learning rate per step and bounds."""
        c[MOVE] = max(1.0, round(p[2] / h))
        c[RATE] = p[3] / c[MOVE]
        c[W_MIN], c[W_MAX] = p[4], p[5]

    def on_post(y, e, c, pre, post):
        """Add the potential caused by the pre spikes to the eligibility."""
        y[E, e] += pre[0] - pre[1]

    def on_pre(y, e, c, pre, post):
        """Do nothing, because the traces hold the pre spikes."""

    def advance(y, e, c, begin, end, n, grid):
        """Integrate move by move from step `begin` to `end`. The last step of a move belongs to the move."""
        step = begin
        while step < end and (y[E, e] != 0.0 or y[E_LAST, e] != 0.0 or y[E_BEFORE, e] != 0.0):
            move_step = step % c[MOVE]
            if move_step == 0.0:
                y[E_BEFORE, e], y[E_LAST, e], y[E, e] = y[E_LAST, e], y[E, e], 0.0
            steps = min(c[MOVE] - move_step, end - step)
            w = y[WEIGHT, e] + c[RATE] * n * y[E_BEFORE, e] * steps
            y[WEIGHT, e] = min(max(w, c[W_MIN]), c[W_MAX])
            step += steps
