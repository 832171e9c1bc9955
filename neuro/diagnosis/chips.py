"""What becomes of a network on a chip: what it refuses, weights and spikes that are lost, rates that are too high."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import replace

from neuro.chips.description import Chip
from neuro.chips.known import ARITHMETICS, arithmetic_of, chip as chip_of
from neuro.chips.placing import place
from neuro.chips.pricing import price
from neuro.chips.quantising import quantise
from neuro.core.clock import NEVER
from neuro.core.errors import ModelError
from neuro.diagnosis.findings import Finding, fault, finding, warning
from neuro.diagnosis.observing import Observation, observe
from neuro.diagnosis.wiring import Wiring
from neuro.model.neurons import Neuron, spike_generator
from neuro.program.backend import OverflowWarning, Problem, find_backend
from neuro.program.program import Program

ERASED, FEW = 0.1, 0.01
"""Share of weights that become 0, or of spikes that merge, which is a fault, and below which it is not reported. A
tenth of the input less moves a mean rate by about as much, and decisions with it."""
APART = 2.0
"""Ratio of the mean rates on the chip and in floats which makes two networks of them."""
SPIKES = 20
"""Spikes of a population below which a ratio may be chance."""
MERGES = "use a finer `resolution`, or several generators of a lower rate in place of one: a spike is one bit there"
ONCE = "lower its weights, raise V_th, or use a finer `resolution`: it fires once a step there"
SECONDS = 10.0
"""Of the clock on the wall for the run on the chip's emulation."""


def findings(wiring: Wiring, seen: Observation, name: str) -> Iterator[Finding]:
    """Findings about a network on a chip.

    Args:
        wiring: of the network.
        seen: its run in floats.
        name: of the chip, or its table's file.

    Raises:
        ModelError: there is no such chip.
    """
    program, chip = wiring.program, chip_of(name)
    found = [*_weights(program, chip), *_merged(program, chip, seen)]
    yield from found
    said = {each.what for each in found}
    problems = _problems(program, chip)
    for each in problems:
        # What was measured in the run is not repeated as it was computed.
        if each.refused or each.what.partition(":")[0] not in said:
            yield _problem(each, chip)
    if not any(each.refused for each in problems):
        yield from _late(program, chip, seen)
        if chip.arithmetic in ARITHMETICS:
            yield from _ran(program, chip, seen)


def _problems(program: Program, chip: Chip) -> list[Problem]:
    quantised = quantise(program, chip).problems if chip.arithmetic in ARITHMETICS else ()
    return [*quantised, *(place(program, chip).problems if chip.mesh is not None or chip.limits else ())]


def _problem(each: Problem, chip: Chip) -> Finding:
    name, severity = ("chip-refuses", "fault") if each.refused else ("chip-approximates", "warning")
    way = each.way_out or f"neuro fit --chip {chip.name} says more"
    return Finding(name, severity, each.what, each.origin, f"{chip.title}: {each.why}", way)


def _weights(program: Program, chip: Chip) -> Iterator[Finding]:
    """Weights other than 0 that rounding makes 0."""
    if chip.arithmetic not in ARITHMETICS:
        return
    for part, fixed in zip(program.projections, quantise(program, chip).projections, strict=True):
        if fixed is not None and (lost := fixed.rounding.zeroed) > FEW:
            evidence = f"{lost:.0%} of its weights become 0 on {chip.title}, whose step is {fixed.step.max():.3g}"
            remedy = "lower the largest weight of its population, which sets the scale, raise small ones, or prune them"
            yield finding("weights-erased", "fault" if lost > ERASED else "warning", part, evidence, remedy)


def _merged(program: Program, chip: Chip, seen: Observation) -> Iterator[Finding]:
    """Spikes of a step that become one where a spike is one bit, counted in the run."""
    if chip.arithmetic not in ARITHMETICS or not arithmetic_of(chip).one_bit:
        return
    said = False
    for k, lost in _lost(seen).items():
        part, spikes = program.populations[k], int(seen.populations[k].spikes.sum())
        relay = isinstance(part.model, Neuron) and part.model.relay
        if lost <= FEW or (relay and said):  # a relay repeats what was lost before it
            continue
        evidence = f"{lost:.1%} of its {spikes:,} spikes share a step with another of their neuron: a spike is one bit"
        remedy = ONCE if part.kind == "neuron" and not relay else MERGES
        said = True
        yield finding("spikes-merged", "fault" if lost > ERASED else "warning", part, evidence, remedy)


