"""Rules of spike pairs and triplets, and short-term plasticity."""

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
"""Indices of the constants. The first line belongs to `WeightDependent`, each later line to one or two other rules."""

LARGEST_WEIGHT: Mapping[str, Any] = {
    "doc": "largest weight, in the unit of the weight; negative if inhibitory",
    "nonzero": True,
    "of_value": True,
    **OF_EACH,
}
"""Options of the parameter Wmax, with a value for all synapses or per synapse."""


def power(share, mu):
    """Return share^mu, mu > 0, of a share of Wmax. The exponent 1, which is frequent, costs no computation."""
    return share if mu == 1.0 else share**mu


def potentiation(w, k, c):
    """Return the change of a weight by a potentiation by k, without bounds."""
    w_max, mu = c[W_MAX], c[MU_PLUS]
    dependence = 1.0 if mu == 0.0 else power(1.0 - w / w_max, mu)
    return w_max * c[LAMBDA] * dependence * k


def depression(w, k, c):
    """Return the change of a weight by a depression by k, without bounds."""
    w_max, mu = c[W_MAX], c[MU_MINUS]
    dependence = 1.0 if mu == 0.0 else power(w / w_max, mu)
    return -(w_max * c[ALPHA] * c[LAMBDA] * dependence * k)


def potentiated(w, k, c):
    """Return a weight after a potentiation by k, at most Wmax."""
    return within(w + potentiation(w, k, c), c[W_MAX])


def depressed(w, k, c):
    """Return a weight after a depression by k, at least 0."""
    return within(w + depression(w, k, c), c[W_MAX])


def within(w, w_max):
    """Return a weight clipped between 0 and `w_max`, which is negative for inhibitory synapses."""
    return min(max(w, 0.0), w_max) if w_max > 0.0 else max(min(w, 0.0), w_max)


@dataclass(frozen=True, kw_only=True, eq=False)
class WeightDependent(Synapse):
    """Base of the rules with a weight dependence from additive (mu = 0) to multiplicative (mu = 1), Guetig et al."""

    learns: ClassVar[str] = "pairs"
    width: ClassVar[int] = 6

    tau_plus: float = quantity(20.0, "ms", "time constant of K+", above=0)
    lambda_: Value = quantity(0.01, "", "step size", at_least=0, **OF_EACH)
    alpha: Value = quantity(1.0, "", "depression relative to potentiation", at_least=0, **OF_EACH)
    mu_plus: Value = quantity(1.0, "", "weight dependence of potentiation", at_least=0, **OF_EACH)
    mu_minus: Value = quantity(1.0, "", "weight dependence of depression", at_least=0, **OF_EACH)
    Wmax: Value = quantity(100.0, **LARGEST_WEIGHT)

    def constants(p, h, c):
        """Fill `c` with the parameters."""
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

    The additive rule has mu_plus = mu_minus = 0, the rule with soft bounds has 1 for both, van Rossum's rule has
    mu_plus = 0 and mu_minus = 1, and Guetig's rule has values between 0 and 1.
    The weight changes at pre spikes. A negative Wmax makes the synapse inhibitory.
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

    NEST behaves as if a pre spike had arrived at time 0. `pre_at_start` does the same.
    Source: NEST 3.10, `stdp_nn_symm_synapse`; Morrison, Diesmann & Gerstner, Biol. Cybern. 98:459, 2008, fig. 7A.
    """

    equation: ClassVar[str] = (
        "post: w += lambda Wmax (1 - w/Wmax)^mu_plus k+; pre: w -= alpha lambda Wmax (w/Wmax)^mu_minus k-; "
        "k = exp(-t/tau), t since the last spike of a side"
    )
    source: ClassVar[str] = "NEST 3.10 stdp_nn_symm_synapse; Morrison et al., Biol. Cybern. 98:459, 2008"
    pre: ClassVar[tuple[Trace, ...]] = (Trace("tau_plus", nearest=True, starts="pre_at_start"),)
    post: ClassVar[tuple[Trace, ...]] = (Trace("tau_minus", nearest=True),)

    pre_at_start: bool = quantity(False, "", "whether K+ starts as after a pre spike at time 0", kind="boolean")


@dataclass(frozen=True, kw_only=True, eq=False)
class stdp_nn_pre_centered(WeightDependent):
    """STDP in which each pre spike pairs with the last post spike before and the first post spike after.

    The first post spike after several pre spikes pairs with all of them, and resets K+ to 0.
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
        State("unanswered", "", "K+ at the last pre spike, from the pre spikes since the last post spike", hidden=True),
    )

    def on_post(y, e, c, pre, post):
        """Potentiate by the pre spikes since the last post spike. `pre[0]` is the decay since the last of them."""
        y[0, e] = potentiated(y[0, e], y[1, e] * pre[0], c)
        y[1, e] = 0.0

    def on_pre(y, e, c, pre, post):
        """Depress by the last post spike."""
        y[0, e] = depressed(y[0, e], post[0], c)
        y[1, e] = y[1, e] * pre[0] + 1.0


