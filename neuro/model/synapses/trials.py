"""Learning rules that are applied at the end of a trial."""

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
"""Indices of the constants, which are the parameters of a rule. Each line after the first is for some rules only."""

INF = math.inf


def softly(w, rate, w_min, w_max):
    """Return a weight after a change by rate s (1 - s) (w_max - w_min), with s = (w - w_min) / (w_max - w_min)."""
    span = w_max - w_min
    share = (w - w_min) / span
    return min(w_max, max(w_min, w + span * rate * share * (1.0 - share)))


def rate_of(since, lesson, c):
    """Return the rate of an input of a rewarded or punished neuron. `since` is 0 in the tick of the decision."""
    if lesson > 0.0:
        return c[AR_PLUS] if since >= 0.0 else c[AR_MINUS]
    return c[AP_MINUS] if since >= 0.0 else c[AP_PLUS]


@dataclass(frozen=True, kw_only=True, eq=False)
class TrialRule(Synapse):
    """Base of rules for trials that change weights. The constants are the parameters."""

    learns: ClassVar[str] = "trials"
    ordered: ClassVar[tuple[tuple[str, str], ...]] = (("Wmin", "Wmax"),)

    Wmin: float = quantity(0.0, "", "smallest weight, in the unit of the weight", of_value=True)
    Wmax: float = quantity(1.0, "", "largest weight, in the unit of the weight", of_value=True)

    def constants(p, h, c):
        """Fill `c` with the parameters."""
        c[: len(p)] = p


@dataclass(frozen=True, kw_only=True, eq=False)
class r_stdp(TrialRule):
    """R-STDP: the inputs of the neuron that decided change by A w (1 - w) at the end of a trial.

    On reward, A is Ar_plus for inputs that arrived before the decision and Ar_minus for others. On punishment, A is
    Ap_minus for inputs before the decision and Ap_plus for others. On punishment and without a decision, every weight
    of the right label's maps grows by epsilon. With `rescue`, the best-excited neuron of these maps is rewarded
    instead, as if it had decided. An input that arrives in the tick of the decision contributed to the decision, so it
    is treated like an earlier input. With `ties_after`, such an input has the rate Ar_minus on reward, as in eq. 126.
    An input that never spikes is one of the others. On punishment the text of the thesis requires a spike after the
    decision instead. Weights are relative to [Wmin, Wmax].

    Source: Mosca, MSc thesis, 2020, eqs 126-128, with t^f(j) as the time of the input and t_i as the time of the
    decision, as the text around the equations requires. `rescue` is an extension of this project. The rule extends
    Mozafari et al., IEEE Trans. Neural Netw. Learn. Syst. 29:6178, 2018, which treats inputs in the tick of the
    decision like earlier inputs.
    """

    equation: ClassVar[str] = "dw = A w (1 - w), A by outcome and by whether the input came before the decision"
    source: ClassVar[str] = "Mosca, MSc thesis, 2020, eqs 126-128; Mozafari et al., IEEE TNNLS 29:6178, 2018"

    Ar_plus: float = quantity(0.075, "", "rate on reward, input before the decision")
    Ar_minus: float = quantity(-0.025, "", "rate on reward, other inputs")
    Ap_plus: float = quantity(0.005, "", "rate on punishment, other inputs")
    Ap_minus: float = quantity(-0.04, "", "rate on punishment, input before the decision")
    epsilon: float = quantity(
        0.0002, "", "growth of the right label's weights on punishment and without a decision", at_least=0
    )
    rescue: bool = quantity(
        False, "", "whether the right label's best-excited neuron is rewarded instead", kind="boolean"
    )
    ties_after: bool = quantity(
        False,
        "",
        "whether, on reward, an input in the tick of the decision counts as after the decision",
        kind="boolean",
    )

    def lessons(self, end: TrialEnd) -> list[Lesson | Growth]:
        """Return the neuron that decided and, after a wrong or missing decision, also the right label's maps."""
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
        """Return the new weight of an input of a rewarded or punished neuron."""
        counts_as_after = since == 0.0 and lesson > 0.0 and c[TIES_AFTER] > 0.0
        return softly(w, c[AR_MINUS] if counts_as_after else rate_of(since, lesson, c), c[W_MIN], c[W_MAX])

    def encourage(w, c):
        """Return the new weight of an input of a map of the right label after a wrong or missing decision (eq. 128)."""
        return min(c[W_MAX], max(c[W_MIN], w + (c[W_MAX] - c[W_MIN]) * c[EPSILON]))


