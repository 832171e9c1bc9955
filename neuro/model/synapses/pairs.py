"""Rules of spike pairs and triplets, and the short-term plasticity of a synapse."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call", check-untyped-defs=False
from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

from neuro.core.quantities import Value, quantity
from neuro.model.neurons.base import State
from neuro.model.synapses.base import DELAY, K_MINUS, K_PLUS, OF_EACH, DelayRule, Synapse, Trace

TAU_PLUS, LAMBDA, ALPHA, MU_PLUS, MU_MINUS, W_MAX = range(6)
DEPRESSION, MU = 2, 3
LIMIT, A_PLUS, A_PLUS_TRIPLET, A_MINUS, A_MINUS_TRIPLET = range(5)
ETA = 1
"""Constants; those of the later lines belong to rules that are not `WeightDependent`."""

LARGEST_WEIGHT: Mapping[str, Any] = {
    "doc": "largest weight, in the unit of the weight; below 0 it inhibits",
    "nonzero": True,
    "of_value": True,
    **OF_EACH,
}
"""What the parameter Wmax accepts, with a value for all synapses or for each."""


def power(share, mu):
    """A share of Wmax to a power above 0; the common one costs nothing."""
    return share if mu == 1.0 else share**mu


def potentiation(w, k, c):
    """Return the change of a weight by a potentiation by k, whatever the bounds."""
    w_max, mu = c[W_MAX], c[MU_PLUS]
    dependence = 1.0 if mu == 0.0 else power(1.0 - w / w_max, mu)
    return w_max * c[LAMBDA] * dependence * k


def depression(w, k, c):
    """Return the change of a weight by a depression by k, whatever the bounds."""
    w_max, mu = c[W_MAX], c[MU_MINUS]
    dependence = 1.0 if mu == 0.0 else power(w / w_max, mu)
    return -(w_max * c[ALPHA] * c[LAMBDA] * dependence * k)


def potentiated(w, k, c):
    """A weight after a potentiation by k, up to Wmax."""
    return within(w + potentiation(w, k, c), c[W_MAX])


def depressed(w, k, c):
    """A weight after a depression by k, down to 0."""
    return within(w + depression(w, k, c), c[W_MAX])


def within(w, w_max):
    """A weight between 0 and `w_max`, which is below 0 where the synapse inhibits."""
    return min(max(w, 0.0), w_max) if w_max > 0.0 else max(min(w, 0.0), w_max)


@dataclass(frozen=True, kw_only=True, eq=False)
class WeightDependent(Synapse):
    """Parameters of rules between additive (mu = 0) and multiplicative (mu = 1): Guetig et al., 2003."""

    learns: ClassVar[str] = "pairs"
    width: ClassVar[int] = 6

    tau_plus: float = quantity(20.0, "ms", "time constant of K+", above=0)
    lambda_: Value = quantity(0.01, "", "step size", at_least=0, **OF_EACH)
    alpha: Value = quantity(1.0, "", "depression relative to potentiation", at_least=0, **OF_EACH)
    mu_plus: Value = quantity(1.0, "", "weight dependence of potentiation", at_least=0, **OF_EACH)
    mu_minus: Value = quantity(1.0, "", "weight dependence of depression", at_least=0, **OF_EACH)
    Wmax: Value = quantity(100.0, **LARGEST_WEIGHT)

    def constants(p, h, c):
        """The constants are the parameters."""
        c[:6] = p[:6]

    def on_post(y, e, c, pre, post):
        """Potentiate, up to Wmax."""
        y[0, e] = potentiated(y[0, e], pre[0], c)

    def on_pre(y, e, c, pre, post):
        """Depress, down to 0."""
        y[0, e] = depressed(y[0, e], post[0], c)


@dataclass(frozen=True, kw_only=True, eq=False)
class stdp(WeightDependent):
    """STDP of all pairs of spikes, between additive (mu = 0) and multiplicative (mu = 1).

    Additive: mu_plus = mu_minus = 0. Soft bounds: both 1. Van Rossum: mu_plus = 0, mu_minus = 1. Guetig: both between.
    The weight changes at pre spikes. Wmax below 0 makes the synapse inhibitory.
    Source: NEST 3.10, `stdp_synapse`; Guetig et al., J. Neurosci. 23:3697, 2003; van Rossum, Bi & Turrigiano,
    J. Neurosci. 20:8812, 2000; Morrison, Diesmann & Gerstner, Biol. Cybern. 98:459, 2008.
    """

    equation: ClassVar[str] = (
        "post: w += lambda Wmax (1 - w/Wmax)^mu_plus K+; pre: w -= alpha lambda Wmax (w/Wmax)^mu_minus K-"
    )
    source: ClassVar[str] = "NEST 3.10 stdp_synapse; Guetig et al., J. Neurosci. 23:3697, 2003"


@dataclass(frozen=True, kw_only=True, eq=False)
class stdp_nn_symm(WeightDependent):
    """STDP in which each spike pairs with the last spike of the other side.

    NEST acts as if a pre spike had come at time 0: `pre_at_start` does so, too.
    Source: NEST 3.10, `stdp_nn_symm_synapse`; Morrison, Diesmann & Gerstner, Biol. Cybern. 98:459, 2008, fig. 7A.
    """

    equation: ClassVar[str] = (
        "post: w += lambda Wmax (1 - w/Wmax)^mu_plus k+; pre: w -= alpha lambda Wmax (w/Wmax)^mu_minus k-; "
        "k = exp(-t/tau), t since the last spike of a side"
    )
    source: ClassVar[str] = "NEST 3.10 stdp_nn_symm_synapse; Morrison et al., Biol. Cybern. 98:459, 2008"
    pre: ClassVar[tuple[Trace, ...]] = (Trace("tau_plus", nearest=True, starts="pre_at_start"),)
    post: ClassVar[tuple[Trace, ...]] = (Trace("tau_minus", nearest=True),)

    pre_at_start: bool = quantity(False, "", "begin as if a pre spike had come at time 0", kind="boolean")


@dataclass(frozen=True, kw_only=True, eq=False)
class stdp_nn_pre_centered(WeightDependent):
    """STDP in which each pre spike pairs with the post spike before it and with the one after it.

    So the first post spike after some pre spikes pairs with all of them, and sets K+ back to 0.
    Source: NEST 3.10, `stdp_nn_pre_centered_synapse`; Morrison, Diesmann & Gerstner, Biol. Cybern. 98:459, 2008,
    fig. 7B.
    """

    equation: ClassVar[str] = (
        "post: w += lambda Wmax (1 - w/Wmax)^mu_plus K+, K+ = 0; "
        "pre: w -= alpha lambda Wmax (w/Wmax)^mu_minus k-, K+ += 1; k- = exp(-t/tau_minus), t since the last post spike"
    )
    source: ClassVar[str] = "NEST 3.10 stdp_nn_pre_centered_synapse; Morrison et al., Biol. Cybern. 98:459, 2008"
    pre: ClassVar[tuple[Trace, ...]] = (Trace("tau_plus", nearest=True),)
    post: ClassVar[tuple[Trace, ...]] = (Trace("tau_minus", nearest=True),)
    states: ClassVar[tuple[State, ...]] = (
        State("unanswered", "", "K+ just after the last pre spike, of those since the last post spike", hidden=True),
    )

    def on_post(y, e, c, pre, post):
        """Potentiate by the pre spikes since the last post spike; `pre` is what is left of K+ of the last."""
        y[0, e] = potentiated(y[0, e], y[1, e] * pre[0], c)
        y[1, e] = 0.0

    def on_pre(y, e, c, pre, post):
        """Depress by the last post spike."""
        y[0, e] = depressed(y[0, e], post[0], c)
        y[1, e] = y[1, e] * pre[0] + 1.0


@dataclass(frozen=True, kw_only=True, eq=False)
class stdp_nn_restr(WeightDependent):
    """STDP in which each spike pairs only with its immediate neighbour of the other side.

    Of the post spikes between two pre spikes the first potentiates, and the last depresses at the second pre spike.
    NEST acts as if a pre spike had come at time 0: `pre_at_start` does so, too.
    Source: NEST 3.10, `stdp_nn_restr_synapse`; Morrison, Diesmann & Gerstner, Biol. Cybern. 98:459, 2008, fig. 7C.
    """

    equation: ClassVar[str] = (
        "first post since a pre: w += lambda Wmax (1 - w/Wmax)^mu_plus k+; "
        "pre after a post: w -= alpha lambda Wmax (w/Wmax)^mu_minus k-; "
        "k = exp(-t/tau), t since the last spike of a side"
    )
    source: ClassVar[str] = "NEST 3.10 stdp_nn_restr_synapse; Morrison et al., Biol. Cybern. 98:459, 2008"
    pre: ClassVar[tuple[Trace, ...]] = (Trace("tau_plus", nearest=True, starts="pre_at_start"),)
    post: ClassVar[tuple[Trace, ...]] = (Trace("tau_minus", nearest=True),)
    states: ClassVar[tuple[State, ...]] = (
        State("answered", "", "whether a post spike came since the last pre spike", hidden=True),
    )

    pre_at_start: bool = quantity(False, "", "begin as if a pre spike had come at time 0", kind="boolean")

    def on_post(y, e, c, pre, post):
        """Potentiate, if it is the first since the last pre spike."""
        if y[1, e] == 0.0:
            y[0, e] = potentiated(y[0, e], pre[0], c)
            y[1, e] = 1.0

    def on_pre(y, e, c, pre, post):
        """Depress, if a post spike came since the last pre spike."""
        if y[1, e] != 0.0:
            y[0, e] = depressed(y[0, e], post[0], c)
            y[1, e] = 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class stdp_literal(Synapse):
    """Multiplicative STDP read literally, w (1 + dw), of all pairs: a weight of 0 stays, and nothing bounds it above.

    `stdp` with mu_plus = mu_minus = 1 is the multiplicative rule with soft bounds.
    Source: Mosca, MSc thesis, 2020, eq. 19.
    """

    equation: ClassVar[str] = "post: w *= 1 + lambda K+; pre: w *= max(0, 1 - alpha lambda K-)"
    source: ClassVar[str] = "Mosca, MSc thesis, 2020, eqs 16 and 19"
    learns: ClassVar[str] = "pairs"

    tau_plus: float = quantity(20.0, "ms", "time constant of K+", above=0)
    lambda_: float = quantity(0.01, "", "step size", at_least=0)
    alpha: float = quantity(1.0, "", "depression relative to potentiation", at_least=0)

    def constants(p, h, c):
        """The steps by one pair of either order."""
        c[LAMBDA], c[DEPRESSION] = p[1], p[1] * p[2]

    def on_post(y, e, c, pre, post):
        """Potentiate by a share of the weight."""
        y[0, e] *= 1.0 + c[LAMBDA] * pre[0]

    def on_pre(y, e, c, pre, post):
        """Depress by a share of the weight, down to 0."""
        y[0, e] *= max(0.0, 1.0 - c[DEPRESSION] * post[0])


@dataclass(frozen=True, kw_only=True, eq=False)
class stdp_pl_hom(Synapse):
    """STDP of all pairs that potentiates by a power of the weight and depresses by a share of it, without upper bound.

    Weights are at least 0; one of 0 stays. Source: NEST 3.10, `stdp_pl_synapse_hom`; Morrison, Aertsen & Diesmann,
    Neural Comput. 19:1437, 2007.
    """

    equation: ClassVar[str] = "post: w += lambda w^mu K+; pre: w -= alpha lambda w K-"
    source: ClassVar[str] = "NEST 3.10 stdp_pl_synapse_hom; Morrison et al., Neural Comput. 19:1437, 2007"
    learns: ClassVar[str] = "pairs"

    tau_plus: float = quantity(20.0, "ms", "time constant of K+", above=0)
    lambda_: float = quantity(0.1, "", "step size", at_least=0)
    alpha: float = quantity(1.0, "", "depression relative to potentiation", at_least=0)
    mu: float = quantity(0.4, "", "power of the weight by which it is potentiated", at_least=0)

    def bounds(self) -> tuple[float, float]:
        """A power of a weight below 0 is NaN."""
        return 0.0, math.inf

    def constants(p, h, c):
        """The steps of one pair of either order, and the power."""
        c[LAMBDA], c[DEPRESSION], c[MU] = p[1], p[1] * p[2], p[3]

    def on_post(y, e, c, pre, post):
        """Potentiate by a power of the weight."""
        y[0, e] += c[LAMBDA] * y[0, e] ** c[MU] * pre[0]

    def on_pre(y, e, c, pre, post):
        """Depress by a share of the weight, down to 0."""
        y[0, e] = max(0.0, y[0, e] - c[DEPRESSION] * y[0, e] * post[0])


@dataclass(frozen=True, kw_only=True, eq=False)
class stdp_triplet(Synapse):
    """STDP by pairs and triplets, all to all: each side has a fast trace and a slow one.

    The slow ones, K+3 and K-3, are those just before the spike. The defaults are the fit to data from visual cortex.
    Wmax below 0 makes the synapse inhibitory. Source: NEST 3.10, `stdp_triplet_synapse`, where tau_minus_triplet
    belongs to the neuron; Pfister & Gerstner, J. Neurosci. 26:9673, 2006.
    """

    equation: ClassVar[str] = (
        "post: |w| += K+ (Aplus + Aplus_triplet K-3); pre: |w| -= K- (Aminus + Aminus_triplet K+3)"
    )
    source: ClassVar[str] = "NEST 3.10 stdp_triplet_synapse; Pfister & Gerstner, J. Neurosci. 26:9673, 2006"
    learns: ClassVar[str] = "pairs"
    pre: ClassVar[tuple[Trace, ...]] = (K_PLUS, Trace("tau_plus_triplet"))
    post: ClassVar[tuple[Trace, ...]] = (K_MINUS, Trace("tau_minus_triplet"))
    width: ClassVar[int] = 5

    tau_plus: float = quantity(16.8, "ms", "time constant of K+", above=0)
    tau_plus_triplet: float = quantity(101.0, "ms", "time constant of K+3", above=0)
    tau_minus_triplet: float = quantity(125.0, "ms", "time constant of K-3", above=0)
    Aplus: Value = quantity(
        5e-10, "", "potentiation by a pair, in the unit of the weight", at_least=0, of_value=True, **OF_EACH
    )
    Aplus_triplet: Value = quantity(
        6.2e-3, "", "potentiation by a triplet, likewise", at_least=0, of_value=True, **OF_EACH
    )
    Aminus: Value = quantity(7e-3, "", "depression by a pair, likewise", at_least=0, of_value=True, **OF_EACH)
    Aminus_triplet: Value = quantity(
        2.3e-4, "", "depression by a triplet, likewise", at_least=0, of_value=True, **OF_EACH
    )
    Wmax: Value = quantity(100.0, **LARGEST_WEIGHT)

    def constants(p, h, c):
        """Step sizes of the sign of Wmax, and Wmax."""
        for k in range(1, 5):
            c[k] = math.copysign(p[2 + k], p[7])
        c[LIMIT] = p[7]

    def on_post(y, e, c, pre, post):
        """Potentiate, up to Wmax."""
        y[0, e] = within(y[0, e] + pre[0] * (c[A_PLUS] + c[A_PLUS_TRIPLET] * post[1]), c[LIMIT])

    def on_pre(y, e, c, pre, post):
        """Depress, down to 0."""
        y[0, e] = within(y[0, e] - post[0] * (c[A_MINUS] + c[A_MINUS_TRIPLET] * pre[1]), c[LIMIT])


@dataclass(frozen=True, kw_only=True, eq=False)
class vogels_sprekeler(Synapse):
    """Near coincidences of either order strengthen a synapse, each pre spike weakens it: so it holds the post rate.

    That rate is alpha / (2 tau). Wmax is below 0 for an inhibitory synapse. K- has the target's own tau_minus, which is
    tau in the paper. Source: NEST 3.10, `vogels_sprekeler_synapse`; Vogels, Sprekeler, Zenke, Clopath & Gerstner,
    Science 334:1569, 2011.
    """

    equation: ClassVar[str] = "post: |w| += eta K+; pre: |w| += eta (K- - alpha)"
    source: ClassVar[str] = "NEST 3.10 vogels_sprekeler_synapse; Vogels et al., Science 334:1569, 2011"
    learns: ClassVar[str] = "pairs"
    pre: ClassVar[tuple[Trace, ...]] = (Trace("tau"),)
    width: ClassVar[int] = 3

    tau: float = quantity(20.0, "ms", "time constant of K+", above=0)
    eta: Value = quantity(0.001, "", "step size, in the unit of the weight", at_least=0, of_value=True, **OF_EACH)
    alpha: Value = quantity(
        0.12, "", "depression by a pre spike, in steps: 2 tau times the rate to hold", at_least=0, **OF_EACH
    )
    Wmax: Value = quantity(-100.0, **LARGEST_WEIGHT)

    def constants(p, h, c):
        """Step sizes of the sign of Wmax, and Wmax."""
        c[ETA], c[DEPRESSION] = math.copysign(p[1], p[3]), math.copysign(p[1] * p[2], p[3])
        c[LIMIT] = p[3]

    def on_post(y, e, c, pre, post):
        """Strengthen, up to Wmax."""
        y[0, e] = within(y[0, e] + c[ETA] * pre[0], c[LIMIT])

    def on_pre(y, e, c, pre, post):
        """Strengthen, up to Wmax; then weaken, down to 0."""
        y[0, e] = within(within(y[0, e] + c[ETA] * post[0], c[LIMIT]) - c[DEPRESSION], c[LIMIT])


@dataclass(frozen=True, kw_only=True, eq=False)
class tsodyks2(Synapse):
    """A pre spike releases the share u of the resources x that are left: w u x is sent, and w stays as it is.

    Between spikes x recovers towards 1 and u falls towards 0; u and x are shown as of the last pre spike. At first x is
    1 and u is U; in NEST itself u begins at 0.5 if nothing else is said, whatever U is.
    Source: NEST 3.10, `tsodyks2_synapse`; Maass & Markram, Neural Networks 15:155, 2002.
    """

    equation: ClassVar[str] = (
        "pre, t after the last: x = 1 + (x - x u - 1) exp(-t/tau_rec), u = U + u (1 - U) exp(-t/tau_fac); sends w u x"
    )
    source: ClassVar[str] = "NEST 3.10 tsodyks2_synapse; Maass & Markram, Neural Networks 15:155, 2002"
    learns: ClassVar[str] = "pairs"
    pre: ClassVar[tuple[Trace, ...]] = (Trace("tau_rec", nearest=True), Trace("tau_fac", nearest=True))
    post: ClassVar[tuple[Trace, ...]] = ()
    width: ClassVar[int] = 1
    states: ClassVar[tuple[State, ...]] = (
        State("u", "", "share of the resources that a spike releases"),
        State("x", "", "share of the resources that is left"),
    )

    U: Value = quantity(0.5, "", "what a spike adds to u, of what is missing to 1", at_least=0, at_most=1, **OF_EACH)
    tau_rec: float = quantity(800.0, "ms", "time constant of recovery", above=0)
    tau_fac: float = quantity(0.0, "ms", "time constant of facilitation; with 0 there is none", at_least=0)

    @staticmethod
    def initial(parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Rested: u is U and x is 1."""
        return {"u": parameters["U"], "x": 1.0}

    def constants(p, h, c):
        """U is all."""
        c[0] = p[0]

    def on_post(y, e, c, pre, post):
        """A post spike changes nothing."""

    def on_pre(y, e, c, pre, post):
        """Recover since the last spike; the first one finds the synapse rested."""
        u, x = y[1, e], y[2, e]
        y[2, e] = 1.0 + (x - x * u - 1.0) * pre[0]
        y[1, e] = c[0] + u * (1.0 - c[0]) * pre[1]

    def sent(y, e, c):
        """What is released."""
        return y[0, e] * y[1, e] * y[2, e]


