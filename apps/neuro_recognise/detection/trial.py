"""A detector tried on scenes: how good its boxes are, how identities hold, and how long it takes."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from neuro_recognise.detection.boxes import Boxes
from neuro_recognise.detection.composing import Scene
from neuro_recognise.detection.detector import Detector
from neuro_recognise.detection.measures import Precision, Switches, identity_switches, precision

__all__ = ["DetectionTrial", "in_pictures", "try_out"]


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
        report: is told how many are done.
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
