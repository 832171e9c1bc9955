"""Detection of several objects: positions, classes and identities over time.

proposals: events -> segments -> regions -> tracks -> pieces of a track's own events -> recogniser -> boxes
dense:     events -> segments -> sliding network -> regions with classes -> tracks -> boxes

A recogniser should learn from crops of scenes, because a detector presents crops. A crop lacks the noise around an
object, contains parts of the background and of neighbours, and moves differently from a recording of one object in the
centre of the field. HATS detects half as many objects with the right class if it learnt from whole recordings
(docs/how-to/detect-objects.md).
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
    """Assignment of regions to tracks with the smallest sum of distances from expected positions."""

    kind = "tracking"
    source = "Kuhn, Naval Research Logistics 2:83, 1955; linear_sum_assignment of scipy"

    reach: float = setting(10.0, "px", "largest distance of a centre from its expected position", CHOSEN, above=0)
    patience: float = setting(250.0, "ms", "longest time without a detection of an object", CHOSEN, at_least=0)
    gain: float = setting(0.3, "", "weight of a new velocity in the running average", CHOSEN, at_least=0, at_most=1)


Tracking.known = Registry("tracking", (Tracking,))


@dataclass(slots=True, eq=False)
class Track:
    """An object that is tracked.

    Attributes:
        number: identity of the object.
        middle: (2,) centre of its last box, px.
        last_us: time of the last box, us.
        velocity: (2,) velocity of the centre, px/us.
    """

    number: int
    middle: Floats
    last_us: int
    velocity: Floats = field(default_factory=lambda: np.zeros(2))

    def expected(self, t: int) -> Floats:
        """Return the expected centre of the box at a time, (2,) px."""
        return self.middle + self.velocity * (t - self.last_us)

    def move(self, middle: Floats, t: int, gain: float) -> None:
        """Update position and velocity with a new detection."""
        if t > self.last_us:
            self.velocity = (1.0 - gain) * self.velocity + gain * (middle - self.middle) / (t - self.last_us)
        self.middle, self.last_us = middle, t


class Tracks:
    """All tracked objects.

    Attributes:
        live: tracks that later detections may continue.
    """

    def __init__(self, tracking: Tracking) -> None:
        self._tracking = tracking
        self._following = 0
        self.live: list[Track] = []

    def follow(self, regions: Sequence[Region], t: int) -> list[Track]:
        """Return the track of each region; a region without a matching track starts a new one.

        Args:
            regions: regions of a segment.
            t: time of the middle of the segment, us.
        """
        from scipy.optimize import linear_sum_assignment

        tracking = self._tracking
        self.live = [track for track in self.live if t - track.last_us <= 1000.0 * tracking.patience]
        middles = np.array([(region.box[:2] + region.box[2:]) / 2.0 for region in regions]).reshape(-1, 2)
        expected = np.array([track.expected(t) for track in self.live]).reshape(-1, 2)
        distance = np.sqrt(((middles[:, None] - expected) ** 2).sum(axis=2))
        # Distances beyond the reach cost equally much, so that far regions do not affect the assignment of near ones.
        pairs = zip(*linear_sum_assignment(np.minimum(distance, tracking.reach)), strict=True)
        tracks_by_region = {int(i): self.live[j] for i, j in pairs if distance[i, j] < tracking.reach}
        tracks = []
        for i, middle in enumerate(middles):
            if i not in tracks_by_region:
                tracks_by_region[i] = Track(self._following, middle, t)
                self._following += 1
                self.live.append(tracks_by_region[i])
            tracks_by_region[i].move(middle, t, tracking.gain)
            tracks.append(tracks_by_region[i])
        return tracks


Finder = Callable[[Events, Floats], list[Region]]
"""Function that returns the regions of a segment. Its arguments are the events of the segment and the event counts,
(height, width), which may include earlier events."""


@dataclass(frozen=True)
class Detecting(Settings):
    """Settings of a detector.

    Attributes:
        segmenter: rule that cuts the events into segments; objects are detected in each segment.
        proposals: rule that proposes regions of objects.
        dense: network that detects regions and classes together, for the way `dense`.
        tracking: rule that assigns identities from segment to segment.
    """

    segmenter: Segmenter = part(Segmenter, Hes(window=100.0))
    leak: float = setting(
        0.0, "ms", "time constant of the counts' decay; 0: no memory of earlier segments", CHOSEN, at_least=0
    )
    proposals: Proposals = part(Proposals, Proposals())
    dense: Dense = part(Dense, Dense())
    overlap: float = setting(0.5, "", "largest IoU of two boxes of a segment", "usual", at_least=0, at_most=1)
    tracking: Tracking = part(Tracking, Tracking())
    memory: float = setting(
        300.0,
        "ms",
        "longest duration of a piece, whose events are classified together",
        "a recording of N-MNIST",
        above=0,
    )


@dataclass(frozen=True, slots=True, eq=False)
class Seen:
    """A detection of an object in one segment.

    Attributes:
        start: time of the first event of the segment, us.
        stop: end of the segment, us, which is 1 us after its last event.
        number: identity of the object.
        region: region of the object.
    """

    start: int
    stop: int
    number: int
    region: Region


@dataclass(slots=True, eq=False)
class Piece:
    """Successive detections of one object, whose events are classified together.

    Attributes:
        detections: detections in the order of time.
    """

    detections: list[Seen] = field(default_factory=list)

    @property
    def regions(self) -> list[Region]:
        """The region of each detection."""
        return [detection.region for detection in self.detections]

    def takes(self, one: Seen, memory: float) -> bool:
        """Return whether the piece stays within `memory` after adding a detection.

        Args:
            one: the detection.
            memory: longest time, ms.
        """
        return not self.detections or one.stop - self.detections[0].start <= 1000.0 * memory


def pieces(events: Events, settings: Detecting, finder: Finder | None = None) -> list[Piece]:
    """Detect the objects of a whole recording, and divide the detections of each into pieces of at most `memory` ms.

    Without a finder, proposals are used.
    """
    view, latest = WindowView(settings, events.sensor_size, finder), dict[int, Piece]()
    result: list[Piece] = []
    for segment in (*view.segments(events), *view.rest()):
        for proposal in view.look(segment):
            if proposal.number not in latest or not latest[proposal.number].takes(proposal, settings.memory):
                latest[proposal.number] = Piece()
                result.append(latest[proposal.number])
            latest[proposal.number].detections.append(proposal)
    return result


class WindowView:
    """State of a detection while events arrive: the current segment, counts, and tracks.

    Args:
        settings: settings of the detector.
        sensor: width and height of the sensor, px.
        finder: function that detects the objects of a segment; None for proposals.
    """

    def __init__(self, settings: Detecting, sensor: tuple[int, int], finder: Finder | None = None) -> None:
        self._settings, self._sensor = settings, sensor
        self._find = finder or settings.proposals.regions
        self._cutter, self._pending, self._cut = settings.segmenter.cutter(), list[Events](), 0
        self._counts, self._counted = np.zeros(sensor[::-1]), 0
        self._tracks = Tracks(settings.tracking)

    @property
    def live(self) -> set[int]:
        """Identities of the objects that later detections may continue."""
        return {track.number for track in self._tracks.live}

    def segments(self, events: Events) -> Iterator[Events]:
        """Yield the segments that the next events complete.

        Raises:
            ModelError: the events have another sensor.
        """
        if events.sensor_size != self._sensor:
            (width, height), (w, h) = self._sensor, events.sensor_size
            raise ModelError(f"events of a sensor of {w}x{h} px after those of {width}x{height} px")
        self._pending.append(events)
        yield from self._until(self._cutter.cuts(events.t))

    def rest(self) -> Iterator[Events]:
        """End the stream: yield the segments that its end completes, and the remaining events as a last segment."""
        yield from self._until(self._cutter.end())
        if self._pending and len(pending := joined_parts(self._pending)):
            yield pending

    def _until(self, cuts: Ints) -> Iterator[Events]:
        if not len(cuts):
            return
        pending, ends = joined_parts(self._pending), (cuts - self._cut).tolist()
        self._cut, self._pending = int(cuts[-1]), [pending[ends[-1] :]]
        for start, stop in zip([0, *ends[:-1]], ends, strict=True):
            yield pending[start:stop]

    def look(self, segment: Events) -> list[Seen]:
        """Detect the objects in a segment."""
        if not len(segment):
            return []
        settings, start, stop = self._settings, int(segment.t[0]), int(segment.t[-1]) + 1
        decay = np.exp((self._counted - stop) / (1000.0 * settings.leak)) if settings.leak else 0.0
        self._counts = decay * self._counts + representations.event_frame(segment, polarity="ignored")
        self._counted = stop
        regions = self._find(segment, self._counts)
        box = np.array([region.box for region in regions]).reshape(-1, 4)
        events = np.array([len(region.events) for region in regions], float)
        regions = [regions[k] for k in suppressed(box, events, settings.overlap)]
        tracks = self._tracks.follow(regions, (start + stop) // 2)
        return [Seen(start, stop, track.number, region) for track, region in zip(tracks, regions, strict=True)]


def crop(regions: Sequence[Region], size: tuple[int, int], scale: float = 1.0) -> Events:
    """Return the events of one object in some segments, shifted into a field.

    In each segment, the mean position of the events is shifted to the centre of the field. The shifts remove the motion
    between segments. A crop therefore differs from a recording of a static object, and a recogniser should learn from
    crops as well (`write_crops`).

    Args:
        regions: regions of the object, in the order of time.
        size: width and height of the field, px; events outside are dropped.
        scale: number of sensor pixels per field pixel; for a scale above 1, one of scale^2 events remains.
    """
    middles = np.repeat([region.centre for region in regions], [len(region.events) for region in regions], axis=0)
    parts = [region.events for region in regions]
    t, x, y, p = (np.concatenate([getattr(part, name) for part in parts]) for name in "txyp")
    axes = zip((x, y), middles.T, size, strict=True)  # positions are relative to the centre of the field
    x, y = (np.rint((pixel - middle) / scale + (side - 1) / 2.0).astype(np.int64) for pixel, middle, side in axes)
    inside = np.flatnonzero((x >= 0) & (x < size[0]) & (y >= 0) & (y < size[1]))
    if scale > 1.0:
        inside = inside[np.floor(np.arange(0.0, len(inside), scale**2)).astype(np.int64)]
    return Events(t[inside], x[inside], y[inside], p[inside], size)


WAYS = ("proposals", "dense")
"""Ways of detection: `proposals` finds regions and then classifies them; the network of `dense` does both at once."""


class Detector:
    """Detects objects of a recogniser's classes.

    Args:
        recogniser: recogniser of the objects; its field may differ in size from the sensor.
        settings: settings of the detection.
        backend: backend that runs networks.
        way: see `WAYS`; `dense` needs a recogniser of the method `remus`.

    Raises:
        ModelError: there is no such way.
    """

    def __init__(
        self, recogniser: Recogniser, settings: Detecting | None = None, backend: str = "event", way: str = "proposals"
    ) -> None:
        if way not in WAYS:
            raise ModelError(f"way = '{way}': expected one of {', '.join(WAYS)}")
        self.recogniser, self.settings, self.backend, self.way = (recogniser, settings or Detecting(), backend, way)
        self._sliding: dict[tuple[int, int], Sliding] = {}
        self._view: WindowView | None = None
        self._known: dict[int, _Known] = {}

    def detect(self, events: Events) -> Boxes:
        """Return all boxes of a recording. All detections of an object decide its class together.

        Args:
            events: the recording, of any sensor.

        Returns:
            A box for each object in each segment with a detection, in the order of time.
        """
        all_pieces = pieces(events, self.settings, self._finder(events.sensor_size))
        objects: dict[int, _Known] = {}
        for piece, scores in zip(all_pieces, self._scores(all_pieces), strict=True):
            objects.setdefault(piece.detections[0].number, _Known()).judge(piece, scores)
        detections = sorted(
            (box for piece in all_pieces for box in piece.detections), key=lambda box: (box.start, box.number)
        )
        return Boxes.of(_row(box, objects[box.number].total) for box in detections)

    def feed(self, events: Events) -> Boxes:
        """Process the next events of a stream.

        Args:
            events: events after the previous ones, of the same sensor.

        Returns:
            A box for each object in each segment that became complete. The class of an object is decided from its
            detections so far.

        Raises:
            ModelError: the sensor differs from the previous one.
        """
        if self._view is None:
            self._view = WindowView(self.settings, events.sensor_size, self._finder(events.sensor_size))
        return self._boxes_of(self._view, self._view.segments(events))

    def finish(self) -> Boxes:
        """End the stream, and return the remaining boxes; the next events begin another stream."""
        if self._view is None:
            return Boxes.of([])
        boxes = self._boxes_of(self._view, self._view.rest())
        self._view, self._known = None, {}
        return boxes

    def _boxes_of(self, view: WindowView, segments: Iterable[Events]) -> Boxes:
        rows = []
        for segment in segments:
            detections = sorted(view.look(segment), key=lambda box: box.number)
            current = [
                self._known.setdefault(box.number, _Known()).add(box, self.settings.memory) for box in detections
            ]
            for box, piece, scores in zip(detections, current, self._scores(current), strict=True):
                self._known[box.number].judge(piece, scores)
                rows.append(_row(box, self._known[box.number].total))
            live = view.live
            self._known = {number: entry for number, entry in self._known.items() if number in live}
        return Boxes.of(rows)

    def _finder(self, sensor: tuple[int, int]) -> Finder | None:
        """Return the function that detects objects in a segment, compiled once per sensor; None for proposals."""
        if self.way == "proposals":
            return None
        if sensor not in self._sliding:
            settings = self.settings
            self._sliding[sensor] = Sliding(self.recogniser, settings.dense, settings.proposals, sensor, self.backend)
        return self._sliding[sensor].regions

    def _scores(self, object_pieces: Sequence[Piece]) -> Floats:
        """Return the score of each class for each piece, (pieces, classes)."""
        if not object_pieces:
            return np.zeros((0, len(self.recogniser.classes)))
        if self.way == "dense":
            tables = [
                [region.scores for region in piece.regions if region.scores is not None] for piece in object_pieces
            ]
            return np.array([np.sum(scores, axis=0) for scores in tables])
        size, proposals = self.recogniser.method.size, self.settings.proposals
        crops = [crop(piece.regions, size, proposals.scale_of(piece.regions)) for piece in object_pieces]
        return self.recogniser.scores(crops, self.backend)


@dataclass(slots=True, eq=False)
class _Known:
    """Scores of an object's pieces; each detection updates the scores of the latest piece."""

    latest: Piece = field(default_factory=Piece)
    scores: dict[int, Floats] = field(default_factory=dict)

    def add(self, one: Seen, memory: float) -> Piece:
        """Add a detection, and return its piece."""
        if not self.latest.takes(one, memory):
            self.latest = Piece()
        self.latest.detections.append(one)
        return self.latest

    def judge(self, piece: Piece, scores: Floats) -> None:
        """Store the scores of a piece, and replace its earlier scores."""
        self.scores[piece.detections[0].start] = scores

    @property
    def total(self) -> Floats:
        """(classes,) sum of the scores over all pieces with evidence; NaN if no piece has evidence."""
        finite = [scores for scores in self.scores.values() if not np.isnan(scores).all()]
        return np.sum(finite, axis=0) if finite else next(iter(self.scores.values()))