@dataclass(frozen=True, kw_only=True, eq=False)
class stdp_nn_restr(WeightDependent):
    """STDP in which each spike pairs only with its immediate neighbour of the other side.

    If several post spikes lie between two pre spikes, the first post spike potentiates. The second pre spike depresses
    by the last post spike.
    NEST behaves as if a pre spike had arrived at time 0. `pre_at_start` does the same.
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
        State("answered", "", "whether a post spike occurred since the last pre spike", hidden=True),
    )

    pre_at_start: bool = quantity(False, "", "whether K+ starts as after a pre spike at time 0", kind="boolean")

    def on_post(y, e, c, pre, post):
        """Potentiate at the first post spike since the last pre spike."""
        if y[1, e] == 0.0:
            y[0, e] = potentiated(y[0, e], pre[0], c)
            y[1, e] = 1.0

    def on_pre(y, e, c, pre, post):
        """Depress if a post spike occurred since the last pre spike."""
        if y[1, e] != 0.0:
            y[0, e] = depressed(y[0, e], post[0], c)
            y[1, e] = 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class stdp_literal(Synapse):
    """Multiplicative STDP of all pairs, in which each pair multiplies the weight by 1 + dw.

    This is the literal form of eq. 19. A weight of 0 does not change, and there is no maximum.

    The multiplicative rule with soft bounds is `stdp` with mu_plus = mu_minus = 1.
    Source: Mosca, MSc thesis, 2020, eq. 19.
    """

    equation: ClassVar[str] = "post: w *= 1 + lambda K+; pre: w *= max(0, 1 - alpha lambda K-)"
    source: ClassVar[str] = "Mosca, MSc thesis, 2020, eqs 16 and 19"
    learns: ClassVar[str] = "pairs"

    tau_plus: float = quantity(20.0, "ms", "time constant of K+", above=0)
    lambda_: float = quantity(0.01, "", "step size", at_least=0)
    alpha: float = quantity(1.0, "", "depression relative to potentiation", at_least=0)

    def constants(p, h, c):
        """Fill `c` with the changes by a pair of either order."""
        c[LAMBDA], c[DEPRESSION] = p[1], p[1] * p[2]

    def on_post(y, e, c, pre, post):
        """Potentiate by a share of the weight."""
        y[0, e] *= 1.0 + c[LAMBDA] * pre[0]

    def on_pre(y, e, c, pre, post):
        """Depress by a share of the weight, down to 0."""
        y[0, e] *= max(0.0, 1.0 - c[DEPRESSION] * post[0])


@dataclass(frozen=True, kw_only=True, eq=False)
class stdp_pl_hom(Synapse):
    """STDP of all pairs with potentiation by a power of the weight and depression by a share of it, without a maximum.

    Weights are at least 0, and a weight of 0 does not change. Source: NEST 3.10, `stdp_pl_synapse_hom`; Morrison,
    Aertsen & Diesmann, Neural Comput. 19:1437, 2007.
    """

    equation: ClassVar[str] = "post: w += lambda w^mu K+; pre: w -= alpha lambda w K-"
    source: ClassVar[str] = "NEST 3.10 stdp_pl_synapse_hom; Morrison et al., Neural Comput. 19:1437, 2007"
    learns: ClassVar[str] = "pairs"

    tau_plus: float = quantity(20.0, "ms", "time constant of K+", above=0)
    lambda_: float = quantity(0.1, "", "step size", at_least=0)
    alpha: float = quantity(1.0, "", "depression relative to potentiation", at_least=0)
    mu: float = quantity(0.4, "", "exponent of the weight in the potentiation", at_least=0)

    def bounds(self) -> tuple[float, float]:
        """Return 0 and infinity, because a power of a negative weight is NaN."""
        return 0.0, math.inf

    def constants(p, h, c):
        """Fill `c` with the changes by a pair of either order, and the exponent."""
        c[LAMBDA], c[DEPRESSION], c[MU] = p[1], p[1] * p[2], p[3]

    def on_post(y, e, c, pre, post):
        """Potentiate by a power of the weight."""
        y[0, e] += c[LAMBDA] * y[0, e] ** c[MU] * pre[0]

    def on_pre(y, e, c, pre, post):
        """Depress by a share of the weight, down to 0."""
        y[0, e] = max(0.0, y[0, e] - c[DEPRESSION] * y[0, e] * post[0])


@dataclass(frozen=True, kw_only=True, eq=False)
class stdp_triplet(Synapse):
    """STDP by pairs and triplets, all to all. Each side has a fast and a slow trace.

    The slow traces K+3 and K-3 are read just before the spike of their own side is added. The defaults are the fit to
    data from visual cortex. A negative Wmax makes the synapse inhibitory. Source: NEST 3.10, `stdp_triplet_synapse`,
    where tau_minus_triplet is a parameter of the neuron; Pfister & Gerstner, J. Neurosci. 26:9673, 2006.
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
        6.2e-3, "", "potentiation by a triplet, in the unit of the weight", at_least=0, of_value=True, **OF_EACH
    )
    Aminus: Value = quantity(
        7e-3, "", "depression by a pair, in the unit of the weight", at_least=0, of_value=True, **OF_EACH
    )
    Aminus_triplet: Value = quantity(
        2.3e-4, "", "depression by a triplet, in the unit of the weight", at_least=0, of_value=True, **OF_EACH
    )
    Wmax: Value = quantity(100.0, **LARGEST_WEIGHT)

    def constants(p, h, c):
        """Fill `c` with step sizes that have the sign of Wmax, and Wmax."""
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
    """Homeostatic plasticity of inhibitory synapses, which keeps the post neuron at a target rate.

    Near coincidences of either order strengthen the synapse, and each pre spike weakens it. The target rate is
    alpha / (2 tau). Wmax is negative for an inhibitory synapse. The time constant of K- is the target's parameter
    tau_minus; in the paper it is tau. Source: NEST 3.10, `vogels_sprekeler_synapse`; Vogels, Sprekeler, Zenke, Clopath
    & Gerstner, Science 334:1569, 2011.
    """

    equation: ClassVar[str] = "post: |w| += eta K+; pre: |w| += eta (K- - alpha)"
    source: ClassVar[str] = "NEST 3.10 vogels_sprekeler_synapse; Vogels et al., Science 334:1569, 2011"
    learns: ClassVar[str] = "pairs"
    pre: ClassVar[tuple[Trace, ...]] = (Trace("tau"),)
    width: ClassVar[int] = 3

    tau: float = quantity(20.0, "ms", "time constant of K+", above=0)
    eta: Value = quantity(0.001, "", "step size, in the unit of the weight", at_least=0, of_value=True, **OF_EACH)
    alpha: Value = quantity(
        0.12, "", "depression by a pre spike, in units of eta: 2 tau times the target rate", at_least=0, **OF_EACH
    )
    Wmax: Value = quantity(-100.0, **LARGEST_WEIGHT)

    def constants(p, h, c):
        """Fill `c` with step sizes that have the sign of Wmax, and Wmax."""
        c[ETA], c[DEPRESSION] = math.copysign(p[1], p[3]), math.copysign(p[1] * p[2], p[3])
        c[LIMIT] = p[3]

    def on_post(y, e, c, pre, post):
        """Strengthen, up to Wmax."""
        y[0, e] = within(y[0, e] + c[ETA] * pre[0], c[LIMIT])

    def on_pre(y, e, c, pre, post):
        """Strengthen, up to Wmax, then weaken, down to 0."""
        y[0, e] = within(within(y[0, e] + c[ETA] * post[0], c[LIMIT]) - c[DEPRESSION], c[LIMIT])


