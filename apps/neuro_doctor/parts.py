"""Checks of single parts: parameters of neurons and generators, the effect of one spike, learning rules."""

from __future__ import annotations

import math
from collections.abc import Iterator

import numpy as np

from neuro.apps import some
from neuro.extend import Neuron, Population, Program, Projection, Synapse
from neuro_doctor.findings import Finding, fault, warning
from neuro_doctor.wiring import Wiring, is_short_term

STRONG = 10.0
"""Effect of one spike above which the unit of its weight seems wrong. A value of 1 is the distance from rest to
threshold. Relays have an effect of 1, trained networks of a few."""
WEAK = 1e-3
"""Effect of one spike, as a share of the distance from rest to threshold, below which the unit of its weight is
doubted, unless all inputs together reach the threshold: many small effects can drive a neuron, too."""
LONGEST_MS = {"izhikevich": 1.0}
"""Longest steps of models without a time constant, ms. Forward Euler is inexact above: at 2 ms, up to 45 % of the
spikes of a fast-spiking neuron are missing. Izhikevich, 2003, halves his steps of 1 ms for V_m."""
FAST_HZ = 1000.0
"""Highest rate of a neuron. A generator with a higher rate represents many neurons."""


def neuron_findings(wiring: Wiring) -> Iterator[Finding]:
    """Yield findings about populations and single spikes."""
    for k, part in enumerate(wiring.program.populations):
        if isinstance(part.model, Neuron) and not part.model.chip:
            yield from _steps(wiring, k)
            yield from _potentials(wiring, k)
        elif part.kind != "neuron":
            yield from _generator(wiring, k)
    for q in range(len(wiring.program.projections)):
        yield from _spike(wiring, q)


def _is_coarse(part: Population, h: float) -> bool:
    return h > LONGEST_MS.get(part.model.name, np.inf)


def _steps(wiring: Wiring, k: int) -> Iterator[Finding]:
    """Yield findings about steps that are longer than a time constant, so inputs decay before the next step."""
    part, h = wiring.program.populations[k], wiring.program.resolution
    inhibits = any(wiring.pushes(q)[1] or wiring.program.projections[q].receptor is not None for q in wiring.onto(k))
    if _is_coarse(part, h):
        longest = LONGEST_MS[part.model.name]
        evidence = f"forward Euler on steps of {h:g} ms falsifies {part.model.name} above {longest:g} ms"
        yield fault("coarse-step", part, evidence, f"use a `resolution` of {longest / 2.0:g} ms or less")
    for word, values in part.parameters.items():
        unit = part.model.quantities()[word].unit if word in part.model.quantities() else ""
        tau = float(values.min(initial=np.inf))
        unused = word == "tau_syn_in" and not inhibits
        if word.startswith("tau") and not unused and unit == "ms" and 0.0 < tau < h:
            remaining = np.exp(-h / tau)
            evidence = f"{word} = {tau:g} ms is shorter than a step of {h:g} ms, after which {remaining:.2g} is left"
            remedy = f"use a `resolution` of at most {tau / 4.0:.2g} ms, or check the unit of {word}: it is ms"
            yield fault("coarse-step", part, evidence, remedy)


def _potentials(wiring: Wiring, k: int) -> Iterator[Finding]:
    part, cell = wiring.program.populations[k], wiring.cell(k)
    if cell is None:
        return
    p = part.parameters
    if "E_L" in p and bool(np.all(p["E_L"] >= p["V_th"])):
        evidence = f"E_L = {p['E_L'].max():g} mV is not below V_th = {p['V_th'].min():g} mV: it fires without any input"
        yield warning("fires-by-itself", part, evidence, "lower E_L or raise V_th; I_e drives neurons on purpose")
    start = np.broadcast_to(part.initial["V_m"], part.size)
    n_above = int((start >= p["V_th"]).sum())
    if n_above and not bool(np.all(p.get("E_L", -np.inf) >= p["V_th"])):
        share = n_above / part.size
        if share > 0.5:
            evidence = f"V_m of {n_above:,} of {some(part.size, 'neuron')} begins at or above V_th: they fire at once"
            yield warning("starts-firing", part, evidence, "draw `initial: {V_m: ...}` between V_reset and V_th")
    for word, above in (("E_ex", True), ("E_in", False)):
        if word in p and bool(np.all(p[word] <= p["V_th"] if above else p[word] >= p["V_th"])):
            name, effect = ("excitatory", "cannot lift V_m to") if above else ("inhibitory", "lifts V_m to")
            evidence = f"{word} = {p[word].max():g} mV, the {name} reversal, {effect} V_th = {p['V_th'].min():g} mV"
            yield fault("reversal", part, evidence, f"set {word} {'above' if above else 'below'} V_th")


