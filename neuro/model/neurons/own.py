"""Neurons and generators of third parties: refused unless they have all that backends rely on."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.own_parts import check_functions, fill
from neuro.model.neurons.base import PAYLOAD, Generator, Model, Neuron

FUNCTIONS = {"constants": 3, "step": 7, "fire": 3, "quiet": 5}
"""The functions of a neuron model's arithmetic and how many arguments each takes."""

DRAWING = FUNCTIONS | {"step": 8}
"""Those of a neuron that draws."""

EMITTING = {"constants": 3, "emit": 7}
"""Those of a generator's."""

SILENCE = 16
"""Steps of a silence: the shortest after which the event backend lets neurons sleep."""

DEVIATIONS = np.repeat([0.0, 1.0, 30.0, 1000.0], 2)
"""How far states are moved from those at step 0, one number for each neuron that is tried."""

LIMIT = 1e-9
"""The largest relative error of a silence that is passed at once."""


def complete(model: type[Model]) -> type[Model]:
    """Return a model if it has all that backends rely on.

    Raises:
        TypeError: something is missing or too large; it says what.
    """
    if not issubclass(model, (Neuron, Generator)):
        raise TypeError(f"model '{model.__name__}': expected a subclass of Neuron or Generator")
    if issubclass(model, Generator):
        if model.role == "generator":
            message = f"generator '{model.__name__}'"
            check_functions(message, model, EMITTING)
            _complete_numbers(message, model)
        return model
    if model.chip:
        return model
    message = f"neuron model '{model.__name__}'"
    check_functions(message, model, DRAWING if model.draws else FUNCTIONS)
    names, receptors = [state.name for state in model.states], model.named_receptors()
    if "V_m" in names[1:]:
        raise TypeError(f"{message}: V_m is state {names.index('V_m')}: expected it first")
    if model.graded and PAYLOAD not in names:
        raise TypeError(f"{message} is graded: expected a state '{PAYLOAD}'")
    if model.receptors < 1:
        raise TypeError(f"{message}: receptors = {model.receptors}: expected at least 1")
    if len(receptors) != model.receptors and (receptors or model.receptors > 1):
        raise TypeError(
            f"{message}: receptors = {model.receptors} with {len(receptors)} receptor_names: expected as many"
        )
    if unknown := [name for name in model.conductances if name not in receptors]:
        raise TypeError(f"{message}: conductance '{unknown[0]}' is none of its receptor_names")
    c = _complete_numbers(message, model)
    if c is None:
        return model
    if "V_m" in names and "V_th" in model.quantities() and c[0] != model.defaults()["V_th"]:
        raise TypeError(f"{message}: its first constant is {c[0]:g}: expected V_th = {model.defaults()['V_th']:g}")
    if hasattr(model.arithmetic, "catch_up"):
        check_functions(message, model, {"catch_up": 8})
    check_sleep(model, {word: float(model.defaults()[word]) for word in model.quantities()})
    return model


def _complete_numbers(prefix: str, model: type[Model]) -> NDArray[np.float64] | None:
    """The constants for the defaults, None if a parameter has none."""
    timed = ("start", "stop") if getattr(model, "timed", False) else ()
    kinds = {word: q.kind for word, q in model.quantities().items() if word not in timed}
    if other := [word for word, kind in kinds.items() if kind not in ("number", "integer", "boolean")]:
        raise TypeError(f"{prefix}: parameter '{other[0]}' is a {kinds[other[0]]}: expected a number or a boolean")
    if len(kinds) > model.width:
        raise TypeError(
            f"{prefix} has {len(kinds)} parameters with tau_minus: expected at most {model.width}, its width"
        )
    defaults = model.defaults()
    if not all(np.isscalar(defaults.get(word)) for word in kinds):
        return None
    c = np.zeros(model.width)
    fill(prefix, model, np.array([float(defaults[word]) for word in kinds]), c)
    return c


def check_sleep(model: type[Any], parameters: Mapping[str, float], h: float = 0.1) -> None:
    """Refuse a neuron model for which a silence passed at once differs from the same silence step by step.

    Neurons at random states are tried. Of those that `quiet` lets sleep none may fire within `SILENCE` steps. Passing
    these steps at once must leave the same state: by `catch_up` or one long step where the model is `linear`, else by
    doing nothing.

    Args:
        model: the class.
        parameters: numbers by word, in order of definition.
        h: length of a step in ms.

    Raises:
        TypeError: it names the state that differs.
    """
    arithmetic, label, n = model.arithmetic, f"neuron model '{model.__name__}'", DEVIATIONS.size
    p, c = np.array([float(value) for value in parameters.values()]), np.zeros(model.width)
    x, i_0, fired, drawn = np.zeros((max(2, model.receptors), n)), np.zeros(n), np.zeros(n, np.uint8), np.zeros(n)
    words = (drawn,) if model.draws else ()
    # States that differ from those at step 0; hidden counters stay.
    rng, start = np.random.default_rng(0), np.zeros((len(model.states), n))
    initial: Mapping[str, Any] = model.initial({word: np.array([value]) for word, value in parameters.items()})
    for k, state in enumerate(model.states):
        start[k] = initial.get(state.name, 0.0)
        if not state.hidden:
            start[k] = np.clip(start[k] + DEVIATIONS * rng.standard_normal(n), state.at_least, state.at_most)
    with np.errstate(all="ignore"):  # states may be far out
        arithmetic.constants(p, h, c)
        for i in range(n):
            if not arithmetic.quiet(start, c, i_0, i, i + 1):
                continue
            stepped, passed = start.copy(), start.copy()
            for _ in range(SILENCE):
                arithmetic.step(stepped, c, x, i_0, i, i + 1, fired, *words)
                if fired[i]:
                    raise TypeError(f"{label} fires without input where `quiet` is true: expected it to be false there")
            way, again = "none of them", np.zeros(model.width)
            if model.linear and hasattr(arithmetic, "catch_up"):
                way = "catch_up"
                arithmetic.catch_up(passed, p, again, i_0, i, i + 1, h, SILENCE)
            elif model.linear:
                way = "one step of their length"
                arithmetic.constants(p, SILENCE * h, again)
                arithmetic.step(passed, again, x, i_0, i, i + 1, fired, *words)
            limit = LIMIT * np.abs(start[:, i]).max(initial=1.0) if model.linear else 0.0
            wrong = ~(np.abs(passed[:, i] - stepped[:, i]) <= limit) & ~(
                np.isnan(passed[:, i]) & np.isnan(stepped[:, i])
            )
            if wrong.any():
                k = int(np.argmax(wrong))
                end, reached = stepped[k, i], passed[k, i]
                raise TypeError(
                    f"{label}: {SILENCE} steps without input bring {model.states[k].name} to {end:.9g}, {way} to "
                    f"{reached:.9g}: expected the same, as {'it is linear and ' if model.linear else ''}`quiet` is true"
                )
