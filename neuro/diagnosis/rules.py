"""What rules of learning are set to: rates of 0, eligibility that ends too early, rewards that say nothing."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from neuro.core.english import some
from neuro.diagnosis.findings import Finding, fault, warning
from neuro.diagnosis.wiring import Wiring, is_short_term
from neuro.model.synapses import Synapse
from neuro.program.program import Program, Projection

LEFT = 0.05
"""Share of an eligibility below which the reward finds nothing of it: the trace of three time constants ago."""
_RATES = ("lambda_", "lambda", "A_plus", "A_minus", "Ar_plus", "Ar_minus", "Ap_plus", "Ap_minus", "eta", "alpha_plus")


def findings(wiring: Wiring, reward_after: float | None) -> Iterator[Finding]:
    """Findings about rules, before anything runs.

    Args:
        wiring: of the network.
        reward_after: how long after the spikes that earned it the reward comes, in ms, if it is known.
    """
    program = wiring.program
    for part in program.projections:
        if changes_weights(part.synapse):
            yield from _rates(part)
            yield from _one_way(part)
            yield from _both_potentiate(part)
            yield from _bounds(part)
            yield from _eligibility(program, part, reward_after)
            yield from _copies(program, part)
    yield from _reward(program)


def changes_weights(rule: Synapse) -> bool:
    """Whether a rule learns, other than by short-term plasticity."""
    return bool(rule.learns) and not is_short_term(rule)


def _rates(part: Projection) -> Iterator[Finding]:
    values = part.synapse.parameters()
    rates = {word: values[word] for word in _RATES if word in values}
    if rates and all(np.all(np.equal(value, 0.0)) for value in rates.values()):
        names = ", ".join(f"{word.rstrip('_')} = 0" for word in rates)
        evidence = f"{part.synapse.name} with {names}: nothing changes a weight"
        remedy = f"set {' and '.join(word.rstrip('_') for word in rates)} above 0, or use static"
        yield fault("learns-nothing", part, evidence, remedy)


def _one_way(part: Projection) -> Iterator[Finding]:
    """Rules of spike pairs that only grow weights, or only shrink them, whatever the spikes."""
    values, rule = part.synapse.parameters(), part.synapse
    if rule.learns != "pairs" or rule.modulated:
        return
    words = {word.rstrip("_") for word in values}
    if {"alpha", "lambda"} <= words and np.all(np.equal(values["alpha"], 0.0)):
        yield warning("one-way", part, "alpha = 0: no pair of spikes depresses a weight", "set alpha to about 1")
    for word, other, does in (("A_plus", "A_minus", "potentiates"), ("A_minus", "A_plus", "depresses")):
        if word in values and other in values and np.all(np.equal(values[word], 0.0)) and np.any(values[other]):
            yield warning("one-way", part, f"{word} = 0: no pair of spikes {does} a weight", f"set {word} other than 0")


def _both_potentiate(part: Projection) -> Iterator[Finding]:
    """A sign of depression as other tools write it, by which both orders of a pair do the same."""
    values, rule = part.synapse.parameters(), part.synapse
    if rule.learns != "pairs" or rule.identity() or not {"A_plus", "A_minus"} <= values.keys():
        return
    if np.all(np.less(values["A_minus"], 0.0)) and np.all(np.greater(values["A_plus"], 0.0)):
        least = float(np.min(values["A_minus"]))
        evidence = f"A_minus = {least:g} and A_plus above 0: pairs of spikes in both orders potentiate"
        remedy = f"set A_minus to {-least:g}: above 0 it depresses here, in Brian's scripts below 0"
        yield warning("one-way", part, evidence, remedy)


def _bounds(part: Projection) -> Iterator[Finding]:
    """Weights that begin where they can only go one way, at the upper end."""
    low, high = part.synapse.bounds()
    if not part.size or not np.all(np.isfinite(high)) or np.all(np.equal(low, high)):
        return
    at = np.isclose(part.weight, high, rtol=1e-9, atol=0.0)
    if float(at.mean()) > 0.9:
        evidence = f"{at.mean():.0%} of its weights begin at the largest, Wmax = {np.max(high):g}: they can only fall"
        yield warning("starts-at-bound", part, evidence, "raise Wmax, or begin below it")


def _eligibility(program: Program, part: Projection, reward_after: float | None) -> Iterator[Finding]:
    values = part.synapse.parameters()
    word = next((w for w in ("tau_c", "tau_e", "tau_z") if w in values), None)
    if word is None or not np.all(np.isfinite(values[word])):
        return
    tau = float(np.max(values[word]))
    late = part.dopamine_delay * program.resolution if part.dopamine >= 0 else 0.0
    window = float(np.max(values.get("tau_plus", 0.0)))
    if reward_after is not None and math.exp(-reward_after / tau) < LEFT:
        left = f"{math.exp(-reward_after / tau):.2g} of the eligibility"
        evidence = f"{word} = {tau:g} ms: after {reward_after:g} ms {left} is left"
        remedy = f"raise {word} to about {reward_after:g} ms, or reward earlier"
        yield fault("eligibility-dies", part, evidence, remedy)
    elif math.exp(-late / tau) < LEFT:
        left = f"{math.exp(-late / tau):.2g} of the eligibility is left"
        evidence = f"dopamine takes {late:g} ms, after which {left}: {word} = {tau:g} ms"
        remedy = f"raise {word} to about {late:g} ms, or shorten dopamine_delay"
        yield fault("eligibility-dies", part, evidence, remedy)
    elif tau < program.resolution or tau < window / 2.0:
        # A pair of spikes counts up to about tau_plus apart, so a reward cannot come sooner than that after the first.
        than = f"a step, {program.resolution:g} ms" if tau < program.resolution else f"half of tau_plus = {window:g} ms"
        evidence = f"the eligibility ends with {word} = {tau:g} ms, less than {than}: a later reward finds none"
        remedy = f"raise {word} to the time from an action to its reward, often 100 to 1000 ms; its unit is ms"
        yield fault("eligibility-dies", part, evidence, remedy)


def _copies(program: Program, part: Projection) -> Iterator[Finding]:
    """Maps that compete, or are taught, and begin as copies of each other: nothing ever distinguishes them."""
    target = program.populations[part.target]
    several = target.shape[0] > 1 if part.grid is not None else target.size > 1
    rule = part.synapse
    if rule.learns != "trials" or rule.delays or not several or part.size < 2 or part.layout not in ("dense", "grid"):
        return
    maps = part.weight.reshape(target.shape[0], -1) if part.grid is not None and part.weight.size > 1 else None
    if maps is None and part.layout == "dense" and part.weight.size > 1:
        maps = part.weight.reshape(-1, target.size).T
    if maps is None or bool((maps == maps[0]).all()):
        n = target.shape[0] if part.grid is not None else target.size
        kind = "map" if part.grid is not None else "neuron"
        evidence = f"the weights onto all {some(n, kind)} of '{target.name}' are equal, so they decide and learn alike"
        remedy = "draw them, as `weight: {normal: {mean: 0.8, std: 0.05}}`"
        yield fault("weights-alike", part, evidence, remedy)


def _reward(program: Program) -> Iterator[Finding]:
    trials = program.trials
    if trials is None or not any(part.synapse.learns == "trials" for part in program.projections):
        return
    correct, wrong, silent = trials.reward
    supervised = any(part.synapse.learns == "trials" and part.synapse.supervised for part in program.projections)
    said = f"the reward is {correct:g} for correct, {wrong:g} for wrong and {silent:g} for silent trials"
    if supervised and correct == wrong == silent == 0.0:
        yield fault("no-reward", trials, f"{said}: no trial teaches", "set `reward: {correct: 1, wrong: -1}`")
    elif supervised and correct < wrong:
        evidence = f"{said}: what is wrong is rewarded above what is right"
        yield fault("no-reward", trials, evidence, "exchange `correct` and `wrong`")
