"""Find several objects in view: where each is, what it is, and which it was before.

proposals: events -> segments -> regions -> tracks -> pieces of a track's own events -> recogniser -> boxes
dense:     events -> segments -> sliding network -> regions with classes -> tracks -> boxes
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from neuro import ModelError
from neuro.events import Events
from neuro_recognise.detection.boxes import UNKNOWN, Boxes
from neuro_recognise.detection.following import Detecting, Finder, Piece, Seen, WindowView, crop, pieces
from neuro_recognise.detection.sliding import Sliding
from neuro_recognise.recogniser import Recogniser
from neuro_recognise.shown import Floats

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
    label = UNKNOWN if np.isnan(scores).all() else int(np.nanargmax(scores))
    return one.start, one.stop, one.number, label, _sureness(scores), one.region.box.tolist()


def _sureness(scores: Floats) -> float:
    """How far the best class is before the next, in units of the recogniser's scores; 0 where none is known."""
    known = np.sort(scores[~np.isnan(scores)])
    return float(known[-1] - known[-2]) if len(known) > 1 else 0.0
