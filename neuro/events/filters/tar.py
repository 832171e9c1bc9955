"""Temporal active regions: an event passes where there was activity a short while ago."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from neuro.core.quantities import quantity
from neuro.events._events import Events
from neuro.events.filters._filter import NEVER, Sieve, State


@dataclass(frozen=True, eq=False)
class TAR(Sieve):
    """Keep events in temporal active regions.

    Every event, whether it passes or not and of either polarity, adds 1 to a mask in the square of side
    ``2 radius + 1`` round its pixel; the mask decays exponentially. The event passes if the mask at its pixel, its own
    1 included, is then above `theta`. A mask value is decayed when it is next touched, by the time since the last.

    Attributes:
        tau: decay time constant, s.
        theta: the mask value that must be exceeded, events; below 1 everything passes.
        radius: R of the neighbourhood, px.
        first: so many events of a recording pass whatever the mask, against the cold start (B.3: about 10).

    Source: thesis appendix B, algorithm 14, lines 3278-3310; B.3 for `first`. The text lets an event pass at exactly
        `theta`, the algorithm does not; the algorithm is followed. Defaults: those for N-MNIST, figure 85.
    """

    word = "tar"
    tau: float = quantity(0.08, "s", above=0)
    theta: float = quantity(2.4, "events", above=0)
    radius: int = quantity(1, "px", kind="integer", at_least=0)
    first: int = quantity(0, "events", kind="integer", at_least=0)

    def _fresh(self) -> State:
        shape = (self.sensor_size[1] + 2 * self.radius, self.sensor_size[0] + 2 * self.radius)
        return np.zeros(shape), np.zeros(shape, np.int64), np.zeros(1, np.int64)

    def _keep(self, events: Events, keep: npt.NDArray[np.bool_]) -> None:
        from neuro.events.filters._kernels import tar

        mask, touched, seen = self._state
        if not seen[0]:
            touched.fill(events.t[0])
        tar(events.t, events.x, events.y, 1e6 * self.tau, self.theta, self.radius, mask, touched, keep)
        keep[: max(0, self.first - int(seen[0]))] = True
        seen[0] += len(events)


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
    tau: float = quantity(0.08, "s", above=0)
    theta: float = quantity(2.4, "events", above=0)
    radius: int = quantity(1, "px", kind="integer", at_least=0)
    cell: int = quantity(10, "px", kind="integer", at_least=1)

    def _fresh(self) -> State:
        (width, height), r, side = self.sensor_size, self.radius, 2 * self.radius + 1
        pixels = (height + 2 * r, width + 2 * r, 2)
        cells = (-(-height // self.cell), -(-width // self.cell))
        counts, sums = np.zeros(cells, np.int64), np.zeros((*cells, 2, side, side))
        return np.full(1, NEVER, np.int64), np.zeros(pixels), counts, sums

    def _keep(self, events: Events, keep: npt.NDArray[np.bool_]) -> None:
        from neuro.events.filters._kernels import surfaces

        origin, held, counts, sums = self._state
        if origin[0] == NEVER:
            origin[0] = events.t[0]
        surfaces(
            events.t, events.x, events.y, events.p, 1e6 * self.tau, self.theta, self.radius, self.cell,
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
