"""Checks of the connections: parts without effect, weights of 0 or of the wrong sign, paths from input to output."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator

import numpy as np

from neuro.apps import some
from neuro.extend import Neuron, Population, Program
from neuro_doctor.findings import Finding, fault, figure, finding, note, warning
from neuro_doctor.observing import idle_inputs
from neuro_doctor.wiring import Wiring

LONG_MS = 100.0
"""Longest plausible delay, ms; delays in nervous systems are 0.1 to 50 ms. Longer ones are probably in another unit."""
ONE_STEP = 0.5
"""Share of drawn delays of one step above which the resolution hides their spread."""
UNREACHED = 0.1
"""Share of neurons without an incoming synapse that is reported. A fixed indegree leaves none, a random one with a mean
of 3 leaves 5 %."""


def findings(wiring: Wiring) -> Iterator[Finding]:
    """Yield findings about connections, from the description."""
    yield from _projections(wiring)
    yield from _generators(wiring)
    yield from _paths(wiring)
    yield from _unreached(wiring)
    yield from _thresholds(wiring)
    yield from _signals(wiring)


def is_open(program: Program) -> bool:
    """Return whether a user's program has to feed inputs, and may therefore also set weights."""
    return bool(idle_inputs(program))


def _projections(wiring: Wiring) -> Iterator[Finding]:
    program = wiring.program
    for q, part in enumerate(program.projections):
        w = wiring.weights[q]
        source, target = program.populations[part.source], program.populations[part.target]
        populations = f"{some(source.size, 'neuron')} of '{source.name}' and {target.size:,} of '{target.name}'"
        if not w.synapses:
            evidence = f"the rule made 0 synapses between {populations}"
            remedy = "raise the probability or the reach of its rule, list other pairs, or use another seed"
            yield fault("no-synapses", part, evidence, remedy)
        elif w.least == w.largest == 0.0 and not part.synapse.learns:
            evidence = f"the weights of all {some(w.synapses, 'synapse')} are 0: no spike has an effect"
            severity = "warning" if is_open(program) else "fault"
            yield finding("zero-weights", severity, part, evidence, "give it a `weight` other than 0")
        else:
            yield from _signs(wiring, q, source, target)
            yield from _mixed(wiring, q, source)
        if part.delay.size > 1 and float((part.delay == 1).mean()) > ONE_STEP:
            share, h = f"{(part.delay == 1).mean():.0%}", program.resolution
            evidence = f"{share} of its drawn delays were rounded to one step of {h:g} ms, the shortest delay"
            remedy = f"use a finer `resolution`, as {h / 10.0:g} ms, or longer delays; their unit is ms"
            yield warning("coarse-delays", part, evidence, remedy)
        longest = part.delay_span[1] * program.resolution
        if longest > LONG_MS and not part.synapse.delays:
            evidence = f"a spike takes up to {longest:g} ms"
            yield warning("long-delay", part, evidence, "give `delay` in ms; delays of axons are 0.1 to 50 ms")


MIXED = 0.02, 0.33
"""Least and largest share of weights with the other sign that is reported as a violation of Dale's law. Normal weights
have these shares at a mean of 2 and 0.4 standard deviations. At a smaller mean both signs are probably intended."""
_INHIBITORY = re.compile(r"(^|_)(?i:inh|basket|gaba|pv(_|$)|sst)|(^|_|\d)I(_|\d|$)")
_EXCITATORY = re.compile(r"(^|_)(?i:exc|pyr)|(^|_|\d)E(_|\d|$)")


def _name(program: Program, part: Population) -> str:
    """Return the name of a population; upper case for a pair of populations named e and i."""
    pair = {"e", "i"} <= {population.name for population in program.populations}
    return part.name.upper() if pair and part.name in ("e", "i") else part.name


