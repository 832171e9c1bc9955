"""A test of what lets a backend leave a neuron without input alone: `quiet`, `linear` and `catch_up`."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

STEPS = 16
"""Steps of a silence: the shortest after which the event backend lets neurons sleep."""

DEVIATIONS = np.repeat([0.0, 1.0, 30.0, 1000.0], 2)
"""How far states are moved from those at step 0, one number for each neuron that is tried."""

LIMIT = 1e-9
"""The largest relative error of a silence that is passed at once."""


def check_sleep(model: type[Any], parameters: Mapping[str, float], h: float = 0.1) -> None:
    """Refuse a neuron model for which a silence passed at once differs from the same silence step by step.

    Neurons at random states are tried. Of those that `quiet` lets sleep none may fire within `STEPS` steps. Passing
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
    start = _states(model, parameters)
    with np.errstate(all="ignore"):  # states may be far out
        arithmetic.constants(p, h, c)
        for i in range(n):
            if not arithmetic.quiet(start, c, i_0, i, i + 1):
                continue
            stepped, passed = start.copy(), start.copy()
            for _ in range(STEPS):
                arithmetic.step(stepped, c, x, i_0, i, i + 1, fired, *words)
                if fired[i]:
                    raise TypeError(f"{label} fires without input where `quiet` is true: expected it to be false there")
            if model.linear:
                _pass_silence(model, p, h, passed, x, i_0, i, fired, words)
            limit = LIMIT * np.abs(start[:, i]).max(initial=1.0) if model.linear else 0.0
            wrong = ~(np.abs(passed[:, i] - stepped[:, i]) <= limit) & ~(
                np.isnan(passed[:, i]) & np.isnan(stepped[:, i])
            )
            if wrong.any():
                k = int(np.argmax(wrong))
                raise TypeError(_difference(label, model, k, passed[k, i], stepped[k, i]))


def _states(model: type[Any], parameters: Mapping[str, float]) -> NDArray[np.float64]:
    """States of neurons that differ from those at step 0; hidden counters stay."""
    rng = np.random.default_rng(0)
    states = np.zeros((len(model.states), DEVIATIONS.size))
    initial: Mapping[str, Any] = model.initial({word: np.array([value]) for word, value in parameters.items()})
    for k, state in enumerate(model.states):
        states[k] = initial.get(state.name, 0.0)
        if not state.hidden:
            moved = states[k] + DEVIATIONS * rng.standard_normal(DEVIATIONS.size)
            states[k] = np.clip(moved, state.at_least, state.at_most)
    return states


def _pass_silence(
    model: type[Any],
    p: NDArray[np.float64],
    h: float,
    states: NDArray[np.float64],
    x: NDArray[np.float64],
    i_0: NDArray[np.float64],
    i: int,
    fired: NDArray[np.uint8],
    words: tuple[NDArray[np.float64], ...],
) -> None:
    """Pass `STEPS` steps at once, as a backend does with a neuron that slept."""
    arithmetic, c = model.arithmetic, np.zeros(model.width)
    if hasattr(arithmetic, "catch_up"):
        arithmetic.catch_up(states, p, c, i_0, i, i + 1, h, STEPS)
    else:
        arithmetic.constants(p, STEPS * h, c)
        arithmetic.step(states, c, x, i_0, i, i + 1, fired, *words)


def _difference(label: str, model: type[Any], state: int, passed: float, stepped: float) -> str:
    how = "one step of their length" if model.linear else "none of them"
    how = "catch_up" if model.linear and hasattr(model.arithmetic, "catch_up") else how
    return (
        f"{label}: {STEPS} steps without input bring {model.states[state].name} to {stepped:.9g}, {how} to "
        f"{passed:.9g}: expected the same, as {'it is linear and ' if model.linear else ''}`quiet` is true"
    )
