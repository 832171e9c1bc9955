"""What a user sets by hand of quantising, by the options that a family of chips has, checked."""

from __future__ import annotations

from collections.abc import Container, Mapping
from typing import Any

import numpy as np

from neuro.chips.arithmetic import Arithmetic, Option
from neuro.chips.description import Chip
from neuro.chips.quantising.inputs import Options
from neuro.core.english import a
from neuro.core.errors import ModelError, nearest
from neuro.model.neurons import Model
from neuro.program.program import Program

EVERYWHERE = ("strict", "order", "neurons_per_core")
"""Options of a chip backend that quantising does not look at, for hints."""


def options_of(program: Program, chip: Chip, arithmetic: Arithmetic, options: Mapping[str, Any]) -> Options:
    """Options by name, checked.

    Args:
        program: has the parts.
        chip: for messages.
        arithmetic: of the chip.
        options: by name, then by part.

    Raises:
        ModelError: one is unknown, is of another chip, or names a part that does not exist or a value that cannot be.
    """
    for name, values in options.items():
        option = arithmetic.option(name)
        if option is None:
            known = [known.name for known in arithmetic.options]
            raise ModelError(f"backend '{chip.name}' has no option '{name}'", hint=nearest(name, [*known, *EVERYWHERE]))
        if not isinstance(values, Mapping):
            raise ModelError(f"{name} = {values!r}: expected values by name, such as {{'exc': ...}}")
        for part, value in values.items():
            _check_part(program, arithmetic, option, part)
            if not option.fits(value):
                raise ModelError(f"{name}['{part}'] = {value!r}: expected {option.expected}")
    return Options(options)


def _check_part(program: Program, arithmetic: Arithmetic, option: Option, name: str) -> None:
    """Refuse a part that does not exist or that has nothing to set by hand."""
    if option.of == "populations":
        models: dict[str, Model] = {part.name: part.model for part in program.populations}
        expected = "populations"
    else:
        models = {part.name: program.populations[part.target].model for part in program.projections}
        expected = "projections onto populations"
    if name not in models:
        raise ModelError(f"{option.name}: unknown part '{name}'", hint=nearest(name, models))
    if not isinstance(models[name], arithmetic.models):
        known = " or ".join(model.__name__ for model in arithmetic.models)
        message = f"{option.name}['{name}']: {a(models[name].name)}: expected {expected} of {known}"
        raise ModelError(message)


def is_positive(value: Any) -> bool:
    """Whether a value is a finite number > 0."""
    kind = isinstance(value, (int, float, np.number)) and not isinstance(value, bool)
    return kind and bool(np.isfinite(value)) and bool(value > 0)


def is_whole(value: Any, allowed: Container[int]) -> bool:
    """Whether a value is a whole number among those allowed."""
    return isinstance(value, (int, np.integer)) and not isinstance(value, bool) and int(value) in allowed
