"""Settings by name: frozen dataclasses whose fields know their bounds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import Field, field, fields, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro import ModelError, Network
from neuro.apps import Quantity, check, unknown
from neuro_drone.parts import choice, number

__all__ = ["changed", "choice", "each_axis", "number", "numbers", "plain", "share", "unknown", "whole"]

REST = "parameters"
"""The field that takes up names that are no fields, where a dataclass has it."""


def numbers(default: float, **bounds: Any) -> Any:
    """A field for a number for all axes, or a list of one for each."""
    return field(default=default, metadata={"quantity": Quantity(**bounds), "axes": True})


def each_axis(name: str, value: float | tuple[float, ...], axes: int) -> npt.NDArray[np.float64]:
    """The value of a `numbers` setting for each axis, (axes,).

    Args:
        name: of the setting, for messages.
        value: of it.
        axes: of the scenario.

    Raises:
        ModelError: it is a list, and not of one for each.
    """
    if isinstance(value, tuple) and len(value) != axes:
        raise ModelError(f"{name} = {list(value)}: expected a number or a list of {axes}, one an axis")
    return np.broadcast_to(np.asarray(value, float), axes)


def share(default: float) -> Any:
    """A field for a number from 0 to 1."""
    return number(default, at_least=0, at_most=1)


def whole(default: int) -> Any:
    """A field for a whole number of at least 1."""
    return number(default, at_least=1)


def changed(settings: Any, values: Mapping[str, Any], whose: str) -> Any:
    """Settings with some values changed.

    Args:
        settings: a frozen dataclass.
        values: by name.
        whose: for messages, e.g. "controller 'lms'".

    Raises:
        ModelError: a name is unknown or a value out of its bounds.
    """
    own = {f.name: f for f in fields(settings) if "fixed" not in f.metadata}
    rest = {name: value for name, value in values.items() if name not in own}
    if rest and not hasattr(settings, REST):
        raise unknown(f"setting of {whose}", min(rest), own)
    new = {name: _checked(own[name], values[name], whose) for name in values.keys() - rest}
    if rest:
        new[REST] = {**getattr(settings, REST), **rest}
    return replace(settings, **new)


def plain(settings: Any) -> dict[str, Any]:
    """Settings by name as plain data that `changed` takes; a network that is no name and no file is left out."""
    own = {f.name: getattr(settings, f.name) for f in fields(settings) if "fixed" not in f.metadata}
    own |= getattr(settings, REST, {})
    return {name: list(v) if isinstance(v, tuple) else v for name, v in own.items() if not isinstance(v, Network)}


def _checked(setting: Field[Any], value: Any, whose: str) -> Any:
    q, what = setting.metadata.get("quantity"), f"{whose}: {setting.name}"
    if q is None:
        return value
    if "axes" not in setting.metadata:
        return check(q, value, what)
    if isinstance(value, (list, tuple)) and len(value) in (2, 3):
        return tuple(check(q, part, f"{what}[{k}]") for k, part in enumerate(value))
    try:
        return check(q, value, what)
    except ModelError as error:
        raise ModelError(f"{error.message} or a list of two or three, one an axis", hint=error.hint) from None
