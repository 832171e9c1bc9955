"""Output of `neuro recognise detect`, and of `neuro recognise watch` for several objects: tables, pictures, a page."""

from __future__ import annotations

import json
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from neuro import ModelError
from neuro.apps import console, html, player, table, write_picture
from neuro_events import Events
from neuro_recognise.detection.boxes import COLOURS, UNKNOWN, Boxes, read_boxes, write_boxes
from neuro_recognise.detection.detector import DetectionTrial, Detector
from neuro_recognise.detection.scenes import Scenes
from neuro_recognise.recogniser import Recogniser
from neuro_recognise.telling.watch import event_track, length_ms, played, span_note, watchable, write


def watch_objects(
    recogniser: Recogniser, recording: Path, out: Path, *, table: Path | None, find: bool, backend: str = "event"
) -> str:
    """Write the page of a recording of several objects.

    Args:
        recogniser: recogniser of the classes.
        recording: a file of any readable format.
        out: file of the page.
        table: file of boxes, e.g. the true ones of a scene, drawn dashed.
        find: whether to detect objects.
        backend: backend that runs networks.

    Returns:
        A summary in a few words.

    Raises:
        ModelError: the page's name does not end in .html, the page cannot be written, there is no such table, or the
            recording is empty.
        EventFileError: the recording is damaged.
    """

    def make() -> tuple[str, str]:
        events = watchable(recording)
        truth = Boxes.of([]) if table is None else read_boxes(table, recogniser.classes)
        boxes = Detector(recogniser, backend=backend).detect(events) if find else Boxes.of([])
        return page(events, boxes, recogniser.classes, recording.name, truth), ", ".join(_summary(boxes, truth))

    return write(out, make)


def page(events: Events, detections: Boxes, classes: Sequence[str], title: str, others: Boxes | None = None) -> str:
    """Return the page as self-contained text.

    Args:
        events: events of the recording.
        detections: detected boxes.
        classes: names of the classes.
        title: name of the recording.
        others: other boxes, drawn dashed.
    """
    true_boxes = Boxes.of([]) if others is None else others
    first, end = int(events.t[0]) if len(events) else 0, max(1.0, length_ms(events))
    boxes = [*_rows(detections, classes, first, end, ""), *_rows(true_boxes, classes, first, end, "given")]
    data, notes = event_track(events, end, 6, 50.0)
    track = player.Track("objects", "events", "events of the sensor", {**data, "boxes": boxes, "colours": COLOURS}, 520)
    heads = ("", "class", "score", "left, top, right, bottom, px")
    head = html.tag("thead", html.tag("tr", *(html.tag("th", head_text) for head_text in heads)))
    objects = html.tag("table", head, html.tag("tbody", id="rows"))
    top = [
        player.Panel("Events", [track], span_note(data["span"])),
        player.Panel("Objects", [], "in view now", content=objects),
    ]
    moments = np.unique([box["start"] for box in boxes])
    script = files("neuro_recognise.detection").joinpath("objects.js").read_text("utf-8")
    columns = "minmax(0, 2fr) minmax(0, 1fr)"
    texts, controls = [*_summary(detections, true_boxes), *notes], player.Panel("", [], controls=True)
    return played(title, texts, end, moments, top, controls, columns, script=script)


def _summary(detections: Boxes, true_boxes: Boxes) -> list[str]:
    texts = [_count_text(detections, "found")] if len(detections) or not len(true_boxes) else []
    return [*texts, _count_text(true_boxes, "given")] if len(true_boxes) else texts


def _count_text(boxes: Boxes, adjective: str) -> str:
    if not len(boxes):
        return f"no objects {adjective}"
    objects = len(np.unique(boxes.identity))
    return f"{objects} {'object' if objects == 1 else 'objects'} in {len(boxes)} boxes {adjective}"


def _rows(boxes: Boxes, classes: Sequence[str], first: int, end: float, kind: str) -> list[dict[str, Any]]:
    """Return boxes with times in ms since the first event. A box is shown until the next, except before long pauses."""
    starts, stops = (boxes.start - first) / 1000.0, (boxes.stop - first) / 1000.0
    following_starts = np.append(np.unique(starts), 1e12)
    following = following_starts[np.searchsorted(following_starts[:-1], stops - 1e-6, "right")]
    shown_stops = np.where((stops >= end) | (following - stops <= stops - starts), following, stops)
    return [
        {
            "start": start, "until": shown_stop, "id": identity, "kind": kind,
            "name": "?" if label == UNKNOWN else classes[label], "score": round(score, 3),
            "box": [round(side, 2) for side in box],
        }
        for start, shown_stop, identity, label, score, box in zip(
            starts.tolist(), shown_stops.tolist(), boxes.identity.tolist(), boxes.label.tolist(), boxes.score.tolist(),
            boxes.box.tolist(), strict=True,
        )
    ]  # fmt: skip


