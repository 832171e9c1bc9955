"""Find several objects in view: where each is, what it is, and which it was before.

proposals: events -> segments -> regions -> tracks -> pieces of a track's own events -> recogniser -> boxes
dense:     events -> segments -> sliding network -> regions with classes -> tracks -> boxes

A recogniser learns what a detector shows it from crops out of scenes. A crop lacks the noise round an object, has some
of the background and of its neighbours, and moves otherwise than a recording of one object in the middle of the field:
HATS finds half as many objects by their class when it learnt from whole recordings (docs/how-to/detect-objects.md).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from neuro import ModelError
from neuro.apps import Part, Registry, Settings, make_folder, part, setting
from neuro_events import Events, representations, save
from neuro_events.parts import joined_parts
from neuro_recognise.detection.boxes import (
    AT_LEAST,
    UNKNOWN,
    Boxes,
    Precision,
    Switches,
    identity_switches,
    iou,
    precision,
    suppressed,
)
from neuro_recognise.detection.proposals import CHOSEN, Dense, Proposals, Region, Sliding
from neuro_recognise.detection.scenes import Scene, Scenes
from neuro_recognise.parts.segmenters import Hes, Segmenter
from neuro_recognise.recogniser import Recogniser
from neuro_recognise.shown import Floats, Ints


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
        found = []
        for i, middle in enumerate(middles):
            if i not in of:
                of[i] = Track(self._following, middle, t)
                self._following += 1
                self.live.append(of[i])
            of[i].move(middle, t, tracking.gain)
            found.append(of[i])
        return found


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
        if self._held and len(left := joined_parts(self._held)):
            yield left

    def _until(self, cuts: Ints) -> Iterator[Events]:
        if not len(cuts):
            return
        whole, ends = joined_parts(self._held), (cuts - self._cut).tolist()
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
    from crops, too (`write_crops`).

    Args:
        regions: of the object, in the order of time.
        size: width and height of the field, px; what lies outside is left out.
        scale: how many px of the sensor become one; of larger objects one event in scale^2 stays.
    """
    middles = np.repeat([region.centre for region in regions], [len(region.events) for region in regions], axis=0)
    parts = [region.events for region in regions]
    t, x, y, p = (np.concatenate([getattr(part, name) for part in parts]) for name in "txyp")
    axes = zip((x, y), middles.T, size, strict=True)  # places are counted from the middle of the field
    x, y = (np.rint((at - middle) / scale + (side - 1) / 2.0).astype(np.int64) for at, middle, side in axes)
    there = np.flatnonzero((x >= 0) & (x < size[0]) & (y >= 0) & (y < size[1]))
    if scale > 1.0:
        there = there[np.floor(np.arange(0.0, len(there), scale**2)).astype(np.int64)]
    return Events(t[there], x[there], y[there], p[there], size)


WAYS = ("proposals", "dense")
"""Of finding objects: places first and then what is there, or both at once by a network over the whole sensor."""


