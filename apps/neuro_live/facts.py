"""What a page says of a network: its parts, once; what can be set of a part, when it is chosen."""

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
"""How far a slider goes by the unit, where neither bounds nor the present value give it."""
PLACES = 500
"""Places of a slider, at most."""
LARGEST = 1e300
"""Of what a slider can reach, so that no difference is infinite."""


def about(sim: Simulation) -> dict[str, Any]:
    """The network in the words of the page."""
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
    """A population."""
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
        "dopamine": sim.program.populations[part.dopamine].name if part.dopamine >= 0 else None,
        "negative": bool(weight.size and weight.mean() < 0.0),
        "unit": sim._values.synapses.weight_unit(index),
    }


def is_signal(sim: Simulation, name: str) -> bool:
    """Whether a part is a signal."""
    return name in [part.name for part in sim.program.signals]


def settable_words(sim: Simulation, name: str) -> dict[str, Quantity]:
    """What can be set of a population, projection or signal, by word."""
    if is_signal(sim, name):
        if next(part for part in sim.program.signals if part.name == name).values is not None:
            return {}
        return {"value": Quantity(unit="1/ms", doc="one for all neurons")}
    found = sim.handles.neurons_or_projection(name)
    if isinstance(found, int):
        rule = sim._run.rules[found]
        words = {word: rule.quantities()[word] for word in settable.settable_numbers(rule)}
        if sim.program.projections[found].size:
            words = {
                "weight": Quantity(unit=sim._values.synapses.weight_unit(found), doc="one for all synapses"),
                **words,
            }
    else:
        each = {word: settable.quantity_of(found.part, word) for word in found.part.parameters}
        words = {word: q for word, q in each.items() if q is not None and word not in NOT_SHOWN}
    return {word: q for word, q in words.items() if q.kind in KINDS}


def present(sim: Simulation, name: str, word: str) -> Floats:
    """The values of what can be set of a part; of a signal 0, since it has none between two settings."""
    if is_signal(sim, name):
        return np.zeros(1)
    found = sim.handles.neurons_or_projection(name)
    if isinstance(found, int) and word != "weight":
        return np.atleast_1d(np.asarray(sim._run.rules[found].parameters()[word], dtype=np.float64))
    values: Floats = sim.get(name, word)
    return values


def sliders(sim: Simulation, name: str) -> list[dict[str, Any]]:
    """What can be set of a part: what it is now, its bounds, and how far its slider goes."""
    found = []
    for word, q in settable_words(sim, name).items():
        now = shown_value(present(sim, name, word))
        signs = {">": q.above, "≥": q.at_least, "<": q.below, "≤": q.at_most}
        bounds = ", ".join(f"{sign} {bound:g}" for sign, bound in signs.items() if bound is not None)
        low, high, step = slider_ends(q, now["value"] or 0.0, sim.program.resolution, partial(accepts, sim, name, word))
        about = {"word": word, "unit": q.unit, "doc": q.doc, "kind": q.kind, "bounds": bounds}
        found.append({**about, **now, "low": low, "high": high, "step": step})
    return found


def accepts(sim: Simulation, name: str, word: str, value: float) -> bool:
    """Whether a parameter of a part may have a value, beside those that the others have now; nothing is set."""
    if is_signal(sim, name):
        return True
    found = sim.handles.neurons_or_projection(name)
    try:
        if not isinstance(found, int):
            sim._values.cells.checked(found, {word: value})
        elif word == "weight":
            sim._values.synapses.checked_weights(found, value)
        else:
            sim._values.synapses.checked_rule(found, {word: value})
    except ModelError:
        return False
    return True


def shown_value(values: Floats) -> dict[str, Any]:
    """The mean of values, None where it is infinite, and whether all are the same."""
    with np.errstate(over="ignore"):
        mean = float(values.mean()) if values.size else 0.0
    return {
        "value": mean if math.isfinite(mean) else None,
        "same": not values.size or bool((values == values.flat[0]).all()),
    }


def slider_ends(
    q: Quantity, value: float, resolution: float, accepted: Callable[[float], bool]
) -> tuple[float, float, float]:
    """The ends of a slider, which are accepted, and its step, of which they are multiples."""
    low, high = (max(-LARGEST, min(end, LARGEST)) for end in span(q, value))
    ten = 10.0 ** math.floor(math.log10((high - low) / PLACES))
    step = 1.0 if q.kind == "integer" else next(n * ten for n in (1, 2, 5, 10) if n * ten * PLACES >= high - low)
    if q.unit == "ms" and not any(accepted((value // step + k) * step) for k in (-1, 1, 3)):
        step = resolution * max(1, round(step / resolution))
    return furthest(value, low, step, accepted), furthest(value, high, step, accepted), step


def furthest(value: float, end: float, step: float, accepted: Callable[[float], bool]) -> float:
    """Of the multiples of a step between a value and an end the furthest that is accepted, or the value."""
    sign = 1 if end > value else -1
    near, far = math.ceil(sign * value / step - 1e-6), math.floor(sign * end / step + 1e-6)

    def at(k: int) -> float:
        return float(f"{sign * k * step:.12g}")

    if far < near or not accepted(at(near)):
        return value
    for last in (far, far - 1):  # the bound itself is accepted, or what is next to it, or the others have a say
        if accepted(at(last)):
            return at(last)
    while far - near > 1:
        middle = (near + far) // 2
        near, far = (middle, far) if accepted(at(middle)) else (near, middle)
    return at(near)


def span(q: Quantity, value: float) -> tuple[float, float]:
    """How far a slider is to go: to the bounds, or as far again as the value is from 0."""
    least = q.at_least if q.at_least is not None else q.above
    most = q.at_most if q.at_most is not None else q.below
    reach = abs(value) if abs(value) > 1.0 / LARGEST else WIDE.get(q.unit, 1.0)
    low = _finite(least, value - reach if least is None or math.isinf(least) else least)
    high = _finite(most, value + reach if value < 0.0 or least is None else low + 3.0 * max(value - low, reach / 3.0))
    return (low, high) if low < high else (low, low + 1.0)


def _finite(bound: float | None, other: float) -> float:
    return other if bound is None or math.isinf(bound) else float(bound)
