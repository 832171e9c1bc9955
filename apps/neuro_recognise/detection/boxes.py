"""Boxes of objects over time: a table, its CSV file, and measures of detection: average precision, identity switches.

```
start_us,stop_us,identity,class,score,left,top,right,bottom
0,100000,0,7,1,12.0,30.5,31.0,52.0
```

A box includes the columns from `left` up to but not including `right`, and the rows from `top` up to but not including
`bottom`. The box of a single pixel therefore has 1 by 1 px.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro.apps import Kind, write_text
from neuro_recognise.shown import Array, Floats, Ints

COLUMNS = ("start_us", "stop_us", "identity", "class", "score", "left", "top", "right", "bottom")
"""Columns of the file."""

JUST = 0.1
"""Smallest overlap of two spans, as a share of the shorter span; spans that overlap less count as separate."""
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""Colours of identities; identity i has the colour i modulo 6. Okabe and Ito's palette for colour-blind readers."""
UNKNOWN = -1
"""The label of a box without evidence for any class."""


def _ours(path: Path) -> bool:
    with path.open("rb") as file:
        return file.readline().decode(errors="replace").strip() == ",".join(COLUMNS)


TABLE = Kind("a table of boxes", _ours)


@dataclass(frozen=True, slots=True, eq=False)
class Boxes:
    """Boxes, one per row; an object has one box in each span of time in which it is visible.

    Attributes:
        start: (n,) start of the span, us.
        stop: (n,) end of the span, us; the span does not include it.
        identity: (n,) index of the object or the track, constant over time.
        label: (n,) index of the class, -1 if unknown.
        score: (n,) confidence of the label, larger for a surer label; 1 for true boxes.
        box: (n, 4) left, top, right and bottom, px.
    """

    start: Ints
    stop: Ints
    identity: Ints
    label: Ints
    score: Floats
    box: Floats

    @classmethod
    def of(cls, rows: Iterable[tuple[int, int, int, int, float, Sequence[float]]]) -> Boxes:
        """Create boxes from rows: start, stop, identity, label, score, box."""
        columns: Any = list(zip(*rows, strict=True)) or [()] * 6
        start, stop, identity, label = (np.array(column, np.int64) for column in columns[:4])
        score, box = (np.array(column, float) for column in columns[4:])
        return cls(start, stop, identity, label, score, box.reshape(-1, 4))

    def __len__(self) -> int:
        """The number of boxes."""
        return len(self.start)

    def __getitem__(self, index: slice | Array) -> Boxes:
        """Return some of the rows."""
        return Boxes(*(getattr(self, field.name)[index] for field in fields(self)))

    def spans(self) -> Ints:
        """Return start and stop of all spans, us, in the order of time, (spans, 2)."""
        return np.unique(np.stack([self.start, self.stop], axis=1), axis=0)

    def within(self, start: int, stop: int) -> Boxes:
        """Return one box for each identity that is visible between two times, us.

        The box is the mean of the identity's boxes, weighted by the time that they share with the interval. Label and
        score are those of the box that shares the most time. A box that shares less than `JUST` is ignored.
        """
        shared = np.minimum(self.stop, stop) - np.maximum(self.start, start)
        visible = shared > JUST * np.minimum(self.stop - self.start, stop - start)
        rows = []
        for identity in np.unique(self.identity[visible]):
            rows_of_identity = np.flatnonzero((self.identity == identity) & visible)
            top = rows_of_identity[shared[rows_of_identity].argmax()]
            box = np.average(self.box[rows_of_identity], axis=0, weights=shared[rows_of_identity])
            rows.append((start, stop, int(identity), int(self.label[top]), float(self.score[top]), box.tolist()))
        return Boxes.of(rows)


def iou(a: Floats, b: Floats) -> Floats:
    """Return the intersection over union of n and m boxes, (n, 4) and (m, 4), as an (n, m) array; 0 if both are empty.

    E.g. boxes (0, 0, 2, 2) and (1, 0, 3, 2) share 2 of 6 px, so their IoU is 1/3.
    """
    low, high = np.maximum(a[:, None, :2], b[None, :, :2]), np.minimum(a[:, None, 2:], b[None, :, 2:])
    shared = np.prod(np.maximum(high - low, 0.0), axis=2)
    areas = [np.prod(np.maximum(box[:, 2:] - box[:, :2], 0.0), axis=1) for box in (a, b)]
    union = areas[0][:, None] + areas[1] - shared
    return np.asarray(np.divide(shared, union, out=np.zeros_like(shared), where=union > 0))