class Detector:
    """Finds objects that a recogniser knows.

    Args:
        recogniser: names an object; its field may be of another size than the sensor.
        settings: how objects are found.
        backend: runs networks.
        way: see `WAYS`; `dense` takes a recogniser of the method `remus`.

    Raises:
        ModelError: there is no such way.
    """

    def __init__(
        self, recogniser: Recogniser, settings: Detecting | None = None, backend: str = "event", way: str = "proposals"
    ) -> None:
        if way not in WAYS:
            raise ModelError(f"way = '{way}': expected one of {', '.join(WAYS)}")
        self.recogniser, self.settings, self.backend, self.way = recogniser, settings or Detecting(), backend, way
        self._sliding: dict[tuple[int, int], Sliding] = {}
        self._view: WindowView | None = None
        self._known: dict[int, _Known] = {}

    def detect(self, events: Events) -> Boxes:
        """All boxes of a recording; what an object is follows from all that was seen of it.

        Args:
            events: the recording, of any sensor.

        Returns:
            A box for each object and each segment in which it is seen, in the order of time.
        """
        found = pieces(events, self.settings, self._finder(events.sensor_size))
        known: dict[int, _Known] = {}
        for piece, scores in zip(found, self._scores(found), strict=True):
            known.setdefault(piece.seen[0].number, _Known()).judge(piece, scores)
        seen = sorted((one for piece in found for one in piece.seen), key=lambda one: (one.start, one.number))
        return Boxes.of(_row(one, known[one.number].total) for one in seen)

    def feed(self, events: Events) -> Boxes:
        """See the next events of a stream.

        Args:
            events: after those seen so far, of the same sensor.

        Returns:
            A box for each object in each segment that became complete; what an object is follows from what was seen of
            it so far.

        Raises:
            ModelError: the sensor is another than before.
        """
        if self._view is None:
            self._view = WindowView(self.settings, events.sensor_size, self._finder(events.sensor_size))
        return self._fed(self._view, self._view.segments(events))

    def finish(self) -> Boxes:
        """The boxes of what is left when a stream ends; the next events begin another one."""
        if self._view is None:
            return Boxes.of([])
        found = self._fed(self._view, self._view.rest())
        self._view, self._known = None, {}
        return found

    def _fed(self, view: WindowView, segments: Iterable[Events]) -> Boxes:
        rows = []
        for segment in segments:
            seen = sorted(view.look(segment), key=lambda one: one.number)
            held = [self._known.setdefault(one.number, _Known()).add(one, self.settings.memory) for one in seen]
            for one, piece, scores in zip(seen, held, self._scores(held), strict=True):
                self._known[one.number].judge(piece, scores)
                rows.append(_row(one, self._known[one.number].total))
            live = view.live
            self._known = {number: known for number, known in self._known.items() if number in live}
        return Boxes.of(rows)

    def _finder(self, sensor: tuple[int, int]) -> Finder | None:
        """What finds the objects of a segment, None for proposals; a network is compiled once for each sensor."""
        if self.way == "proposals":
            return None
        if sensor not in self._sliding:
            settings = self.settings
            self._sliding[sensor] = Sliding(self.recogniser, settings.dense, settings.proposals, sensor, self.backend)
        return self._sliding[sensor].regions

    def _scores(self, found: Sequence[Piece]) -> Floats:
        """(pieces, classes) what speaks for each class."""
        if not found:
            return np.zeros((0, len(self.recogniser.classes)))
        if self.way == "dense":
            scored = [[region.scores for region in piece.regions if region.scores is not None] for piece in found]
            return np.array([np.sum(scores, axis=0) for scores in scored])
        size, proposals = self.recogniser.method.size, self.settings.proposals
        shown = [crop(piece.regions, size, proposals.scale_of(piece.regions)) for piece in found]
        return self.recogniser.scores(shown, self.backend)


@dataclass(slots=True, eq=False)
class _Known:
    """What is known of an object: the scores of its pieces; of the latest those of what was seen of it so far."""

    latest: Piece = field(default_factory=Piece)
    scores: dict[int, Floats] = field(default_factory=dict)

    def add(self, one: Seen, memory: float) -> Piece:
        """It was seen; gives the piece that this belongs to."""
        if not self.latest.takes(one, memory):
            self.latest = Piece()
        self.latest.seen.append(one)
        return self.latest

    def judge(self, piece: Piece, scores: Floats) -> None:
        """What speaks for each class in a piece, in place of what did before."""
        self.scores[piece.seen[0].start] = scores

    @property
    def total(self) -> Floats:
        """(classes,) the sum over all pieces; where nothing speaks for any class NaN."""
        heard = [scores for scores in self.scores.values() if not np.isnan(scores).all()]
        return np.sum(heard, axis=0) if heard else next(iter(self.scores.values()))


def _row(one: Seen, scores: Floats) -> tuple[int, int, int, int, float, Sequence[float]]:
    """A row of boxes; its score is how far the best class is before the next, 0 where none is known."""
    label = UNKNOWN if np.isnan(scores).all() else int(np.nanargmax(scores))
    known = np.sort(scores[~np.isnan(scores)])
    sureness = float(known[-1] - known[-2]) if len(known) > 1 else 0.0
    return one.start, one.stop, one.number, label, sureness, one.region.box.tolist()


