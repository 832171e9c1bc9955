"""Rules that learn at the end of a trial."""

# mypy: disable-error-code="no-untyped-def,no-untyped-call", check-untyped-defs=False
from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from neuro.core.quantities import quantity
from neuro.model.synapses.base import DelayRule, Growth, Lesson, Synapse, TrialEnd

W_MIN, W_MAX, AR_PLUS, AR_MINUS, AP_PLUS, AP_MINUS = range(6)
EPSILON, TIES_AFTER = 6, 8
MISSES, HITS = 6, 7
A_PLUS, A_MINUS, TOTAL = range(2, 5)
STEP, TAU_M, TAU_S = range(2, 5)
D_MIN, D_MAX = range(2)
"""Constants, which are the parameters of a rule; those of the later lines belong to some rules."""

INF = math.inf


def softly(w, rate, w_min, w_max):
    """A weight after a change by rate w (1 - w), relative to its bounds."""
    span = w_max - w_min
    share = (w - w_min) / span
    return min(w_max, max(w_min, w + span * rate * share * (1.0 - share)))


def rate_of(since, lesson, c):
    """Rate of an input of a rewarded or punished neuron; at the decision counts as before it."""
    if lesson > 0.0:
        return c[AR_PLUS] if since >= 0.0 else c[AR_MINUS]
    return c[AP_MINUS] if since >= 0.0 else c[AP_PLUS]


@dataclass(frozen=True, kw_only=True, eq=False)
class TrialRule(Synapse):
    """Base of rules for trials that change weights; their constants are their parameters."""

    learns: ClassVar[str] = "trials"
    ordered: ClassVar[tuple[tuple[str, str], ...]] = (("Wmin", "Wmax"),)

    Wmin: float = quantity(0.0, "", "smallest weight, in the unit of the weight", of_value=True)
    Wmax: float = quantity(1.0, "", "largest weight, in the unit of the weight", of_value=True)

    def constants(p, h, c):
        """The constants are the parameters."""
        c[: len(p)] = p


@dataclass(frozen=True, kw_only=True, eq=False)
class r_stdp(TrialRule):
    """At the end of a trial the inputs of the neuron that decided change by A w (1 - w).

    Reward: A is Ar_plus where the input arrived before the decision and Ar_minus elsewhere. Punishment:
    Ap_minus before, Ap_plus elsewhere. On punishment and on silence every weight of the right label's maps
    grows by epsilon; with `rescue` their best-excited neuron is rewarded instead, as if it had decided.
    An input that arrives in the tick of the decision took part in it and counts as before. Eq. 126 as printed
    takes Ar_minus for this input on reward: `ties_after`. An input that never spikes counts as "elsewhere", also on
    punishment, where the text of the thesis asks for a spike after the decision. Weights are taken relative to
    [Wmin, Wmax].

    Source: Mosca, MSc thesis, 2020, eqs 126-128, in which t^f(j) is read as the time of the input and t_i as that
    of the decision, as the text around the equations needs. `rescue` is this project's. The rule extends Mozafari
    et al., IEEE Trans. Neural Netw. Learn. Syst. 29:6178, 2018, where ties count as before.
    """

    equation: ClassVar[str] = "dw = A w (1 - w), A by outcome and by whether the input came before the decision"
    source: ClassVar[str] = "Mosca, MSc thesis, 2020, eqs 126-128; Mozafari et al., IEEE TNNLS 29:6178, 2018"

    Ar_plus: float = quantity(0.075, "", "rate on reward, input before the decision")
    Ar_minus: float = quantity(-0.025, "", "rate on reward, other inputs")
    Ap_plus: float = quantity(0.005, "", "rate on punishment, other inputs")
    Ap_minus: float = quantity(-0.04, "", "rate on punishment, input before the decision")
    epsilon: float = quantity(0.0002, "", "growth of the right label's weights on punishment and silence", at_least=0)
    rescue: bool = quantity(False, "", "reward the right label's best-excited neuron instead", kind="boolean")
    ties_after: bool = quantity(
        False, "", "on reward an input in the tick of the decision counts as after the decision", kind="boolean"
    )

    def lessons(self, end: TrialEnd) -> list[Lesson | Growth]:
        """The neuron that decided; after a mistake or silence also the right label's maps."""
        lessons: list[Lesson | Growth] = []
        if end.reward:
            lessons.append(Lesson(end.winner, end.tick, end.reward))
        if end.hit:
            return lessons
        if self.rescue:
            best = end.best_excited()
            if best >= 0:
                lessons.append(Lesson(best, end.tick if end.tick >= 0 else end.ticks - 1, 1.0))
        elif self.epsilon > 0.0:
            lessons.append(Growth(end.maps))
        return lessons

    def teach(w, since, lesson, c):
        """New weight of one input of a rewarded or punished neuron."""
        late = since == 0.0 and lesson > 0.0 and c[TIES_AFTER] > 0.0
        return softly(w, c[AR_MINUS] if late else rate_of(since, lesson, c), c[W_MIN], c[W_MAX])

    def encourage(w, c):
        """New weight of one input of a map of the right label after a wrong or silent trial (eq. 128)."""
        return min(c[W_MAX], max(c[W_MIN], w + (c[W_MAX] - c[W_MIN]) * c[EPSILON]))