def _signs(wiring: Wiring, q: int, source: Population, target: Population) -> Iterator[Finding]:
    """Yield a finding about weights whose effect contradicts the name of their source or of their receptor."""
    part = wiring.program.projections[q]
    up, down = wiring.pushes(q)
    if source.kind != "neuron" or not isinstance(target.model, Neuron) or target.model.relay:
        return
    mean, unit, name = wiring.weights[q].mean, target.model.weight_unit, _name(wiring.program, source)
    if part.receptor is None and (mean < 0.0 if up > 0.0 else mean > 0.0):
        return  # the sign of the weights is right, and a reversal potential inverts their effect
    if _INHIBITORY.search(name) and up > 0.0 and down == 0.0:
        evidence = f"'{source.name}' is named as inhibitory, and its weights, of mean {mean:g} {unit}".rstrip()
        remedy = "make `weight` negative" if part.receptor is None else "name the inhibitory receptor"
        yield warning("wrong-sign", part, f"{evidence}, all excite", f"{remedy}, or rename '{source.name}'")
    elif _EXCITATORY.search(name) and down < 0.0 and up == 0.0:
        evidence = f"'{source.name}' is named as excitatory, and its weights, of mean {mean:g} {unit}".rstrip()
        remedy = "make `weight` positive" if part.receptor is None else "name the excitatory receptor"
        yield warning("wrong-sign", part, f"{evidence}, all inhibit", f"{remedy}, or rename '{source.name}'")
    elif part.receptor is not None and part.receptor.name in ("ex", "in"):
        is_wrong = up == 0.0 and down < 0.0 if part.receptor.name == "ex" else down == 0.0 and up > 0.0
        if is_wrong and not part.receptor.conductance:
            effect = "inhibits" if part.receptor.name == "ex" else "excites"
            evidence = f"receptor '{part.receptor.name}' with a mean weight of {mean:g} {unit}".rstrip() + f" {effect}"
            yield warning("wrong-sign", part, evidence, "turn the sign of `weight`, or name the other receptor")


def _mixed(wiring: Wiring, q: int, source: Population) -> Iterator[Finding]:
    """Yield a finding about neurons that mostly excite but have some inhibitory weights, or vice versa (Dale's law)."""
    part, w = wiring.program.projections[q], wiring.weights[q]
    if source.kind != "neuron" or part.synapse.learns or part.receptor is not None or not w.least < 0.0 < w.largest:
        return
    share = float((part.weight < 0.0).mean()) if w.mean > 0.0 else float((part.weight > 0.0).mean())
    sign, name = np.sign(w.mean), _name(wiring.program, source)
    other_weights = [wiring.weights[j] for j in wiring.out_of(part.source) if j != q]
    single = any(x.synapses and min(x.least * sign, x.largest * sign) > 0.0 for x in other_weights)
    name_match = _EXCITATORY.search(name) if sign > 0.0 else _INHIBITORY.search(name)
    if MIXED[0] < share < MIXED[1] and (name_match or single):
        effect, bound = ("inhibit", "low") if sign > 0.0 else ("excite", "high")
        evidence = f"{share:.0%} of its weights {effect}, though their mean is {w.mean:.3g}: '{source.name}' does both"
        remedy = f"truncate their distribution by `{bound}: 0`, or draw them with less spread"
        yield warning("mixed-signs", part, evidence, remedy)


def _generators(wiring: Wiring) -> Iterator[Finding]:
    program = wiring.program
    probed = {probe.population for probe in program.probes}
    released = {part.dopamine for part in program.projections}
    has_neurons = any(part.kind == "neuron" for part in program.populations)
    for k, part in enumerate(program.populations):
        unused = part.kind != "neuron" and not wiring.out_of(k) and k not in released
        if unused and has_neurons and k not in probed:
            evidence = f"no projection begins at its {some(part.size, 'neuron')}, and no probe records them"
            # Listed spikes are always recorded, so a user may list them only to see them in the results.
            severity = "warning" if part.kind == "listed" else "fault"
            yield finding("unconnected", severity, part, evidence, f"connect '{part.name}', or remove it")


def can_fire_alone(wiring: Wiring, k: int) -> bool:
    """Return whether neurons of a population may fire without incoming spikes; True if unknown."""
    part, cell = wiring.program.populations[k], wiring.cell(k)
    if cell is None:
        return not (isinstance(part.model, Neuron) and part.model.relay)
    if cell.model.draws or bool((part.initial["V_m"] >= cell.threshold).any()):
        return True
    currents = part.parameters.get("I_e", np.zeros(1))
    strongest = float(currents.max()) - float(currents[0]) + wiring.current(k)
    # Only the first neuron is simulated, so neurons with different thresholds or rests are assumed to fire.
    return (
        any(v.size > 1 for w, v in part.parameters.items() if w in ("V_th", "E_L"))
        or cell.follow(np.zeros(1), current=strongest)[1]
    )


