"""Detection of several objects: scenes with true boxes, detection by any recogniser, and measures of its quality.

from neuro_recognise.detection import Detector

Detector(recogniser).detect(events)    # boxes with classes, scores and identities
"""

from __future__ import annotations

from neuro_recognise.detection.boxes import Boxes
from neuro_recognise.detection.detector import Detecting, Detector
from neuro_recognise.detection.scenes import Scene, Scenery, Scenes, compose, write_scenes

__all__ = ["Boxes", "Detecting", "Detector", "Scene", "Scenery", "Scenes", "compose", "write_scenes"]
