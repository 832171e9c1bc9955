"""Settings by name: frozen dataclasses whose fields know their bounds."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from math import inf
from typing import Any

from neuro import ModelError, Network
from neuro.apps import unknown

__all__ = ["changed", "choice", "number", "numbers", "plain", "share", "unknown", "whole"]

REST = "parameters"
"""The field that takes up names that are no fields, where a dataclass has it."""


@dataclass(frozen=True, slots=True)
class _Number:
    least: float
    above: bool
    per_axis: bool

    def check(self, value: Any) -> Any:
        if self.per_axis and isinstance(value, (list, tuple)):
            if len(value) != 2:
                raise ModelError(f"expected {self}")
            return tuple(self.one(part) for part in value)
        return self.one(value)

    def one(self, value: Any) -> float:
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not -inf < value < inf:
            raise ModelError(f"expected {self}")
        if value < self.least or (self.above and value == self.least):
            raise ModelError(f"expected {self}")
        return float(value)

    def __str__(self) -> str:
        bound = "" if self.least == -inf else f" {'>' if self.above else '>='} {self.least:g}"
        return f"a number{bound}" + (" or a list of two, one an axis" if self.per_axis else "")


@dataclass(frozen=True, slots=True)
class _Share:
    def check(self, value: Any) -> float:
        if isinstance(value, bool) or not isinstance(value, (int, float)) or not 0.0 <= value <= 1.0:
            raise ModelError("expected a number from 0 to 1")
        return float(value)


@dataclass(frozen=True, slots=True)
class _Whole:
    def check(self, value: Any) -> int:
        if isinstance(value, bool) or not isinstance(value, int) or value < 1:
            raise ModelError("expected a whole number >= 1")
        return value


@dataclass(frozen=True, slots=True)
class _Choice:
    known: tuple[str, ...]

    def check(self, value: Any) -> Any:
        if value not in self.known:
            raise ModelError(f"expected {', '.join(self.known[:-1])} or {self.known[-1]}")
        return value


def number(default: float, least: float = -inf, above: bool = False) -> Any:
    """A field for a number of at least `least`, or above it."""
    return field(default=default, metadata={"check": _Number(least, above, False)})


def numbers(default: float, least: float = -inf, above: bool = False) -> Any:
    """A field for a number for both axes, or a list of one for each."""
    return field(default=default, metadata={"check": _Number(least, above, True)})


def share(default: float) -> Any:
    """A field for a number from 0 to 1."""
    return field(default=default, metadata={"check": _Share()})


def whole(default: int) -> Any:
    """A field for a whole number of at least 1."""
    return field(default=default, metadata={"check": _Whole()})


def choice(default: str, *known: str) -> Any:
    """A field for one of some words."""
    return field(default=default, metadata={"check": _Choice(known)})


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
    new = {name: _checked(own[name].metadata.get("check"), name, values[name], whose) for name in values.keys() - rest}
    if rest:
        new[REST] = {**getattr(settings, REST), **rest}
    return replace(settings, **new)


def plain(settings: Any) -> dict[str, Any]:
    """Settings by name as plain data that `changed` takes; a network that is no name and no file is left out."""
    told = {f.name: getattr(settings, f.name) for f in fields(settings) if "fixed" not in f.metadata}
    told |= getattr(settings, REST, {})
    return {name: list(v) if isinstance(v, tuple) else v for name, v in told.items() if not isinstance(v, Network)}


def _checked(rule: _Number | _Share | _Whole | _Choice | None, name: str, value: Any, whose: str) -> Any:
    try:
        return value if rule is None else rule.check(value)
    except ModelError as error:
        raise ModelError(f"{whose}: {name} = {value!r}: {error}") from None
