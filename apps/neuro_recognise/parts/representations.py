"""What the filters are shown at the end of each segment: its events, or surfaces that remember those before."""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass
from typing import ClassVar, NamedTuple, Protocol

import numpy as np

from neuro.apps import Part, Registry, setting
from neuro.events import Events, representations
from neuro_recognise.shown import Array, Floats, Ints


class Pixels(NamedTuple):
    """What pixels hold at the end of each segment; entries of the same pixel add up.

    Attributes:
        x, y: (entries,) px.
        value: (entries,) above 0.
        bounds: (segments + 1,) segment i has the entries ``[bounds[i], bounds[i + 1])``.
    """

    x: Array
    y: Array
    value: Floats
    bounds: Ints

    def pictures(self, size: tuple[int, int]) -> Floats:
        """(segments, height, width) of a field so wide and high, px."""
        width, height = size
        segment = np.repeat(np.arange(len(self.bounds) - 1), np.diff(self.bounds))
        inside = slice(int(self.bounds[0]), int(self.bounds[-1]))
        drawn = np.zeros((len(self.bounds) - 1, height, width))
        np.add.at(drawn, (segment, self.y[inside], self.x[inside]), self.value[inside])
        return drawn


@dataclass(frozen=True)
class Representation(Part):
    """Base of the representations.

    Class attributes:
        remembers: whether it holds what was before a segment.
    """

    kind = "representation"
    remembers: ClassVar[bool] = True

    @abstractmethod
    def pixels(self, events: Events, bounds: Ints) -> Pixels:
        """What is held at the last event before the end of each segment.

        Args:
            events: a recording inside the field.
            bounds: (segments + 1,) segment i is ``[bounds[i], bounds[i + 1])``.
        """


@dataclass(frozen=True)
class Counts(Representation):
    """The number of events of the segment."""

    remembers = False
    source = "thesis 6.2.1, lines 2321-2334"

    def pixels(self, events: Events, bounds: Ints) -> Pixels:
        """Each event counts 1."""
        return Pixels(events.x, events.y, np.ones(len(events)), bounds)


class _Held(Protocol):
    """A surface of `neuro.events.representations`."""

    def add(self, events: Events) -> None: ...
    def at(self, t_us: int, dtype: type) -> Array: ...


@dataclass(frozen=True)
class _Remembering(Representation):
    """Base of surfaces."""

    tau: float = setting(20.0, "ms", "in which an event is forgotten to 1/e", "that of MSD", above=0)

    @abstractmethod
    def held(self, size: tuple[int, int]) -> _Held:
        """A surface of a sensor so wide and high, px, without events."""

    def pixels(self, events: Events, bounds: Ints) -> Pixels:
        """All pixels that had an event."""
        width, height = events.sensor_size
        held, begin = self.held(events.sensor_size), 0
        read = np.empty((len(bounds) - 1, height, width))
        for segment, end in enumerate(bounds[1:].tolist()):
            held.add(events[begin:end])
            begin = end
            # read at an event, some pixel is large however long the pause before it was
            read[segment] = held.at(int(events.t[end - 1]), np.float64)
        segments, y, x = np.nonzero(read)
        lengths = np.bincount(segments, minlength=len(read))
        return Pixels(x.astype(np.uint16), y.astype(np.uint16), read[segments, y, x], np.cumsum([0, *lengths]))


@dataclass(frozen=True)
class Leaky(_Remembering):
    """The sum of a pixel's events, each of which decays exponentially."""

    source = "thesis 6.2.8; appendix C, algorithm 15"

    def held(self, size: tuple[int, int]) -> _Held:
        """Whatever the polarity."""
        return representations.LeakySurface(size, tau_us=1000.0 * self.tau, polarity="ignored")


@dataclass(frozen=True)
class Surface(_Remembering):
    """A pixel's last event, which decays exponentially."""

    source = "thesis 6.2.8; Lagorce et al., IEEE TPAMI 39:1346, 2017, eq. 2"

    def held(self, size: tuple[int, int]) -> _Held:
        """Whatever the polarity."""
        return representations.TimeSurface(size, tau_us=1000.0 * self.tau, polarity="ignored")


Representation.known = Registry("representation", (Counts, Leaky, Surface))
