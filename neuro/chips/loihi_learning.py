"""Conversion of `stdp` and `stdp_dopa` to scales, impulses and rules of Loihi's learning engine.

A trace that rises by an impulse i represents K = trace / i. With a scale S = m 2^e, one pair changes the weight by S i
mantissas. Impulses are at most 31, so that 7 bits can hold K = 4. With dopamine the tag holds the eligibility, 16 to 31
units for the largest change by one pair. r1 and r2 hold the positive and the negative part of n, and the weight moves
in every 2^k-th step.

A post spike reaches a float synapse after its delay of D >= 1 steps, but a synapse on the chip at once. A pair in one
step is causal in both, but the window of the float model begins one step later. The amplitudes A_plus exp(-h /
tau_plus) and A_minus give both windows the areas of the float model, so that uncorrelated spikes cause the same drift.

On Loihi 2 the target sends y1, y2 and y3 (lava's Loihi3FLearningRule): y1 is a trace of its spikes before this step,
and y2 and y3 replace r1 and r2. lava has one u_k for a whole rule. lava also truncates the 5 lowest bits of a tag times
a trace downwards, so that small changes of both signs would lower the weight. The target therefore rounds n
stochastically to one of 16 levels, multiples of 8, and the mantissa is 4, so that no product has the lowest bits.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

from neuro.chips.description import Chip
from neuro.chips.fixed import FixedProjection
from neuro.chips.inputs import LEARN_ELSEWHERE, Options, approximated, foreign, largest_signal, no_rule, refused
from neuro.core.errors import ModelError
from neuro.model.synapses import Modulated, Synapse, loihi_learning, stdp, stdp_dopa
from neuro.model.synapses.loihi_registers import LoihiEngine
from neuro.model.synapses.loihi_rule import (
    FRACTION_BITS,
    KEEP,
    LARGEST_CONSTANT,
    LARGEST_EXPONENT,
    LARGEST_U,
    LEVEL,
    MANTISSA_BITS,
    MODULATORY,
    POST,
    PRODUCT_BITS,
    TRACE_MAX,
    WIDTHS,
    Factor,
    LearningRule,
    Outgoing,
    Term,
    Trace,
)
from neuro.program.backend import SAVE_FROZEN, Problem
from neuro.program.program import Program

LARGEST_IMPULSE = 31
"""Largest impulse of a trace: four spikes fit into 7 bits."""
SMALLEST_UPDATE = 2.0**-FRACTION_BITS
"""Smallest change in mantissas. The chip truncates smaller changes to 0, so mappings with such a change are refused."""
COARSE_UPDATE = 16 * SMALLEST_UPDATE
"""Changes below this number of mantissas lose up to 6 %, or a trace has fewer than 16 levels. A problem is reported."""
_MANTISSAS = (1, 3, 5, 7)
LEAST_SHIFT = 3
"""Smallest number of low bits dropped from the modulatory trace of a target; 7 bits then have 16 levels."""


@dataclass(frozen=True, slots=True)
class Fit:
    """An impulse and a scale mantissa x 2^exponent; `value` is their product."""

    impulse: int
    mantissa: int
    exponent: int

    @property
    def value(self) -> float:
        """Change by one spike."""
        return self.impulse * self.mantissa * 2.0**self.exponent


def nearest_fit(change: float, bits: int, label: str) -> Fit:
    """Return the impulse and scale with the product nearest to a change. Within 1 %, the largest impulse is taken.

    Raises:
        ModelError: no product is within a quarter of the change.
    """
    lowest = -FRACTION_BITS - max(0, bits - PRODUCT_BITS)
    candidates = []
    for impulse in range(1, LARGEST_IMPULSE + 1):
        for mantissa in _MANTISSAS:
            exponent = round(math.log2(change / (impulse * mantissa)))
            fit = Fit(impulse, mantissa, min(LARGEST_EXPONENT, max(lowest, exponent)))
            error = abs(fit.value / change - 1.0)
            candidates.append(((error > 0.01, error if error > 0.01 else -impulse, mantissa), fit, error))
    _, fit, error = min(candidates, key=lambda entry: entry[0])
    if error > 0.25:
        raise too_small(label, change) if fit.value > change else too_large(label, change)
    return fit


def signal_fit(gain: float, largest_n: float, b: float) -> tuple[Fit, float]:
    """Return a scale and the unit of r1 and r2. The scale is exact, and `largest_n` fits 7 bits in this unit.

    The unit lies between the smallest possible one and four times as much; `b` is nearly a multiple of it.
    """
    lowest = -FRACTION_BITS - (WIDTHS["t"] + WIDTHS["r1"] + MANTISSA_BITS - PRODUCT_BITS)
    units = [
        (mantissa * 2.0**exponent / gain, mantissa, exponent)
        for mantissa in _MANTISSAS
        for exponent in range(lowest, LARGEST_EXPONENT + 1)
    ]
    fitting = [unit for unit in units if unit[0] * TRACE_MAX >= largest_n]
    if not fitting:
        raise too_large("stdp_dopa: dopamine", largest_n * gain)
    smallest = min(fitting)[0]
    n_scale, mantissa, exponent = min(
        (unit for unit in fitting if unit[0] <= 4 * smallest), key=lambda u: (abs(round(b / u[0]) * u[0] - b), u[0])
    )
    return Fit(0, mantissa, exponent), n_scale


def tag_decay(tau: float, periods: Sequence[int] = range(LARGEST_U + 1)) -> tuple[tuple[Term, ...], float, str]:
    """Return the products of a rule that let a tag decay: in every 2^k-th step it loses n/128.

    Args:
        tau: time constant in steps.
        periods: allowed exponents k.

    Returns:
        The products, the relative error of the time constant, and both as text.
    """
    fits = []
    for every in periods:
        share = 1.0 - math.exp(-(2**every) / tau)
        part = max(1, round(share * 128))
        if share <= 0.25 or every == 0:
            fits.append((abs(-(2**every) / math.log1p(-min(part, 127) / 128) / tau - 1.0), every, min(part, 127)))
    close = [entry for entry in fits if entry[0] <= 0.01]
    error, every, part = close[0] if close else min(fits)
    bits = [1 << k for k in range(7) if part >> k & 1]
    terms = tuple(Term(-1, bit.bit_length() - 8, "u", every, (Factor("t"),)) for bit in bits)
    return terms, error, f"the eligibility loses {part}/128 {_period(every)}: tau_c is {error:.1%} off"


def too_small(label: str, change: float) -> ModelError:
    """Return the error for a change below the smallest step of the accumulator."""
    return ModelError(
        f"{label}: a change of {change:.3g} mantissas cannot be represented: the smallest is {SMALLEST_UPDATE:.3g}",
        hint="use a smaller weight scale (weight exponent) or a larger step size of the rule",
    )


def too_large(label: str, change: float) -> ModelError:
    """Return the error for a change that is too large for the accumulator."""
    return ModelError(
        f"{label}: a change of {change:.3g} mantissas does not fit the accumulator",
        hint="use a larger weight scale (weight exponent) or a smaller step size of the rule",
    )


@dataclass(frozen=True, slots=True)
class MappedRule:
    """A rule of the chip that replaces a float synapse model.

    Attributes:
        rule: the rule.
        approximations: differences from the float model, one sentence each.
        update: size of one weight change in mantissas: by one pair, or for `stdp_dopa` by one application after one
            pair, at the largest n or the n of one dopamine spike. Below `COARSE_UPDATE` a problem is reported.
        n_scale: dopamine in 1/ms per unit of r1 and r2; 0 without dopamine.
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
    from_target: bool = False,
) -> MappedRule:
    """Return the rule of Loihi's learning engine that approximates a float synapse model.

    Args:
        synapse: a `stdp` or `stdp_dopa`, or a model with a method `microcode`.
        resolution_ms: length of a step in ms.
        tau_minus: time constant of the target's K- in ms.
        weight_scale: weight of one mantissa, in its unit.
        weight_bits: bits of a weight, for the messages.
        delay: delay of the projection in steps.
        largest_n: largest |n| that a signal will set, in 1/ms.
        from_target: whether the chip is Loihi 2, whose targets send y1, y2 and y3.

    Raises:
        ModelError: the chip cannot run the model; the hint names another way.
    """
    if isinstance(synapse, stdp_dopa):
        mapped = _dopamine_rule(synapse, resolution_ms, tau_minus, weight_scale, largest_n, from_target)
    elif isinstance(synapse, stdp) and not from_target:
        mapped = _pair_rule(synapse, resolution_ms, tau_minus, weight_scale)
    elif hasattr(synapse, "microcode") and not from_target:
        mapped = _microcode_rule(synapse, resolution_ms, tau_minus, weight_scale, largest_n)
    else:
        supported = "stdp_dopa with a signal, and loihi2_learning"
        if not from_target:
            supported = "stdp, stdp_dopa, loihi_learning, and rules with a method 'microcode'"
        raise ModelError(
            f"the learning engine runs {supported}",
            hint=f"run it on event, or send static weights: {SAVE_FROZEN}",
        )
    shared = [
        f"weights have {weight_bits} bits and change by whole steps, stochastically rounded from 2^-7 of a mantissa",
        f"traces are 7-bit: K above {TRACE_MAX / LARGEST_IMPULSE:.3g} saturates; their decay is stochastically rounded",
        *(["one random number rounds x1 of all sources, another all weights and tags of a step"] * from_target),
        f"a post spike reaches its synapses at once, not after the delay ({delay} steps): STDP windows are shifted "
        "by it" + " and keep their areas" * isinstance(synapse, (stdp, stdp_dopa)),
        "several spikes of a neuron in one step count as one",
    ]
    return MappedRule(mapped.rule, (*mapped.approximations, *shared), mapped.update, mapped.n_scale)