def suppressed(box: Floats, score: Floats, most: float) -> Ints:
    """Non-maximum suppression: return the indices of the boxes that remain, best first.

    Args:
        box: (n, 4) boxes.
        score: (n,) scores; of two boxes that overlap too much, the one with the larger score remains.
        most: largest IoU that two boxes may have.
    """
    candidates = np.argsort(-score, kind="stable")
    remaining: list[int] = []
    while candidates.size:
        remaining.append(int(candidates[0]))
        candidates = candidates[1:][iou(box[candidates[:1]], box[candidates[1:]])[0] <= most]
    return np.array(remaining, np.int64)


def write_boxes(path: Path, boxes: Boxes, classes: Sequence[str]) -> None:
    """Write a table of boxes, and replace an existing table. An unknown class is an empty field.

    Raises:
        Unwritable: the name belongs to another kind of file, or the file cannot be written.
    """
    out = io.StringIO()
    table = csv.writer(out, lineterminator="\n")
    table.writerow(COLUMNS)
    for k in range(len(boxes)):
        name = "" if boxes.label[k] == UNKNOWN else classes[boxes.label[k]]
        times = boxes.start[k], boxes.stop[k], boxes.identity[k]
        table.writerow((*times, name, f"{boxes.score[k]:.6g}", *(f"{side:.2f}" for side in boxes.box[k])))
    write_text(path, out.getvalue(), TABLE)


def read_boxes(path: Path, classes: Sequence[str]) -> Boxes:
    """Read a table of boxes.

    Args:
        path: the file.
        classes: names of the classes; labels are indices into them.

    Raises:
        ModelError: there is no such table, a class is unknown, or a field is not a number; the message names the line.
    """
    try:
        lines = list(csv.reader(path.read_text().splitlines()))
    except (OSError, UnicodeDecodeError):
        raise ModelError(f"{path}: expected a table of boxes") from None
    if not lines or tuple(lines[0]) != COLUMNS:
        raise ModelError(f"{path}: expected a table of boxes with the columns {', '.join(COLUMNS)}")
    return Boxes.of(_row(path, number, line, classes) for number, line in enumerate(lines[1:], 2))


def _row(
    path: Path, number: int, line: list[str], classes: Sequence[str]
) -> tuple[int, int, int, int, float, Sequence[float]]:
    try:
        start, stop, identity = (int(word) for word in line[:3])
        left, top, right, bottom = (float(word) for word in line[5:])
        score = float(line[4])
    except (ValueError, IndexError):
        raise ModelError(f"{path}:{number}: {','.join(line)!r}: expected numbers, {', '.join(COLUMNS)}") from None
    if line[3] and line[3] not in classes:
        raise ModelError(f"{path}:{number}: class '{line[3]}' is unknown, expected one of {', '.join(classes)}")
    label = classes.index(line[3]) if line[3] else UNKNOWN
    return start, stop, identity, label, score, (left, top, right, bottom)


Pair = tuple[Boxes, Boxes]
"""True and detected boxes of one picture, i.e. one span of time of a scene."""
AT_LEAST = 0.5
"""Smallest IoU of a correct box; Everingham et al., IJCV 88:303, 2010, section 4.2."""


@dataclass(frozen=True, slots=True)
class Precision:
    """Average precision of boxes.

    Attributes:
        of_class: average precision of each class; NaN without true boxes.
        mean: mean over the classes with true boxes (mAP).
        box: average precision of all boxes, ignoring classes.
        pictures: number of pictures.
    """

    of_class: tuple[float, ...]
    mean: float
    box: float
    pictures: int