def _row(detection: Seen, scores: Floats) -> tuple[int, int, int, int, float, Sequence[float]]:
    """Return a row of `Boxes`. The score is the lead of the best class over the second one, 0 without evidence."""
    label = UNKNOWN if np.isnan(scores).all() else int(np.nanargmax(scores))
    ordered = np.sort(scores[~np.isnan(scores)])
    lead = float(ordered[-1] - ordered[-2]) if len(ordered) > 1 else 0.0
    return detection.start, detection.stop, detection.number, label, lead, detection.region.box.tolist()


def crops(scene: Scene, settings: Detecting, size: tuple[int, int]) -> Iterator[tuple[int, Events]]:
    """Yield class and crop of each piece of an object that a detector finds in a scene and that matches a true box.

    Args:
        scene: a scene with true boxes.
        settings: settings of the detection.
        size: width and height of the crops, px.
    """
    for piece in pieces(scene.events, settings):
        labels: list[int] = []
        for detection in piece.detections:
            true_boxes = scene.boxes.within(detection.start, detection.stop)
            overlaps = iou(detection.region.box[None], true_boxes.box)[0]
            labels += (
                [int(true_boxes.label[overlaps.argmax()])] if len(true_boxes) and overlaps.max() >= AT_LEAST else []
            )
        if labels:  # the class that most matching true boxes have
            scale = settings.proposals.scale_of(piece.regions)
            yield int(np.bincount(labels).argmax()), crop(piece.regions, size, scale)