@dataclass(frozen=True, kw_only=True, eq=False)
class mozafari(TrialRule):
    """R-STDP of Mozafari et al.: the inputs of the neuron that decided change by s A w (1 - w) at the end of a trial.

    On reward, A is Ar_plus for inputs that arrived before or at the decision and Ar_minus for others, and s is
    `misses`. On punishment, A is Ap_minus for inputs before the decision and Ap_plus for others, and s is `hits`.
    Without a decision nothing changes. `misses` and `hits` are the shares in the last batch of trials, set between
    batches by `sim.set`. A network with few errors thus hardly learns from rewards, and a network with many errors
    hardly learns from punishments. Weights are relative to [Wmin, Wmax].

    Source: Mozafari et al., IEEE Trans. Neural Netw. Learn. Syst. 29:6178, 2018; Mosca, MSc thesis, 2020, eqs 120 and
    121, read as eqs 126 and 127 of `r_stdp`. Eq. 120 has Ar_minus for inputs that arrive at the decision.
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
        """Return the new weight of an input of the neuron that decided."""
        share = c[MISSES] if lesson > 0.0 else c[HITS]
        return softly(w, share * rate_of(since, lesson, c), c[W_MIN], c[W_MAX])


@dataclass(frozen=True, kw_only=True, eq=False)
class first_spike_stdp(TrialRule):
    """Unsupervised STDP: the inputs of the neuron that decided change by A w (1 - w) at the end of a trial.

    A is A_plus for inputs that arrived before or at the decision, and A_minus for others. Weights are relative to
    [Wmin, Wmax]. The rule needs no labels: `neuro.assign_labels` assigns a label to each neuron after learning.

    Source: Masquelier & Thorpe, PLoS Comput. Biol. 3:e31, 2007; the rates are those of Kheradpisheh et al., Neural
    Networks 99:56, 2018.
    """

    equation: ClassVar[str] = "dw = A w (1 - w), A by whether the input came before the decision"
    source: ClassVar[str] = "Masquelier & Thorpe, PLoS Comput. Biol. 3:e31, 2007"
    supervised: ClassVar[bool] = False

    A_plus: float = quantity(0.004, "", "rate, input before the decision")
    A_minus: float = quantity(-0.003, "", "rate, other inputs")

    def lessons(self, end: TrialEnd) -> tuple[Lesson, ...]:
        """Return the neuron that decided."""
        return (Lesson(end.winner, end.tick, 1.0),) if end.winner >= 0 else ()

    def teach(w, since, lesson, c):
        """Return the new weight of an input of the neuron that decided."""
        return softly(w, c[A_PLUS] if since >= 0.0 else c[A_MINUS], c[W_MIN], c[W_MAX])


@dataclass(frozen=True, kw_only=True, eq=False)
class normalised_stdp(first_spike_stdp):
    """Unsupervised STDP with normalisation of the weights of the neuron that decided, at the end of a trial.

    A weight changes by A_plus (1 - w) if the input arrived before or at the decision, and by A_minus w otherwise,
    relative to [Wmin, Wmax]. Then all weights of the neuron are scaled to the sum `total`, and clipped. The rule needs
    no labels: `neuro.assign_labels` assigns a label to each neuron after learning.

    Source: Rubin et al., Phys. Rev. Lett. 86:364, 2001, for the bounds, which slow down changes towards them; Diehl &
    Cook, Front. Comput. Neurosci. 9:99, 2015, for the sum of the weights; their sum for 784 inputs is the default. The
    rates are a choice of this project.
    """

    equation: ClassVar[str] = "dw = A_plus (1 - w) or A_minus w by whether the input came; w *= total / sum w"
    source: ClassVar[str] = (
        "Rubin et al., Phys. Rev. Lett. 86:364, 2001; Diehl & Cook, Front. Comput. Neurosci. 9:99, 2015"
    )

    A_plus: float = quantity(0.05, "", "rate, input before the decision", at_least=0, at_most=1)
    A_minus: float = quantity(-0.01, "", "rate, other inputs", at_least=-1, at_most=0)
    total: float = quantity(
        78.0, "", "sum of the weights of a neuron, in the unit of the weight", above=0, of_value=True
    )
    Wmin: float = quantity(0.0, "", "smallest weight, in the unit of the weight", at_least=0, of_value=True)

    def teach(w, since, lesson, c):
        """Return the new weight of an input of the neuron that decided."""
        return w + c[A_PLUS] * (c[W_MAX] - w) if since >= 0.0 else w + c[A_MINUS] * (w - c[W_MIN])

    def settle(w, since, total, c):
        """Return the weight times one factor, with which the sum of all inputs becomes the parameter `total`.

        The argument `total` is the sum before. A sum of 0 stays 0.
        """
        return min(c[W_MAX], max(c[W_MIN], w * c[TOTAL] / total)) if total > 0.0 else w


@dataclass(frozen=True, kw_only=True, eq=False)
class tempotron(TrialRule):
    """Tempotron: after an error, inputs change by their contribution to the largest potential.

    For inputs that arrived at t_i, up to t_max, dw = +lambda K(t_max - t_i) if the neuron should have fired, and dw =
    -lambda K(t_max - t_i) if it should not have fired. K(t) = V0 (exp(-t/tau_m) - exp(-t/tau_s)) is a postsynaptic
    potential, with V0 so that its peak is 1. `tau_m` and `tau_s` are preferably those of the neuron (tau_m and
    tau_syn_ex of `iaf_psc_exp`, tau_m and 0 for `iaf_psc_delta`). For a neuron that decided wrongly t_max is the time
    of its spike. In a trial with a wrong or missing decision, the neuron that should have fired is the neuron of the
    right label with the largest V_m up to the decision, and t_max is the tick of this V_m.

    With `alone`, each neuron is taught independently, as in the paper, in trials in which no neuron decides (V_th is
    set out of reach while learning). V_m should have reached `alone` in all neurons of the right label, and in no other
    neuron. t_max is the tick of a neuron's largest V_m. Trials with a decision are treated as without `alone`.

    Source: Guetig & Sompolinsky, Nat. Neurosci. 9:420, 2006. Without `alone`, at most one neuron of a group fires, so
    no other neuron can err by firing.
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
    alone: float = quantity(
        INF, "mV", "V_m that each neuron learns by itself to reach or not to reach; .inf: one decides", infinite=True
    )

    def lessons(self, end: TrialEnd) -> list[Lesson]:
        """Return lessons after an error: for the neuron that decided and for the neuron that should have decided."""
        if end.winner < 0 and self.alone < INF:
            # Neurons that should have reached `alone` and did not, and neurons that reached it and should not have.
            assert end.peak is not None
            assert end.peak_tick is not None
            per_map = len(end.peak) // len(end.silenced)
            should_reach = np.repeat(np.isin(np.arange(len(end.silenced)), end.maps), per_map)
            errors = np.flatnonzero(np.repeat(~end.silenced, per_map) & ((end.peak >= self.alone) != should_reach))
            signs = np.where(should_reach[errors], 1.0, -1.0)
            return list(map(Lesson, errors.tolist(), end.peak_tick[errors].tolist(), signs.tolist()))
        if end.hit:
            return []
        lessons = [Lesson(end.winner, end.tick, -1.0)] if end.winner >= 0 else []
        neuron, tick = end.highest()
        if neuron >= 0:
            lessons.append(Lesson(neuron, tick, 1.0))
        return lessons

    def constants(p, h, c):
        """Fill `c` with the parameters, with the step size multiplied by V0."""
        c[: len(p)] = p
        if p[TAU_S] > 0.0 and p[TAU_M] < math.inf:
            ratio = p[TAU_M] / p[TAU_S]
            c[STEP] = p[STEP] * ratio ** (ratio / (ratio - 1.0)) / (ratio - 1.0)

    def teach(w, since, lesson, c):
        """Return the new weight of an input, by its contribution to the potential at the time of the lesson."""
        if since < 0.0:
            return w
        rise = math.exp(-since / c[TAU_S]) if c[TAU_S] > 0.0 else 0.0
        kernel = math.exp(-since / c[TAU_M]) - rise
        return min(c[W_MAX], max(c[W_MIN], w + lesson * c[STEP] * kernel))