def crops(scene: Scene, settings: Detecting, size: tuple[int, int]) -> Iterator[tuple[int, Events]]:
    """The objects that a detector finds in a scene: class and crop; what fits to no true box is left out.

    Args:
        scene: with its true boxes.
        settings: how objects are found.
        size: width and height of the crops, px.
    """
    for piece in pieces(scene.events, settings):
        fits: list[int] = []
        for one in piece.seen:
            now = scene.boxes.within(one.start, one.stop)
            shared = iou(one.region.box[None], now.box)[0]
            fits += [int(now.label[shared.argmax()])] if len(now) and shared.max() >= AT_LEAST else []
        if fits:  # of the class that most of its boxes fit to
            scale = settings.proposals.scale_of(piece.regions)
            yield int(np.bincount(fits).argmax()), crop(piece.regions, size, scale)


def write_crops(
    folder: Path,
    scenes: Scenes,
    settings: Detecting,
    *,
    before: str = "",
    report: Callable[[int, int], None] = lambda done, total: None,
) -> int:
    """Write crops of all scenes, in folders named as their classes; the same call writes the same files.

    Args:
        folder: made if it is not there.
        scenes: with true boxes.
        settings: how objects are found.
        before: stands before the names of files, so that several data sets of scenes fit into one folder.
        report: called with how many scenes are done, and of how many.

    Returns:
        How many there are.

    Raises:
        EventFileError: a crop cannot be written.
    """
    for name in scenes.classes:
        make_folder(folder / name)
    size = settings.proposals.field
    written = 0
    for done, scene in enumerate(scenes, 1):
        for k, (label, events) in enumerate(crops(scene, settings, size)):
            save(events, folder / scenes.classes[label] / f"{before}{scene.name}-{k}.npz", replace=True)
            written += 1
        report(done, len(scenes))
    return written


@dataclass(frozen=True, slots=True)
class DetectionTrial:
    """What came of scenes.

    Attributes:
        scenes: how many.
        precision: of all boxes; a slice of a scene is a picture.
        switches: of all scenes.
        ms: processor time of a scene, the median; the first one, on which kernels may be compiled, does not count if
            there are others.
        pictures: true boxes and those that were found, of each slice of a scene.
    """

    scenes: int
    precision: Precision
    switches: Switches
    ms: float
    pictures: tuple[tuple[Boxes, Boxes], ...] = ()

    def as_words(self, classes: tuple[str, ...]) -> dict[str, Any]:
        """The figures as plain data, for JSON."""
        of_class = zip(classes, self.precision.of_class, strict=True)
        return {
            "scenes": self.scenes,
            "map": self.precision.mean,
            "box_ap": self.precision.box,
            "ap": {name: None if np.isnan(ap) else ap for name, ap in of_class},
            **asdict(self.switches),
            "ms": self.ms,
        }


def try_out(
    detector: Detector, scenes: Iterable[Scene], report: Callable[[int], None] = lambda done: None
) -> DetectionTrial:
    """Let a detector find the objects of scenes.

    Args:
        detector: its recogniser knows the classes of the scenes, in their order.
        scenes: with true boxes.
        report: called with how many are done.
    """
    pairs, switches, ms = list[tuple[Boxes, Boxes]](), list[Switches](), list[float]()
    for done, scene in enumerate(scenes, 1):
        began = time.process_time()
        found = detector.detect(scene.events)
        ms.append(1000.0 * (time.process_time() - began))
        pictures = in_pictures(scene, found)
        pairs += pictures
        switches.append(identity_switches(pictures))
        report(done)
    names = ("switches", "objects", "missed", "boxes")
    held = Switches(*(sum(getattr(one, name) for one in switches) for name in names))
    average = precision(pairs, len(detector.recogniser.classes))
    typical = float(np.median(ms[1:] or ms)) if ms else float("nan")
    return DetectionTrial(len(ms), average, held, typical, tuple(pairs))


def in_pictures(scene: Scene, found: Boxes) -> list[tuple[Boxes, Boxes]]:
    """True boxes and those that were found, for each slice of a scene."""
    there = scene.boxes
    return [(there[there.start == start], found.within(start, stop)) for start, stop in scene.slices]