def write_crops(
    folder: Path,
    scenes: Scenes,
    settings: Detecting,
    *,
    before: str = "",
    report: Callable[[int, int], None] = lambda n_done, total: None,
) -> int:
    """Write crops of all scenes, in one folder per class; equal calls write equal files.

    Args:
        folder: folder for the crops; created if missing.
        scenes: scenes with true boxes.
        settings: settings of the detection.
        before: prefix of file names, so that crops of several data sets fit into one folder.
        report: function that is called with the number of finished and of all scenes.

    Returns:
        The number of crops.

    Raises:
        EventFileError: a crop cannot be written.
    """
    for name in scenes.classes:
        make_folder(folder / name)
    size = settings.proposals.field
    written = 0
    for n_done, scene in enumerate(scenes, 1):
        for k, (label, events) in enumerate(crops(scene, settings, size)):
            save(events, folder / scenes.classes[label] / f"{before}{scene.name}-{k}.npz", replace=True)
            written += 1
        report(n_done, len(scenes))
    return written


@dataclass(frozen=True, slots=True)
class DetectionTrial:
    """Measures of detection on scenes.

    Attributes:
        scenes: number of scenes.
        precision: average precision of all boxes; each slice of a scene is a picture.
        switches: stability of identities over all scenes.
        ms: median processor time per scene, ms, without the first scene, during which kernels may compile.
        pictures: pairs of true and detected boxes, one for each slice of each scene.
    """

    scenes: int
    precision: Precision
    switches: Switches
    ms: float
    pictures: tuple[tuple[Boxes, Boxes], ...] = ()

    def as_words(self, classes: tuple[str, ...]) -> dict[str, Any]:
        """Return the measures as plain data, for JSON."""
        class_precisions = zip(classes, self.precision.of_class, strict=True)
        return {
            "scenes": self.scenes,
            "map": self.precision.mean,
            "box_ap": self.precision.box,
            "ap": {name: None if np.isnan(ap) else ap for name, ap in class_precisions},
            **asdict(self.switches),
            "ms": self.ms,
        }


