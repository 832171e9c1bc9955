"""What codes and decoders accept, and the errors for the rest."""

from __future__ import annotations

import math
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt

from neuro.core.checks import is_number, numbers
from neuro.core.errors import ModelError

Floats: TypeAlias = npt.NDArray[np.float64]


def number(value: Any, name: str) -> float:
    """A finite number.

    Raises:
        ModelError: it is none.
    """
    if not is_number(value):
        raise ModelError(f"{name} is {value!r:.60}, expected a number", path=(name,))
    if not math.isfinite(value):
        raise ModelError(f"{name} is {value}, expected a finite number", path=(name,))
    return float(value)


def positive(value: Any, name: str) -> float:
    """A finite number above 0.

    Raises:
        ModelError: it is none.
    """
    if not number(value, name) > 0:
        raise ModelError(f"{name} is {value}, expected more than 0", path=(name,))
    return float(value)


def whole(value: Any, name: str, at_least: int, at_most: int) -> int:
    """A whole number between bounds.

    Raises:
        ModelError: it is none.
    """
    if not is_number(value) or not float(value).is_integer() or not at_least <= value <= at_most:
        expected = f"expected a whole number from {at_least} to {at_most}"
        raise ModelError(f"{name} is {value!r:.60}, {expected}", path=(name,))
    return int(value)


def word(value: Any, name: str, words: tuple[str, ...]) -> str:
    """One of some words.

    Raises:
        ModelError: it is none of them.
    """
    if value not in words:
        raise ModelError(f"{name} is {value!r:.60}, expected one of {', '.join(words)}", path=(name,))
    return str(value)


def finite(values: npt.ArrayLike, name: str) -> Floats:
    """Finite numbers.

    Raises:
        ModelError: something in them is no number, infinite or NaN.
    """
    array = numbers(values, name)
    if not np.isfinite(array).all():
        raise ModelError(f"{name} has the value {array[~np.isfinite(array)][0]}, expected finite numbers", path=(name,))
    return array


def check_bounds(r_min: float, r_max: float) -> None:
    """Refuse bounds that are no numbers, or not in this order."""
    number(r_min, "r_min")
    number(r_max, "r_max")
    if not r_min < r_max:
        raise ModelError(f"r_min is {r_min} and r_max {r_max}, expected r_min < r_max", path=("r_max",))


def check_inside(values: Floats, r_min: float, r_max: float) -> None:
    """Refuse a value outside of the bounds, or none."""
    outside = ~((values >= r_min) & (values <= r_max))
    if outside.any():
        raise ModelError(f"value {values[outside][0]} is outside of [{r_min}, {r_max}]", path=("r",))


def share(r: npt.ArrayLike, r_min: float, r_max: float) -> Floats:
    """Where values lie between their bounds: 0 at ``r_min``, 1 at ``r_max``.

    Raises:
        ModelError: not ``r_min < r_max``, or a value is no number or outside of them.
    """
    check_bounds(r_min, r_max)
    values = numbers(r, "r")
    check_inside(values, r_min, r_max)
    return (values - r_min) / (r_max - r_min)
