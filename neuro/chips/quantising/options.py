"""What a user sets by hand of quantising: scales, exponents, shifts and signals, checked."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import fields
from typing import Any

import numpy as np

from neuro.chips.description import Chip
from neuro.chips.loihi.words import WEIGHT_EXPONENTS
from neuro.chips.quantising.inputs import Options
from neuro.chips.spinnaker.limits import LARGEST_SHIFT
from neuro.core.errors import ModelError, nearest
from neuro.model.neurons import Model, iaf_psc_delta, iaf_psc_exp
from neuro.program.program import Program

OF_CHIP = {"scales": "loihi", "exponents": "loihi", "signals": "loihi", "shifts": "spinnaker"}
"""The arithmetic that has each option."""


def options_of(program: Program, chip: Chip, options: Mapping[str, Any]) -> Options:
    """Options by name, checked.

    Raises:
        ModelError: one is unknown, is of another chip, or names a part that does not exist or a value that cannot be.
    """
    known = [entry.name for entry in fields(Options) if OF_CHIP[entry.name] == chip.arithmetic]
    for name, values in options.items():
        if name not in known:
            everywhere = ("strict", "order", "neurons_per_core")
            raise ModelError(f"backend '{chip.name}' has no option '{name}'", hint=nearest(name, [*known, *everywhere]))
        if not isinstance(values, Mapping):
            raise ModelError(f"{name} = {values!r}: expected values by name, such as {{'exc': ...}}")
        for part, value in values.items():
            _check_part(program, name, part)
            fits, expected = _EXPECTED[name]
            if not fits(value):
                raise ModelError(f"{name}['{part}'] = {value!r}: expected {expected}")
    return Options(**options)


def _check_part(program: Program, option: str, name: str) -> None:
    """Refuse a part that does not exist or that has nothing to set by hand."""
    if option in ("scales", "shifts"):
        models: dict[str, Model] = {part.name: part.model for part in program.populations}
        expected = "populations"
    else:
        models = {part.name: program.populations[part.target].model for part in program.projections}
        expected = "projections onto populations"
    if name not in models:
        raise ModelError(f"{option}: unknown part '{name}'", hint=nearest(name, models))
    if not isinstance(models[name], (iaf_psc_exp, iaf_psc_delta)):
        told = f"{option}['{name}']: a {models[name].name}: expected {expected} of iaf_psc_exp or iaf_psc_delta"
        raise ModelError(told)


def _number(value: Any) -> bool:
    kind = isinstance(value, (int, float, np.number)) and not isinstance(value, bool)
    return kind and bool(np.isfinite(value)) and bool(value > 0)


def _whole(value: Any, allowed: range) -> bool:
    return isinstance(value, (int, np.integer)) and not isinstance(value, bool) and int(value) in allowed


def _two_shifts(value: Any) -> bool:
    shifts = range(LARGEST_SHIFT + 1)
    return isinstance(value, (tuple, list)) and len(value) == 2 and all(_whole(shift, shifts) for shift in value)


_EXPECTED: dict[str, tuple[Callable[[Any], bool], str]] = {
    "scales": (_number, "units per mV, a number > 0"),
    "exponents": (lambda value: _whole(value, WEIGHT_EXPONENTS), "a weight exponent, a whole number from -8 to 7"),
    "shifts": (
        _two_shifts,
        f"the shifts of excitatory and inhibitory slots, two whole numbers up to {LARGEST_SHIFT}",
    ),
    "signals": (_number, "the largest dopamine that the signal sets in 1/ms, a number > 0"),
}
"""Whether a value can be, and what is expected, by option."""