def _microcode_rule(p: Any, h: float, tau_minus: float, scale: float, largest_n: float) -> MappedRule:
    """Return the rule of a synapse model that defines its own sums of products."""
    n, modulatory = 0.0, {}
    if isinstance(p, Modulated):
        tau, impulse = p.parameters().get("tau_n", math.inf), 0 if p.dopamine is None else LARGEST_IMPULSE
        n = 1.0 / (tau * impulse) if impulse else largest_n / TRACE_MAX
        modulatory = {"r1": Trace.exponential(impulse, tau / h), "r2": Trace.exponential(0, tau / h)}
    try:
        rule = p.microcode(LoihiEngine(h, tau_minus, scale, n, modulatory))
    except ModelError:
        raise
    except Exception as error:  # any error of third-party code
        raise ModelError(f"{p.name}.microcode: {type(error).__name__}: {error}") from error
    if not isinstance(rule, LearningRule):
        raise ModelError(f"{p.name}.microcode: found {rule!r:.60}: expected the result of the engine's method 'rule'")
    notes = (
        f"the engine runs its microcode: {'; '.join(str(rule).splitlines())}",
        f"the chip clips at 0 and 255 mantissas ({255 * scale:g})",
    )
    return MappedRule(rule, notes, COARSE_UPDATE, n)