def _generator(wiring: Wiring, k: int) -> Iterator[Finding]:
    part, h = wiring.program.populations[k], wiring.program.resolution
    if part.stop <= part.start:
        evidence = f"it ends at {part.stop * h:g} ms and begins at {part.start * h:g} ms, so it never emits"
        yield fault("never-on", part, evidence, "set `stop` after `start`")
    if part.kind != "poisson":
        return
    rate = part.largest("rate")
    for q in wiring.out_of(k):
        target = wiring.program.populations[wiring.program.projections[q].target]
        sources = wiring.weights[q].synapses / target.size
        if rate > FAST_HZ and sources > 1.5:
            evidence = (
                f"each of its {some(part.size, 'neuron')} emits {rate:g} Hz, and a neuron of '{target.name}' hears "
                f"{sources:.3g} of them: {rate * sources:,.0f} spikes a second"
            )
            remedy = f"`rate` is per neuron: if {rate:g} Hz is meant for all, set it to {rate / part.size:.3g} Hz"
            yield warning("rate-of-all", part, evidence, remedy, target.name)
            return


def _spike(wiring: Wiring, q: int) -> Iterator[Finding]:
    """Yield a finding if one spike is very strong or very weak relative to the distance to the threshold."""
    part, w = wiring.program.projections[q], wiring.weights[q]
    cell, target = wiring.cell(part.target), wiring.program.populations[part.target]
    if cell is None or part.carries != "spikes" or not w.synapses or cell.distance <= 0.0:
        return
    if _is_coarse(target, cell.h):
        return
    forced = part.layout == "one_to_one" and wiring.program.populations[part.source].kind == "listed"
    (up, _), (down, _) = wiring.receptors(q)
    largest = max(abs(w.largest), abs(w.least))
    # The mean magnitude is used, since drawn weights have tails.
    mean = (w.above - w.below) / w.synapses
    receptor = up if w.above >= -w.below else down
    slope = abs(cell.slope(receptor))
    peak = slope * mean
    unit = f" {target.model.weight_unit}" if isinstance(target.model, Neuron) and target.model.weight_unit else ""
    if not slope or not largest:
        return
    psp = f"a spike of weight {mean:.4g}{unit} moves V_m of '{target.name}' by {peak:.3g} mV, "
    scale = f"a weight of {1.0 / slope:.3g}{unit} moves it by 1 mV"
    # An inhibitory spike makes no neuron fire, so its effect is compared with the distance to the threshold.
    excites = w.above >= -w.below and peak > cell.distance / STRONG
    fires = min(cell.to_fire(receptor) if excites else math.inf, cell.distance / slope)
    if mean > STRONG * fires and not forced:  # listed spikes may set the spikes of their targets on purpose
        evidence = f"{psp}{mean / fires:.3g} times what makes it fire"
        remedy = f"check the unit of `weight`: {scale}, and one of {fires:.3g}{unit} makes it fire"
        yield warning("strong-spike", part, evidence, remedy)
    elif peak < WEAK * cell.distance and not part.synapse.learns and _all_at_once(wiring, part.target) < cell.distance:
        evidence = f"{psp}{peak / cell.distance:.2%} of the way to the threshold; all inputs at once do not reach it"
        yield warning("weak-spike", part, evidence, f"check the unit of `weight`: {scale}")


def _all_at_once(wiring: Wiring, population: int) -> float:
    """Return the mean effect on V_m of one simultaneous spike from each input, mV."""
    size = wiring.program.populations[population].size
    cell = wiring.cell(population)
    assert cell is not None
    slope = max(abs(cell.slope(k)) for k in range(cell.model.receptors))
    return slope * sum(wiring.pushes(q)[0] for q in wiring.onto(population)) / size


LEFT = 0.05
"""Share of an eligibility below which a reward comes too late: the share after three time constants."""
_RATES = ("lambda_", "lambda", "A_plus", "A_minus", "Ar_plus", "Ar_minus", "Ap_plus", "Ap_minus", "eta", "alpha_plus")