def try_out(
    detector: Detector, scenes: Iterable[Scene], report: Callable[[int], None] = lambda n_done: None
) -> DetectionTrial:
    """Run a detector on scenes, and measure its quality.

    Args:
        detector: detector whose recogniser has the classes of the scenes, in the same order.
        scenes: scenes with true boxes.
        report: function that is called with the number of finished scenes.
    """
    pairs, switches, ms = list[tuple[Boxes, Boxes]](), list[Switches](), list[float]()
    for n_done, scene in enumerate(scenes, 1):
        began = time.process_time()
        boxes = detector.detect(scene.events)
        ms.append(1000.0 * (time.process_time() - began))
        pictures = in_pictures(scene, boxes)
        pairs += pictures
        switches.append(identity_switches(pictures))
        report(n_done)
    names = ("switches", "objects", "missed", "boxes")
    totals = Switches(*(sum(getattr(counts, name) for counts in switches) for name in names))
    average = precision(pairs, len(detector.recogniser.classes))
    typical = float(np.median(ms[1:] or ms)) if ms else float("nan")
    return DetectionTrial(len(ms), average, totals, typical, tuple(pairs))


def in_pictures(scene: Scene, detections: Boxes) -> list[tuple[Boxes, Boxes]]:
    """Return true and detected boxes for each slice of a scene."""
    true_boxes = scene.boxes
    return [(true_boxes[true_boxes.start == start], detections.within(start, stop)) for start, stop in scene.slices]
