"""A recording with the boxes of its objects as a page for a browser, the one of `neuro recognise watch`."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from neuro.apps import output
from neuro.events import Events
from neuro_recognise.detection.boxes import UNKNOWN, Boxes, read_boxes
from neuro_recognise.detection.detector import Detector
from neuro_recognise.recogniser import Recogniser
from neuro_recognise.telling.watch import PAGE, check_page, filled, shown, watchable

__all__ = ["COLOURS", "page", "watch_objects"]

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""Of identities, in turn: Okabe and Ito's, which colour-blind readers tell apart."""


def watch_objects(
    recogniser: Recogniser, recording: Path, out: Path, *, given: Path | None, find: bool, backend: str = "event"
) -> str:
    """Write the page of a recording of several objects.

    Args:
        recogniser: knows the classes.
        recording: a file of any readable format.
        out: the page.
        given: a table of boxes, such as the true ones of a scene; drawn in dashes.
        find: whether objects are looked for.
        backend: runs networks.

    Returns:
        What came of it, in a few words.

    Raises:
        ModelError: the page is not called .html or cannot be written, there is no such table, or the recording is
            empty.
        EventFileError: the recording is damaged.
    """
    check_page(out)
    with output(out, PAGE) as part:
        events = watchable(recording)
        there = Boxes.of([]) if given is None else read_boxes(given, recogniser.classes)
        found = Detector(recogniser, backend=backend).detect(events) if find else Boxes.of([])
        part.write_text(PAGE.seal(page(events, found, recogniser.classes, recording.name, there)), "utf-8")
    return ", ".join(_told(found, there))


def page(events: Events, found: Boxes, classes: Sequence[str], title: str, given: Boxes | None = None) -> str:
    """The page as text; it needs nothing else.

    Args:
        events: of the recording.
        found: boxes.
        classes: names.
        title: what to call the recording.
        given: other boxes, drawn in dashes.
    """
    there = Boxes.of([]) if given is None else given
    data, about = shown(events)
    first = int(events.t[0]) if len(events) else 0
    boxes = [*_rows(found, classes, first, ""), *_rows(there, classes, first, "given")]
    return filled(title, [*_told(found, there), *about], {**data, "boxes": boxes, "colours": COLOURS})


def _told(found: Boxes, given: Boxes) -> list[str]:
    told = [_counted(found, "found")] if len(found) or not len(given) else []
    return [*told, _counted(given, "given")] if len(given) else told


def _counted(boxes: Boxes, how: str) -> str:
    if not len(boxes):
        return f"no objects {how}"
    objects = len(np.unique(boxes.identity))
    return f"{objects} {'object' if objects == 1 else 'objects'} in {len(boxes)} boxes {how}"


def _rows(boxes: Boxes, classes: Sequence[str], first: int, kind: str) -> list[dict[str, Any]]:
    """Times in ms from the first event on."""
    return [
        {
            "start": (start - first) / 1000.0, "stop": (stop - first) / 1000.0, "id": identity, "kind": kind,
            "name": "?" if label == UNKNOWN else classes[label], "score": round(score, 3),
            "box": [round(side, 2) for side in box],
        }
        for start, stop, identity, label, score, box in zip(
            boxes.start.tolist(), boxes.stop.tolist(), boxes.identity.tolist(), boxes.label.tolist(),
            boxes.score.tolist(), boxes.box.tolist(), strict=True,
        )
    ]  # fmt: skip