def _period(exponent: int) -> str:
    """Return "every step" for 0, "every 32 steps" for 5."""
    return f"every {2**exponent} steps" if exponent else "every step"


def _pair_rule(p: stdp, h: float, tau_minus: float, scale: float) -> MappedRule:
    for word, mu in (("mu_plus", p.mu_plus), ("mu_minus", p.mu_minus)):
        if mu not in (0.0, 1.0):
            raise ModelError(
                f"stdp.{word} = {mu:g}: expected 0 or 1, which are sums of products on the chip",
                hint=f"{word}: {round(min(mu, 1.0))} is nearest",
                path=(word,),
            )
    top = p.Wmax / scale
    bound = _bound("stdp.Wmax", p.Wmax, scale)
    growth: tuple[Factor, ...] = (Factor("w", -bound),) if p.mu_plus else ()
    decay: tuple[Factor, ...] = (Factor("w"),) if p.mu_minus else ()
    plus, minus = p.lambda_ * (1.0 if p.mu_plus else top), p.alpha * p.lambda_ * (1.0 if p.mu_minus else top)
    terms, traces, notes = _pair_terms(
        (plus * math.exp(-h / p.tau_plus), growth, -1 if p.mu_plus else 1),
        (minus, decay, -1),
        (p.tau_plus / h, tau_minus / h),
        "stdp.lambda",
    )
    if not math.isclose(bound, top, rel_tol=1e-9):
        notes += (f"Wmax = {p.Wmax:g} is {top:.5g} mantissas, rounded to {bound}",)
    if not p.mu_plus:
        notes += (f"potentiation stops at the largest mantissa, {255 * scale:g}, not at Wmax = {p.Wmax:g}",)
    if p.mu_plus or p.mu_minus:
        notes += ("weight-dependent changes are truncated towards 0 to multiples of 2^-7 of a mantissa",)
    return MappedRule(LearningRule(terms, traces=traces), notes, p.lambda_ * top)


