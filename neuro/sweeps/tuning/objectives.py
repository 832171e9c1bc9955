"""What is to be large or small: objectives of a tuning, what a trial is worth, and which trials no other one beats."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.checks import is_number
from neuro.core.errors import ModelError, nearest, unknown
from neuro.core.values import shown

MAXIMISE, MINIMISE = "maximise", "minimise"
_WORDS = {
    **dict.fromkeys((MAXIMISE, "maximize", "max"), MAXIMISE),
    **dict.fromkeys((MINIMISE, "minimize", "min"), MINIMISE),
}

Floats = NDArray[np.float64]


def objectives_of(said: Any) -> dict[str, str]:
    """Objectives by name, each "maximise" or "minimise".

    Args:
        said: a mapping like `{"accuracy": "maximise", "energy.loihi": "minimise"}`; "maximize", "max" and others of
            Optuna and Ray mean the same.

    Raises:
        ModelError: it is none.
    """
    if not isinstance(said, Mapping) or not said:
        hint = "write objectives: {accuracy: maximise}"
        raise ModelError(
            f"objectives = {shown(said)}: expected metrics, each maximise or minimise", hint=hint, path=("objectives",)
        )
    found = {}
    for name, direction in said.items():
        if not isinstance(direction, str) or direction not in _WORDS:
            message = f"objectives.{name} = {shown(direction)}"
            if isinstance(direction, str) and (near := nearest(direction, _WORDS)):
                raise ModelError(f"{message}: expected {MAXIMISE} or {MINIMISE}", hint=near, path=("objectives",))
            raise ModelError(f"{message}: expected {MAXIMISE} or {MINIMISE}", path=("objectives",))
        found[str(name)] = _WORDS[direction]
    return found


def mean_metrics(each: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Means over runs of those metrics that are numbers in all; of a single run all that it has."""
    if len(each) == 1:
        return dict(each[0])
    names = [name for name in each[0] if all(is_number(one.get(name)) for one in each)] if each else []
    return {name: float(np.mean([one[name] for one in each])) for name in names}


def worth(metrics: Mapping[str, Any], objectives: Mapping[str, str]) -> list[float]:
    """The values of the objectives, in their order.

    Args:
        metrics: of a trial.
        objectives: by name.

    Raises:
        ModelError: one is not among the metrics, or no finite number.
    """
    found = []
    for name in objectives:
        if name not in metrics:
            raise unknown("objective", name, metrics)
        value = metrics[name]
        if not is_number(value) or not math.isfinite(value):
            raise ModelError(f"objective '{name}' = {shown(value)}: expected a finite number")
        found.append(float(value))
    return found


def front(values: Floats, directions: Sequence[str]) -> NDArray[np.bool_]:
    """Which points no other one beats: at least as good in all objectives, and better in one.

    Args:
        values: (points, objectives).
        directions: of each objective, "maximise" or "minimise".

    Returns:
        (points,); of equal points all or none. Of one objective: the best.
    """
    signs = np.array([-1.0 if each == MAXIMISE else 1.0 for each in directions])
    costs = np.asarray(values, float).reshape(-1, len(signs)) * signs
    kept = np.ones(len(costs), bool)
    for k, cost in enumerate(costs):
        beaten = (costs <= cost).all(axis=1) & (costs < cost).any(axis=1)
        kept[k] = not beaten.any()
    return kept


def so_far(values: Sequence[float] | Floats, direction: str) -> Floats:
    """The best value up to each."""
    best = np.maximum if direction == MAXIMISE else np.minimum
    return np.asarray(best.accumulate(np.asarray(values, float)))
