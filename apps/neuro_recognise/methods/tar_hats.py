"""TAR-HATS: HATS after the filter TAR, which stands in for its memory of all events."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from neuro.apps import kernel, part
from neuro.events import Events
from neuro_recognise.method import Grows
from neuro_recognise.methods.hats import Hats
from neuro_recognise.parts.cleaners import Cleaner, Tar
from neuro_recognise.shown import Array, Floats, Ints

NEVER = -(1 << 53)
"""us; so long ago that nothing is left of it."""


@dataclass(frozen=True)
class TarHats(Hats):
    """Each event sees when the last event came at each pixel round it; what events see is averaged over cells."""

    known_as = "tar_hats"
    title = "HATS without memory behind the filter TAR"
    source = "thesis B.4; Sironi et al., CVPR 2018; the thesis leaves open what is in place of the memory"
    measured = {"N-MNIST": "95.2 %", "POKER-DVS": "97.7 %"}

    cleaner: Cleaner = part(Cleaner, Tar())

    def grown(self) -> Grows:
        """The histograms of all cells, (rows, columns, 2, side, side), of no events yet."""
        return _LastSurfaces(self)


class _LastSurfaces:
    """What events see of the last events round them, averaged over cells, growing event by event."""

    def __init__(self, method: TarHats) -> None:
        (width, height), cell, side = method.size, method.cell, 2 * method.radius + 1
        rows, columns = -(-height // cell), -(-width // cell)
        self._cell, self._tau_us, self._sieve = cell, 1000.0 * method.tau, method.cleaner.begun(method.size)
        self._last = np.full((2, height + side - 1, width + side - 1), NEVER)
        self._sums, self._counts = np.zeros((rows, columns, 2, side, side)), np.zeros((rows, columns), np.int64)

    def add(self, events: Events) -> None:
        """Take in what the filter leaves of the next events."""
        left = self._sieve(events)
        state = (self._last, self._sums, self._counts)
        last_surfaces(left.t, left.x, left.y, left.p, self._cell, self._tau_us, *state)

    def histograms(self) -> Floats:
        """Means over the events of each cell."""
        means: Floats = self._sums / np.maximum(self._counts, 1)[:, :, None, None, None]
        return means


@kernel
def last_surfaces(
    t: Ints, x: Array, y: Array, p: Array, cell: int, tau_us: float, last: Ints, sums: Floats, counts: Ints
) -> None:
    """Add to each cell what its events see: exp(-age / tau) of the last event of their polarity at each pixel round.

    t: int64[n]; x, y: uint16[n]; p: uint8[n]; last: int64[2, height + 2 radius, width + 2 radius], long ago where there
    was none; sums: float64[rows, columns, 2, side, side]; counts: int64[rows, columns]. An event sees itself.
    """
    side = sums.shape[3]
    radius = side // 2
    for k in range(len(t)):
        last[p[k], y[k] + radius, x[k] + radius] = t[k]
        seen = sums[y[k] // cell, x[k] // cell, p[k]]
        counts[y[k] // cell, x[k] // cell] += 1
        for i in range(side):
            for j in range(side):
                age = t[k] - last[p[k], y[k] + i, x[k] + j]
                seen[i, j] += math.exp(-age / tau_us)
