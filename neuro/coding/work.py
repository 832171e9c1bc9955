"""Counts of the operations that a host computes outside of a network."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, TypeAlias

NUMBER = 8
"""Bytes of a number, a double."""


class Work(NamedTuple):
    """Operations and bytes of a single use of a part, e.g. of an encoder in a control step of a copy.

    Counting rule: a multiply-accumulate is a multiplication with the addition of its result, or any other addition,
    subtraction, multiplication, division, comparison, rounding, or call of a function, e.g. exp. Indices,
    copies and look-ups count as bytes only. The size of an array sets the count: a data-dependent count is its maximum.

    Attributes:
        macs: multiply-accumulates.
        bytes: bytes of the numbers that the part reads and writes.
    """

    macs: float = 0.0
    bytes: float = 0.0

    def __add__(self, other: object) -> Work:
        """Return the sum of the operations and of the bytes of two parts."""
        if not isinstance(other, Work):
            return NotImplemented
        return Work(self.macs + other.macs, self.bytes + other.bytes)

    def times(self, uses: float) -> Work:
        """Return the operations and bytes of so many uses."""
        return Work(self.macs * uses, self.bytes * uses)


Works: TypeAlias = Mapping[str, Work | None]
"""Operations of a part by the unit of a use, e.g. "event" or "frame"; None without a count."""


def on_numbers(macs: float, numbers: float) -> Work:
    """Return the work of so many multiply-accumulates on so many numbers that are read or written."""
    return Work(macs, NUMBER * numbers)