def _begins(wiring: Wiring, k: int) -> bool:
    """Return whether spikes may originate in a population.

    The population is a spike generator, or its neurons get a current or fire without input.
    """
    kind = wiring.program.populations[k].kind
    return can_fire_alone(wiring, k) or bool(wiring.onto(k, "current")) if kind == "neuron" else kind != "current"


def _paths(wiring: Wiring) -> Iterator[Finding]:
    """Yield findings about populations that no excitation reaches, and about trials without a path to their output."""
    program = wiring.program
    begin = [k for k in range(len(program.populations)) if _begins(wiring, k)]
    if not begin:
        evidence = "it has no generator, and none of its neurons fires by itself"
        remedy = "add a generator and connect it, or set currents or states from a program"
        yield note("no-input", program, evidence, remedy)
        return
    reached = wiring.reached(begin)
    trials = program.trials
    for k, part in enumerate(program.populations):
        if part.kind != "neuron" or k in reached:
            continue
        inputs = wiring.onto(k)
        if inputs:
            ways = f"no generator reaches it by synapses that excite, only {wiring.names(inputs)}"
            evidence = f"{ways}; it does not fire by itself either"
        else:
            evidence = "no projection ends at it, and it does not fire by itself"
        output = ", the output of trials," if trials is not None and trials.output == k else ""
        remedy = f"connect an input to '{part.name}'{output} with weights that excite, or reverse a projection"
        if inhibitory := [q for q in inputs if _is_inhibiting_input(wiring, q)]:
            remedy = f"make `weight` of {wiring.names(inhibitory)} excite, if it is meant to, or {remedy}"
        may_be_meant = (inputs and is_open(program)) or (isinstance(part.model, Neuron) and part.model.relay)
        severity = "warning" if may_be_meant else "fault"
        yield finding("no-path", severity, part, evidence, remedy)
    if trials is not None and trials.output in reached and trials.output not in wiring.reached({trials.input}):
        first, last = (program.populations[k].name for k in (trials.input, trials.output))
        evidence = f"no synapses that excite lead from '{first}', the input of trials, to '{last}', their output"
        yield fault("no-path", trials, evidence, f"connect '{first}' towards '{last}'")


_BACKGROUND = re.compile(r"(?i)noise|backg|poisson|(^|_)(bg|ext|tonic|spont|ongoing|bias|drive)")
_OUTPUT = re.compile(
    r"(?i)(^|_)(out(puts?)?|readouts?|(motor|action|actor|decision|muscle|label)s?|class(es)?)(_|\d|$)"
)


def isolated_outputs(wiring: Wiring) -> Iterator[Finding]:
    """Yield findings about outputs that fire by noise or currents, but that no input reaches."""
    program, populations = wiring.program, wiring.program.populations
    generators = [k for k, part in enumerate(populations) if part.kind != "neuron" and wiring.out_of(k)]
    noise = {k for k in generators if populations[k].kind == "current" or _BACKGROUND.search(populations[k].name)}
    inputs = [k for k in generators if k not in noise]
    reached, driven_by_noise = wiring.reached(inputs, excite=False), wiring.reached(noise)
    outputs = {k for k, part in enumerate(populations) if part.kind == "neuron" and _OUTPUT.search(part.name)}
    ends = [k for k, part in enumerate(populations) if k in outputs or (part.kind == "neuron" and is_end(wiring, k))]
    reached_ends = [k for k in ends if k in reached and k not in outputs]
    for k in ends if inputs and program.trials is None else ():
        if k in reached or not (k in outputs or reached_ends):
            continue
        targets = reached_ends or [j for j in reached if populations[j].kind == "neuron"]
        names, final = (", ".join(f"'{populations[j].name}'" for j in ks[:5]) for ks in (inputs, targets))
        evidence = f"no path leads from {names} to it, only its own noise or currents; {names} reaches {final}"
        remedy = f"connect {final} towards '{populations[k].name}'"
        # A population without the name of an output may be an unstimulated control on purpose.
        severity = "fault" if k in outputs else "note" if driven_by_noise & set(reached_ends) else "warning"
        yield finding("no-path", severity, populations[k], evidence, remedy, populations[k].name)


