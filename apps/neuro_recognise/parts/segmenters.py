"""Filters of events, and cuts into frames by motion, clock, count or peaks."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from neuro.apps import Part, Registry, setting
from neuro_events import Events, filters, segmentation
from neuro_recognise.method import SPLITS
from neuro_recognise.shown import Ints


@dataclass(frozen=True)
class Cleaner(Part):
    """Base of the cleaners."""

    kind = "cleaner"

    @abstractmethod
    def begun(self, sensor_size: tuple[int, int]) -> Callable[[Events], Events]:
        """A function that takes a recording part after part and gives what is left of each part."""

    def clean(self, events: Events) -> Events:
        """The events of a recording that are left."""
        return self.begun(events.sensor_size)(events)


@dataclass(frozen=True)
class Plain(Cleaner):
    """All events stay."""

    source = "what all methods but those with a filter do"

    def begun(self, sensor_size: tuple[int, int]) -> Callable[[Events], Events]:
        """Each part as it is."""
        return lambda events: events


@dataclass(frozen=True)
class Tar(Cleaner):
    """Events of temporal active regions stay."""

    source = "thesis appendix B, algorithm 14"

    tau: float = setting(0.08, "s", "decay of activity", "thesis figure 85", above=0)
    theta: float = setting(2.4, "events", "activity that must be exceeded", "thesis figure 85", above=0)
    radius: int = setting(1, "px", "of the neighbourhood", "thesis figure 85", at_least=0)

    def begun(self, sensor_size: tuple[int, int]) -> Callable[[Events], Events]:
        """Those whose surroundings were active shortly before."""
        return filters.TAR(sensor_size, tau=self.tau, theta=self.theta, radius=self.radius)


Cleaner.known = Registry("cleaner", (Plain, Tar))


@dataclass(frozen=True)
class Segmenter(Part):
    """Base of the segmenters.

    Class attributes:
        tentative: whether the last segment of a beginning may end elsewhere once more is seen.
    """

    kind = "segmenter"
    tentative: ClassVar[bool] = False

    def bounds(self, t: Ints) -> Ints:
        """Where segments begin, and the end of the last; what comes after it belongs to none.

        Args:
            t: (n,) times, us, ascending.

        Returns:
            (segments + 1,) segment i is ``[bounds[i], bounds[i + 1])``.
        """
        cutter = self.cutter()
        return np.concatenate([np.zeros(1, np.int64), cutter.cuts(t), cutter.end()])

    @abstractmethod
    def cutter(self) -> segmentation.Cutter:
        """What cuts, also a recording that comes in parts."""

    def complete_at(self, t: Ints, bounds: Ints) -> Ints:
        """When each segment is known to be complete.

        Args:
            t: (n,) times, us, ascending.
            bounds: of the segments.

        Returns:
            (segments,) us, the time of the event that shows it.
        """
        return t[bounds[1:] - 1]


@dataclass(frozen=True)
class Msd(Segmenter):
    """A leaky neuron that all events reach ends a segment where it fires."""

    source = "thesis section 6.2.1, lines 2321-2334"

    tau: float = setting(0.02, "s", "decay of the motion symbol detector", "thesis table 3 (printed as ms)", above=0)
    threshold: float = setting(150.0, "events", "potential that completes a segment", "thesis table 3", above=0)

    def cutter(self) -> segmentation.Cutter:
        """A detector of motion symbols."""
        return segmentation.MSD(self.tau, self.threshold)


@dataclass(frozen=True)
class Hes(Segmenter):
    """Segments of equal time: hard segmentation."""

    source = "thesis section 3.3, lines 875-890"

    window: float = setting(20.0, "ms", "length of a segment", "a fifth of a saccade of N-MNIST", above=0)

    def cutter(self) -> segmentation.Cutter:
        """A clock."""
        return segmentation.TimeWindows(max(1, round(1000.0 * self.window)))

    def complete_at(self, t: Ints, bounds: Ints) -> Ints:
        """At the first event after the window."""
        return t[bounds[1:]]


@dataclass(frozen=True)
class Counts(Segmenter):
    """Segments of equally many events: hard segmentation."""

    source = "thesis section 3.3, lines 875-890"

    count: int = setting(200, "events", "of a segment", "about that of MSD's on N-MNIST", at_least=1)

    def cutter(self) -> segmentation.Cutter:
        """A counter."""
        return segmentation.Counts(self.count)


@dataclass(frozen=True)
class Ses(Segmenter):
    """Segments round the peaks of a leaky neuron's potential: soft segmentation."""

    tentative = True
    source = "Zhao et al., IEEE TNNLS 26:1963, 2015; thesis section 6.1.1, lines 2165-2176"

    search: float = setting(15.0, "ms", "how far a peak is the highest on both sides", "MK-Tempotron's code", above=0)
    tau: float = setting(20.0, "ms", "decay of the potential; 4 times its rise", "MK-Tempotron's code", above=0)
    threshold: float = setting(
        0.0, "", "a peak is above it; in potentials of single events",
        f"0: all; EDHMAX: 200, {SPLITS}; MK-Tempotron: 603", at_least=0,
    )  # fmt: skip

    def cutter(self) -> segmentation.Cutter:
        """A finder of peaks; whether one is the highest is known `search` later only."""
        return segmentation.Peaks(round(1000.0 * self.search), tau_us=1000.0 * self.tau, threshold=self.threshold)


class _End(segmentation.Cutter):
    """Cuts behind the last event, once no more come."""

    seen = 0

    def cuts(self, t: Ints) -> Ints:
        """None."""
        self.seen += len(t)
        return segmentation.NONE

    def end(self) -> Ints:
        """All events; none of a recording without any."""
        return np.array([self.seen] if self.seen else [], np.int64)


@dataclass(frozen=True)
class Whole(Segmenter):
    """The whole recording as a segment: for still pictures, whose pixels have as many events as their grey level."""

    tentative = True
    source = "Mozafari et al. 2018, Masquelier and Thorpe 2007: a picture is shown once"

    def cutter(self) -> segmentation.Cutter:
        """What cuts at the end."""
        return _End()


Segmenter.known = Registry("recogniser segmenter", (Msd, Hes, Counts, Ses, Whole))
