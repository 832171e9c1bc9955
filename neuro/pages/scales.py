"""Scales of drawings: round marks on an axis, numbers of three digits, units with a prefix."""

from __future__ import annotations

import math
from collections.abc import Sequence

from neuro.chips.energy import quantity

_SLACK = (1e-9, 0.0)
"""Of a step: multiples that lie just outside are marks, too, where there is room for them."""
_LEAST_PLAIN, _LARGE, _LARGEST_PLAIN = 1e-3, 1e3, 1e15


def ticks(low: float, high: float, most: int) -> list[float]:
    """At most so many round numbers from `low` to `high`, evenly apart, at least two if they can be round."""
    ten = 10.0 ** math.floor(math.log10((high - low) / most))
    found = [_multiples(low, high, n * ten, slack) for n in (1, 2, 5, 10, 20) for slack in _SLACK]
    best = next((marks for marks in found if len(marks) <= most), found[-1])
    if len(best) > 1:
        return best
    threes = (_multiples(low, high, 3 * ten, slack) for slack in _SLACK)  # -2 to 4: not 0 alone, but 0 and 3
    return next((marks for marks in threes if 1 < len(marks) <= most), best)


def _multiples(low: float, high: float, step: float, slack: float) -> list[float]:
    return [step * k for k in range(math.ceil(low / step - slack), math.floor(high / step + slack) + 1)]


def tick(mark: float, marks: Sequence[float]) -> str:
    """A round number with the digits that all marks of its axis need."""
    step = marks[1] - marks[0] if len(marks) > 1 else abs(mark) or 1.0
    digits = max(0, -math.floor(math.log10(step) + 1e-9))
    return f"{mark:,.{digits}f}" if digits < 5 and abs(mark) < 1e6 else f"{mark:.3g}"


def few(value: float) -> str:
    """A number in three digits: 0.0123, 16.4, 302,000."""
    rounded = float(f"{value:.3g}")
    if _LARGE <= abs(rounded) < _LARGEST_PLAIN:
        return f"{rounded:,.0f}"
    return f"{value:.3g}" if abs(rounded) >= _LEAST_PLAIN or not rounded else f"{value:.2e}"


def prefixed(largest: float, unit: str) -> tuple[float, str]:
    """A factor and the unit with a prefix, by which a quantity is at most 1000; only joules and seconds take one.

    Args:
        largest: the largest magnitude of the values.
        unit: of the values.
    """
    if unit not in ("J", "s") or not 0.0 < largest < math.inf:
        return 1.0, unit
    number, with_prefix = quantity(largest, unit).split()
    return 10.0 ** round(math.log10(float(number) / largest)), with_prefix
