"""The description of a network that a page gets once: its parts, their parameters, and the bounds of these."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from neuro.core.errors import ModelError
from neuro.core.quantities import Quantity
from neuro.live.beside import has_curve
from neuro.model.neurons import Neuron
from neuro.program.program import Floats, Population, Projection
from neuro.run import settable
from neuro.run.lesions import driver
from neuro.run.simulation import Simulation

KINDS = ("number", "integer", "boolean")
NOT_SHOWN = ("tau_minus", "start", "stop")
WIDE = {"Hz": 100.0, "pA": 500.0, "mV": 20.0, "ms": 20.0, "pF": 250.0, "nS": 10.0}
"""How far a slider goes by the unit, where neither bounds nor the present value give it."""
MOST_PARTS = 400
"""Populations and projections of which a page has sliders; of more it shows activity only."""


def about(sim: Simulation) -> dict[str, Any]:
    """The network in the words of the page."""
    program = sim.program
    parts = len(program.populations) + len(program.projections)
    sliders = parts <= MOST_PARTS
    return {
        "name": program.name,
        "backend": sim.backend,
        "seed": program.seed,
        "resolution": program.resolution,
        "populations": [population(sim, part, sliders) for part in program.populations],
        "projections": [projection(sim, index, sliders) for index in range(len(program.projections))],
        "signals": [
            {
                "name": part.name,
                "to": program.populations[part.target].name,
                "sliders": [slider("value", Quantity(unit="1/ms", doc="one for all neurons"), np.zeros(1))],
            }
            for part in program.signals
        ],
    }


def population(sim: Simulation, part: Population, sliders: bool) -> dict[str, Any]:
    """A population."""
    computes = isinstance(part.model, Neuron)
    return {
        "name": part.name,
        "model": part.said,
        "kind": part.kind,
        "size": part.size,
        "shape": list(part.shape),
        "records": part.records,
        "states": {s.name: s.unit for s in part.model.states if s.name in sim.states(part.name)} if computes else {},
        "driven": _is_driven(sim, part),
        "curve": isinstance(part.model, Neuron) and has_curve(part.model),
        "camera": list(part.shape[-2:]) if part.kind == "listed" and part.stream is not None else None,
        "sliders": neuron_sliders(sim, part) if sliders else [],
    }


def _is_driven(sim: Simulation, part: Population) -> bool:
    try:
        driver(sim.program, sim.handles.neurons(part.name))
    except ModelError:
        return False
    return True


def neuron_sliders(sim: Simulation, part: Population) -> list[dict[str, Any]]:
    """The parameters of a population that can be set."""
    found = []
    for word in part.parameters:
        q = settable.quantity_of(part, word)
        if q is not None and q.kind in KINDS and word not in NOT_SHOWN:
            found.append(slider(word, q, sim.get(part.name, word)))
    return found


def projection(sim: Simulation, index: int, sliders: bool) -> dict[str, Any]:
    """A projection."""
    part = sim.program.projections[index]
    source, target = (sim.program.populations[end] for end in (part.source, part.target))
    weight = part.weight
    return {
        "name": part.name,
        "from": source.name,
        "to": target.name,
        "synapse": part.synapse.name,
        "size": part.size,
        "learns": bool(part.synapse.learns),
        "negative": bool(weight.size and weight.mean() < 0.0),
        "unit": weight_unit(part, target),
        "sliders": synapse_sliders(sim, index) if sliders else [],
    }


def weight_unit(part: Projection, target: Population) -> str:
    """The unit of the weights of a projection."""
    return "" if part.carries == "current" else getattr(target.model, "weight_unit", "")


def synapse_sliders(sim: Simulation, index: int) -> list[dict[str, Any]]:
    """The weight of a projection, and the numbers of its rule that can be set."""
    part = sim.program.projections[index]
    rule = sim._rules[index]
    unit = weight_unit(part, sim.program.populations[part.target])
    found = [slider("weight", Quantity(unit=unit, doc="one for all synapses"), part.weight)] if part.size else []
    for word in settable.settable_numbers(rule):
        q, value = rule.quantities()[word], rule.parameters()[word]
        if q.kind in KINDS:
            found.append(slider(word, q, np.atleast_1d(np.asarray(value, dtype=np.float64))))
    return found


def slider(word: str, q: Quantity, values: Floats) -> dict[str, Any]:
    """A number that can be set: what it is now, how far its slider goes, and its bounds."""
    now = shown_value(values)
    low, high = span(q, now["value"] or 0.0)
    signs = {">": q.above, "≥": q.at_least, "<": q.below, "≤": q.at_most}
    bounds = ", ".join(f"{sign} {bound:g}" for sign, bound in signs.items() if bound is not None)
    about = {"word": word, "unit": q.unit, "doc": q.doc, "kind": q.kind, "bounds": bounds}
    return {**about, "low": low, "high": high, **now}


def shown_value(values: Floats) -> dict[str, Any]:
    """The mean of values, None where it is infinite, and whether all are the same."""
    mean = float(values.mean()) if values.size else 0.0
    return {
        "value": mean if math.isfinite(mean) else None,
        "same": bool(values.size == 0 or (values == values.flat[0]).all()),
    }


def span(q: Quantity, value: float) -> tuple[float, float]:
    """How far a slider goes: to the bounds, or as far again as the value is from 0."""
    least = q.at_least if q.at_least is not None else q.above
    most = q.at_most if q.at_most is not None else q.below
    reach = abs(value) or WIDE.get(q.unit, 1.0)
    low = _finite(least, value - reach if least is None or math.isinf(least) else least)
    high = _finite(most, value + reach if value < 0.0 or least is None else low + 3.0 * max(value - low, reach / 3.0))
    return (low, high) if low < high else (low, low + 1.0)


def _finite(bound: float | None, other: float) -> float:
    return other if bound is None or math.isinf(bound) else float(bound)
