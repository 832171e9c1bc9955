"""Checks of neurons and generators of third parties."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.own_parts import check_functions, fill
from neuro.model.neurons.base import PAYLOAD, Generator, Model, Neuron

FUNCTIONS = {"constants": 3, "step": 7, "fire": 3, "quiet": 5}
"""Functions of a neuron model's arithmetic, and their numbers of arguments."""

DRAWING = FUNCTIONS | {"step": 8}
"""Functions of a neuron model with `draws`, and their numbers of arguments."""

EMITTING = {"constants": 3, "emit": 7}
"""Functions of a generator's arithmetic, and their numbers of arguments."""

SILENCE = 16
"""Number of steps without input in `check_sleep`: the shortest period that the event backend computes as one step."""

DEVIATIONS = np.repeat([0.0, 1.0, 30.0, 1000.0], 2)
"""Standard deviations of the tested states around their initial values, one per tested neuron."""

LIMIT = 1e-9
"""Largest accepted relative difference between `SILENCE` steps and the same time computed at once."""


def complete(model: type[Model]) -> type[Model]:
    """Return a model if it has everything that backends need.

    Raises:
        TypeError: an attribute or function is missing, or there are too many parameters. The message has the reason.
    """
    if not issubclass(model, (Neuron, Generator)):
        raise TypeError(f"model '{model.__name__}': expected a subclass of Neuron or Generator")
    if issubclass(model, Generator):
        if model.role == "generator":
            message = f"generator '{model.__name__}'"
            check_functions(message, model, EMITTING)
            _checked_constants(message, model)
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
        raise TypeError(f"{message}: conductance '{unknown[0]}' is not in its receptor_names")
    c = _checked_constants(message, model)
    if c is None:
        return model
    if "V_m" in names and "V_th" in model.quantities() and c[0] != model.defaults()["V_th"]:
        raise TypeError(f"{message}: its first constant is {c[0]:g}: expected V_th = {model.defaults()['V_th']:g}")
    if hasattr(model.arithmetic, "catch_up"):
        check_functions(message, model, {"catch_up": 8})
    check_sleep(model, {word: float(model.defaults()[word]) for word in model.quantities()})
    return model


def _checked_constants(prefix: str, model: type[Model]) -> NDArray[np.float64] | None:
    """Check the number and the kinds of the parameters.

    Return the constants for the default parameters, shape (width,), or None if a parameter has no default.
    """
    time_words = ("start", "stop") if getattr(model, "timed", False) else ()
    kinds = {word: q.kind for word, q in model.quantities().items() if word not in time_words}
    if wrong_words := [word for word, kind in kinds.items() if kind not in ("number", "integer", "boolean")]:
        raise TypeError(
            f"{prefix}: parameter '{wrong_words[0]}' is a {kinds[wrong_words[0]]}: expected a number or a boolean"
        )
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
    """Raise an error if steps of a neuron model without input must not be computed at once or skipped.

    Neurons in random states are tested. A neuron for which `quiet` is true must not fire within `SILENCE` steps of h.
    If the model is `linear`, `catch_up` or a single step of `SILENCE` h must lead to the same state as these steps. For
    other models these steps must not change the state.

    Args:
        model: the class.
        parameters: numbers by parameter, in order of definition.
        h: length of a step in ms.

    Raises:
        TypeError: the states differ. The message names the state.
    """
    arithmetic, label, n = model.arithmetic, f"neuron model '{model.__name__}'", DEVIATIONS.size
    p, c = np.array([float(value) for value in parameters.values()]), np.zeros(model.width)
    x, i_0, fired, uniform = np.zeros((max(2, model.receptors), n)), np.zeros(n), np.zeros(n, np.uint8), np.zeros(n)
    extra_arguments = (uniform,) if model.draws else ()
    # Random states around the initial states. Hidden counters keep the initial value.
    rng, start = np.random.default_rng(0), np.zeros((len(model.states), n))
    initial: Mapping[str, Any] = model.initial({word: np.array([value]) for word, value in parameters.items()})
    for k, state in enumerate(model.states):
        start[k] = initial.get(state.name, 0.0)
        if not state.hidden:
            start[k] = np.clip(start[k] + DEVIATIONS * rng.standard_normal(n), state.at_least, state.at_most)
    with np.errstate(all="ignore"):  # extreme states may overflow
        arithmetic.constants(p, h, c)
        for i in range(n):
            if not arithmetic.quiet(start, c, i_0, i, i + 1):
                continue
            stepped, at_once = start.copy(), start.copy()
            for _ in range(SILENCE):
                arithmetic.step(stepped, c, x, i_0, i, i + 1, fired, *extra_arguments)
                if fired[i]:
                    raise TypeError(f"{label} fires without input where `quiet` is true: expected it to be false there")
            method, buffer = "skipping them", np.zeros(model.width)
            if model.linear and hasattr(arithmetic, "catch_up"):
                method = "catch_up"
                arithmetic.catch_up(at_once, p, buffer, i_0, i, i + 1, h, SILENCE)
            elif model.linear:
                method = "one step of their length"
                arithmetic.constants(p, SILENCE * h, buffer)
                arithmetic.step(at_once, buffer, x, i_0, i, i + 1, fired, *extra_arguments)
            limit = LIMIT * np.abs(start[:, i]).max(initial=1.0) if model.linear else 0.0
            differs = ~(np.abs(at_once[:, i] - stepped[:, i]) <= limit) & ~(
                np.isnan(at_once[:, i]) & np.isnan(stepped[:, i])
            )
            if differs.any():
                k = int(np.argmax(differs))
                name, value, value_at_once = model.states[k].name, stepped[k, i], at_once[k, i]
                reason = f"{'it is linear and ' if model.linear else ''}`quiet` is true"
                raise TypeError(
                    f"{label}: {SILENCE} steps without input bring {name} to {value:.9g}, {method} to "
                    f"{value_at_once:.9g}: expected the same, as {reason}"
                )
