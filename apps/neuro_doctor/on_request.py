"""Optional checks: the network on a chip, and the surrogate gradients of training."""

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
"""Least share of erased weights or merged spikes that is a fault (ERASED), and that is reported (FEW). The loss of a
tenth of the input changes a mean rate by about a tenth, and may change decisions."""
MOST_RATIO = 2.0
"""Largest accepted ratio of the mean rates on the chip and in floats."""
SPIKES = 20
"""Least number of spikes of a population for a comparison of rates."""
ONE_BIT_SPIKES = "use a finer `resolution`, or several generators of a lower rate: on the chip a spike is one bit"
ONE_SPIKE_PER_STEP = "lower its weights, raise V_th, or use a finer `resolution`: a neuron fires once per step there"
SECONDS = 10.0
"""Longest run on the chip's emulation, s of wall-clock time."""


def chip_findings(wiring: Wiring, run: Observation, name: str) -> Iterator[Finding]:
    """Yield findings about a network on a chip.

    Args:
        wiring: wiring of the network.
        run: record of the run in floats.
        name: name of the chip, or file of its table.

    Raises:
        ModelError: there is no such chip.
    """
    program, chip = wiring.program, chip_of(name)
    measured = [*_weights(program, chip), *_merged(program, chip, run)]
    yield from measured
    measured_parts = {problem.what for problem in measured}
    problems = _problems(program, chip)
    for problem in problems:
        # A part with a measured problem does not get a second finding from the estimate.
        if problem.refused or problem.what.partition(":")[0] not in measured_parts:
            yield _problem(problem, chip)
    if not any(problem.refused for problem in problems):
        yield from _slower_than_real_time(program, chip, run)
        if chip.arithmetic in ARITHMETICS:
            yield from _compare_runs(program, chip, run)


def _problems(program: Program, chip: Chip) -> list[Problem]:
    quantised = quantise(program, chip).problems if chip.arithmetic in ARITHMETICS else ()
    return [*quantised, *(place(program, chip).problems if chip.mesh is not None or chip.limits else ())]


def _problem(problem: Problem, chip: Chip) -> Finding:
    name, severity = ("chip-refuses", "fault") if problem.refused else ("chip-approximates", "warning")
    remedy = problem.way_out or f"neuro fit --chip {chip.name} says more"
    return Finding(name, severity, problem.what, problem.origin, f"{chip.title}: {problem.why}", remedy)


def _weights(program: Program, chip: Chip) -> Iterator[Finding]:
    """Yield findings about weights that rounding changes to 0."""
    if chip.arithmetic not in ARITHMETICS:
        return
    for part, fixed in zip(program.projections, quantise(program, chip).projections, strict=True):
        if fixed is not None and (loss := fixed.rounding.zeroed) > FEW:
            evidence = f"{loss:.0%} of its weights become 0 on {chip.title}, whose step is {fixed.step.max():.3g}"
            remedy = "lower the largest weight of its population, which sets the scale, raise small ones, or prune them"
            yield finding("weights-erased", "fault" if loss > ERASED else "warning", part, evidence, remedy)


def _merged(program: Program, chip: Chip, run: Observation) -> Iterator[Finding]:
    """Yield findings about several spikes of a neuron in a step, which a chip with one-bit spikes merges."""
    if chip.arithmetic not in ARITHMETICS or not arithmetic_of(chip).one_bit:
        return
    reported = False
    for k, loss in _lost(run).items():
        part, spikes = program.populations[k], int(run.populations[k].spikes.sum())
        relay = isinstance(part.model, Neuron) and part.model.relay
        if loss <= FEW or (relay and reported):  # the losses of a relay are those of its input
            continue
        evidence = f"{loss:.1%} of its {spikes:,} spikes share a step with another of their neuron: a spike is one bit"
        remedy = ONE_SPIKE_PER_STEP if part.kind == "neuron" and not relay else ONE_BIT_SPIKES
        reported = True
        yield finding("spikes-merged", "fault" if loss > ERASED else "warning", part, evidence, remedy)