def _lost(seen: Observation) -> dict[int, float]:
    """The share of its spikes that each population loses where those of a neuron in a step are one."""
    sums = {k: (int(s.events.sum()), int(s.spikes.sum())) for k, s in enumerate(seen.populations)}
    return {k: 1.0 - events / spikes for k, (events, spikes) in sums.items() if events < spikes}


def _merged_rates(program: Program, seen: Observation) -> list[float]:
    """The rate of each population in floats where several spikes of an input in a step are one."""
    inputs = [k for k in _lost(seen) if program.populations[k].kind != "neuron"]
    heard = [replace(part, records=part.records or k in inputs) for k, part in enumerate(program.populations)]
    given = replace(program, populations=tuple(heard))
    backend = find_backend("event")
    first = observe(backend.build(given, threads=1), given, seen.steps, seen.drive, SECONDS, inputs)
    for k, (steps, ids) in first.kept.items():
        part = replace(heard[k], kind="listed", model=spike_generator(), parameters={}, schedule=None, stream=None)
        heard[k] = replace(part, spike_steps=steps, spike_ids=ids, start=0, stop=NEVER)
    once = replace(program, populations=tuple(heard))
    then = observe(backend.build(once, threads=1), once, seen.steps, seen.drive, SECONDS)
    return [then.rate(k) for k in range(len(heard))]


def _late(program: Program, chip: Chip, seen: Observation) -> Iterator[Finding]:
    """Rates at which the chip needs longer for a step than the step is."""
    try:
        placement = place(program, chip) if chip.mesh is not None else None
        spent = price(program, seen.counts, placement, chip).chip_time_s
    except ModelError:
        return  # no costs are published
    if spent is not None and spent > seen.ms / 1000.0:
        busiest = max(range(len(program.populations)), key=lambda k: seen.rate(k))
        evidence = (
            f"{chip.title} takes {spent * 1000.0:.3g} ms for {seen.ms:g} ms: it is late in real time; the highest "
            f"rate is {seen.rate(busiest):.3g} Hz, of '{program.populations[busiest].name}'"
        )
        remedy = "lower rates or the number of synapses, use a coarser `resolution`, or spread it over more cores"
        yield warning("too-fast-for-chip", program, evidence, remedy, program.populations[busiest].name)


def _ran(program: Program, chip: Chip, seen: Observation) -> Iterator[Finding]:
    """What its emulation does otherwise in the same run."""
    severity = "warning" if seen.driven else "fault"  # of an input that was made up
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", OverflowWarning)
        try:
            engine = find_backend(chip.path or chip.name).build(program, threads=1)
            ran = observe(engine, program, seen.steps, seen.drive, SECONDS)
        except ModelError as error:
            yield fault("chip-refuses", program, f"{chip.title}: {error.message}", error.hint or "neuro fit says more")
            return
    for each in {str(w.message): w.message for w in caught if isinstance(w.message, OverflowWarning)}.values():
        evidence = f"a register overflowed in {ran.ms:g} ms: {ran.native.get(each.what, 1):,} {each.what}"
        yield finding("chip-overflows", severity, program, evidence, each.hint or "lower the weights or rates onto it")
    merged, one_bit = list[float](), arithmetic_of(chip).one_bit
    for k, part in enumerate(program.populations):
        here, there = seen.rate(k), ran.rate(k)
        if (
            part.kind == "neuron"
            and seen.populations[k].spikes.sum() >= SPIKES
            and not here / APART <= there <= here * APART
        ):
            evidence = f"its rate is {there:.3g} Hz on {chip.title} and {here:.3g} Hz in floats"
            remedy = f"look at its rounding: neuro fit --chip {chip.name}; scale its weights and V_th to use more bits"
            if there < here > 1000.0 / program.resolution:
                evidence += f", which is {here * program.resolution / 1000.0:.3g} times a step"
                remedy = ONCE
            elif one_bit and _lost(seen):
                merged = merged or _merged_rates(program, seen)
                evidence += f"; {merged[k]:.3g} Hz in floats with one spike of an input in a step at most"
                if merged[k] / APART <= there <= merged[k] * APART:
                    remedy = MERGES
            yield finding("chip-differs", severity, part, evidence, remedy, part.name)