@dataclass(frozen=True, kw_only=True, eq=False)
class mozafari(TrialRule):
    """At the end of a trial the inputs of the neuron that decided change by s A w (1 - w).

    Reward: A is Ar_plus where the input arrived before the decision or with it and Ar_minus elsewhere, and s is
    `misses`. Punishment: Ap_minus before, Ap_plus elsewhere, and s is `hits`. Silence teaches nothing. The two shares
    are those of the last batch of trials, set between batches by `sim.set`: a network that is mostly right hardly
    learns from rewards, one that is mostly wrong hardly from punishments. Weights are taken relative to [Wmin, Wmax].

    Source: Mozafari et al., IEEE Trans. Neural Netw. Learn. Syst. 29:6178, 2018; Mosca, MSc thesis, 2020, eqs 120 and
    121, read as eqs 126 and 127 of `r_stdp`. Eq. 120 takes Ar_minus for what arrived with the decision.
    """

    equation: ClassVar[str] = "dw = s A w (1 - w), s = N_miss/N on reward, N_hit/N on punishment"
    source: ClassVar[str] = "Mozafari et al., IEEE TNNLS 29:6178, 2018"

    Ar_plus: float = quantity(0.004, "", "rate on reward, input before the decision")
    Ar_minus: float = quantity(-0.003, "", "rate on reward, other inputs")
    Ap_plus: float = quantity(0.0005, "", "rate on punishment, other inputs")
    Ap_minus: float = quantity(-0.004, "", "rate on punishment, input before the decision")
    misses: float = quantity(1.0, "", "share of wrong decisions in the last batch", at_least=0, at_most=1)
    hits: float = quantity(1.0, "", "share of right decisions in the last batch", at_least=0, at_most=1)

    def teach(w, since, lesson, c):
        """New weight of one input of the neuron that decided."""
        share = c[MISSES] if lesson > 0.0 else c[HITS]
        return softly(w, share * rate_of(since, lesson, c), c[W_MIN], c[W_MAX])


@dataclass(frozen=True, kw_only=True, eq=False)
class first_spike_stdp(TrialRule):
    """At the end of a trial the inputs of the neuron that decided change by A w (1 - w), whatever the label.

    A is A_plus where the input arrived before the decision or with it, A_minus elsewhere. Weights are taken relative to
    [Wmin, Wmax]. It needs no labels: `neuro.assign_labels` finds afterwards for what each neuron stands.

    Source: Masquelier & Thorpe, PLoS Comput. Biol. 3:e31, 2007; the rates are those of Kheradpisheh et al., Neural
    Networks 99:56, 2018.
    """

    equation: ClassVar[str] = "dw = A w (1 - w), A by whether the input came before the decision"
    source: ClassVar[str] = "Masquelier & Thorpe, PLoS Comput. Biol. 3:e31, 2007"
    supervised: ClassVar[bool] = False

    A_plus: float = quantity(0.004, "", "rate where the input came before the decision")
    A_minus: float = quantity(-0.003, "", "rate elsewhere")

    def lessons(self, end: TrialEnd) -> tuple[Lesson, ...]:
        """The neuron that decided."""
        return (Lesson(end.winner, end.tick, 1.0),) if end.winner >= 0 else ()

    def teach(w, since, lesson, c):
        """New weight of one input of the neuron that decided."""
        return softly(w, c[A_PLUS] if since >= 0.0 else c[A_MINUS], c[W_MIN], c[W_MAX])


