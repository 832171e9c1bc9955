"""From events to objects that are followed, whatever they are: segments, regions, tracks, and pieces of these."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

import numpy as np

from neuro import ModelError
from neuro.events import Events, representations
from neuro.events.parts import together
from neuro_recognise.detection.boxes import suppressed
from neuro_recognise.detection.proposals import CHOSEN, Proposals, Region
from neuro_recognise.detection.sliding import Dense
from neuro_recognise.detection.tracks import Tracking, Tracks
from neuro_recognise.parts.segmenters import Hes, Segmenter
from neuro_recognise.settings import Settings, part, setting
from neuro_recognise.shown import Floats, Ints

__all__ = ["Detecting", "Finder", "Piece", "Seen", "WindowView", "pieces"]

Finder = Callable[[Events, Floats], list[Region]]
"""The objects of a segment: of its events, and the counts of these and of those before that shall count."""


@dataclass(frozen=True)
class Detecting(Settings):
    """How objects are found.

    Attributes:
        segmenter: cuts the events; objects are looked for in each segment.
        proposals: finds places of objects.
        dense: finds places and classes at once, where that way is taken.
        tracking: tells which object is which from segment to segment.
    """

    segmenter: Segmenter = part(Segmenter, Hes(window=100.0))
    leak: float = setting(
        0.0, "ms", "decay of counts from segment to segment, for short ones; 0: none are left", CHOSEN, at_least=0
    )
    proposals: Proposals = part(Proposals, Proposals())
    dense: Dense = part(Dense, Dense())
    overlap: float = setting(0.5, "", "largest IoU of two boxes of a segment", "usual", at_least=0, at_most=1)
    tracking: Tracking = part(Tracking, Tracking())
    memory: float = setting(300.0, "ms", "of events that are recognised together", "a recording of N-MNIST", above=0)


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """An object in a segment.

    Attributes:
        start: of the segment, us.
        stop: the us after its last event.
        number: identity of the object.
        region: where it is.
    """

    start: int
    stop: int
    number: int
    region: Region


@dataclass(slots=True, eq=False)
class Piece:
    """What is seen of an object for a while.

    Attributes:
        seen: in the order of time.
    """

    seen: list[Seen] = field(default_factory=list)

    @property
    def regions(self) -> list[Region]:
        """Where it is."""
        return [one.region for one in self.seen]

    def takes(self, one: Seen, memory: float) -> bool:
        """Whether it is still short enough with a segment more.

        Args:
            one: the segment.
            memory: longest time, ms.
        """
        return not self.seen or one.stop - self.seen[0].start <= 1000.0 * memory


def pieces(events: Events, settings: Detecting, finder: Finder | None = None) -> list[Piece]:
    """The objects of a whole recording, in pieces of at most `memory`; found by proposals if no other way is told."""
    view, latest = WindowView(settings, events.sensor_size, finder), dict[int, Piece]()
    found: list[Piece] = []
    for segment in (*view.segments(events), *view.rest()):
        for one in view.look(segment):
            if one.number not in latest or not latest[one.number].takes(one, settings.memory):
                latest[one.number] = Piece()
                found.append(latest[one.number])
            latest[one.number].seen.append(one)
    return found


class WindowView:
    """What is on its way while events come: a segment, counts, and tracks.

    Args:
        settings: how objects are found.
        sensor: width and height, px.
        finder: finds the objects of a segment; None for proposals.
    """

    def __init__(self, settings: Detecting, sensor: tuple[int, int], finder: Finder | None = None) -> None:
        self._settings, self._sensor = settings, sensor
        self._find = finder or settings.proposals.regions
        self._cutter, self._held, self._cut = settings.segmenter.cutter(), list[Events](), 0
        self._counts, self._counted = np.zeros(sensor[::-1]), 0
        self._tracks = Tracks(settings.tracking)

    @property
    def live(self) -> set[int]:
        """Identities of the objects that may still be seen again."""
        return {track.number for track in self._tracks.live}

    def segments(self, events: Events) -> Iterator[Events]:
        """Those that the next events complete.

        Raises:
            ModelError: they are of another sensor.
        """
        if events.sensor_size != self._sensor:
            (width, height), (w, h) = self._sensor, events.sensor_size
            raise ModelError(f"events of a sensor of {w}x{h} px after those of {width}x{height} px")
        self._held.append(events)
        yield from self._until(self._cutter.cuts(events.t))

    def rest(self) -> Iterator[Events]:
        """Those that are complete when no more events come, and what is left over."""
        yield from self._until(self._cutter.end())
        if self._held and len(left := together(self._held)):
            yield left

    def _until(self, cuts: Ints) -> Iterator[Events]:
        if not len(cuts):
            return
        whole, ends = together(self._held), (cuts - self._cut).tolist()
        self._cut, self._held = int(cuts[-1]), [whole[ends[-1] :]]
        for start, stop in zip([0, *ends[:-1]], ends, strict=True):
            yield whole[start:stop]

    def look(self, segment: Events) -> list[Seen]:
        """The objects in a segment."""
        if not len(segment):
            return []
        settings, start, stop = self._settings, int(segment.t[0]), int(segment.t[-1]) + 1
        left = np.exp((self._counted - stop) / (1000.0 * settings.leak)) if settings.leak else 0.0
        self._counts = left * self._counts + representations.event_frame(segment, polarity="ignored")
        self._counted = stop
        regions = self._find(segment, self._counts)
        box = np.array([region.box for region in regions]).reshape(-1, 4)
        events = np.array([len(region.events) for region in regions], float)
        regions = [regions[k] for k in suppressed(box, events, settings.overlap)]
        tracks = self._tracks.follow(regions, (start + stop) // 2)
        return [Seen(start, stop, track.number, region) for track, region in zip(tracks, regions, strict=True)]
