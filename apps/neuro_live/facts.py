"""Descriptions for the page: the parts of a network, and the sliders of a selected part."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from neuro import ModelError, Simulation
from neuro.apps import Quantity, driver, settable
from neuro.extend import Floats, Neuron, Population
from neuro_live.beside import has_curve

KINDS = ("number", "integer", "boolean")
NOT_SHOWN = ("tau_minus", "start", "stop")
WIDE = {"Hz": 100.0, "pA": 500.0, "mV": 20.0, "ms": 20.0, "pF": 250.0, "nS": 10.0}
"""Range of a slider for each unit, if neither bounds nor the present value determine the range."""
PLACES = 500
"""Largest number of positions of a slider."""
LARGEST = 1e300
"""Bound of the ends of a slider, so that their difference is finite."""


def about(sim: Simulation) -> dict[str, Any]:
    """Describe a network for the page."""
    program = sim.program
    return {
        "name": program.name,
        "backend": sim.backend,
        "seed": program.seed,
        "resolution": program.resolution,
        "populations": [population(sim, part) for part in program.populations],
        "projections": [projection(sim, index) for index in range(len(program.projections))],
        "signals": [{"name": part.name, "to": program.populations[part.target].name} for part in program.signals],
    }


def population(sim: Simulation, part: Population) -> dict[str, Any]:
    """Describe a population for the page."""
    computes = isinstance(part.model, Neuron)
    return {
        "name": part.name,
        "model": part.model_name,
        "kind": part.kind,
        "size": part.size,
        "shape": list(part.shape),
        "records": part.records,
        "states": {s.name: s.unit for s in part.model.states if s.name in sim.states(part.name)} if computes else {},
        "driven": _is_driven(sim, part),
        "curve": isinstance(part.model, Neuron) and has_curve(part.model),
        "camera": list(part.shape[-2:]) if part.kind == "listed" and part.stream is not None else None,
    }


def _is_driven(sim: Simulation, part: Population) -> bool:
    try:
        driver(sim.program, sim.handles.neurons(part.name))
    except ModelError:
        return False
    return True


def projection(sim: Simulation, index: int) -> dict[str, Any]:
    """Describe a projection for the page."""
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
        "dopamine": sim.program.populations[part.dopamine].name if part.dopamine >= 0 else None,
        "negative": bool(weight.size and weight.mean() < 0.0),
        "unit": sim._values.synapses.weight_unit(index),
    }


def is_signal(sim: Simulation, name: str) -> bool:
    """Return whether a name is that of a signal."""
    return name in [part.name for part in sim.program.signals]


def settable_words(sim: Simulation, name: str) -> dict[str, Quantity]:
    """Return the settable quantities of a population, projection or signal by name."""
    if is_signal(sim, name):
        if next(part for part in sim.program.signals if part.name == name).values is not None:
            return {}
        return {"value": Quantity(unit="1/ms", doc="one for all neurons")}
    part = sim.handles.neurons_or_projection(name)
    if isinstance(part, int):
        rule = sim._run.rules[part]
        chosen = {word: rule.quantities()[word] for word in settable.settable_numbers(rule)}
        if sim.program.projections[part].size:
            chosen = {
                "weight": Quantity(unit=sim._values.synapses.weight_unit(part), doc="one for all synapses"),
                **chosen,
            }
    else:
        quantities = {word: settable.quantity_of(part.part, word) for word in part.part.parameters}
        chosen = {word: q for word, q in quantities.items() if q is not None and word not in NOT_SHOWN}
    return {word: q for word, q in chosen.items() if q.kind in KINDS}


def present(sim: Simulation, name: str, word: str) -> Floats:
    """Return the present values of a settable quantity; 0 for a signal, which has no present value."""
    if is_signal(sim, name):
        return np.zeros(1)
    part = sim.handles.neurons_or_projection(name)
    if isinstance(part, int) and word != "weight":
        return np.atleast_1d(np.asarray(sim._run.rules[part].parameters()[word], dtype=np.float64))
    values: Floats = sim.get(name, word)
    return values


def sliders(sim: Simulation, name: str) -> list[dict[str, Any]]:
    """Return a slider for each settable quantity of a part: present value, bounds, ends and step."""
    rows = []
    for word, q in settable_words(sim, name).items():
        avg = shown_value(present(sim, name, word))
        signs = {">": q.above, "≥": q.at_least, "<": q.below, "≤": q.at_most}
        bounds = ", ".join(f"{sign} {bound:g}" for sign, bound in signs.items() if bound is not None)
        low, high, step = slider_ends(q, avg["value"] or 0.0, sim.program.resolution, partial(accepts, sim, name, word))
        slider = {"word": word, "unit": q.unit, "doc": q.doc, "kind": q.kind, "bounds": bounds}
        rows.append({**slider, **avg, "low": low, "high": high, "step": step})
    return rows


def accepts(sim: Simulation, name: str, word: str, value: float) -> bool:
    """Return whether a value is valid together with the present values of the other parameters, without setting it."""
    if is_signal(sim, name):
        return True
    part = sim.handles.neurons_or_projection(name)
    try:
        if not isinstance(part, int):
            sim._values.cells.checked(part, {word: value})
        elif word == "weight":
            sim._values.synapses.checked_weights(part, value)
        else:
            sim._values.synapses.checked_rule(part, {word: value})
    except ModelError:
        return False
    return True


def shown_value(values: Floats) -> dict[str, Any]:
    """Return the mean of the values, or None if it is not finite, and whether all values are equal."""
    with np.errstate(over="ignore"):
        mean = float(values.mean()) if values.size else 0.0
    return {
        "value": mean if math.isfinite(mean) else None,
        "same": not values.size or bool((values == values.flat[0]).all()),
    }


def slider_ends(
    q: Quantity, value: float, resolution: float, accepted: Callable[[float], bool]
) -> tuple[float, float, float]:
    """Return the ends and the step of a slider. The ends are valid values and multiples of the step.

    Args:
        q: the quantity.
        value: present value.
        resolution: resolution of the network, ms.
        accepted: function that returns whether a value is valid.
    """
    low, high = (max(-LARGEST, min(end, LARGEST)) for end in span(q, value))
    power = 10.0 ** math.floor(math.log10((high - low) / PLACES))
    step = 1.0 if q.kind == "integer" else next(n * power for n in (1, 2, 5, 10) if n * power * PLACES >= high - low)
    if q.unit == "ms" and not any(accepted((value // step + k) * step) for k in (-1, 1, 3)):
        step = resolution * max(1, round(step / resolution))
    return furthest(value, low, step, accepted), furthest(value, high, step, accepted), step


def furthest(value: float, end: float, step: float, accepted: Callable[[float], bool]) -> float:
    """Return the valid multiple of `step`, from `value` to `end`, that is closest to `end`; `value` if none is valid.

    Validity is assumed to end at one point on the way, which is found by bisection.
    """
    sign = 1 if end > value else -1
    near, edge = math.ceil(sign * value / step - 1e-6), math.floor(sign * end / step + 1e-6)

    def at(k: int) -> float:
        return float(f"{sign * k * step:.12g}")

    if edge < near or not accepted(at(near)):
        return value
    for step_k in (edge, edge - 1):  # usually the bound itself is valid, or the value next to an exclusive bound
        if accepted(at(step_k)):
            return at(step_k)
    while edge - near > 1:
        middle = (near + edge) // 2
        near, edge = (middle, edge) if accepted(at(middle)) else (near, middle)
    return at(near)


def span(q: Quantity, value: float) -> tuple[float, float]:
    """Return the desired ends of a slider: the bounds, or the value plus and minus its distance from 0."""
    lower = q.at_least if q.at_least is not None else q.above
    upper = q.at_most if q.at_most is not None else q.below
    reach = abs(value) if abs(value) > 1.0 / LARGEST else WIDE.get(q.unit, 1.0)
    low = _finite(lower, value - reach if lower is None or math.isinf(lower) else lower)
    high = _finite(upper, value + reach if value < 0.0 or lower is None else low + 3.0 * max(value - low, reach / 3.0))
    return (low, high) if low < high else (low, low + 1.0)


def _finite(bound: float | None, default: float) -> float:
    return default if bound is None or math.isinf(bound) else float(bound)