@dataclass(frozen=True, kw_only=True, eq=False)
class normalised_stdp(first_spike_stdp):
    """At the end of a trial the inputs of the neuron that decided change, and then its weights are scaled to a sum.

    A weight grows by A_plus (1 - w) where the input arrived before the decision or with it and changes by A_minus w
    elsewhere, taken relative to [Wmin, Wmax]; then all weights of the neuron are multiplied by one factor, so that
    their sum is `total`, and cut at the bounds. It needs no labels: `neuro.assign_labels` finds afterwards for what
    each neuron stands.

    Source: the bounds, of which each slows down what moves towards it, Rubin et al., Phys. Rev. Lett. 86:364, 2001; the
    sum, which is theirs for 784 inputs, Diehl & Cook, Front. Comput. Neurosci. 9:99, 2015. The rates are ours.
    """

    equation: ClassVar[str] = "dw = A_plus (1 - w) or A_minus w by whether the input came; w *= total / sum w"
    source: ClassVar[str] = (
        "Rubin et al., Phys. Rev. Lett. 86:364, 2001; Diehl & Cook, Front. Comput. Neurosci. 9:99, 2015"
    )

    A_plus: float = quantity(0.05, "", "rate where the input came before the decision", at_least=0, at_most=1)
    A_minus: float = quantity(-0.01, "", "rate elsewhere", at_least=-1, at_most=0)
    total: float = quantity(
        78.0, "", "sum of the weights of a neuron, in the unit of the weight", above=0, of_value=True
    )
    Wmin: float = quantity(0.0, "", "smallest weight, in the unit of the weight", at_least=0, of_value=True)

    def teach(w, since, lesson, c):
        """New weight of one input of the neuron that decided."""
        return w + c[A_PLUS] * (c[W_MAX] - w) if since >= 0.0 else w + c[A_MINUS] * (w - c[W_MIN])

    def settle(w, since, total, c):
        """The same weight after those of all inputs, which have the sum `total`, are scaled; all 0 stay so."""
        return min(c[W_MAX], max(c[W_MIN], w * c[TOTAL] / total)) if total > 0.0 else w