def _lost(run: Observation) -> dict[int, float]:
    """Return the share of spikes that each population loses if the spikes of a neuron in a step merge."""
    totals = {k: (int(s.events.sum()), int(s.spikes.sum())) for k, s in enumerate(run.populations)}
    return {k: 1.0 - events / spikes for k, (events, spikes) in totals.items() if events < spikes}


def _merged_rates(program: Program, run: Observation) -> list[float]:
    """Return the rate of each population in floats, Hz, if the spikes of an input neuron in a step merge.

    A first run records the spikes of the inputs, a second run replays each spike once per step.
    """
    inputs = [k for k in _lost(run) if program.populations[k].kind != "neuron"]
    parts = [replace(part, records=part.records or k in inputs) for k, part in enumerate(program.populations)]
    recording = replace(program, populations=tuple(parts))
    backend = find_backend("event")
    input_run = observe(backend.build(recording, threads=1), recording, run.steps, run.drive, SECONDS, inputs)
    for k, (steps, ids) in input_run.all_spikes.items():
        part = replace(parts[k], kind="listed", model=spike_generator(), parameters={}, schedule=None, stream=None)
        parts[k] = replace(part, spike_steps=steps, spike_ids=ids, start=0, stop=NEVER)
    replaying = replace(program, populations=tuple(parts))
    merged_run = observe(backend.build(replaying, threads=1), replaying, run.steps, run.drive, SECONDS)
    return [merged_run.rate(k) for k in range(len(parts))]


def _slower_than_real_time(program: Program, chip: Chip, run: Observation) -> Iterator[Finding]:
    """Yield a finding if the chip needs more time for the run than the run's biological time."""
    try:
        placement = place(program, chip) if chip.mesh is not None else None
        chip_time_s = price(program, run.counts, placement, chip).chip_time_s
    except ModelError:
        return  # no costs are published
    if chip_time_s is not None and chip_time_s > run.ms / 1000.0:
        busiest = max(range(len(program.populations)), key=lambda k: run.rate(k))
        evidence = (
            f"{chip.title} takes {chip_time_s * 1000.0:.3g} ms for {run.ms:g} ms: it is late in real time; the highest "
            f"rate is {run.rate(busiest):.3g} Hz, of '{program.populations[busiest].name}'"
        )
        remedy = "lower rates or the number of synapses, use a coarser `resolution`, or spread it over more cores"
        yield warning("too-fast-for-chip", program, evidence, remedy, program.populations[busiest].name)


def _compare_runs(program: Program, chip: Chip, run: Observation) -> Iterator[Finding]:
    """Yield findings about overflows and different rates in the same run on the chip's emulation."""
    severity = "warning" if run.driven else "fault"  # artificial input proves no fault
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", OverflowWarning)
        try:
            engine = find_backend(chip.path or chip.name).build(program, threads=1)
            chip_run = observe(engine, program, run.steps, run.drive, SECONDS)
        except ModelError as error:
            yield fault("chip-refuses", program, f"{chip.title}: {error.message}", error.hint or "neuro fit says more")
            return
    for item in {str(w.message): w.message for w in caught if isinstance(w.message, OverflowWarning)}.values():
        evidence = f"a register overflowed in {chip_run.ms:g} ms: {chip_run.native.get(item.what, 1):,} {item.what}"
        yield finding("chip-overflows", severity, program, evidence, item.hint or "lower the weights or input rates")
    merged, one_bit = list[float](), arithmetic_of(chip).one_bit
    for k, part in enumerate(program.populations):
        float_rate, chip_rate = run.rate(k), chip_run.rate(k)
        if (
            part.kind == "neuron"
            and run.populations[k].spikes.sum() >= SPIKES
            and not float_rate / MOST_RATIO <= chip_rate <= float_rate * MOST_RATIO
        ):
            evidence = f"its rate is {chip_rate:.3g} Hz on {chip.title} and {float_rate:.3g} Hz in floats"
            remedy = f"look at its rounding: neuro fit --chip {chip.name}; scale its weights and V_th to use more bits"
            if chip_rate < float_rate > 1000.0 / program.resolution:
                evidence += f", which is {float_rate * program.resolution / 1000.0:.3g} times a step"
                remedy = ONE_SPIKE_PER_STEP
            elif one_bit and _lost(run):
                merged = merged or _merged_rates(program, run)
                evidence += f"; {merged[k]:.3g} Hz in floats with one spike of an input in a step at most"
                if merged[k] / MOST_RATIO <= chip_rate <= merged[k] * MOST_RATIO:
                    remedy = ONE_BIT_SPIKES
            yield finding("chip-differs", severity, part, evidence, remedy, part.name)


