"""Checks of values against their quantities, and canonical forms of values."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np

from neuro.core import lists as lists  # the module defines the kinds that are lists
from neuro.core.arrays import (
    array_of,
    check_each,
    check_returned as check_returned,
    finite as finite,
    numbers as numbers,
    refuse_masked as refuse_masked,
)
from neuro.core.errors import ModelError
from neuro.core.inputs import file_path
from neuro.core.quantities import KINDS, LARGEST, Quantity, is_written, kind, with_unit
from neuro.core.values import FromFile, is_number as is_number, shown
from neuro.core.wrong import wrong as wrong


def check(q: Quantity, value: Any, label: str, path: tuple[str, ...] = ()) -> Any:
    """Return `value` in its canonical form, or raise an error.

    Args:
        q: quantity of the parameter.
        value: a number, word, list, array, distribution or `FromFile`.
        label: full name for the message, e.g. "iaf_psc_exp.tau_m".
        path: words that lead to the value inside its part; by default the last word of `label`.

    Raises:
        ModelError: the value has the wrong kind, or is out of bounds. The message has the first wrong element.
    """
    if value is None and q.optional:
        return None
    try:
        return KINDS[q.kind].check(q, value, label)
    except ModelError as error:
        error.path = (*(path or (re.split(r"[^\w]", label)[-1],)), *error.path)
        raise


def argument(name: str, value: Any, **more: Any) -> Any:
    """Return a single argument of a function in its canonical form.

    Args:
        name: name of the argument in messages.
        value: value of the argument.
        more: accepted values, see `Quantity`; `words` without a kind accepts one of the words.

    Raises:
        ModelError: see `check`.
    """
    default_kind = "word" if "words" in more else "number"
    return check(Quantity(**{"kind": default_kind, **more}), value, name)


def check_fields(part: Any, place: str = "") -> None:
    """Convert the fields of a frozen dataclass to canonical form, if a field has a `Quantity`.

    Args:
        part: the dataclass, from its `__post_init__`.
        place: prefix of the names of the fields in messages, e.g. "task.ball".

    Raises:
        ModelError: see `check`; the path has the words of `place` and the name of the field.
    """
    for entry in fields(part):
        if q := entry.metadata.get("quantity"):
            words = (*filter(None, place.split(".")), entry.name)
            object.__setattr__(part, entry.name, check(q, getattr(part, entry.name), ".".join(words), words))


def _within(q: Quantity, x: float) -> bool:
    return not (
        math.isnan(x)
        or (q.whole and not x.is_integer())
        or (q.nonzero and x == 0.0)
        or (math.isinf(x) and not q.infinite)
        or not all(holds(x, bound) for _, bound, holds in q.bounds)
    )


@kind("number", "a number")
def _number(q: Quantity, value: Any, label: str) -> Any:
    if is_written(value):
        if q.of_value:
            return value
        value = with_unit(q, value, label)
    if is_number(value):
        if not _within(q, float(value)):
            raise wrong(q, value, label)
        return float(value)
    if not q.arrays:
        raise wrong(q, value, label)
    value_kind = "" if isinstance(value, type) else getattr(value, "kind", "")
    if value_kind == "distribution" or (q.of_distance and value_kind == "of_distance"):
        return value if q.of_value else value.in_unit(q, label)
    if isinstance(value, FromFile):
        check_each(q, value.values, label)
        return value
    if q.of_value and isinstance(value, (list, tuple)) and any(map(is_written, value)):
        return tuple(value)
    array = array_of(q, value, label)
    check_each(q, array, label)
    return array


@kind("delay", "a time > 0 ms")
def _delay(q: Quantity, value: Any, label: str) -> float:
    if is_written(value):
        value = with_unit(q, value, label)
    if not is_number(value) or not math.isfinite(value) or value <= 0:
        raise wrong(q, value, label)
    return float(value)


def _is_whole(value: Any, most: float = LARGEST) -> bool:
    return is_number(value) and -most <= value <= most and float(value).is_integer()


@kind("integer", "a whole number")
def _integer(q: Quantity, value: Any, label: str) -> int | str:
    if isinstance(value, str) and value in q.words:
        return value
    limit = LARGEST if q.at_most is None else abs(q.at_most)
    if not _is_whole(value, max(limit, LARGEST)) or not _within(q, int(value)):
        raise wrong(q, value, label)
    return int(value)


@kind("microseconds", "a whole number of us")
def _microseconds(q: Quantity, value: Any, label: str) -> int:
    """Return a whole number of microseconds; floats such as 1e6 are accepted."""
    lowest = -(1 << 63) if q.at_least is None else q.at_least
    if not _is_whole(value, 1 << 63) or not lowest <= int(value) < 1 << 63:
        raise wrong(q, value, label)
    return int(value)


@kind("boolean", "true or false")
def _boolean(q: Quantity, value: Any, label: str) -> bool:
    if not isinstance(value, (bool, np.bool_)):
        raise wrong(q, value, label)
    return bool(value)


@kind("name", "a name")
@kind("receptor", "a name")
def _name(q: Quantity, value: Any, label: str) -> str:
    text = getattr(value, "name", value)
    if not isinstance(text, str):
        raise wrong(q, value, label)
    return text


@kind("names", "names")
def _names(q: Quantity, value: Any, label: str) -> tuple[str, ...]:
    items = [value] if isinstance(value, str) else value
    if not isinstance(items, (list, tuple)):
        raise wrong(q, value, label)
    for k, item in enumerate(items):
        if not isinstance(item, str):
            raise wrong(q, item, label, k)
    return tuple(items)


@kind("words", "{name: value}")
def _words(q: Quantity, value: Any, label: str) -> dict[str, Any]:
    """Return a mapping from names to numbers, texts or lists. A number may serve as a name."""
    if not isinstance(value, Mapping) or not value:
        raise wrong(q, value, label)
    for name, entry in value.items():
        for item in entry if isinstance(entry, (list, tuple)) else (entry,):
            if not isinstance(item, str) and not is_number(item):
                raise ModelError(f"{label}: {name} = {shown(item)}: expected a number or a text", path=(str(name),))
    return {str(name): list(entry) if isinstance(entry, tuple) else entry for name, entry in value.items()}


@kind("expression", "an expression as text")
def _expression(q: Quantity, value: Any, label: str) -> str:
    """Return an expression as text. The owner of the expression parses it."""
    if not isinstance(value, str):
        raise wrong(q, value, label)
    return value


@kind("word", "a word")
def _word(q: Quantity, value: Any, label: str) -> str:
    if not isinstance(value, str) or value not in q.words:
        raise wrong(q, value, label)
    return value


@kind("shape", "whole numbers")
def _shape(q: Quantity, value: Any, label: str) -> tuple[int | str, ...]:
    items = [value] if is_number(value) or (isinstance(value, str) and value in q.words) else value
    if not isinstance(items, (list, tuple, np.ndarray)) or len(items) == 0:
        raise wrong(q, value, label)
    for k, item in enumerate(items):
        if is_number(item) and item > LARGEST and float(item).is_integer():
            _check_count((int(item),), label)
        if not (isinstance(item, str) and item in q.words) and not (_is_whole(item) and _within(q, float(item))):
            raise wrong(q, item, label, *([k] if items is value else []))
    sizes = tuple(item if isinstance(item, str) else int(item) for item in items)
    _check_count(sizes, label)
    return sizes


def _check_count(sizes: tuple[int | str, ...], label: str) -> None:
    if math.prod(size for size in sizes if isinstance(size, int)) > LARGEST:
        sizes_text = shown(sizes if len(sizes) > 1 else sizes[0])
        raise ModelError(f"{label} = {sizes_text}: expected at most {LARGEST} elements")


@kind("codes", "a code, or a list of codes")
def _codes(q: Quantity, value: Any, label: str) -> tuple[Any, ...]:
    if not isinstance(value, tuple) or not all(getattr(item, "kind", "") == "code" for item in value):
        raise wrong(q, value, label)
    return value


@kind("file", "the name of a file")
def _file(q: Quantity, value: Any, label: str) -> Path:
    if isinstance(value, str) and not value:
        raise wrong(q, value, label)
    return file_path(value, label)


@kind("events", "events")
def _events(q: Quantity, value: Any, label: str) -> Any:
    """Return events unchanged. The type is checked where the events are used."""
    return value


@kind("choice", "")
def _choice(q: Quantity, value: Any, label: str) -> Any:
    assert q.choice is not None
    if (q.at_least is not None and is_number(value)) or (q.arrays and not isinstance(value, (q.choice, str))):
        return _number(q, value, label)
    if not isinstance(value, q.choice):
        raise wrong(q, value, label)
    return value.in_unit(q, label) if q.at_least is not None else value


@kind("choices", "")
def _choices(q: Quantity, value: Any, label: str) -> dict[str, Any]:
    assert q.choice is not None
    if not isinstance(value, Mapping):
        raise ModelError(
            f"{label} = {shown(value)}: expected a {q.choice.kind} for each name, {{name: {q.choice.kind}}}"
        )
    for name, entry in value.items():
        if not isinstance(entry, q.choice):
            message = f"{label}: {name} = {shown(entry)}: expected {'an' if q.choice.kind[0] in 'aeiou' else 'a'} "
            raise ModelError(message + q.choice.kind, path=(str(name),))
    return {str(name): entry for name, entry in value.items()}


@kind("part", "")
def _part(q: Quantity, value: Any, label: str) -> Any:
    assert q.part is not None
    if isinstance(value, q.part):
        return value
    if not isinstance(value, Mapping):
        raise wrong(q, value, label)
    return q.part.from_words(value)
