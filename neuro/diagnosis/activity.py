"""What a short run shows of activity: missing inputs, ceilings, runaway, copies, dead outputs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from itertools import chain

import numpy as np

from neuro.core.english import some
from neuro.diagnosis import rhythm
from neuro.diagnosis.findings import Finding, fault, figure, finding, note, warning
from neuro.diagnosis.neurons import FAST_HZ
from neuro.diagnosis.observing import Observation
from neuro.diagnosis.rules import changes_weights
from neuro.diagnosis.silence import Silence, rheobase
from neuro.diagnosis.structure import is_end
from neuro.diagnosis.wiring import Wiring
from neuro.model.neurons import Neuron
from neuro.program.program import Population

CEILING, RUNAWAY = 0.7, 0.5
"""Shares of the highest possible rate. At the first a neuron gets 13 times the input that makes it fire (tau_m 10 ms,
t_ref 2 ms), and twice as much adds a tenth. The second is of populations that excite themselves: no cortical rhythm is
near it."""
ALONE = 0.5
"""Share of a rate that a constant current alone brings, which makes it the cause."""
SLOW_HZ = 50.0
"""A rate below it is no ceiling: neurons with a long t_ref answer once to each of several inputs."""
DEAD = 0.25
"""Share of outputs without a spike that is reported: weights drawn around 0 leave some without a net excitation."""


def findings(wiring: Wiring, seen: Observation) -> Iterator[Finding]:
    """Findings about activity."""
    if seen.unstable:
        evidence = f"{seen.unstable}, on {seen.program.resolution:g} ms steps"
        remedy = f"use a finer `resolution`, as {seen.program.resolution / 4.0:g} ms, or smaller weights and currents"
        yield fault("unstable", seen.program, evidence, remedy)
        return
    yield from _inputs(wiring, seen)
    decided = {
        g.population for g in seen.program.groups if getattr(g.choice, "first_to_fire", False) or g.choice.several
    }
    silent, tried = Silence(wiring, seen), wiring.reached(seen.driven)
    for k, part in enumerate(seen.program.populations):
        if part.kind != "neuron" or seen.steps == 0:
            continue
        if not seen.populations[k].spikes.any():
            found = silent.findings(k)
        elif k not in decided:  # their spikes end with a decision
            found = chain(_firing(wiring, seen, k), silent.falls(k))
        else:
            continue
        # What an input does that was made up for the examination proves no fault.
        yield from map(_milder, found) if k in tried else found


def _milder(found: Finding) -> Finding:
    if found.name == "dead-outputs":  # noise is no picture of what an output answers to
        return replace(found, severity="note")
    return replace(found, severity="warning") if found.severity == "fault" else found


def _firing(wiring: Wiring, seen: Observation, k: int) -> Iterator[Finding]:
    """Of a population that fires."""
    yield from list(_fast(wiring, seen, k)) or rhythm.findings(wiring, seen, k)
    yield from list(rhythm.shared(wiring, seen, k)) or _copies(wiring, seen, k)
    yield from _dead(wiring, seen, k)


def _inputs(wiring: Wiring, seen: Observation) -> Iterator[Finding]:
    """Generators that gave nothing, though the rest of the network may wait for them."""
    program, h = seen.program, seen.program.resolution
    for k, part in enumerate(program.populations):
        if part.kind in ("neuron", "current"):
            continue
        heard = bool(wiring.out_of(k))
        if k in seen.idle - seen.driven and heard:
            lacks, word = ("lists no spikes", "spike_times") if part.kind == "listed" else ("has rate 0", "rate")
            remedy = f"feed it from a program, or set its {word}; `neuro doctor --drive 20Hz` tries Poisson spikes"
            yield note("no-input", part, f"no input was given: it {lacks}", remedy)
        elif heard and seen.is_brief(k):
            evidence = (
                f"it is on from {part.start * h:g} to {part.stop * h:g} ms only, {(part.stop - part.start) * h:g} of "
                f"{seen.ms:g} ms, and emitted {seen.populations[k].spikes.mean():.2g} spikes a neuron"
            )
            yield warning("brief-input", part, evidence, "check `stop`: its unit is ms; `stop: 1 s` may be written")
        elif k not in seen.idle and not seen.populations[k].spikes.any() and heard and part.stop > part.start:
            first = part.spike_steps.min(initial=2**62) if part.kind == "listed" and part.stream is None else part.start
            if first >= seen.steps:
                evidence = f"its first spikes come at {first * h:g} ms, after the run of {seen.ms:g} ms"
                yield warning("late-input", part, evidence, "run longer (`--for`), or check its times: they are in ms")
            else:
                evidence = f"it emitted no spike in {seen.ms:g} ms"
                yield note("late-input", part, evidence, "raise its rate, or run longer")


def ceiling_hz(part: Population, h: float) -> float:
    """The highest rate of a neuron in Hz: one spike in each refractory period and step."""
    held = part.parameters.get("t_ref", part.parameters.get("dead_time", np.zeros(1)))
    return 1000.0 / (round(float(held.min()) / h) * h + h)


def _fast(wiring: Wiring, seen: Observation, k: int) -> Iterator[Finding]:
    part = seen.program.populations[k]
    if not isinstance(part.model, Neuron) or part.model.relay or part.model.chip or part.model.most:
        return
    if part.model.graded:
        return  # a message in each step may be what they are for
    if float(np.max(part.parameters.get("max_spikes", 1.0))) > 1.0:
        return  # several spikes in a step are what these neurons are for
    rate, most = seen.rate(k), min(ceiling_hz(part, seen.program.resolution), FAST_HZ)
    again = wiring.excites_itself(k)
    if rate < max((RUNAWAY if again else CEILING) * most, SLOW_HZ):
        return
    fires = f"the mean rate of {some(part.size, 'neuron')} is {rate:.3g} Hz"
    h = seen.program.resolution
    allows = "t_ref allows" if most < min(999.0 / h, FAST_HZ) else f"one spike in each step of {h:g} ms allows"
    allows = "no neuron exceeds" if most == FAST_HZ < 999.0 / h else allows
    evidence = f"{fires}, {rate / most:.0%} of the {most:,.0f} Hz that {allows}"
    if alone := _alone(wiring, k, rate):
        yield fault("ceiling", part, f"{evidence}; {alone[0]}", alone[1], part.name)
    elif again:
        names = wiring.names(wiring.loops(k))
        remedy = f"lower `weight` of {names}, or strengthen the inhibition onto it"
        yield fault("runaway", part, f"{evidence}; it excites itself through {names}", remedy, part.name)
    else:
        remedy = f"lower the weights or rates of {_strongest(wiring, seen, k)}{_by(wiring, seen, k)}"
        yield fault("ceiling", part, evidence, remedy, part.name)


def _alone(wiring: Wiring, k: int, rate: float) -> tuple[str, str] | None:
    """The constant current by which a population fires at half its rate or more without spikes, and what to lower."""
    part, cell, current = wiring.program.populations[k], wiring.cell(k), wiring.current(k)
    if cell is None:
        return None
    i_e = float(part.parameters.get("I_e", np.zeros(1)).mean())
    v, fires = cell.follow(np.zeros(1), current=current + i_e - cell.parameters.get("I_e", 0.0))
    interval = v.size * cell.h + cell.parameters.get("t_ref", 0.0)
    if not fires or 1000.0 / interval < ALONE * rate:
        return None
    said = f"without a spike that arrives it fires every {interval:.3g} ms"
    if cell.distance <= 0.0:
        return f"{said}, as E_L is not below V_th", "lower E_L, or raise V_th"
    if current > i_e:
        names = wiring.names(wiring.onto(k, "current"))
        return f"{said}, by {current:g} pA of {names}", f"lower `weight` of {names}, or the amplitude of its generator"
    return f"{said}, by I_e = {i_e:g} pA{rheobase(part)}", f"lower I_e of '{part.name}'"


def _strongest(wiring: Wiring, seen: Observation, k: int) -> str:
    """The projections that bring most of its excitation."""
    per_step = seen.per_step()
    up = {q: per_step[wiring.program.projections[q].source] * wiring.pushes(q)[0] for q in wiring.onto(k)}
    return wiring.names(q for q, each in up.items() if each >= 0.2 * sum(up.values())) or "its inputs"


def _by(wiring: Wiring, seen: Observation, k: int) -> str:
    """How far the mean input is beyond the threshold, as a share to which it may be lowered."""
    cell = wiring.cell(k)
    if cell is None or cell.distance <= 0.0:
        return ""
    x = wiring.drive(k, seen.per_step())
    pull = sum(x[r] * cell.slope(r) for r in range(min(x.size, cell.model.receptors)))
    # What a spike leaves lasts about a membrane time constant.
    tau = cell.parameters.get("tau_m", 10.0)
    mean = pull * min(tau, 1000.0) / cell.h
    return f" to about 1/{figure(mean / cell.distance)}" if mean > 1.5 * cell.distance else ""


def _copies(wiring: Wiring, seen: Observation, k: int) -> Iterator[Finding]:
    if not rhythm.is_copied(seen, k):
        return
    part, s = seen.program.populations[k], seen.populations[k]
    # A signal has a value for each neuron, so it may teach copies differently.
    learns = [p.name for p in seen.program.projections if p.target == k and changes_weights(p.synapse) and p.signal < 0]
    n = s.steps.size // s.ids.size
    evidence = f"{some(s.ids.size, 'neuron')} that were followed fired the same {some(n, 'spike')} in the same steps"
    remedy = "draw the weights onto them, connect them at random, or let `initial` differ: until then they do the same"
    if learns:
        evidence += f", so '{learns[0]}' teaches all of them alike"
    yield finding("neurons-alike", "warning" if learns else "note", part, evidence, remedy, part.name)


def _dead(wiring: Wiring, seen: Observation, k: int) -> Iterator[Finding]:
    """Neurons of an output that stay silent while the others fire: more than chance explains."""
    part, spikes = seen.program.populations[k], seen.populations[k].spikes
    if not is_end(wiring, k) or spikes.all() or part.size < 2:
        return
    inputs = wiring.inputs_of_each(k)  # neurons without any are `unreached`
    dead = np.flatnonzero((spikes == 0) & (True if inputs is None else inputs > 0))
    silent = dead.size
    others = float(spikes[spikes > 0].mean())
    if others < 10.0 or silent < DEAD * part.size:  # of 10 spikes expected, none is a chance of 1 in 20,000
        return
    evidence = f"{silent:,} of {some(part.size, 'neuron')} never fired, the others {others:.3g} times each"
    ids, fire = ", ".join(map(str, dead[:5])), spikes > 0
    remedy = f"look at the inputs of neurons {ids}: raise their weights, or draw them with less spread"
    for word, v in part.parameters.items():
        if v.size > 1 and (v[dead].max() < v[fire].min() or v[dead].min() > v[fire].max()):
            evidence += f"; their {word} is {v[dead].mean():.4g} on average, that of the others {v[fire].mean():.4g}"
            remedy = f"set {word} of neurons {ids} as that of the others"
    # With inhibition some may well lose, before they have learnt.
    excited = not any(wiring.pushes(q)[1] for q in wiring.onto(k))
    severity = "fault" if excited and 2 * silent >= part.size else "warning"
    yield finding("dead-outputs", severity, part, evidence, remedy, part.name)
