"""Numbers that are written with their unit, as the quantities that take them want them.

Units are looked up only where there is one: a start does not pay for them.
"""

from __future__ import annotations

import math
from typing import Any

from neuro.core.errors import ModelError, words_of
from neuro.core.quantities import Quantity


def with_unit(q: Quantity, value: str, what: str) -> float:
    """A number that is written with its unit, in the unit of the quantity.

    Raises:
        ModelError: it has another dimension, or there is no such unit.
    """
    from neuro.core.units import converted

    try:
        number = converted(value, "ms" if q.kind in ("delay", "times") else q.unit or q.taken_in)
    except ModelError as error:
        raise error.but(message=f"{what} = {value.strip()}: {error.message}") from None
    if math.isinf(number):
        raise ModelError(f"{what} = {value.strip()}: expected a number below 1.8e308")
    return number


def in_ms(value: Any, what: str) -> Any:
    """A time that is said with its unit, as a number of ms; all else as it is.

    Raises:
        ModelError: it has another dimension, or there is no such unit.
    """
    try:
        return with_unit(Quantity("ms"), value, what) if is_written(value) else value
    except ModelError as error:
        raise error.but(path=words_of(what)) from None


def is_written(value: Any) -> bool:
    """Whether a value is a text that says a number and a unit."""
    if not isinstance(value, str):
        return False
    from neuro.core.units import is_measure

    return is_measure(value)
