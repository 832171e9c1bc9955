"""What `neuro recognise detect` tells and writes."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from neuro import ModelError
from neuro.apps import console, output, table, write_picture
from neuro.events import Events
from neuro_recognise.detection.boxes import UNKNOWN, Boxes, write_boxes
from neuro_recognise.detection.detector import Detector
from neuro_recognise.detection.scenes import Scenes
from neuro_recognise.detection.trial import DetectionTrial

__all__ = ["check_classes", "check_ending", "show_found", "show_tried", "write_found"]

FORMAT = "neuro recognise detection 1"
Writer = Callable[[Path, Events, Boxes, Sequence[str], str], None]


def check_classes(known: tuple[str, ...], scenes: Scenes) -> None:
    """Refuse scenes whose classes a recogniser does not know.

    Raises:
        ModelError: it knows others, or in another order.
    """
    if known != scenes.classes:
        raise ModelError(
            f"the scenes have classes {', '.join(scenes.classes)}, expected those of the recogniser: {', '.join(known)}"
        )


def check_ending(path: Path) -> None:
    """Refuse a file whose ending does not tell what to write.

    Raises:
        ModelError: it ends otherwise.
    """
    if path.suffix.lower() not in WRITERS:
        raise ModelError(f"{path}: expected a name that ends in {', '.join(WRITERS)}")


def write_found(path: Path, events: Events, boxes: Boxes, classes: Sequence[str], title: str) -> None:
    """Write boxes as the name's ending tells.

    Raises:
        ModelError: the ending is unknown.
        Unwritable: something else has this name, or it cannot be written.
    """
    check_ending(path)
    WRITERS[path.suffix.lower()](path, events, boxes, classes, title)


def show_found(boxes: Boxes, classes: Sequence[str], as_json: bool) -> None:
    """Print one line for each object, or all boxes as JSON."""
    if as_json:
        print(json.dumps({"format": FORMAT, "boxes": [_words(boxes, k, classes) for k in range(len(boxes))]}, indent=1))
        return
    if not len(boxes):
        print("no objects found")
        return
    rows = []
    for number in np.unique(boxes.identity):
        of = boxes[boxes.identity == number]
        when = f"{of.start[0] / 1000:.0f} to {of.stop[-1] / 1000:.0f} ms"
        way = f"{_place(of.box[0])} to {_place(of.box[-1])}"
        rows.append((f"#{number}", _name(int(of.label[-1]), classes), f"{of.score[-1]:.2f}", when, len(of), way))
    console().print(table(("object", "class", ">score", ">seen", ">boxes", "middle, px"), rows))


def show_tried(detector: Detector, tried: DetectionTrial, as_json: bool) -> None:
    """Print the figures as a table, or as JSON."""
    classes = detector.recogniser.classes
    if as_json:
        method = detector.recogniser.method.called()
        print(json.dumps({"format": FORMAT, "method": method, **tried.as_words(classes)}, indent=1))
        return
    held, found = tried.switches, tried.precision
    rows = [
        ("mAP at IoU 0.5", f"{found.mean:.3f}"),
        ("AP of boxes, whatever the class", f"{found.box:.3f}"),
        ("boxes missed", f"{held.missed} of {held.boxes}"),
        ("identity switches", f"{held.switches} of {held.objects} objects"),
        ("processor time of a scene", f"{tried.ms:.0f} ms"),
    ]
    console().print(table(("of all scenes", ">"), rows, title=f"{tried.scenes} scenes"))
    of_class = [(name, "-" if np.isnan(ap) else f"{ap:.3f}") for name, ap in zip(classes, found.of_class, strict=True)]
    console().print(table(("class", ">AP"), of_class))


def _page(path: Path, events: Events, boxes: Boxes, classes: Sequence[str], title: str) -> None:
    from neuro_recognise.detection.watching import page
    from neuro_recognise.telling.watch import PAGE

    with output(path, PAGE) as part:
        part.write_text(PAGE.seal(page(events, boxes, classes, title)), "utf-8")


def _picture(path: Path, events: Events, boxes: Boxes, classes: Sequence[str], title: str) -> None:
    from neuro_recognise.detection.pictures import drawn

    write_picture(path, drawn(events, boxes, classes, title))


def _table(path: Path, events: Events, boxes: Boxes, classes: Sequence[str], title: str) -> None:
    write_boxes(path, boxes, classes)


WRITERS: dict[str, Writer] = {".html": _page, ".png": _picture, ".csv": _table}
"""By the ending of the file."""


def _words(boxes: Boxes, k: int, classes: Sequence[str]) -> dict[str, Any]:
    return {
        "start_us": int(boxes.start[k]),
        "stop_us": int(boxes.stop[k]),
        "identity": int(boxes.identity[k]),
        "class": None if boxes.label[k] == UNKNOWN else classes[boxes.label[k]],
        "score": float(boxes.score[k]),
        "box": boxes.box[k].round(2).tolist(),
    }


def _name(label: int, classes: Sequence[str]) -> str:
    return "unknown" if label == UNKNOWN else classes[label]


def _place(box: Any) -> str:
    return f"{(box[0] + box[2]) / 2:.0f}, {(box[1] + box[3]) / 2:.0f}"
