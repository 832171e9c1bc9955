"""Histograms of averaged time surfaces without memory cells: TAR's activity stands in for them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from neuro.events._events import Events
from neuro.events.filters._filter import NEVER, Sieve, State


@dataclass(frozen=True, eq=False)
class TARSurfaces(Sieve):
    """Filter as `TAR` does and sum up the surfaces round the events that pass, as HATS does.

    HATS keeps the last events of each cell in memory to sum their decayed influence on a new one. Here one leaky value
    per pixel and polarity holds that sum, and no event is stored. The surface of an event is what its neighbours of
    the same polarity in the same cell hold just before it; the sum of what all neighbours hold, plus 1, is TAR's mask
    and decides whether the event counts. With ``theta`` below 1 this is HATS with an endless memory.

    Attributes:
        tau: decay time constant, s.
        theta: activity that must be exceeded, events.
        radius: R of the neighbourhood, px.
        cell: side of the square cells that share a histogram, px; those at the right and lower edge may be cut.

    Source: thesis B.4, line 3356, which tells the idea only; that the mask is the sum of the surface follows from
        algorithm 14. HATS: Sironi et al., CVPR 2018, eqs 5-7. Defaults: tau, theta and radius as `TAR`; cell of 10 px
        as HATS on N-CARS.
    """

    word = "tar_surfaces"
    units = {"tau": "s", "theta": "events", "radius": "px", "cell": "px"}
    tau: float = 0.08
    theta: float = 2.4
    radius: int = 1
    cell: int = 10

    def _check(self) -> None:
        self._expect_positive("tau", " s")
        self._expect_positive("theta", " events")
        self._expect_whole("radius", 0, " px")
        self._expect_whole("cell", 1, " px")

    def _fresh(self) -> State:
        (width, height), r, side = self.sensor_size, self.radius, 2 * self.radius + 1
        pixels = (height + 2 * r, width + 2 * r, 2)
        cells = (-(-height // self.cell), -(-width // self.cell))
        counts, sums = np.zeros(cells, np.int64), np.zeros((*cells, 2, side, side))
        return np.full(1, NEVER, np.int64), np.zeros(pixels), counts, sums

    def _keep(self, events: Events, keep: npt.NDArray[np.bool_]) -> None:
        from neuro.events.filters._surfaces_kernel import surfaces

        origin, held, counts, sums = self._state
        if origin[0] == NEVER:
            origin[0] = events.t[0]
        surfaces(
            events.t, events.x, events.y, events.p, 1e6 * self.tau, float(self.theta), self.radius, self.cell,
            origin, held, counts, sums, keep,
        )  # fmt: skip

    def histograms(self) -> npt.NDArray[np.float64]:
        """The averaged surfaces so far; ask before `finish`.

        Returns:
            (rows, columns, 2, 2 radius + 1, 2 radius + 1): of each cell, for OFF and ON, the sum of the surfaces of
            its events that passed, by rows and columns from the event, over the number of these events of either
            polarity; 0 where there was none.
        """
        _, _, counts, sums = self._state
        averages: npt.NDArray[np.float64] = sums / np.maximum(counts, 1)[:, :, None, None, None]
        return averages
