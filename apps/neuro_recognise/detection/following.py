"""From events to objects that are followed, whatever they are: segments, regions, tracks, their pieces and crops."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from neuro import ModelError
from neuro.apps import Part, Registry, Settings, part, setting
from neuro.events import Events, representations
from neuro.events.parts import together
from neuro_recognise.detection.boxes import suppressed
from neuro_recognise.detection.proposals import CHOSEN, Proposals, Region
from neuro_recognise.detection.sliding import Dense
from neuro_recognise.parts.segmenters import Hes, Segmenter
from neuro_recognise.shown import Array, Floats, Ints


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


Finder = Callable[[Events, Floats], list[Region]]
"""The objects of a segment: of its events, and the counts of these and of those before that shall count."""


@dataclass(frozen=True)
class Detecting(Settings):
    """How objects are found.

    Attributes:
        segmenter: cuts the events; objects are looked for in each segment.
        proposals: finds places of objects.
        dense: finds places and classes at once, where that way is taken.
        tracking: finds which object is which from segment to segment.
    """

    segmenter: Segmenter = part(Segmenter, Hes(window=100.0))
    leak: float = setting(0.0, "ms", "decay of counts from segment to segment; 0: none are left", CHOSEN, at_least=0)
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
    """The objects of a whole recording, in pieces of at most `memory`; found by proposals if no other way is given."""
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


def crop(regions: Sequence[Region], size: tuple[int, int], scale: float = 1.0) -> Events:
    """The events of an object in some segments, without those of others and moved into a field.

    In each segment the mean of its events comes to the middle of the field, which takes the motion from segment to
    segment out. So what is seen differs a little from a recording of an object that stays: a recogniser should learn
    from crops, too (`neuro_recognise.detection.learning`).

    Args:
        regions: of the object, in the order of time.
        size: width and height of the field, px; what lies outside is left out.
        scale: how many px of the sensor become one; of larger objects one event in scale^2 stays.
    """
    middles = np.repeat([region.centre for region in regions], [len(region.events) for region in regions], axis=0)
    parts = [region.events for region in regions]
    t, x, y, p = (np.concatenate([getattr(part, name) for part in parts]) for name in "txyp")
    x, y = _into(x - middles[:, 0], size[0], scale), _into(y - middles[:, 1], size[1], scale)
    there = np.flatnonzero((x >= 0) & (x < size[0]) & (y >= 0) & (y < size[1]))
    if scale > 1.0:
        there = there[np.floor(np.arange(0.0, len(there), scale**2)).astype(np.int64)]
    return Events(t[there], x[there], y[there], p[there], size)


def _into(places: Array, side: int, scale: float) -> Array:
    """Columns or rows, counted from the middle of a side of the field."""
    return np.rint(places / scale + (side - 1) / 2.0).astype(np.int64)