def _dopamine_rule(
    p: stdp_dopa, h: float, tau_minus: float, scale: float, largest_n: float, from_target: bool
) -> MappedRule:
    if p.dopamine is not None and from_target:
        message = f"dopamine = '{p.dopamine}': no public model of Loihi 2 has a trace that spikes of a population raise"
        raise ModelError(message, hint="name a signal, or run it on loihi or event", path=("dopamine",))
    if p.A_plus == p.A_minus == 0.0:
        raise ModelError("stdp_dopa.A_plus = A_minus = 0: nothing to learn", path=("A_plus",))
    if p.c_min > -math.inf:
        message = f"stdp_dopa.c_min = {p.c_min:g}: a tag has no such bound"
        raise ModelError(message, hint="leave it out, or run on spinnaker", path=("c_min",))
    one = _tag_of_one(abs(p.A_plus) * math.exp(-h / p.tau_plus), abs(p.A_minus))
    dt, traces, notes = _pair_terms(
        (p.A_plus * one * math.exp(-h / p.tau_plus), (), 1),
        (p.A_minus * one, (), -1),
        (p.tau_plus / h, tau_minus / h),
        "stdp_dopa.A_plus",
        from_target,
    )
    every = max(0, min(LARGEST_U, math.floor(math.log2(max(1.0, min(p.tau_c, p.tau_n) / h / 8)))))
    if from_target:
        fade, off, factor = tag_decay(p.tau_c / h, range(every, -1, -1))
        every = fade[0].every
        if off > 0.25:
            problem_text = f"n is read {_period(every)}, and the nearest decay of the eligibility then is {off:.0%} off"
            message = f"stdp_dopa.tau_c = {p.tau_c:g} ms, tau_n = {p.tau_n:g} ms: {problem_text}"
            raise ModelError(message, hint="bring them nearer to each other", path=("tau_c",))
    else:
        fade, _, factor = tag_decay(p.tau_c / h)
    gain = 2.0**every * h / one / scale  # mantissas per application, for one tag unit at n = 1/ms
    shift = 0
    if from_target:
        power = math.ceil(math.log2(gain * largest_n / TRACE_MAX))
        n_scale, shift = 2.0**power / gain, max(LEAST_SHIFT, -FRACTION_BITS - power)
        fit = Fit(0, 4, power + shift)
    elif p.dopamine is None:
        fit, n_scale = signal_fit(gain, largest_n, p.b)
    else:
        fit = nearest_fit(gain / p.tau_n, MANTISSA_BITS + WIDTHS["t"] + WIDTHS["r1"], "stdp_dopa.A_plus")
        n_scale = 1.0 / p.tau_n / fit.impulse
        notes += (f"dopamine of one spike is {fit.value * p.tau_n / gain - 1:+.1%} off",)
    largest_b, fraction = (TRACE_MAX, 2**FRACTION_BITS) if from_target else (LARGEST_CONSTANT, 1)
    baseline = round(p.b / n_scale * fraction)
    if abs(baseline) > largest_b * fraction:
        raise ModelError(
            f"stdp_dopa.b = {p.b:g}: {p.b / n_scale:.0f} units of {n_scale:.3g}: expected at most {largest_b}",
            path=("b",),
        )
    more, less = POST[1:] if from_target else MODULATORY
    products = (Factor("t"), Factor(more, 0 if from_target else -baseline)), (Factor("t"), Factor(less))
    dw = tuple(
        Term(sign * fit.mantissa, fit.exponent, "u", every, part) for sign, part in zip((1, -1), products, strict=True)
    )
    decay = Trace.exponential(0, p.tau_n / h)
    traces |= {more: Trace(fit.impulse, decay.numerator, KEEP), less: decay}
    described = baseline / fraction * n_scale
    if from_target:
        rounding = (
            f"which the target rounds stochastically to steps of {n_scale * 2**shift:.4g} 1/ms, {LEVEL} units of {more}"
        )
    else:
        rounding = "truncated towards 0 to multiples of 2^-7 of a mantissa"
    notes += (
        factor,
        f"n is {more} - {less} in units of {n_scale:.4g} 1/ms, 7 bits each; b = {p.b:g} is {described:.4g}",
        f"the eligibility is a 9-bit tag of {one:.4g} units per 1; it saturates beyond {255 / one:.4g}",
        f"the weight moves {_period(every)} by c (n - b), {rounding}",
        f"the chip clips at 0 and 255 mantissas ({255 * scale:g}), not at Wmin = {p.Wmin:g} and Wmax = {p.Wmax:g}",
    )
    if from_target:
        outgoing = Outgoing(baseline, shift)
        return MappedRule(LearningRule(dw, (*dt, *fade), traces, outgoing=outgoing), notes, COARSE_UPDATE, n_scale)
    update = gain * one * max(abs(p.A_plus), abs(p.A_minus)) * (largest_n if p.dopamine is None else 1.0 / p.tau_n)
    if update < SMALLEST_UPDATE:
        raise too_small("stdp_dopa", update)
    return MappedRule(LearningRule(dw, (*dt, *fade), traces), notes, update, n_scale)