def is_end(wiring: Wiring, k: int) -> bool:
    """Return whether a population has no projection to another population."""
    return all(wiring.program.projections[q].target == k for q in wiring.out_of(k))


def _is_inhibiting_input(wiring: Wiring, q: int) -> bool:
    """Return whether a projection is from a generator and inhibits."""
    part = wiring.program.projections[q]
    return wiring.program.populations[part.source].kind != "neuron" and wiring.pushes(q)[1] < 0.0


def _unreached(wiring: Wiring) -> Iterator[Finding]:
    for k, part in enumerate(wiring.program.populations):
        if part.kind != "neuron" or not wiring.onto(k):
            continue
        inputs = wiring.inputs_of_each(k)
        if inputs is not None and inputs.any() and float((inputs == 0).mean()) > UNREACHED:
            n = int((inputs == 0).sum())
            evidence = f"no synapse ends at {n:,} of its {some(part.size, 'neuron')}; the mean is {inputs.mean():.3g}"
            remedy = "use a rule with a fixed indegree, a larger probability or reach; or check the index of a view"
            yield warning("unreached", part, evidence, remedy)


def _thresholds(wiring: Wiring) -> Iterator[Finding]:
    """Yield findings about populations that cannot reach their threshold with any input spikes."""
    program = wiring.program
    most_spikes = {k: _most(part, program.resolution) for k, part in enumerate(program.populations)}
    for k, part in enumerate(program.populations):
        cell, inputs = wiring.cell(k), wiring.onto(k)
        if cell is None or not inputs or any(program.projections[q].synapse.learns for q in inputs):
            continue
        if can_fire_alone(wiring, k) or any(math.isinf(most_spikes[program.projections[q].source]) for q in inputs):
            continue
        if any(v.size > 1 for w, v in part.parameters.items() if w != "tau_minus"):
            continue  # neurons differ, so the first is not representative
        largest = wiring.strongest(k, most_spikes)
        if largest is None or not largest.any():
            continue
        v, fired = cell.follow(largest, current=wiring.current(k))
        if not fired and v.size:
            share = (float(v.max()) - cell.rest) / cell.distance
            factor = f"to about {figure(1.2 / share)} times" if share > 1e-6 else "far"
            distance = f"{cell.threshold - v.max():.3g} mV below V_th = {cell.threshold:g} mV"
            evidence = f"with all its inputs firing in every step V_m reaches {v.max():.4g} mV, {distance}"
            remedy = f"raise `weight` of {wiring.names(inputs)} {factor}, or lower V_th"
            yield fault("cannot-fire", part, evidence, remedy, part.name)


def _most(part: Population, h: float) -> float:
    """Return the largest number of spikes of a neuron per step; infinite if unknown."""
    if part.kind == "poisson":
        mean = part.largest("rate") * h / 1000.0
        return max(1.0, mean + 5.0 * math.sqrt(mean) + 3.0) if mean > 0.0 else 1.0
    if part.kind == "listed":
        pairs = part.spike_steps * part.size + part.spike_ids
        several = int(np.unique(pairs, return_counts=True)[1].max(initial=1)) if pairs.size else 1
        return math.inf if part.stream is not None else float(several)
    if part.kind == "generator" or (isinstance(part.model, Neuron) and part.model.relay):
        return math.inf
    return float(np.max(part.parameters.get("max_spikes", 1.0)))


def _signals(wiring: Wiring) -> Iterator[Finding]:
    program = wiring.program
    used_signals = {index for part in program.projections for index in (part.signal, part.gate)}
    for index, signal in enumerate(program.signals):
        if index not in used_signals:
            target = program.populations[signal.target].name
            evidence = f"no rule of a projection onto '{target}' uses it"
            remedy = f"name it in a rule, as `synapse: {{stdp_dopa: {{signal: {signal.name}}}}}`, or remove it"
            yield warning("unheard-signal", signal, evidence, remedy)
