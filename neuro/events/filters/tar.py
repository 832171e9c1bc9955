"""Temporal active regions: an event passes where there was activity a short while ago."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from neuro.events._events import Events
from neuro.events.filters._filter import Sieve, State


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
    units = {"tau": "s", "theta": "events", "radius": "px", "first": "events"}
    tau: float = 0.08
    theta: float = 2.4
    radius: int = 1
    first: int = 0

    def _check(self) -> None:
        self._expect_positive("tau", " s")
        self._expect_positive("theta", " events")
        self._expect_whole("radius", 0, " px")
        self._expect_whole("first", 0, " events")

    def _fresh(self) -> State:
        shape = (self.sensor_size[1] + 2 * self.radius, self.sensor_size[0] + 2 * self.radius)
        return np.zeros(shape), np.zeros(shape, np.int64), np.zeros(1, np.int64)

    def _keep(self, events: Events, keep: npt.NDArray[np.bool_]) -> None:
        from neuro.events.filters._tar_kernel import tar

        mask, touched, seen = self._state
        if not seen[0]:
            touched.fill(events.t[0])
        tar(events.t, events.x, events.y, 1e6 * self.tau, float(self.theta), self.radius, mask, touched, keep)
        keep[: max(0, self.first - int(seen[0]))] = True
        seen[0] += len(events)