@dataclass(frozen=True, kw_only=True, eq=False)
class tsodyks2(Synapse):
    """Short-term plasticity: a pre spike releases the share u of the available resources x, and w u x is sent.

    The weight w does not change. Between spikes x recovers towards 1 and u decays towards 0. The recorded u and
    x are their values at the last pre spike. Initially x is 1 and u is U. In NEST u is initially 0.5 for any U.
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
        State("x", "", "available share of the resources"),
    )

    U: Value = quantity(0.5, "", "increase of u per spike, as a share of 1 - u", at_least=0, at_most=1, **OF_EACH)
    tau_rec: float = quantity(800.0, "ms", "time constant of recovery", above=0)
    tau_fac: float = quantity(0.0, "ms", "time constant of facilitation; 0: no facilitation", at_least=0)

    @staticmethod
    def initial(parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Return u = U and x = 1, the state at rest."""
        return {"u": parameters["U"], "x": 1.0}

    def constants(p, h, c):
        """Fill `c` with U."""
        c[0] = p[0]

    def on_post(y, e, c, pre, post):
        """Do nothing, because the rule has no post traces."""

    def on_pre(y, e, c, pre, post):
        """Update u and x for the time since the last pre spike. The first spike finds the synapse at rest."""
        u, x = y[1, e], y[2, e]
        y[2, e] = 1.0 + (x - x * u - 1.0) * pre[0]
        y[1, e] = c[0] + u * (1.0 - c[0]) * pre[1]

    def sent(y, e, c):
        """Return the released amount."""
        return y[0, e] * y[1, e] * y[2, e]