D_MIN, D_MAX, A, TAU, BY_STEP, STEP = range(6)


def moved(delay, late, c):
    """A delay after a pair whose post spike comes `late` ms after the arrival."""
    apart = abs(late)
    if c[BY_STEP] != 0.0:
        change = math.copysign(min(c[STEP], apart), late) if apart <= c[TAU] else 0.0
    else:
        change = c[A] * late * math.exp(-apart / c[TAU]) if apart < math.inf else 0.0
    return min(c[D_MAX], max(c[D_MIN], delay + change))


@dataclass(frozen=True, kw_only=True, eq=False)
class stddp(DelayRule):
    """Spike-timing-dependent delay plasticity: weights stay, and inputs that come together arrive together.

    Where a pre spike arrives before a post spike, its synapse gets a longer delay, where it arrives after it, a shorter
    one. A post spike pairs with the last pre spike that set out before it, a pre spike with the last post spike before.
    The window is A dt exp(-|dt|/tau) or, with `by_step`, one step of the network up to |dt| = tau.
    Source: Wang et al., 2014, in Mosca, MSc thesis, 2020, fig. 32, which gives the direction; the windows are choices.
    """

    equation: ClassVar[str] = "d += A dt exp(-|dt|/tau), or a step, dt = t_post - (t_pre + d)"
    source: ClassVar[str] = "Wang et al., 2014, in Mosca, MSc thesis, 2020, fig. 32"
    learns: ClassVar[str] = "pairs"
    pre: ClassVar[tuple[Trace, ...]] = (Trace(""),)
    post: ClassVar[tuple[Trace, ...]] = (Trace(""),)

    A: float = quantity(0.1, "", "share of dt by which a delay changes at most", above=0, at_most=1)
    tau: float = quantity(20.0, "ms", "time constant of the window; with by_step its end", above=0)
    by_step: bool = quantity(False, "", "change by one step, however far apart", kind="boolean")

    def constants(p, h, c):
        """The parameters and the step."""
        c[:5] = p[:5]
        c[STEP] = h

    def on_post(y, e, c, pre, post):
        """Move the last arrival, or the one to come, towards this post spike."""
        y[DELAY, e] = moved(y[DELAY, e], pre[0] - y[DELAY, e], c)

    def on_pre(y, e, c, pre, post):
        """Move the arrival of this pre spike towards the last post spike, which is over."""
        y[DELAY, e] = moved(y[DELAY, e], -(post[0] + y[DELAY, e]), c)
