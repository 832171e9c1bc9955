"""What `--set` means: words of the scenario, and settings of the controller."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import fields, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from neuro import ModelError
from neuro.apps import assignments, unknown
from neuro_drone.controllers import CONTROLLERS, Controller, kind_of, make
from neuro_drone.controllers.deep import Deep, needed
from neuro_drone.model import Model
from neuro_drone.scenario import Scenario, load
from neuro_drone.train import train

__all__ = ["chosen", "pilot"]

_WORDS = {one.name for one in fields(Scenario)}


def chosen(scenario: str | Path, controller: str, texts: Sequence[str]) -> tuple[Scenario, dict[str, Any]]:
    """A scenario and the settings of a controller, with changes.

    Args:
        scenario: its name or file.
        controller: its name.
        texts: "name=value": with a dot, or a word that only a scenario has, a change of the scenario; else a setting
            of the controller.

    Raises:
        ModelError: there is no such scenario, controller or word, or a value cannot be.
    """
    own = set(kind_of(controller).settings.own())
    values = _said(texts)
    world = {name for name in values if "." in name or name in _WORDS - own}
    changed = load(scenario, **{name: values[name] for name in values if name in world})
    settings = {name: values[name] for name in values if name not in world}
    made = _made(controller, changed, settings, own | _WORDS)  # mistakes are reported before any work
    if isinstance(made, Deep):
        needed(controller)
    return changed, settings


def _said(texts: Sequence[str]) -> dict[str, Any]:
    """Changes by name; the seed of a scenario is refused, since all episodes of a command have seeds of their own."""
    values = assignments(list(texts))
    if "seed" in values:
        raise ModelError("--set seed: it would change nothing", hint="training has --seed; tests have fixed seeds")
    return values


def _made(controller: str, scenario: Scenario, settings: dict[str, Any], known: set[str]) -> Controller:
    """The controller; a name that is none of its network's parameters may be meant for a setting."""
    try:
        return make(controller, scenario, 0, settings)
    except ModelError as error:
        for name in sorted(settings.keys() - known):
            if error.kind.startswith("unknown parameter") and get_close_matches(name, known, 1):
                raise unknown(f"setting of controller '{controller}'", name, known) from None
        raise


def pilot(model: Path | None, scenario: str | None, controller: str | None, texts: Sequence[str]) -> Model:
    """A trained model, or one of a controller that does not learn.

    Args:
        model: file of the model.
        scenario: another one than the model's; of a controller B60 if not given.
        controller: its name, if there is no file.
        texts: changes, see `chosen`; of a model only those of the scenario.

    Raises:
        ModelError: as `chosen`, or a controller by name must learn first.
    """
    if model is None:
        name = controller or ""
        if kind_of(name).learns:
            fixed = ", ".join(name for name, kind in CONTROLLERS.items() if not kind.learns)
            raise ModelError(
                f"controller '{name}' has to learn first: expected a model, or one of {fixed}",
                hint=f"neuro drone train --controller {name}",
            )
        world, settings = chosen(scenario or "B60", name, texts)
        return train(world, name, settings=settings)
    trained = Model.load(model)
    changes = _said(texts)
    for name in changes:
        if "." not in name and name not in _WORDS:
            raise ModelError(
                f"--set {name}: the settings of a trained controller stay: expected a word of the scenario",
                hint="'neuro drone train --set' has settings of the controller",
            )
    return replace(trained, scenario=load(trained.scenario if scenario is None else scenario, **changes))