LEAST_GRADIENT = 1e-2
"""Least gradient of a layer, relative to the gradient at the outputs. With a smaller one the layer hardly learns.
Optimizers that rescale, such as Adam, hide this at first, but not the noise of small batches."""
MOST_GRADIENT = 1e2
"""Largest gradient of a layer, relative to the gradient at the outputs. With a larger one a step overshoots."""
MOST_GROWTH = 1e3
"""Largest growth of a gradient through recurrence. Compared with torch's gradients of 40 recurrent neurons over 20
steps, this estimate begins to grow at the same weights, and is 10 to 20 times too large at larger weights."""
WINDOW_MS = 100.0
"""Duration of a recording through which gradients go back in time, ms; N-MNIST's saccades have 105 ms."""


def gradient_findings(wiring: Wiring, run: Observation) -> Iterator[Finding]:
    """Yield findings about surrogate gradients."""
    program = wiring.program
    if not any(s.spikes.any() for s in run.populations):
        yield note(
            "no-gradients", program, "nothing fired: gradients cannot be judged", "give it input, or `--drive 20`"
        )
        return
    for wires in program.projections:
        target = program.populations[wires.target]
        equal_rows = wires.layout == "dense" and bool((wires.weight == wires.weight[:1]).all())
        if equal_rows and target.size > 1 and wiring.out_of(wires.target):
            evidence = f"all its weights are {wires.weight[0]:g}: all neurons of '{target.name}' get the same gradient"
            yield fault("weights-alike", wires, evidence, "draw them, as `weight: {normal: {mean: 0.0, std: 0.1}}`")
    sizes = _sizes(wiring, run)
    for k, part in enumerate(program.populations):
        if part.kind != "neuron" or k not in sizes:
            continue
        s = surrogate(wiring, run, k)
        slope = "" if s is None else f"; the surrogate of its neurons is {s:.2g} on average, of at most 1"
        evidence = f"a gradient of 1 at the outputs becomes {sizes[k]:.2g} here{slope}"
        names = wiring.names(wiring.out_of(k))
        if sizes[k] < LEAST_GRADIENT and names:
            layers = _layers(wiring, k)
            passes = max(sizes[k], 1e-30) ** (1.0 / layers)
            if layers > 1:
                evidence += f"; each of {layers} layers passes {passes:.2g} of its gradient"
            targets = f"{names} and of the later layers" if layers > 1 else names
            remedy = f"draw weights of {targets} up to {figure(1.0 / passes)} times larger, so that V_m comes near V_th"
            yield fault("gradients-vanish", part, evidence, remedy)
        elif sizes[k] > MOST_GRADIENT:
            yield fault("gradients-explode", part, evidence, f"draw smaller weights for {names}")
    for q, wires in enumerate(program.projections):
        if wires.source != wires.target or wires.carries != "spikes":
            continue
        growth = _growth(wiring, run, q)
        if growth is not None and growth > MOST_GROWTH:
            text = f"a gradient grows {growth:.2g} times on its way back through {WINDOW_MS:g} ms of recurrence"
            yield fault("gradients-explode", wires, text, "draw smaller recurrent weights, or cut gradients in time")


