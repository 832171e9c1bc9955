"""Cleaners, which filter events, and segmenters, which cut a recording into frames by motion, clock, count or peaks."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from neuro.apps import Part, Registry, setting
from neuro.coding import Works, on_numbers
from neuro_events import Events, filters, segmentation
from neuro_recognise.method import SPLITS, FrameSize, FrontEndPart
from neuro_recognise.shown import Ints


@dataclass(frozen=True)
class Cleaner(Part):
    """Base of the cleaners, which remove noise events."""

    kind = "cleaner"

    @abstractmethod
    def new_filter(self, sensor_size: tuple[int, int]) -> Callable[[Events], Events]:
        """Return a function that filters a recording in successive parts."""

    def clean(self, events: Events) -> Events:
        """Return the events of a recording that pass the filter."""
        return self.new_filter(events.sensor_size)(events)


@dataclass(frozen=True)
class Plain(Cleaner):
    """No filter: all events pass."""

    source = "default of methods without a filter"

    def new_filter(self, sensor_size: tuple[int, int]) -> Callable[[Events], Events]:
        """Return the identity."""
        return lambda events: events


@dataclass(frozen=True)
class Tar(Cleaner):
    """Filter that passes events of temporal active regions (TAR)."""

    source = "thesis appendix B, algorithm 14"

    tau: float = setting(0.08, "s", "decay of activity", "thesis figure 85", above=0)
    theta: float = setting(2.4, "events", "activity that must be exceeded", "thesis figure 85", above=0)
    radius: int = setting(1, "px", "radius of the neighbourhood", "thesis figure 85", at_least=0)

    def new_filter(self, sensor_size: tuple[int, int]) -> Callable[[Events], Events]:
        """Return a filter that passes events whose neighbourhood was recently active."""
        return filters.TAR(sensor_size, tau=self.tau, theta=self.theta, radius=self.radius)


Cleaner.known = Registry("cleaner", (Plain, Tar))


@dataclass(frozen=True)
class Segmenter(FrontEndPart):
    """Base of the segmenters.

    Class attributes:
        tentative: whether the end of the last segment may change when more events of the recording arrive.
    """

    kind = "segmenter"
    tentative: ClassVar[bool] = False

    def bounds(self, t: Ints) -> Ints:
        """Return the first event of each segment, and the end of the last segment. Later events belong to no segment.

        Args:
            t: (n,) times, us, ascending.

        Returns:
            (segments + 1,) indices; segment i has the events ``[bounds[i], bounds[i + 1])``.
        """
        cutter = self.cutter()
        return np.concatenate([np.zeros(1, np.int64), cutter.cuts(t), cutter.end()])

    @abstractmethod
    def cutter(self) -> segmentation.Cutter:
        """Return a new cutter, which also accepts a recording in parts."""

    def complete_at(self, t: Ints, bounds: Ints) -> Ints:
        """Return the time at which each segment is known to be complete.

        Args:
            t: (n,) times, us, ascending.
            bounds: bounds of the segments.

        Returns:
            (segments,) time of the event from which on the end of the segment is certain, us.
        """
        return t[bounds[1:] - 1]

    def proposal(self, events: float, us: float) -> dict[str, float]:
        """Return settings with which a recording has about four segments; an empty dict if no setting is known.

        Args:
            events: number of events of the recording.
            us: duration of the recording, us.
        """
        return {}


@dataclass(frozen=True)
class Msd(Segmenter):
    """Motion symbol detector: a leaky neuron that receives all events ends a segment at each of its spikes."""

    source = "thesis section 6.2.1, lines 2321-2334"

    tau: float = setting(0.02, "s", "decay of the motion symbol detector", "thesis table 3 (printed as ms)", above=0)
    threshold: float = setting(150.0, "events", "potential that completes a segment", "thesis table 3", above=0)

    def cutter(self) -> segmentation.Cutter:
        """Return a motion symbol detector."""
        return segmentation.MSD(self.tau, self.threshold)

    def proposal(self, events: float, us: float) -> dict[str, float]:
        """Return the potential after a quarter of a recording whose events come at equal intervals."""
        quarter_us, tau_us = us / 4, 1e6 * self.tau
        potential = events / us * tau_us * -np.expm1(-quarter_us / tau_us) if us else events / 4
        return {"threshold": max(1, int(potential))}

    def work(self, size: FrameSize) -> Works:
        """Return the operations of a leak: a difference, a division, exp, a product with a sum, and a comparison."""
        return {"event": on_numbers(5, 5)}


@dataclass(frozen=True)
class Hes(Segmenter):
    """Segments of equal duration: hard event segmentation."""

    source = "thesis section 3.3, lines 870-874"

    window: float = setting(20.0, "ms", "length of a segment", "a fifth of a saccade of N-MNIST", above=0)

    def cutter(self) -> segmentation.Cutter:
        """Return a cutter by time."""
        return segmentation.TimeWindows(max(1, round(1000.0 * self.window)))

    def proposal(self, events: float, us: float) -> dict[str, float]:
        """Return a quarter of the duration, ms."""
        return {"window": us / 4000}

    def complete_at(self, t: Ints, bounds: Ints) -> Ints:
        """Return the time of the first event after each window."""
        return t[bounds[1:]]

    def work(self, size: FrameSize) -> Works:
        """Return the comparison of a time with the end of the window."""
        return {"event": on_numbers(1, 2)}


@dataclass(frozen=True)
class Counts(Segmenter):
    """Segments with equal numbers of events: hard event segmentation."""

    source = "thesis section 3.3, lines 870-874"

    count: int = setting(200, "events", "events per segment", "about that of MSD's on N-MNIST", at_least=1)

    def cutter(self) -> segmentation.Cutter:
        """Return a cutter by number of events."""
        return segmentation.Counts(self.count)

    def proposal(self, events: float, us: float) -> dict[str, float]:
        """Return a quarter of the events."""
        return {"count": max(1, int(events / 4))}

    def work(self, size: FrameSize) -> Works:
        """Return the addition and the comparison of a counter."""
        return {"event": on_numbers(2, 2)}


@dataclass(frozen=True)
class Ses(Segmenter):
    """Segments around the peaks of a leaky neuron's potential: soft event segmentation."""

    tentative = True
    source = "Zhao et al., IEEE TNNLS 26:1963, 2015; thesis section 6.1.1, lines 2165-2176"

    search: float = setting(
        15.0, "ms", "time on both sides of a peak without a higher one", "MK-Tempotron's code", above=0
    )
    tau: float = setting(20.0, "ms", "decay of the potential; 4 times its rise", "MK-Tempotron's code", above=0)
    threshold: float = setting(
        0.0, "", "smallest potential of a peak, in units of one event's potential",
        f"0: all; EDHMAX: 200, {SPLITS}; MK-Tempotron: 603", at_least=0,
    )  # fmt: skip

    def cutter(self) -> segmentation.Cutter:
        """Return a peak finder, which confirms a peak `search` after it."""
        return segmentation.Peaks(round(1000.0 * self.search), tau_us=1000.0 * self.tau, threshold=self.threshold)

    def work(self, size: FrameSize) -> Works:
        """Return the operations of an event.

        The difference of times takes 1 operation, each of two leaks 3, and the difference of the leaks 1. The candidate
        and the first of the queue take 2 each (a difference and a comparison). A new candidate takes 2, and the end of
        the queue 2.
        """
        return {"event": on_numbers(1 + 2 * 3 + 1 + 2 * 2 + 2 + 2, 9)}


class _End(segmentation.Cutter):
    """Cuts once, after the last event."""

    count = 0

    def cuts(self, t: Ints) -> Ints:
        """Return no cuts."""
        self.count += len(t)
        return segmentation.NONE

    def end(self) -> Ints:
        """Return the end of the recording; an empty array without events."""
        return np.array([self.count] if self.count else [], np.int64)


@dataclass(frozen=True)
class Whole(Segmenter):
    """The whole recording as one segment, for still images whose pixels have as many events as their grey level."""

    tentative = True
    source = "Mozafari et al. 2018, Masquelier and Thorpe 2007: a picture is shown once"

    def cutter(self) -> segmentation.Cutter:
        """Return a cutter that cuts after the last event."""
        return _End()

    def work(self, size: FrameSize) -> Works:
        """Return no operations, because the recording is one segment."""
        return {}


Segmenter.known = Registry("recogniser segmenter", (Msd, Hes, Counts, Ses, Whole))