@dataclass(frozen=True, kw_only=True, eq=False)
class r_stddp(DelayRule):
    """Reward-modulated delay plasticity: at the end of a trial, delays onto the neuron that decided change by A d.

    On reward, A is Ar_plus for inputs that arrived before or at the decision and Ar_minus for others. On punishment, A
    is Ap_minus for inputs before the decision and Ap_plus for others. Without a decision nothing changes. Inputs that
    contributed to a right decision should arrive earlier, so Ar_plus < 0 < Ar_minus. Inputs that contributed to a wrong
    decision should arrive later, so Ap_plus < 0 < Ap_minus. With the opposite signs, which are those of rules for
    weights, performance decreases. Weights do not change.

    Source: Mosca, MSc thesis, 2020, eq. 131, which has Ar_minus for inputs that arrive at the decision. The signs, and
    the use of arrivals instead of emissions, were chosen by measurement: other choices do not learn.
    """

    equation: ClassVar[str] = "dd = A d, A by outcome and by whether the input came before the decision"
    source: ClassVar[str] = "Mosca, MSc thesis, 2020, eq. 131"
    learns: ClassVar[str] = "trials"

    d_min: float = quantity(1.0, "ms", "shortest delay; changes are proportional, so near 0 they are slow", above=0)
    d_max: float = quantity(20.0, "ms", "longest delay, which fixes the size of the spike buffers", above=0)
    Ar_plus: float = quantity(-0.05, "", "rate on reward, input before the decision")
    Ar_minus: float = quantity(0.05, "", "rate on reward, other inputs")
    Ap_plus: float = quantity(-0.02, "", "rate on punishment, other inputs")
    Ap_minus: float = quantity(0.1, "", "rate on punishment, input before the decision")

    def constants(p, h, c):
        """Fill `c` with the parameters."""
        c[: len(p)] = p

    def teach(d, since, lesson, c):
        """Return the new delay of an input of a rewarded or punished neuron."""
        return min(c[D_MAX], max(c[D_MIN], d + rate_of(since, lesson, c) * d))