def _layers(wiring: Wiring, k: int) -> int:
    """Return the least number of projections from a population to an output."""
    frontier, passed = {k}, {k}
    for layers in range(len(wiring.program.populations)):
        targets = {wiring.program.projections[q].target for j in frontier for q in wiring.out_of(j)} - passed
        if not targets:
            break
        if any(is_end(wiring, j) for j in targets):
            return layers + 1
        frontier, passed = targets, passed | targets
    return 1


def surrogate(wiring: Wiring, run: Observation, k: int) -> float | None:
    """Return the mean of 1 / (1 + abs(x))^2 at x = (V_m - V_th) / (V_th - V_reset) over time and sampled neurons."""
    cell, v = wiring.cell(k), run.populations[k].potentials
    if cell is None or not v.size or "V_reset" not in cell.parameters:
        return None
    x = (v - cell.threshold) / (cell.threshold - cell.parameters["V_reset"])
    return float((1.0 / (1.0 + np.abs(x)) ** 2).mean())


def _spread(wiring: Wiring, q: int) -> float:
    """Return sqrt(sum of squared weights / number of source neurons)."""
    part, w = wiring.program.projections[q], wiring.weights[q]
    if not w.synapses or not part.weight.size:
        return 0.0
    squares = float(np.einsum("i,i->", part.weight, part.weight)) * w.synapses / part.weight.size
    return float(np.sqrt(squares / wiring.program.populations[part.source].size))


def _factor(wiring: Wiring, run: Observation, q: int, to_end: bool) -> float | None:
    """Return the factor by which a projection scales a gradient that passes back through it; None if unknown.

    The factor uses the sum of the postsynaptic potential over time if `to_end`, else its peak.
    """
    part = wiring.program.projections[q]
    cell, s = wiring.cell(part.target), surrogate(wiring, run, part.target)
    if cell is None or s is None:
        return None
    response = cell.response(wiring.receptors(q)[0][0])
    reach = float(np.abs(response).sum() if to_end else np.abs(response).max())
    return _spread(wiring, q) * reach * s / (cell.threshold - cell.parameters["V_reset"])


def _sizes(wiring: Wiring, run: Observation) -> dict[int, float]:
    """Return the gradient at each population relative to the gradient at the outputs, without recurrent projections."""
    program = wiring.program
    forward = {
        k: [
            q
            for q in wiring.out_of(k)
            if program.projections[q].target != k and program.projections[q].carries == "spikes"
        ]
        for k in range(len(program.populations))
    }

    @cache
    def size(k: int, visited: frozenset[int]) -> float | None:
        outgoing = [q for q in forward[k] if program.projections[q].target not in visited]
        if not outgoing:
            return 1.0
        terms = []
        for q in outgoing:
            factor, beyond = _factor(wiring, run, q, to_end=True), size(program.projections[q].target, visited | {k})
            if factor is not None and beyond is not None:
                terms.append(factor * beyond)
        return float(np.sqrt(np.square(terms).sum())) if terms else None

    sizes = {k: size(k, frozenset()) for k in range(len(program.populations))} if len(forward) <= 12 else {}
    return {k: g for k, g in sizes.items() if g is not None}


def _growth(wiring: Wiring, run: Observation, q: int) -> float | None:
    """Return the factor by which a recurrent projection scales a gradient within WINDOW_MS; None if unknown."""
    part, factor = wiring.program.projections[q], _factor(wiring, run, q, to_end=False)
    cell = wiring.cell(part.target)
    if factor is None or cell is None:
        return None
    delay = part.delay_span[0]
    leak = np.exp(-delay * cell.h / cell.parameters.get("tau_m", np.inf))
    with np.errstate(over="ignore"):
        return float((leak + factor) ** (WINDOW_MS / (delay * cell.h)))
