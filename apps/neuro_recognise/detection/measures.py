"""How good boxes are: average precision, identities that change, and a detector tried on scenes."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro_recognise.detection.boxes import Boxes, iou
from neuro_recognise.detection.detector import Detector
from neuro_recognise.detection.scenes import Scene
from neuro_recognise.shown import Floats, Ints

Pair = tuple[Boxes, Boxes]
"""True boxes and those that were found, of one picture: a span of time of a scene."""
AT_LEAST = 0.5
"""IoU from which on a box is right; Everingham et al., IJCV 88:303, 2010, section 4.2."""


@dataclass(frozen=True, slots=True)
class Precision:
    """Average precision of boxes.

    Attributes:
        of_class: by class; NaN where no true box is of it.
        mean: over the classes that have true boxes, mAP.
        box: of all boxes, whatever their class.
        pictures: of how many.
    """

    of_class: tuple[float, ...]
    mean: float
    box: float
    pictures: int


def precision(pairs: Sequence[Pair], classes: int, at_least: float = AT_LEAST) -> Precision:
    """Compare what was found with what is there.

    Args:
        pairs: for each picture.
        classes: their number.
        at_least: IoU from which on a box is right.
    """
    of_class = tuple(_of([_of_label(pair, label) for pair in pairs], at_least) for label in range(classes))
    known = [one for one in of_class if not np.isnan(one)]
    return Precision(of_class, float(np.mean(known)) if known else float("nan"), _of(pairs, at_least), len(pairs))


def average_precision(right: npt.NDArray[np.bool_], true: int) -> float:
    """Area under precision over recall, where precision is the best one at this recall or a larger.

    Args:
        right: (n,) whether each box is right, the surest first.
        true: number of true boxes; NaN of none.

    Source: Everingham et al., The PASCAL Visual Object Classes Challenge 2012 development kit, section 3.4.1 (all
        points, where the challenge took eleven before 2010).
    """
    if not true:
        return float("nan")
    hits = np.cumsum(right)
    best = np.maximum.accumulate((hits / np.arange(1, len(right) + 1))[::-1])[::-1]
    return float(best[right].sum() / true)


def _of(pairs: Iterable[Pair], at_least: float) -> float:
    scores, right, true = [np.zeros(0)], [np.zeros(0, bool)], 0
    for there, found in pairs:
        scores.append(found.score)
        right.append(_right(there.box, found, at_least))
        true += len(there)
    order = np.argsort(-np.concatenate(scores), kind="stable")
    return average_precision(np.concatenate(right)[order], true)


def _right(there: Floats, found: Boxes, at_least: float) -> npt.NDArray[np.bool_]:
    """Which boxes of a picture are right: the surest first, each takes the true box that it shares most with.

    A box that finds it taken is wrong.
    """
    right, taken = np.zeros(len(found), bool), np.zeros(len(there), bool)
    if not len(there):
        return right
    shared = iou(found.box, there)
    for k in np.argsort(-found.score, kind="stable"):
        best = int(shared[k].argmax())
        if shared[k, best] >= at_least and not taken[best]:
            right[k] = taken[best] = True
    return right


def _of_label(pair: Pair, label: int) -> Pair:
    there, found = pair
    return there[there.label == label], found[found.label == label]


@dataclass(frozen=True, slots=True)
class Switches:
    """How identities hold.

    Attributes:
        switches: how often an object was found under another identity than before.
        objects: that were found at all.
        missed: true boxes to which no box fits.
        boxes: true ones.
    """

    switches: int
    objects: int
    missed: int
    boxes: int


def identity_switches(pairs: Sequence[Pair], at_least: float = AT_LEAST) -> Switches:
    """Follow the true objects of one scene.

    Args:
        pairs: its pictures in the order of time.
        at_least: IoU from which on a box fits.

    Source: Bernardin and Stiefelhagen, EURASIP J. Image Video Processing 2008:246309, section 2.1: who was matched
        before and still fits stays matched; the others are matched so that the most area is shared.
    """
    before: dict[int, int] = {}
    switches = missed = boxes = 0
    for there, found in pairs:
        matched = _matched(there, found, before, at_least)
        switches += sum(who in before and before[who] != by for who, by in matched.items())
        before |= matched
        missed += len(there) - len(matched)
        boxes += len(there)
    return Switches(switches, len(before), missed, boxes)


def _matched(there: Boxes, found: Boxes, before: dict[int, int], at_least: float) -> dict[int, int]:
    """The identity under which each object is found in a picture."""
    from scipy.optimize import linear_sum_assignment

    shared = iou(there.box, found.box)
    same = np.array([[before.get(int(who)) == by for by in found.identity] for who in there.identity], bool)
    worth = np.where(shared >= at_least, shared + 2.0 * same.reshape(shared.shape), 0.0)
    rows, columns = linear_sum_assignment(worth, maximize=True)
    fits = worth[rows, columns] > 0
    return _numbers(there.identity[rows[fits]], found.identity[columns[fits]])


def _numbers(who: Ints, by: Ints) -> dict[int, int]:
    return dict(zip(who.tolist(), by.tolist(), strict=True))


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
        of_class = {
            name: None if np.isnan(ap) else ap for name, ap in zip(classes, self.precision.of_class, strict=True)
        }
        return {
            "scenes": self.scenes,
            "map": self.precision.mean,
            "box_ap": self.precision.box,
            "ap": of_class,
            "switches": self.switches.switches,
            "objects": self.switches.objects,
            "missed": self.switches.missed,
            "boxes": self.switches.boxes,
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
