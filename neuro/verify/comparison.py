"""A golden case as it was read, and how far a result is from it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
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
class TraceComparison:
    """Deviation of one quantity.

    Attributes:
        quantity: "spikes", a state, or "case" where the case could not be compared.
        error: largest deviation; where whole numbers are compared, how many are wrong.
        message: where, if that is known.
        case: which of a file's cases, "" if it holds one.
        exact: whether no deviation is accepted.
        limit: the largest deviation that is accepted otherwise.
    """

    quantity: str
    error: float
    message: str = ""
    case: str = ""
    exact: bool = False
    limit: float = LIMIT


def equal(case: str, quantity: str, found: NDArray[Any], expected: NDArray[Any]) -> TraceComparison:
    """Whether whole numbers are equal, and if not, where the first is that differs."""
    name = "spikes" if quantity == "s" else quantity
    if found.shape != expected.shape:
        text = f"shape {list(found.shape)}: expected {list(expected.shape)}"
        return TraceComparison(name, float("inf"), text, case=case, exact=True)
    wrong = np.argwhere(found != expected)
    if not wrong.size:
        return TraceComparison(name, 0.0, case=case, exact=True)
    at = tuple(int(i) for i in wrong[0])
    text = f"{len(wrong)} differ, first {list(at)}: {found[at]}: expected {expected[at]}"
    return TraceComparison(name, float(len(wrong)), text, case=case, exact=True)
