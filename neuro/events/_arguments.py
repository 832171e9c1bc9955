"""Checks of single arguments, with the words for what is wrong."""

from __future__ import annotations

import operator
from collections.abc import Sequence

import numpy as np

from neuro.core.checks import check
from neuro.core.errors import ModelError
from neuro.core.quantities import Quantity


def positive(name: str, value: float, unit: str = "") -> float:
    """A number above 0.

    Raises:
        ModelError: it is none.
    """
    return float(check(Quantity(unit=unit, above=0, infinite=True), value, name))


def whole(name: str, value: int, least: int = 1) -> int:
    """A whole number.

    Raises:
        ModelError: it is none, or too small.
    """
    check(Quantity(whole=True, at_least=least), value, name)
    return int(value)


def microseconds(name: str, value: float, least: int = -(1 << 63)) -> int:
    """A time or a duration, us; also a float such as 1e6 that is a whole number.

    Raises:
        ModelError: it is none, too small, or 2^63 us and more.
    """
    number = exact(value)
    if number is None or not least <= number < 1 << 63:
        low = "-2^63" if least < 0 else least
        raise ModelError(f"{name} is {value!r}, expected a whole number of us from {low} to 2^63 - 1")
    return number


def exact(value: object) -> int | None:
    """A whole number, also one written as a float; None: it is none."""
    if isinstance(value, float | np.floating):
        return int(value) if np.isfinite(value) and value == int(value) else None
    if isinstance(value, bool | np.bool_) or not isinstance(value, int | np.integer):
        return None
    return int(value)


def sensor(size: object) -> tuple[int, int]:
    """Width and height of a sensor, px.

    Raises:
        ModelError: it is none.
    """
    try:
        width, height = (operator.index(side) for side in size)  # type: ignore[attr-defined]
    except (TypeError, ValueError):
        raise ModelError(f"sensor_size = {size!r}: expected width and height, two whole numbers") from None
    if not (1 <= width <= 65536 and 1 <= height <= 65536):
        raise ModelError(f"sensor size is {width}x{height}, expected 1x1 to 65536x65536 px")
    return width, height


def moment(name: str, value: int) -> int:
    """A time, us.

    Raises:
        ModelError: it is not a whole number.
    """
    if isinstance(value, bool) or not isinstance(value, int | np.integer):
        raise ModelError(f"{name} is {value!r}, expected a whole number of us")
    return int(value)


def flag(name: str, value: bool) -> bool:
    """True or False.

    Raises:
        ModelError: it is neither.
    """
    if not isinstance(value, bool | np.bool_):
        raise ModelError(f"{name} is {value!r:.60}, expected True or False")
    return bool(value)


def choice(name: str, value: str, known: Sequence[str]) -> str:
    """One of a few words.

    Raises:
        ModelError: it is another.
    """
    return str(check(Quantity(kind="word", words=tuple(known)), value, name))