FORMAT = "neuro recognise detection 1"
ENDINGS = (".html", ".png", ".csv")
"""Formats of boxes: a page, a picture, a table."""


def check_classes(classes: tuple[str, ...], scenes: Scenes) -> None:
    """Check that a recogniser has the classes of the scenes.

    Raises:
        ModelError: the classes or their order differ.
    """
    if classes != scenes.classes:
        raise ModelError(
            f"the scenes have classes {', '.join(scenes.classes)}, "
            f"expected those of the recogniser: {', '.join(classes)}"
        )


def check_ending(path: Path) -> None:
    """Check that a file's ending names a format.

    Raises:
        ModelError: the ending is unknown.
    """
    if path.suffix.lower() not in ENDINGS:
        raise ModelError(f"{path}: expected a name that ends in {', '.join(ENDINGS)}")


def write_found(path: Path, events: Events, boxes: Boxes, classes: Sequence[str], title: str) -> None:
    """Write boxes in the format of the name's ending.

    Raises:
        ModelError: the ending is unknown.
        Unwritable: the name belongs to another kind of file, or the file cannot be written.
    """
    check_ending(path)
    ending = path.suffix.lower()
    if ending == ".csv":
        write_boxes(path, boxes, classes)
    elif ending == ".png":
        from neuro_recognise.telling.pictures import boxes_on_frames

        write_picture(path, boxes_on_frames(events, boxes, classes, title))
    else:
        write(path, lambda: (page(events, boxes, classes, title), ""))


def show_found(boxes: Boxes, classes: Sequence[str], as_json: bool) -> None:
    """Print one line per object, or all boxes as JSON."""
    if as_json:
        columns = (boxes.start, boxes.stop, boxes.identity, boxes.label, boxes.score, boxes.box.round(2))
        each = [
            {
                **{"start_us": start, "stop_us": stop, "identity": identity},
                **{"class": None if label == UNKNOWN else classes[label], "score": score, "box": box},
            }
            for start, stop, identity, label, score, box in zip(*(part.tolist() for part in columns), strict=True)
        ]
        print(json.dumps({"format": FORMAT, "boxes": each}, indent=1))
        return
    if not len(boxes):
        print("no objects found")
        return
    rows = []
    for number in np.unique(boxes.identity):
        track = boxes[boxes.identity == number]
        interval = f"{track.start[0] / 1000:.0f} to {track.stop[-1] / 1000:.0f} ms"
        middles = (track.box[[0, -1], :2] + track.box[[0, -1], 2:]) / 2
        path_text = " to ".join(f"{x:.0f}, {y:.0f}" for x, y in middles)
        name = "unknown" if track.label[-1] == UNKNOWN else classes[track.label[-1]]
        rows.append((f"#{number}", name, f"{track.score[-1]:.2f}", interval, len(track), path_text))
    console().print(table(("object", "class", ">score", ">seen", ">boxes", "middle, px"), rows))


def show_tried(detector: Detector, result: DetectionTrial, as_json: bool) -> None:
    """Print the measures of a test as a table or as JSON."""
    classes = detector.recogniser.classes
    if as_json:
        method = detector.recogniser.method.called()
        print(json.dumps({"format": FORMAT, "method": method, **result.as_words(classes)}, indent=1))
        return
    switches, average = result.switches, result.precision
    rows = [
        ("mAP at IoU 0.5", f"{average.mean:.3f}"),
        ("AP of boxes, ignoring the class", f"{average.box:.3f}"),
        ("boxes missed", f"{switches.missed} of {switches.boxes}"),
        ("identity switches", f"{switches.switches} of {switches.objects} objects"),
        ("processor time per scene", f"{result.ms:.0f} ms"),
    ]
    console().print(table(("all scenes", ">"), rows, title=f"{result.scenes} scenes"))
    class_rows = [
        (name, "-" if np.isnan(ap) else f"{ap:.3f}") for name, ap in zip(classes, average.of_class, strict=True)
    ]
    console().print(table(("class", ">AP"), class_rows))
