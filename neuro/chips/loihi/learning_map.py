"""From `stdp` and `stdp_dopa` to rules of Loihi's learning engine, with what is lost on the way.

A trace that rises by `impulse` i stands for K = trace / i; a scale S = m 2^e makes S i the change by one pair, in
mantissas. Impulses of up to 31 leave room for K = 4 in 7 bits. With dopamine the tag holds the eligibility, 16 to 31
for the largest pair; r1 and r2 hold the positive and the negative part of n, and the weight moves in every 2^k-th step.

A post spike reaches a float synapse after its delay of D >= 1 steps, on the chip at once. A pair in one step is then
causal on both, but the window of the float model begins one step later: A_plus exp(-h / tau_plus) and A_minus give both
windows the float model's areas, so that uncorrelated spikes drift alike.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from neuro.chips.loihi.learning_fit import LARGEST_IMPULSE, SMALLEST_UPDATE, fading, nearest_fit, signal_fit, too_small
from neuro.core.errors import ModelError
from neuro.model.synapses import Synapse, stdp, stdp_dopa
from neuro.model.synapses.loihi_rule import (
    KEEP,
    LARGEST_CONSTANT,
    LARGEST_U,
    MANTISSA_BITS,
    TRACE_MAX,
    WIDTHS,
    Factor,
    LearningRule,
    Term,
    Trace,
)


@dataclass(frozen=True, slots=True)
class Mapped:
    """A rule of the chip that stands for a float synapse model.

    Attributes:
        rule: the rule.
        approximations: what differs, one sentence each.
        update: size of one change of the weight in mantissas: by one pair; for `stdp_dopa` in one application, after
            one pair, at the largest n or at that of one dopamine spike. Below `COARSE_UPDATE` it is worth a warning.
        n_scale: dopamine in 1/ms of one unit of r1 and r2; 0 without dopamine.
    """

    rule: LearningRule
    approximations: tuple[str, ...]
    update: float
    n_scale: float = 0.0


def rule_of(
    synapse: Synapse,
    resolution_ms: float,
    tau_minus: float,
    weight_scale: float,
    weight_bits: int = 8,
    *,
    delay: int = 1,
    largest_n: float = 1.0,
) -> Mapped:
    """The rule that does on Loihi what a float synapse model does.

    Args:
        synapse: a `stdp` or `stdp_dopa`.
        resolution_ms: length of a step in ms.
        tau_minus: time constant of the target's K- in ms.
        weight_scale: weight, in its unit, of one mantissa.
        weight_bits: bits of a weight, for the messages.
        delay: delay of the projection in steps.
        largest_n: largest |n| that a signal will set, in 1/ms.

    Raises:
        ModelError: the chip cannot do it; the hint is a way out.
    """
    if isinstance(synapse, stdp_dopa):
        mapped = _dopamine(synapse, resolution_ms, tau_minus, weight_scale, largest_n)
    elif isinstance(synapse, stdp):
        mapped = _pairs(synapse, resolution_ms, tau_minus, weight_scale)
    else:
        raise ModelError(
            "the learning engine runs stdp, stdp_dopa and loihi_learning",
            hint="run it on event, or send static weights: sim.network() has what was learnt",
        )
    shared = [
        f"weights have {weight_bits} bits and change by whole steps, stochastically rounded from 2^-7 of a mantissa",
        f"traces are 7-bit: K above {TRACE_MAX / LARGEST_IMPULSE:.3g} saturates; their decay is stochastically rounded",
        f"a post spike reaches its synapses at once, not after the delay ({delay} steps): the windows of pairs are "
        "shifted by it and keep their areas",
        "several spikes of a neuron in one step are one",
    ]
    return Mapped(mapped.rule, (*mapped.approximations, *shared), mapped.update, mapped.n_scale)


def _pairs(p: stdp, h: float, tau_minus: float, scale: float) -> Mapped:
    for word, mu in (("mu_plus", p.mu_plus), ("mu_minus", p.mu_minus)):
        if mu not in (0.0, 1.0):
            raise ModelError(
                f"stdp.{word} = {mu:g}: expected 0 or 1, which are sums of products on the chip",
                hint=f"{word}: {round(min(mu, 1.0))} is nearest",
                path=(word,),
            )
    top = p.Wmax / scale
    bound = _bound("stdp.Wmax", p.Wmax, scale)
    more: tuple[Factor, ...] = (Factor("w", -bound),) if p.mu_plus else ()
    less: tuple[Factor, ...] = (Factor("w"),) if p.mu_minus else ()
    plus, minus = p.lambda_ * (1.0 if p.mu_plus else top), p.alpha * p.lambda_ * (1.0 if p.mu_minus else top)
    terms, traces, notes = _sides(
        (plus * math.exp(-h / p.tau_plus), more, -1 if p.mu_plus else 1),
        (minus, less, -1),
        (p.tau_plus / h, tau_minus / h),
        "stdp.lambda",
    )
    if not math.isclose(bound, top, rel_tol=1e-9):
        notes += (f"Wmax = {p.Wmax:g} is {top:.5g} mantissas, taken as {bound}",)
    if not p.mu_plus:
        notes += (f"potentiation stops at the largest mantissa, {255 * scale:g}, not at Wmax = {p.Wmax:g}",)
    if p.mu_plus or p.mu_minus:
        notes += ("changes that depend on the weight are cut towards 0 to 2^-7 of a mantissa",)
    return Mapped(LearningRule(terms, traces=traces), notes, p.lambda_ * top)


def _dopamine(p: stdp_dopa, h: float, tau_minus: float, scale: float, largest_n: float) -> Mapped:
    if p.A_plus == p.A_minus == 0.0:
        raise ModelError("stdp_dopa.A_plus = A_minus = 0: nothing to learn", path=("A_plus",))
    one = _tag_of_one(abs(p.A_plus) * math.exp(-h / p.tau_plus), abs(p.A_minus))
    dt, traces, notes = _sides(
        (p.A_plus * one * math.exp(-h / p.tau_plus), (), 1),
        (p.A_minus * one, (), -1),
        (p.tau_plus / h, tau_minus / h),
        "stdp_dopa.A_plus",
    )
    fade, told = fading(p.tau_c / h)
    every = max(0, min(LARGEST_U, math.floor(math.log2(max(1.0, min(p.tau_c, p.tau_n) / h / 8)))))
    gain = 2.0**every * h / one / scale  # mantissas in one application, of one tag unit at n = 1/ms
    if p.dopamine is None:
        fit, n_scale = signal_fit(gain, largest_n, p.b)
    else:
        fit = nearest_fit(gain / p.tau_n, MANTISSA_BITS + WIDTHS["t"] + WIDTHS["r1"], "stdp_dopa.A_plus")
        n_scale = 1.0 / p.tau_n / fit.impulse
        notes += (f"dopamine of one spike is {fit.value * p.tau_n / gain - 1:+.1%} off",)
    baseline = round(p.b / n_scale)
    if abs(baseline) > LARGEST_CONSTANT:
        raise ModelError(
            f"stdp_dopa.b = {p.b:g}: {baseline} units of {n_scale:.3g}: expected at most {LARGEST_CONSTANT}",
            path=("b",),
        )
    moving = (Factor("t"), Factor("r1", -baseline)), (Factor("t"), Factor("r2"))
    dw = tuple(
        Term(sign * fit.mantissa, fit.exponent, "u", every, part) for sign, part in zip((1, -1), moving, strict=True)
    )
    keep = Trace.exponential(0, p.tau_n / h)
    traces |= {"r1": Trace(fit.impulse, keep.numerator, KEEP), "r2": keep}
    notes += (
        told,
        f"n is r1 - r2 in units of {n_scale:.4g} 1/ms, 7 bits each; b = {p.b:g} is {baseline * n_scale:.4g}",
        f"the eligibility is a 9-bit tag, {one:.4g} for each of its units; beyond {255 / one:.4g} it saturates",
        f"the weight moves by c (n - b) of every {2**every}th step, cut towards 0 to 2^-7 of a mantissa",
        f"the chip clips at 0 and 255 mantissas ({255 * scale:g}), not at Wmin = {p.Wmin:g} and Wmax = {p.Wmax:g}",
    )
    update = gain * one * max(abs(p.A_plus), abs(p.A_minus)) * (largest_n if p.dopamine is None else 1.0 / p.tau_n)
    if update < SMALLEST_UPDATE:
        raise too_small("stdp_dopa", update)
    return Mapped(LearningRule(dw, (*dt, *fade), traces), notes, update, n_scale)


def _tag_of_one(plus: float, minus: float) -> float:
    """Units of the tag for an eligibility of 1: the larger side is some whole impulse, the other one nearly exact."""
    larger, smaller = max(plus, minus), min(plus, minus)
    sizes = [impulse / larger for impulse in range(LARGEST_IMPULSE // 2 + 1, LARGEST_IMPULSE + 1)]
    if smaller == 0.0:
        return sizes[-1]
    bits = MANTISSA_BITS + WIDTHS["x1"]
    return min(
        sizes, key=lambda one: abs(nearest_fit(smaller * one, bits, "stdp_dopa.A_minus").value / one / smaller - 1)
    )


def _sides(
    plus: tuple[float, tuple[Factor, ...], int],
    minus: tuple[float, tuple[Factor, ...], int],
    taus: tuple[float, float],
    what: str,
) -> tuple[tuple[Term, ...], dict[str, Trace], tuple[str, ...]]:
    """Products, traces and notes of potentiation (y0 x1) and depression (x0 (y1 - y2)); y2 is a spike of this step.

    Each side is its change by one pair, the factors beside its trace, and its sign; `taus` are in steps.
    """
    terms: list[Term] = []
    traces: dict[str, Trace] = {}
    notes: list[str] = []
    for (change, more, sign), gate, trace, tau in zip((plus, minus), ("y0", "x0"), ("x1", "y1"), taus, strict=True):
        if change == 0.0:
            continue
        if change < 0.0:
            change, sign = -change, -sign
        fit = nearest_fit(change, MANTISSA_BITS + WIDTHS[trace] + sum(WIDTHS[f.name] for f in more), what)
        terms.append(Term(sign * fit.mantissa, fit.exponent, gate, 0, (Factor(trace), *more)))
        traces[trace] = Trace.exponential(fit.impulse, tau)
        if trace == "y1":
            terms.append(Term(-sign * fit.mantissa, fit.exponent, gate, 0, (Factor("y2"), *more)))
            traces["y2"] = Trace(fit.impulse, 0, 1)
        off = fit.value / change - 1
        if abs(off) > 1e-3:
            notes.append(f"{'potentiation' if gate == 'y0' else 'depression'} is {off:+.1%} off")
    return tuple(terms), traces, tuple(notes)


def _bound(what: str, weight: float, scale: float) -> int:
    bound = round(weight / scale)
    if not 0 < bound <= LARGEST_CONSTANT:
        raise ModelError(
            f"{what} = {weight:g}: {bound} mantissas of {scale:g}: expected 1 to {LARGEST_CONSTANT}",
            hint="change the weight exponent of the projection",
        )
    return bound
