"""Who is who over time: regions are given to the tracks that they lie nearest to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from neuro.apps import Registry
from neuro_recognise.detection.proposals import CHOSEN, Region
from neuro_recognise.settings import Part, setting
from neuro_recognise.shown import Floats

__all__ = ["Track", "Tracking", "Tracks"]


@dataclass(frozen=True)
class Tracking(Part):
    """Each region goes to the track whose middle it is nearest to, so that all together move least."""

    kind = "tracking"
    source = "Kuhn, Naval Research Logistics 2:83, 1955; linear_sum_assignment of scipy"

    reach: float = setting(10.0, "px", "that an object's middle may have moved since it was seen", CHOSEN, above=0)
    patience: float = setting(250.0, "ms", "for which an object may be out of sight", CHOSEN, at_least=0)
    gain: float = setting(0.3, "", "share of a new velocity in the one that is expected", CHOSEN, at_least=0, at_most=1)


Tracking.known = Registry("tracking", (Tracking,))


@dataclass(slots=True, eq=False)
class Track:
    """An object that is followed.

    Attributes:
        number: its identity.
        middle: (2,) of its box, where it was last seen, px.
        seen: when that was, us.
        velocity: (2,) px/us.
    """

    number: int
    middle: Floats
    seen: int
    velocity: Floats = field(default_factory=lambda: np.zeros(2))

    def expected(self, t: int) -> Floats:
        """(2,) the middle of its box at a time."""
        return self.middle + self.velocity * (t - self.seen)

    def move(self, middle: Floats, t: int, gain: float) -> None:
        """It was seen."""
        if t > self.seen:
            self.velocity = (1.0 - gain) * self.velocity + gain * (middle - self.middle) / (t - self.seen)
        self.middle, self.seen = middle, t


class Tracks:
    """All that are followed.

    Attributes:
        live: those that may still be seen again.
    """

    def __init__(self, tracking: Tracking) -> None:
        self._tracking = tracking
        self._following = 0
        self.live: list[Track] = []

    def follow(self, regions: Sequence[Region], t: int) -> list[Track]:
        """The track of each region; what fits to none begins a new one.

        Args:
            regions: of a segment.
            t: its middle, us.
        """
        from scipy.optimize import linear_sum_assignment

        tracking = self._tracking
        self.live = [track for track in self.live if t - track.seen <= 1000.0 * tracking.patience]
        middles = np.array([(region.box[:2] + region.box[2:]) / 2.0 for region in regions]).reshape(-1, 2)
        expected = np.array([track.expected(t) for track in self.live]).reshape(-1, 2)
        far = np.sqrt(((middles[:, None] - expected) ** 2).sum(axis=2))
        # what is out of reach costs the same however far: it shall not move those that are near
        pairs = zip(*linear_sum_assignment(np.minimum(far, tracking.reach)), strict=True)
        of = {int(i): self.live[j] for i, j in pairs if far[i, j] < tracking.reach}
        found = [of[i] if i in of else self._new(middles[i], t) for i in range(len(regions))]
        for track, middle in zip(found, middles, strict=True):
            track.move(middle, t, tracking.gain)
        return found

    def _new(self, middle: Floats, t: int) -> Track:
        track = Track(self._following, middle, t)
        self._following += 1
        self.live.append(track)
        return track
