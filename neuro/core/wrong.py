"""The error for a value that a quantity does not accept, with a hint on how to write the value."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from neuro.core.errors import ModelError
from neuro.core.hints import axes, near, notation
from neuro.core.quantities import LARGEST, Quantity
from neuro.core.values import is_number, shown

_BOOLEANS = {"true": "true", "yes": "true", "on": "true", "false": "false", "no": "false", "off": "false"}


def wrong(q: Quantity, value: Any, label: str, *index: int) -> ModelError:
    """Return the error for a value, or for its element at `index`, that a quantity does not accept."""
    name = f"{label}[{', '.join(map(str, index))}]" if index else label
    assignment = f"{name} has no value" if value is None else f"{name} = {shown(value)}"
    expected = _with_exceeded_bound(q, value).expected()
    if isinstance(value, float) and not math.isfinite(value):
        expected = expected.replace("a number", "a finite number", 1)
    return ModelError(f"{assignment}: expected {expected}", hint=_hint(q, value), path=tuple(map(str, index)))


def _with_exceeded_bound(q: Quantity, value: Any) -> Quantity:
    """Add the bound of whole numbers to a quantity if the value exceeds it and the quantity has no own bound there."""
    if q.kind in ("integer", "shape", "ids") and is_number(value):
        if q.at_most is None and value > LARGEST:
            return replace(q, at_most=LARGEST)
        if q.at_least is None and value < -LARGEST:
            return replace(q, at_least=-LARGEST)
    return q


def _hint(q: Quantity, value: Any) -> str:
    if isinstance(value, type) and hasattr(value, "called"):
        return f"write {value.called()}(...)"
    if q.of_distance and getattr(value, "kind", "") == "profile":
        return f"write neuro.of_distance({_home(type(value))}{value!r})"
    if q.part is not None:
        return f"its words are {', '.join(q.part.quantities())}"
    if q.choice is not None and isinstance(value, Mapping) and len(value) == 1:
        return _as_call(q.choice, *next(iter(value.items())))
    if not isinstance(value, str):
        return ""
    if q.kind == "word" or (q.kind == "integer" and q.words):
        return near(value, q.words)
    if q.kind == "boolean":
        return f"write {_BOOLEANS[value.lower()]}" if value.lower() in _BOOLEANS else ""
    if q.kind == "shape":
        return axes(value) or near(value, q.words)
    return notation(value) if q.kind not in ("name", "receptor", "names", "part", "choice") else ""


def _as_call(base: type[Any], name: object, mapping: Any) -> str:
    """Return a hint with the Python call for a choice in the notation of YAML, or ""."""
    choice = next((kind for kind in base.__subclasses__() if kind.called() == name), None)
    if choice is None or not isinstance(mapping, Mapping) or not set(mapping) <= set(choice.quantities()):
        return ""
    arguments = ", ".join(f"{word}={value!r:.60}" for word, value in mapping.items())
    return f"write {_home(choice)}{name}({arguments})"


def _home(kind: type[Any]) -> str:
    return "neuro." if kind.__module__.startswith("neuro.") else ""
