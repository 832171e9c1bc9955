"""Times of any size in a table of one size, so that an hour takes no more memory than a second."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from neuro.kernels.jit import kernel
from neuro.program.program import Ints

_FINE = 5
"""Bits of a time that are kept: bins are 1/32 of a power of two wide, so a percentile is at most 3.2 % too large."""


def _bins() -> Ints:
    return np.zeros((64 - _FINE) << _FINE, dtype=np.int64)


@dataclass(slots=True, eq=False)
class Histogram:
    """How often something took how long.

    Attributes:
        counts: of bins that are 1/32 of a power of two wide, in ns; those below 64 ns hold one ns each.
        largest_ns: the longest time, exact.
    """

    counts: Ints = field(default_factory=_bins)
    largest_ns: int = 0

    def add(self, ns: int) -> None:
        """Count one time; below 0 is 0."""
        ns = max(0, ns)
        shift = max(0, ns.bit_length() - _FINE - 1)
        self.counts[(shift << _FINE) + (ns >> shift)] += 1
        if ns > self.largest_ns:
            self.largest_ns = ns

    def add_since(self, moments: NDArray[np.int64], now: int) -> None:
        """Count how long before `now` each of some moments was, ns of one clock."""
        self.largest_ns = max(self.largest_ns, count_since(moments, now, self.counts))

    def __len__(self) -> int:
        return int(self.counts.sum())

    def ms(self, share: float) -> float:
        """The time in ms that a share of all did not exceed, e.g. 0.99 of all; NaN where nothing was counted."""
        sums = np.cumsum(self.counts)
        if not sums[-1]:
            return float("nan")
        number = int(np.searchsorted(sums, share * sums[-1]))
        shift = max(0, (number >> _FINE) - 1)
        upper = ((number - (shift << _FINE) + 1) << shift) - 1
        return min(upper, self.largest_ns) / 1e6

    @property
    def largest_ms(self) -> float:
        """The longest time in ms."""
        return self.largest_ns / 1e6

    @property
    def texts(self) -> tuple[str, str, str]:
        """p50, p99 and the longest time in ms; a dash for each where nothing was counted."""
        p50, p99, largest = (f"{ms:.3f}" for ms in (self.ms(0.5), self.ms(0.99), self.largest_ms))
        return (p50, p99, largest) if len(self) else ("–", "–", "–")

    def __str__(self) -> str:
        return "p50 {}, p99 {}, largest {} ms".format(*self.texts)


@kernel
def count_since(moments: NDArray[np.int64], now: int, counts: Ints) -> int:
    """Count each time into its bin; return the longest."""
    largest, shift = 0, 0
    for k in range(moments.shape[0]):
        ns = max(0, now - moments[k])
        largest = max(largest, ns)
        while ns >> shift >= 2 << _FINE:
            shift += 1
        while shift > 0 and ns >> shift < 1 << _FINE:
            shift -= 1
        counts[(shift << _FINE) + (ns >> shift)] += 1
    return largest
