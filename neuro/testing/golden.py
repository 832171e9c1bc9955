"""Golden traces, and the deviations of a backend from them."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from neuro.core.clock import Clock

LIMIT = 1e-9
"""Largest accepted deviation of values that two simulators compute by the same formulas."""


@dataclass(frozen=True, slots=True, eq=False)
class Golden:
    """A case of golden traces: `facts` describe the simulation, `arrays` are its recorded results."""

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
        case: name of the files, followed by the name of the case if the files have several.
        quantity: "spikes", a state such as "V_m", or "case" if the case could not be compared.
        error: largest deviation in the unit of the quantity; for whole numbers, the number of different values.
        limit: largest accepted deviation.
        ok: whether the deviation is within the limit.
        message: description of the deviation, "" if `ok`.
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


def equal(case: str, quantity: str, actual: NDArray[Any], expected: NDArray[Any]) -> Result:
    """Compare whole numbers, which must be equal; the message describes the first difference."""
    name = "spikes" if quantity == "s" else quantity
    if actual.shape != expected.shape:
        return _shape_result(case, name, actual, expected, 0.0)
    unequal = np.argwhere(actual != expected)
    if not unequal.size:
        return Result(case, name, 0.0)
    index = tuple(int(i) for i in unequal[0])
    text = f"{len(unequal)} differ, first {list(index)}: {actual[index]}: expected {expected[index]}"
    return Result(case, name, float(len(unequal)), message=text)


def close(quantity: str, actual: NDArray[Any], expected: NDArray[Any], limit: float = LIMIT) -> Result:
    """Compare values, which may differ by at most a limit; the message describes the largest deviation."""
    if actual.shape != expected.shape:
        return _shape_result("", quantity, actual, expected, limit)
    if not actual.size:
        return Result("", quantity, 0.0, limit)
    error = np.abs(actual - expected)
    error[np.isnan(error)] = np.inf
    index = np.unravel_index(int(error.argmax()), error.shape)
    text = f"[{', '.join(str(i) for i in index)}] = {actual[index]:.12g}: expected {expected[index]:.12g}"
    return Result("", quantity, float(error[index]), limit, text)


def _shape_result(case: str, name: str, actual: NDArray[Any], expected: NDArray[Any], limit: float) -> Result:
    text = f"shape {list(actual.shape)}: expected {list(expected.shape)}"
    return Result(case, name, float("inf"), limit, text)
