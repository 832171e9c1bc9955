"""Golden traces as they were read, and how far a backend is from them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.clock import Clock

LIMIT = 1e-9
"""Deviation that is accepted of values that two simulators compute in the same way."""


@dataclass(frozen=True, slots=True, eq=False)
class Golden:
    """A case as it was read: what was simulated and what came out."""

    facts: Mapping[str, Any]
    arrays: Mapping[str, NDArray[Any]]

    @property
    def clock(self) -> Clock:
        """Steps and milliseconds of the case."""
        return Clock(float(self.facts["resolution_ms"]))


@dataclass(frozen=True, slots=True)
class Result:
    """Deviation of one quantity of one case.

    Attributes:
        case: the name of the files, and of one case where they hold several.
        quantity: "spikes", a state such as "V_m", or "case" where the case could not be compared.
        error: largest deviation in the unit of the quantity; of whole numbers how many are wrong.
        limit: the largest deviation that is accepted.
        ok: whether the deviation is within the limit.
        message: what is wrong, "" if nothing is.
    """

    case: str
    quantity: str
    error: float
    limit: float = 0.0
    ok: bool = field(init=False)
    message: str = ""

    def __post_init__(self) -> None:
        ok = bool(self.error <= self.limit)
        object.__setattr__(self, "ok", ok)
        if ok:
            object.__setattr__(self, "message", "")


def failure(message: str, case: str = "") -> Result:
    """Return the result of a case that could not be compared."""
    return Result(case, "case", float("inf"), message=message)


def equal(case: str, quantity: str, found: NDArray[Any], expected: NDArray[Any]) -> Result:
    """Compare whole numbers, which must be equal; the message names the first that differs."""
    name = "spikes" if quantity == "s" else quantity
    if found.shape != expected.shape:
        return _of_other_shape(case, name, found, expected, 0.0)
    wrong = np.argwhere(found != expected)
    if not wrong.size:
        return Result(case, name, 0.0)
    at = tuple(int(i) for i in wrong[0])
    text = f"{len(wrong)} differ, first {list(at)}: {found[at]}: expected {expected[at]}"
    return Result(case, name, float(len(wrong)), message=text)


def close(quantity: str, found: NDArray[Any], expected: NDArray[Any], limit: float = LIMIT) -> Result:
    """Compare values, which may differ by a limit; the message names the one that differs most."""
    if found.shape != expected.shape:
        return _of_other_shape("", quantity, found, expected, limit)
    if not found.size:
        return Result("", quantity, 0.0, limit)
    error = np.abs(found - expected)
    error[np.isnan(error)] = np.inf
    worst = np.unravel_index(int(error.argmax()), error.shape)
    text = f"[{', '.join(str(i) for i in worst)}] = {found[worst]:.12g}: expected {expected[worst]:.12g}"
    return Result("", quantity, float(error[worst]), limit, text)


def _of_other_shape(case: str, name: str, found: NDArray[Any], expected: NDArray[Any], limit: float) -> Result:
    text = f"shape {list(found.shape)}: expected {list(expected.shape)}"
    return Result(case, name, float("inf"), limit, text)
