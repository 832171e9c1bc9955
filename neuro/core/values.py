"""Values of parameters: the test for numbers, values from files, comparison and text."""

from __future__ import annotations

import math
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import PurePath
from typing import Any

import numpy as np
from numpy.typing import NDArray

_HUGE = int(sys.float_info.max)
_LONGEST = 60
_BIG = 10**_LONGEST


@dataclass(frozen=True, slots=True)
class FromFile:
    """Values read from an HDF5 (`key` names the data set) or NPY file beside the YAML file."""

    file: str
    key: str
    values: NDArray[np.float64]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, FromFile) and same(self.values, other.values)


def is_number(value: Any) -> bool:
    """Return True if a value is a single number that a double can hold; booleans are not numbers."""
    if isinstance(value, int):
        return not isinstance(value, bool) and abs(value) <= _HUGE
    return isinstance(value, (float, np.integer, np.floating))


def plain(value: Any) -> Any:
    """Return the values of a `FromFile`, and all other values unchanged."""
    return value.values if isinstance(value, FromFile) else value


def same(a: Any, b: Any) -> bool:
    """Return whether two values are equal. Arrays, also those of a `FromFile`, are compared by value."""
    a, b = plain(a), plain(b)
    if isinstance(a, np.ndarray) or isinstance(b, np.ndarray):
        return type(a) is type(b) and a.shape == b.shape and bool(np.array_equal(a, b, equal_nan=True))
    if isinstance(a, tuple) and isinstance(b, tuple):
        return len(a) == len(b) and all(same(x, y) for x, y in zip(a, b, strict=True))
    if isinstance(a, Mapping) and isinstance(b, Mapping):
        return list(a) == list(b) and all(same(a[k], b[k]) for k in a)
    return bool(a == b)


def shown(value: Any) -> str:
    """Return a value in the notation of the language, shortened if long, for messages."""
    text = repr(value) if isinstance(value, str) else _text(value)
    return text if len(text) <= _LONGEST else text[: _LONGEST - 3] + "..."


def _text(value: Any) -> str:
    if isinstance(value, FromFile):
        return f"{{file: {value.file}}}"
    if isinstance(value, np.ndarray):
        return f"array of shape {value.shape}"
    if isinstance(value, np.generic):
        return _text(value.item())
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int) and abs(value) >= _BIG:
        return f"{'-' * (value < 0)}1e{int(math.log10(abs(value)))} or more"
    if isinstance(value, type):
        return value.__name__
    if isinstance(value, PurePath):
        return repr(value.as_posix())
    if isinstance(value, float):
        text = repr(value).removesuffix(".0")
        return text if math.isfinite(value) else {"inf": ".inf", "-inf": "-.inf"}.get(text, ".nan")
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_text(item) for item in value[:_LONGEST]) + "]"
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key}: {_text(item)}" for key, item in value.items()) + "}"
    return value if isinstance(value, str) else repr(value)


def literal(text: str) -> str:
    """Return a text for matplotlib in which dollar signs do not start a formula."""
    return text.replace("$", r"\$")
