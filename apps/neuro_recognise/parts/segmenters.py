"""Where a recording is cut into frames: by motion, by the clock, by count, or at peaks."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from neuro.apps import Part, Registry, setting
from neuro.events import segmentation
from neuro_recognise.settings import SPLITS
from neuro_recognise.shown import Ints


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


Segmenter.known = Registry("recogniser segmenter", (Msd, Hes, Counts, Ses))
