"""Parts as people read them: what was said, units, no place in a file and no long array."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import MISSING, fields
from pathlib import PurePath
from typing import Any

import numpy as np

from neuro.core.choice import Choice
from neuro.core.quantities import word_of
from neuro.core.tables import Table, as_text
from neuro.core.values import FromFile, same, shown

_LISTED = 6


def one_line(part: Any) -> str:
    """A part as a call would make it: what is not as by default, without its place in a file."""
    said = (
        f"{field.name}={repr(value) if isinstance(value, (str, Choice)) else in_words(value)}"
        for field, value in _said(part)
    )
    return f"{type(part).__name__}({', '.join([repr(part.name), *said])})"


def in_full(part: Any) -> str:
    """A part with all parameters of what it is made of, and their units."""
    rows = tuple((field.name, in_words(value)) for field, value in _said(part))
    made_of = [getattr(part, field.name) for field in fields(part)]
    return as_text(
        f"{part.word} '{part.name}'",
        [Table("", ("word", "value"), rows), *(_parameters(each) for each in made_of if isinstance(each, Choice))],
    )


def _parameters(choice: Choice) -> Table:
    changed = {word_of(name) for name in choice.changed()}
    defaults = {word: in_words(value) for word, value in choice.defaults().items() if word in changed}
    units = {word: q.unit for word, q in choice.quantities().items()}
    rows = ((word, in_words(value), units[word], defaults.get(word, "")) for word, value in choice.parameters().items())
    return Table(choice.name, ("parameter", ">value", "unit", ">default"), tuple(rows))


def _said(part: Any) -> Iterator[tuple[Any, Any]]:
    for field in fields(part):
        value = getattr(part, field.name)
        default = field.default_factory() if field.default_factory is not MISSING else field.default
        if field.name not in ("name", "origin") and (default is MISSING or not same(value, default)):
            yield field, value


def in_words(value: Any) -> str:
    """A value in few words: of an array its range, of a choice what differs from its defaults."""
    values = value.values if isinstance(value, FromFile) else value
    if isinstance(values, np.ndarray) and values.size > _LISTED and values.dtype.kind in "fiu":
        return f"{values.min():g} .. {values.max():g} ({values.size:,} values)"
    if isinstance(values, np.ndarray) and values.dtype.kind in "fiu":
        return shown(values.tolist())
    if isinstance(value, Choice):
        if len(fields(value)) == 1 and value.changed():  # as of_distance, which is of one thing alone
            return f"{value.name}({in_words(next(iter(value.changed().values())))})"
        told = ", ".join(f"{word_of(name)}={in_words(each)}" for name, each in value.changed().items())
        return f"{value.name}({told})" if told else value.name
    if isinstance(value, str):
        return value
    return str(value) if isinstance(value, PurePath) else shown(value)