def precision(pairs: Sequence[Pair], classes: int, at_least: float = AT_LEAST) -> Precision:
    """Compute the average precision of detected boxes.

    Args:
        pairs: true and detected boxes of each picture.
        classes: number of classes.
        at_least: smallest IoU of a correct box with its true box.
    """
    pairs_by_label = ([(a[a.label == label], b[b.label == label]) for a, b in pairs] for label in range(classes))
    precisions = tuple(_precision_of(label_pairs, at_least) for label_pairs in pairs_by_label)
    finite = [precision for precision in precisions if not np.isnan(precision)]
    return Precision(
        precisions, float(np.mean(finite)) if finite else float("nan"), _precision_of(pairs, at_least), len(pairs)
    )


def average_precision(right: npt.NDArray[np.bool_], true: int) -> float:
    """Return the area under the interpolated precision-recall curve.

    The interpolated precision at a recall is the largest precision at this or a larger recall.

    Args:
        right: (n,) whether each detected box is correct, in descending order of score.
        true: number of true boxes; if there are none, the result is NaN.

    Source: Everingham et al., The PASCAL Visual Object Classes Challenge 2012 development kit, section 3.4.1 (all
        points; the challenge used eleven before 2010).
    """
    if not true:
        return float("nan")
    hits = np.cumsum(right)
    best = np.maximum.accumulate((hits / np.arange(1, len(right) + 1))[::-1])[::-1]
    return float(best[right].sum() / true)


def _precision_of(pairs: Iterable[Pair], at_least: float) -> float:
    scores, right, true = [np.zeros(0)], [np.zeros(0, bool)], 0
    for true_boxes, detections in pairs:
        shared, is_matched, hits = (
            iou(detections.box, true_boxes.box),
            np.zeros(len(true_boxes), bool),
            np.zeros(len(detections), bool),
        )
        # In descending order of score, each box is matched to the true box with the largest IoU.
        # A true box can be matched only once.
        for k in np.argsort(-detections.score, kind="stable") if len(true_boxes) else ():
            best_row = int(shared[k].argmax())
            if shared[k, best_row] >= at_least and not is_matched[best_row]:
                hits[k] = is_matched[best_row] = True
        scores.append(detections.score)
        right.append(hits)
        true += len(true_boxes)
    order = np.argsort(-np.concatenate(scores), kind="stable")
    return average_precision(np.concatenate(right)[order], true)


@dataclass(frozen=True, slots=True)
class Switches:
    """Stability of identities.

    Attributes:
        switches: number of times that an object was detected under another identity than before.
        objects: number of objects that were detected at least once.
        missed: number of true boxes without a matching box.
        boxes: number of true boxes.
    """

    switches: int
    objects: int
    missed: int
    boxes: int


def identity_switches(pairs: Sequence[Pair], at_least: float = AT_LEAST) -> Switches:
    """Match the true objects of one scene over time, and count changes of identity.

    Args:
        pairs: pictures of the scene in the order of time.
        at_least: smallest IoU of a matching box.

    Source: Bernardin and Stiefelhagen, EURASIP J. Image Video Processing 2008:246309, section 2.1: a match is kept
        while it is valid; the others are matched so that the total IoU is largest.
    """
    previous: dict[int, int] = {}
    switches = missed = boxes = 0
    for true_boxes, detections in pairs:
        matched = _matched(true_boxes, detections, previous, at_least)
        switches += sum(a in previous and previous[a] != b for a, b in matched.items())
        previous |= matched
        missed += len(true_boxes) - len(matched)
        boxes += len(true_boxes)
    return Switches(switches, len(previous), missed, boxes)


def _matched(true_boxes: Boxes, detections: Boxes, previous: dict[int, int], at_least: float) -> dict[int, int]:
    """Return the detected identity of each true object that has a match in a picture."""
    from scipy.optimize import linear_sum_assignment

    shared = iou(true_boxes.box, detections.box)
    is_same = np.array([[previous.get(int(a)) == b for b in detections.identity] for a in true_boxes.identity], bool)
    weight = np.where(shared >= at_least, shared + 2.0 * is_same.reshape(shared.shape), 0.0)
    rows, columns = linear_sum_assignment(weight, maximize=True)
    is_match = weight[rows, columns] > 0
    return dict(
        zip(true_boxes.identity[rows[is_match]].tolist(), detections.identity[columns[is_match]].tolist(), strict=True)
    )