def _tag_of_one(plus: float, minus: float) -> float:
    """Return the units of the tag for an eligibility of 1.

    With these units, the larger side is a whole impulse, and the smaller side has the smallest rounding error.
    """
    larger, smaller = max(plus, minus), min(plus, minus)
    sizes = [impulse / larger for impulse in range(LARGEST_IMPULSE // 2 + 1, LARGEST_IMPULSE + 1)]
    if smaller == 0.0:
        return sizes[-1]
    bits = MANTISSA_BITS + WIDTHS["x1"]
    return min(
        sizes, key=lambda one: abs(nearest_fit(smaller * one, bits, "stdp_dopa.A_minus").value / one / smaller - 1)
    )


def _pair_terms(
    plus: tuple[float, tuple[Factor, ...], int],
    minus: tuple[float, tuple[Factor, ...], int],
    taus: tuple[float, float],
    label: str,
    from_target: bool = False,
) -> tuple[tuple[Term, ...], dict[str, Trace], tuple[str, ...]]:
    """Return products, traces and notes of potentiation, y0 x1, and of depression, x0 (y1 - y2).

    y2 is the spike of the present step, which does not count for depression.

    Args:
        plus: for potentiation, the change by one pair, further factors of the product, and the sign.
        minus: the same values for depression.
        taus: time constants of x1 and y1 in steps.
        label: name of the parameter, for messages.
        from_target: whether the target sends y1, without the spike of the present step.
    """
    terms: list[Term] = []
    traces: dict[str, Trace] = {}
    notes: list[str] = []
    for (change, factors, sign), gate, trace, tau in zip((plus, minus), ("y0", "x0"), ("x1", "y1"), taus, strict=True):
        if change == 0.0:
            continue
        if change < 0.0:
            change, sign = -change, -sign
        fit = nearest_fit(change, MANTISSA_BITS + WIDTHS[trace] + sum(WIDTHS[f.name] for f in factors), label)
        terms.append(Term(sign * fit.mantissa, fit.exponent, gate, 0, (Factor(trace), *factors)))
        traces[trace] = Trace.exponential(fit.impulse, tau)
        if trace == "y1" and not from_target:
            terms.append(Term(-sign * fit.mantissa, fit.exponent, gate, 0, (Factor("y2"), *factors)))
            traces["y2"] = Trace(fit.impulse, 0, 1)
        error = fit.value / change - 1
        if abs(error) > 1e-3:
            notes.append(f"{'potentiation' if gate == 'y0' else 'depression'} is {error:+.1%} off")
    return tuple(terms), traces, tuple(notes)


def _bound(label: str, weight: float, scale: float) -> int:
    bound = round(weight / scale)
    if not 0 < bound <= LARGEST_CONSTANT:
        raise ModelError(
            f"{label} = {weight:g}: {bound} mantissas of {scale:g}: expected 1 to {LARGEST_CONSTANT}",
            hint="change the weight exponent of the projection",
        )
    return bound


FRACTIONS = 256
"""Fractions of a step in the tag of a delay, from -128 to 127 around the whole number of steps in the register."""


def give_rule(
    program: Program,
    chip: Chip,
    index: int,
    wires: dict[int, FixedProjection],
    options: Options,
    from_target: bool = False,
) -> Iterator[Problem]:
    """Set the rule of a projection that learns on the chip; yield refusals and approximations.

    Args:
        program: the whole network.
        chip: the chip for which the network is quantised.
        index: index of the projection.
        wires: quantised projections by index. A projection that learns is replaced by a copy with a rule.
        options: options of the user, for the largest dopamine.
        from_target: whether the chip is Loihi 2, whose targets send y1, y2 and y3.
    """
    part = program.projections[index]
    synapse = part.synapse
    if (problem := foreign(program, chip, index) or no_rule(program, index)) is not None:
        yield problem
    elif isinstance(synapse, loihi_learning) and index in wires:
        wires[index] = replace(wires[index], rule=synapse.rule())
    elif synapse.delays and index in wires:
        yield _delay_problem(program, index)
    elif synapse.learns == "pairs" and index in wires:
        try:
            mapped = _map_rule(program, index, wires[index], options, from_target)
        except ModelError as error:
            yield refused(part, synapse.name, error.message, error.hint)
            return
        wires[index] = replace(wires[index], rule=mapped.rule, n_scale=mapped.n_scale)
        differences = "".join(f"\n    - {text}" for text in mapped.approximations)
        yield approximated(part, synapse.name, f"differences on the chip's learning engine:{differences}")
        if mapped.update < COARSE_UPDATE:
            reason = f"a change is {mapped.update:.2g} of a weight step: below {COARSE_UPDATE:g} much is truncated"
            yield approximated(part, synapse.name, reason, "learn faster, or lower Wmax, which sets the weight step")


def _delay_problem(program: Program, index: int) -> Problem:
    """Return the approximation of a rule for delays, or a refusal if it has traces other than times of spikes."""
    part = program.projections[index]
    traces = (*part.synapse.pre, *part.synapse.post) if part.synapse.learns == "pairs" else ()
    if any(trace.tau for trace in traces) or len(traces) > 2:
        return refused(part, part.synapse.name, "the host stores only the times of the last spikes", LEARN_ELSEWHERE)
    moment = "times of spikes, which its learning engine lacks" if traces else "the ends of trials"
    storage = f"delays are whole steps in the register and 1/{FRACTIONS} of a step in the tag"
    return approximated(part, part.synapse.name, f"{storage}; the host changes them by {moment}")


def _map_rule(program: Program, index: int, wires: FixedProjection, options: Options, from_target: bool) -> MappedRule:
    """Return the rule of the learning engine for a projection.

    Raises:
        ModelError: the engine cannot run the rule.
    """
    part = program.projections[index]
    numbers = part.synapse.parameters()
    tau_minus = program.populations[part.target].parameters["tau_minus"]
    if wires.step.size > 1 or tau_minus.size > 1:
        raise ModelError("the target's neurons differ: expected equal neurons, because a projection has one rule")
    if wires.sign_mode != "excitatory":
        raise ModelError(
            f"weights in sign mode {wires.sign_mode}: expected Wmin >= 0 and weights >= 0",
            hint="set Wmin: 0" if "Wmin" in numbers else "backend 'event' runs it",
        )
    return rule_of(
        part.synapse,
        program.resolution,
        float(tau_minus[0]),
        float(wires.step[0]),
        wires.bits,
        delay=int(part.delay.max(initial=1)),
        largest_n=largest_signal(program, index, options),
        from_target=from_target,
    )