D_MIN, D_MAX, A, TAU, BY_STEP, STEP = range(6)


def changed_delay(delay, lag, c):
    """Return a delay after a pair whose post spike occurs `lag` ms after the arrival of the pre spike."""
    distance = abs(lag)
    if c[BY_STEP] != 0.0:
        change = math.copysign(min(c[STEP], distance), lag) if distance <= c[TAU] else 0.0
    else:
        change = c[A] * lag * math.exp(-distance / c[TAU]) if distance < math.inf else 0.0
    return min(c[D_MAX], max(c[D_MIN], delay + change))


@dataclass(frozen=True, kw_only=True, eq=False)
class stddp(DelayRule):
    """Spike-timing-dependent delay plasticity: delays change so that inputs arrive together. Weights do not change.

    The delay of a synapse increases if a pre spike arrives before a post spike, and decreases if it arrives after. A
    post spike pairs with the last pre spike emitted before it, and a pre spike pairs with the last post spike. The
    window is A dt exp(-|dt|/tau) or, with `by_step`, one step of the network up to |dt| = tau.
    Source: Wang et al., 2014, in Mosca, MSc thesis, 2020, fig. 32. The figure gives the direction of a change; the
    windows are choices of this project.
    """

    equation: ClassVar[str] = "d += A dt exp(-|dt|/tau), or a step, dt = t_post - (t_pre + d)"
    source: ClassVar[str] = "Wang et al., 2014, in Mosca, MSc thesis, 2020, fig. 32"
    learns: ClassVar[str] = "pairs"
    pre: ClassVar[tuple[Trace, ...]] = (Trace(""),)
    post: ClassVar[tuple[Trace, ...]] = (Trace(""),)

    A: float = quantity(0.1, "", "largest change of a delay, as a share of dt", above=0, at_most=1)
    tau: float = quantity(20.0, "ms", "time constant of the window; with by_step its length", above=0)
    by_step: bool = quantity(False, "", "whether a delay changes by one step, whatever dt is", kind="boolean")

    def constants(p, h, c):
        """Fill `c` with the parameters and the step."""
        c[:5] = p[:5]
        c[STEP] = h

    def on_post(y, e, c, pre, post):
        """Move the arrival of the last pre spike towards this post spike."""
        y[DELAY, e] = changed_delay(y[DELAY, e], pre[0] - y[DELAY, e], c)

    def on_pre(y, e, c, pre, post):
        """Move the arrival of this pre spike towards the last post spike."""
        y[DELAY, e] = changed_delay(y[DELAY, e], -(post[0] + y[DELAY, e]), c)
