"""Checks of single arguments, with the words for what is wrong."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from neuro.errors import ModelError


def positive(name: str, value: float, unit: str = "") -> float:
    """A number above 0.

    Raises:
        ModelError: it is none.
    """
    if not value > 0:
        raise ModelError(f"{name} is {value}{unit and ' '}{unit}, expected more than 0")
    return float(value)


def whole(name: str, value: int, least: int = 1) -> int:
    """A whole number.

    Raises:
        ModelError: it is none, or too small.
    """
    if isinstance(value, bool) or not isinstance(value, int | np.integer) or value < least:
        raise ModelError(f"{name} is {value!r}, expected a whole number of at least {least}")
    return int(value)


def moment(name: str, value: int) -> int:
    """A time, us.

    Raises:
        ModelError: it is not a whole number.
    """
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        raise ModelError(f"{name} is {value!r}, expected a whole number of us")
    return int(value)


def choice(name: str, value: str, known: Sequence[str]) -> str:
    """One of a few words.

    Raises:
        ModelError: it is another.
    """
    if value not in known:
        raise ModelError(f"{name} is {value!r}, expected one of {', '.join(repr(word) for word in known)}")
    return value
