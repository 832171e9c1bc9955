"""What gradients of surrogates would see: whether they vanish or explode on their way from the outputs.

An estimate from the weights and from the potentials of the run, without tensors. A gradient passes a projection with
the factor W^T diag(s) r: s is the surrogate of the target, r the sum of its response to a spike, as a spike acts on all
later steps. Of random gradients this changes the root mean square by sqrt(sum w^2 / sources) s r.

Source: Neftci, Mostafa & Zenke, IEEE Signal Process. Mag. 36(6):51, 2019; the surrogate is that of Zenke and Ganguli,
Neural Comput. 30(6):1514, 2018, with slope 1.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache

import numpy as np

from neuro.diagnosis.findings import Finding, fault, figure, note
from neuro.diagnosis.observing import Observation
from neuro.diagnosis.structure import is_end
from neuro.diagnosis.wiring import Wiring

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


def findings(wiring: Wiring, seen: Observation) -> Iterator[Finding]:
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
