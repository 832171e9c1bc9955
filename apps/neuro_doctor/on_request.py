"""Checks that are made on request: the network on a chip, and the gradients that training would see."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import replace
from functools import cache

import numpy as np

from neuro import ModelError, OverflowWarning, spike_generator
from neuro.apps import ARITHMETICS, NEVER, arithmetic_of, find_backend
from neuro.chips import Chip, chip as chip_of, place, price, quantise
from neuro.extend import Neuron, Problem, Program
from neuro_doctor.findings import Finding, fault, figure, finding, note, warning
from neuro_doctor.observing import Observation, observe
from neuro_doctor.structure import is_end
from neuro_doctor.wiring import Wiring

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


def of_chip(wiring: Wiring, seen: Observation, name: str) -> Iterator[Finding]:
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


GONE = 1e-2
"""Size of a gradient, relative to that at the outputs, below which a layer hardly learns. Optimisers that rescale, as
Adam does, hide it at first, not the noise of small batches."""
MUCH = 1e2
"""Likewise, above which a step overshoots."""
GROWN = 1e3
"""Growth through recurrence above which gradients explode. Beside torch's gradients of 40 recurrent neurons over 20
steps this estimate begins to grow at the same weights, and is ten to twenty times too large from there on."""
WINDOW_MS = 100.0
"""What a recording takes through which errors go back in time: N-MNIST's saccades have 105 ms."""


def of_gradients(wiring: Wiring, seen: Observation) -> Iterator[Finding]:
    """Findings about gradients."""
    program = wiring.program
    if not any(s.spikes.any() for s in seen.populations):
        yield note(
            "no-gradients", program, "nothing fired: gradients cannot be judged", "give it input, or `--drive 20`"
        )
        return
    for wires in program.projections:
        target = program.populations[wires.target]
        alike = wires.layout == "dense" and bool((wires.weight == wires.weight[:1]).all())
        if alike and target.size > 1 and wiring.out_of(wires.target):
            evidence = f"all its weights are {wires.weight[0]:g}: all neurons of '{target.name}' get one gradient"
            yield fault("weights-alike", wires, evidence, "draw them, as `weight: {normal: {mean: 0.0, std: 0.1}}`")
    sizes = _sizes(wiring, seen)
    for k, part in enumerate(program.populations):
        if part.kind != "neuron" or k not in sizes:
            continue
        s = surrogate(wiring, seen, k)
        said = "" if s is None else f"; the surrogate of its neurons is {s:.2g} on average, of at most 1"
        evidence = f"a gradient of 1 at the outputs is {sizes[k]:.2g} at it{said}"
        names = wiring.names(wiring.out_of(k))
        if sizes[k] < GONE and names:
            layers = _layers(wiring, k)
            passes = max(sizes[k], 1e-30) ** (1.0 / layers)
            if layers > 1:
                evidence += f"; each of {layers} layers passes {passes:.2g} of its gradient"
            each = f"{names} and of the layers behind" if layers > 1 else names
            remedy = f"draw weights of {each} up to {figure(1.0 / passes)} times larger: V_m is to come near V_th"
            yield fault("gradients-vanish", part, evidence, remedy)
        elif sizes[k] > MUCH:
            yield fault("gradients-explode", part, evidence, f"draw smaller weights for {names}")
    for q, wires in enumerate(program.projections):
        if wires.source != wires.target or wires.carries != "spikes":
            continue
        growth = _growth(wiring, seen, q)
        if growth is not None and growth > GROWN:
            back = f"a gradient grows {growth:.2g} times on its way back through {WINDOW_MS:g} ms of recurrence"
            yield fault("gradients-explode", wires, back, "draw smaller recurrent weights, or cut gradients in time")


def _layers(wiring: Wiring, k: int) -> int:
    """The fewest projections from a population to an output."""
    ahead, passed = {k}, {k}
    for layers in range(len(wiring.program.populations)):
        after = {wiring.program.projections[q].target for j in ahead for q in wiring.out_of(j)} - passed
        if not after:
            break
        if any(is_end(wiring, j) for j in after):
            return layers + 1
        ahead, passed = after, passed | after
    return 1


def surrogate(wiring: Wiring, seen: Observation, k: int) -> float | None:
    """The mean of 1 / (1 + abs(x))^2 at x = (V_m - V_th) / (V_th - V_reset), over time and followed neurons."""
    cell, v = wiring.cell(k), seen.populations[k].potentials
    if cell is None or not v.size or "V_reset" not in cell.parameters:
        return None
    x = (v - cell.threshold) / (cell.threshold - cell.parameters["V_reset"])
    return float((1.0 / (1.0 + np.abs(x)) ** 2).mean())


def _spread(wiring: Wiring, q: int) -> float:
    """sqrt(sum w^2 / sources)."""
    part, w = wiring.program.projections[q], wiring.weights[q]
    if not w.synapses or not part.weight.size:
        return 0.0
    squares = float(np.einsum("i,i->", part.weight, part.weight)) * w.synapses / part.weight.size
    return float(np.sqrt(squares / wiring.program.populations[part.source].size))


def _factor(wiring: Wiring, seen: Observation, q: int, whole: bool) -> float | None:
    """What passing a projection makes of a gradient: of all later steps, or only the peak."""
    part = wiring.program.projections[q]
    cell, s = wiring.cell(part.target), surrogate(wiring, seen, part.target)
    if cell is None or s is None:
        return None
    response = cell.response(wiring.receptors(q)[0][0])
    reach = float(np.abs(response).sum() if whole else np.abs(response).max())
    return _spread(wiring, q) * reach * s / (cell.threshold - cell.parameters["V_reset"])


def _sizes(wiring: Wiring, seen: Observation) -> dict[int, float]:
    """The size of a gradient at each population that leads to an output, where it is 1; recurrence left out."""
    program = wiring.program
    ahead = {
        k: [
            q
            for q in wiring.out_of(k)
            if program.projections[q].target != k and program.projections[q].carries == "spikes"
        ]
        for k in range(len(program.populations))
    }

    @cache
    def size(k: int, before: frozenset[int]) -> float | None:
        ways = [q for q in ahead[k] if program.projections[q].target not in before]
        if not ways:
            return 1.0
        found = []
        for q in ways:
            factor, beyond = _factor(wiring, seen, q, whole=True), size(program.projections[q].target, before | {k})
            if factor is not None and beyond is not None:
                found.append(factor * beyond)
        return float(np.sqrt(np.square(found).sum())) if found else None

    every = {k: size(k, frozenset()) for k in range(len(program.populations))} if len(ahead) <= 12 else {}
    return {k: g for k, g in every.items() if g is not None}


def _growth(wiring: Wiring, seen: Observation, q: int) -> float | None:
    part, factor = wiring.program.projections[q], _factor(wiring, seen, q, whole=False)
    cell = wiring.cell(part.target)
    if factor is None or cell is None:
        return None
    delay = part.delay_span[0]
    leak = np.exp(-delay * cell.h / cell.parameters.get("tau_m", np.inf))
    with np.errstate(over="ignore"):
        return float((leak + factor) ** (WINDOW_MS / (delay * cell.h)))