def rule_findings(wiring: Wiring, reward_after: float | None) -> Iterator[Finding]:
    """Yield findings about learning rules, from the description.

    Args:
        wiring: wiring of the network.
        reward_after: delay of a reward after the spikes that earn it, ms, if known.
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
    """Return whether a rule changes weights or delays for good, unlike short-term plasticity."""
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
    """Yield a finding about a pair rule that can only potentiate or only depress."""
    values, rule = part.synapse.parameters(), part.synapse
    if rule.learns != "pairs" or rule.modulated:
        return
    names = {word.rstrip("_") for word in values}
    if {"alpha", "lambda"} <= names and np.all(np.equal(values["alpha"], 0.0)):
        yield warning("one-way", part, "alpha = 0: no pair of spikes depresses a weight", "set alpha to about 1")
    for word, opposite, verb in (("A_plus", "A_minus", "potentiates"), ("A_minus", "A_plus", "depresses")):
        if word in values and opposite in values and np.all(np.equal(values[word], 0.0)) and np.any(values[opposite]):
            yield warning("one-way", part, f"{word} = 0: no pair of spikes {verb} a weight", f"set {word} other than 0")


def _both_potentiate(part: Projection) -> Iterator[Finding]:
    """Yield a finding about A_minus < 0, which depresses in Brian; here spike pairs in both orders then potentiate."""
    values, rule = part.synapse.parameters(), part.synapse
    if rule.learns != "pairs" or rule.identity() or not {"A_plus", "A_minus"} <= values.keys():
        return
    if np.all(np.less(values["A_minus"], 0.0)) and np.all(np.greater(values["A_plus"], 0.0)):
        smallest = float(np.min(values["A_minus"]))
        evidence = f"A_minus = {smallest:g} and A_plus above 0: pairs of spikes in both orders potentiate"
        remedy = f"set A_minus to {-smallest:g}: above 0 it depresses here, in Brian's scripts below 0"
        yield warning("one-way", part, evidence, remedy)


def _bounds(part: Projection) -> Iterator[Finding]:
    """Yield a finding about weights that begin at the upper bound, so they can only fall."""
    low, high = part.synapse.bounds()
    if not part.size or not np.all(np.isfinite(high)) or np.all(np.equal(low, high)):
        return
    share = float(np.isclose(part.weight, high, rtol=1e-9, atol=0.0).mean())
    if share > 0.9:
        evidence = f"{share:.0%} of its weights begin at the largest, Wmax = {np.max(high):g}: they can only fall"
        yield warning("starts-at-bound", part, evidence, "raise Wmax, or begin below it")


def _eligibility(program: Program, part: Projection, reward_after: float | None) -> Iterator[Finding]:
    values = part.synapse.parameters()
    word = next((w for w in ("tau_c", "tau_e", "tau_z") if w in values), None)
    if word is None or not np.all(np.isfinite(values[word])):
        return
    tau = float(np.max(values[word]))
    delay = part.dopamine_delay * program.resolution if part.dopamine >= 0 else 0.0
    window = float(np.max(values.get("tau_plus", 0.0)))
    if reward_after is not None and math.exp(-reward_after / tau) < LEFT:
        remaining = f"{math.exp(-reward_after / tau):.2g} of the eligibility"
        evidence = f"{word} = {tau:g} ms: after {reward_after:g} ms {remaining} is left"
        remedy = f"raise {word} to about {reward_after:g} ms, or reward earlier"
        yield fault("eligibility-dies", part, evidence, remedy)
    elif math.exp(-delay / tau) < LEFT:
        remaining = f"{math.exp(-delay / tau):.2g} of the eligibility is left"
        evidence = f"dopamine takes {delay:g} ms, after which {remaining}: {word} = {tau:g} ms"
        remedy = f"raise {word} to about {delay:g} ms, or shorten dopamine_delay"
        yield fault("eligibility-dies", part, evidence, remedy)
    elif tau < program.resolution or tau < window / 2.0:
        # Spikes up to about tau_plus apart form a pair, so a reward comes at least that long after the first spike.
        span = f"a step, {program.resolution:g} ms" if tau < program.resolution else f"half of tau_plus = {window:g} ms"
        evidence = f"the eligibility ends with {word} = {tau:g} ms, less than {span}: a later reward finds none"
        remedy = f"raise {word} to the time from an action to its reward, often 100 to 1000 ms; its unit is ms"
        yield fault("eligibility-dies", part, evidence, remedy)


def _copies(program: Program, part: Projection) -> Iterator[Finding]:
    """Yield a finding about maps or neurons with equal initial weights, which learn the same in all trials."""
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
    rewards = f"the reward is {correct:g} for correct, {wrong:g} for wrong and {silent:g} for silent trials"
    if supervised and correct == wrong == silent == 0.0:
        yield fault("no-reward", trials, f"{rewards}: no trial teaches", "set `reward: {correct: 1, wrong: -1}`")
    elif supervised and correct < wrong:
        evidence = f"{rewards}: wrong decisions are rewarded more than correct ones"
        yield fault("no-reward", trials, evidence, "exchange `correct` and `wrong`")
