"""What a search varies, from a text such as "step,duration,hidden=16:64,prune"."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import fields
from typing import Any

import neuro
from neuro import ModelError
from neuro.apps import unknown
from neuro_train.plan import TrainingPlan

__all__ = ["Space", "parted", "space"]

Space = dict[str, list[Any]]
"""Values to choose from, by name."""

OF_PLAN = (
    "prune",
    "rate",
    "decay",
    "slope",
    "temperature",
    "warp",
    "mirror",
    "epochs",
    "batch",
    "bits",
    "neurons_per_core",
)
"""Words of a plan that may vary, beside the duration."""

STEPS = (1, 2, 4)
SHARES = (0.25, 0.5, 0.75, 1.0)
HIDDEN = (0.125, 0.25, 0.5, 1.0)
PRUNE = (0.0, 0.25, 0.5, 0.75)
EXAMPLE = "--search step,duration,hidden=16:64,prune"


def space(text: str, net: neuro.Network, plan: TrainingPlan, given: Mapping[str, Any]) -> Space:
    """Read what varies.

    Args:
        text: names with commas between them, each with its values after "=" and ":" between these: `step` (ms),
            `duration` (ms), words of a plan, and parameters of the network's file. `step`, `duration`, `hidden` and
            `prune` have values if none are given: the network's step and 2 and 4 times it, quarters of the plan's
            duration in whole steps of all, 1/8 to the whole of the hidden layer, and nothing to three quarters pruned.
        net: the network.
        plan: what every training is told that does not vary.
        given: the parameters of the network's file.

    Raises:
        ModelError: a name is unknown, a value is NaN, or a duration is not a whole number of steps.
    """
    said = dict(_named(part) for part in text.split(","))
    known = ["step", "duration", *OF_PLAN, *(name for name in given if name != "resolution")]
    for name in said:
        if name not in known:
            raise unknown("parameter of --search", name, known)
    if "step" in said and "resolution" not in given:
        message = "--search step: the network's file has no parameter 'resolution'"
        raise ModelError(f"{message}: expected one, as 'neuro train dense' has")
    steps = said.get("step") or [net.resolution * k for k in STEPS] if "step" in said else [net.resolution]
    found: Space = {}
    for name, values in said.items():
        found[name] = values or _usual(name, steps, plan, given)
    for duration in found.get("duration", [plan.duration]):
        for step in steps:
            if abs(duration / step - round(duration / step)) > 1e-9:
                message = f"--search: a duration of {duration:g} ms is no whole number of steps of {step:g} ms"
                raise ModelError(f"{message}: expected multiples of all steps", hint="duration=50:100,step=5:10")
    return {name: list(dict.fromkeys(values)) for name, values in found.items()}


def parted(point: Mapping[str, Any]) -> tuple[dict[str, Any], dict[str, Any]]:
    """What of a point the network's file is told, and what the plan."""
    words = {field.name for field in fields(TrainingPlan)}
    of_plan = {name: value for name, value in point.items() if name in words}
    of_file = {"resolution" if name == "step" else name: value for name, value in point.items() if name not in words}
    return of_file, of_plan


def _named(part: str) -> tuple[str, list[Any]]:
    name, equals, text = part.strip().partition("=")
    if not name or (equals and not text):
        raise ModelError(f"--search {part}: expected NAME or NAME=VALUE:VALUE", hint=EXAMPLE)
    return name, [_number(name, value) for value in text.split(":")] if text else []


def _number(name: str, text: str) -> float | int:
    try:
        return int(text)
    except ValueError:
        pass
    try:
        return float(text)
    except ValueError:
        raise ModelError(f"--search {name}={text}: expected numbers with ':' between them", hint=EXAMPLE) from None


def _usual(name: str, steps: list[Any], plan: TrainingPlan, given: Mapping[str, Any]) -> list[Any]:
    """The values of a parameter for which none are given."""
    if name == "step":
        return steps
    if name == "duration":
        coarse = max(steps)
        whole = [max(1, int(plan.duration * share / coarse + 1e-9)) for share in SHARES]
        return [k * coarse for k in whole]
    if name == "hidden":
        return [max(1, round(given["hidden"] * share)) for share in HIDDEN]
    if name == "prune":
        return list(PRUNE)
    raise ModelError(f"--search {name}: expected its values", hint=f"--search {name}=1:2:4")
