"""Counts of the operations of a host, outside of a network."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple, TypeAlias

NUMBER = 8
"""Bytes of a number, a double."""


class Work(NamedTuple):
    """Operations and bytes of a single use of a part, e.g. of an encoder in one control step.

    Counting rule: a multiply-accumulate is a multiplication with the addition of its result, or any other addition,
    subtraction, multiplication, division, comparison, rounding, or call of a function, e.g. exp. Indices,
    copies and look-ups count as bytes only. A count that depends on the data is taken at its maximum.

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
        """Return the operations and bytes of `uses` uses."""
        return Work(self.macs * uses, self.bytes * uses)


Works: TypeAlias = Mapping[str, Work | None]
"""Operations of a part by the unit of a use, e.g. "event" or "frame"; None without a count."""


def on_numbers(macs: float, numbers: float) -> Work:
    """Return the work of `macs` multiply-accumulates that read or write `numbers` numbers."""
    return Work(macs, NUMBER * numbers)