@dataclass(frozen=True, kw_only=True, eq=False)
class tempotron(TrialRule):
    """After a mistake, inputs change by how much each added to the potential at its largest.

    dw = +lambda K(t_max - t_i) for the neuron that should have fired, dw = -lambda K(t_max - t_i) for the one that
    should not, over the inputs that arrived up to t_max. K(t) = V0 (exp(-t/tau_m) - exp(-t/tau_s)) is the course of a
    postsynaptic potential, V0 such that its largest value is 1: `tau_m` and `tau_s` are best those of the neuron
    (tau_m and tau_syn_ex of `iaf_psc_exp`; tau_m and 0 for `iaf_psc_delta`). A neuron that decided wrongly has its
    t_max at its spike. The one that should have fired is, in a wrong or silent trial, the neuron of the right label
    with the largest V_m up to the decision; t_max is the tick of it.

    With `alone`, each neuron is taught by itself, as in the paper: in a trial in which no neuron decides (V_th is set
    out of reach while learning), all neurons of the right label should have reached `alone`, and no others; t_max is
    the tick of a neuron's largest V_m. Where one decides, it is as without.

    Source: Guetig & Sompolinsky, Nat. Neurosci. 9:420, 2006. Without `alone`, one neuron of a group fires at most, so
    that of the others none erred by firing.
    """

    equation: ClassVar[str] = "dw = +-lambda K(t_max - t_i) after a mistake, K(t) = V0 (exp(-t/tau_m) - exp(-t/tau_s))"
    source: ClassVar[str] = "Guetig & Sompolinsky, Nat. Neurosci. 9:420, 2006"
    peaks: ClassVar[bool] = True
    ordered: ClassVar[tuple[tuple[str, str], ...]] = (("tau_s", "tau_m"), ("Wmin", "Wmax"))

    lambda_: float = quantity(0.01, "", "step size, in the unit of the weight", at_least=0, of_value=True)
    tau_m: float = quantity(15.0, "ms", "time constant of the membrane", above=0, infinite=True)
    tau_s: float = quantity(3.75, "ms", "time constant of the synaptic current", at_least=0)
    Wmin: float = quantity(-INF, "", "smallest weight, in the unit of the weight", infinite=True, of_value=True)
    Wmax: float = quantity(INF, "", "largest weight, in the unit of the weight", infinite=True, of_value=True)
    alone: float = quantity(INF, "mV", "V_m that each neuron is taught by itself to reach, or not", infinite=True)

    def lessons(self, end: TrialEnd) -> list[Lesson]:
        """After a mistake the neuron that decided, and the one that should have."""
        if end.winner < 0 and self.alone < INF:
            # Each neuron that did not reach what it should have, or did what it should not.
            assert end.peak is not None
            assert end.peak_tick is not None
            per_map = len(end.peak) // len(end.silenced)
            wanted = np.repeat(np.isin(np.arange(len(end.silenced)), end.maps), per_map)
            erred = np.flatnonzero(np.repeat(~end.silenced, per_map) & ((end.peak >= self.alone) != wanted))
            signs = np.where(wanted[erred], 1.0, -1.0)
            return list(map(Lesson, erred.tolist(), end.peak_tick[erred].tolist(), signs.tolist()))
        if end.hit:
            return []
        lessons = [Lesson(end.winner, end.tick, -1.0)] if end.winner >= 0 else []
        neuron, tick = end.highest()
        if neuron >= 0:
            lessons.append(Lesson(neuron, tick, 1.0))
        return lessons

    def constants(p, h, c):
        """The parameters, but the step with V0."""
        c[: len(p)] = p
        if p[TAU_S] > 0.0 and p[TAU_M] < math.inf:
            ratio = p[TAU_M] / p[TAU_S]
            c[STEP] = p[STEP] * ratio ** (ratio / (ratio - 1.0)) / (ratio - 1.0)

    def teach(w, since, lesson, c):
        """New weight of one input, by what it added to the potential at the moment of the lesson."""
        if since < 0.0:
            return w
        rise = math.exp(-since / c[TAU_S]) if c[TAU_S] > 0.0 else 0.0
        kernel = math.exp(-since / c[TAU_M]) - rise
        return min(c[W_MAX], max(c[W_MIN], w + lesson * c[STEP] * kernel))


@dataclass(frozen=True, kw_only=True, eq=False)
class r_stddp(DelayRule):
    """At the end of a trial the delays of the inputs of the neuron that decided change by A d; weights stay.

    Reward: A is Ar_plus where the input arrived before the decision or with it and Ar_minus elsewhere. Punishment:
    Ap_minus before, Ap_plus elsewhere. After silence nothing changes. What contributed to a right decision comes
    earlier from then on, so Ar_plus < 0 < Ar_minus, and the other way round after a wrong one: with the signs of rates
    of weights the rule unlearns.

    Source: Mosca, MSc thesis, 2020, eq. 131, which takes Ar_minus for what arrived with the decision; the signs, and
    that arrivals count and not emissions, are choices measured to learn.
    """

    equation: ClassVar[str] = "dd = A d, A by outcome and by whether the input came before the decision"
    source: ClassVar[str] = "Mosca, MSc thesis, 2020, eq. 131"
    learns: ClassVar[str] = "trials"

    d_min: float = quantity(1.0, "ms", "shortest delay; from near 0 none comes back soon", above=0)
    d_max: float = quantity(20.0, "ms", "longest delay; fixed, as it says how much may be under way", above=0)
    Ar_plus: float = quantity(-0.05, "", "rate on reward, input before the decision")
    Ar_minus: float = quantity(0.05, "", "rate on reward, other inputs")
    Ap_plus: float = quantity(-0.02, "", "rate on punishment, other inputs")
    Ap_minus: float = quantity(0.1, "", "rate on punishment, input before the decision")

    def constants(p, h, c):
        """The constants are the parameters."""
        c[: len(p)] = p

    def teach(d, since, lesson, c):
        """New delay of one input of a rewarded or punished neuron."""
        return min(c[D_MAX], max(c[D_MIN], d + rate_of(since, lesson, c) * d))
