"""Boxes of objects over time: a table, its CSV file, and how good boxes are: average precision, identities that change.

```
start_us,stop_us,identity,class,score,left,top,right,bottom
0,100000,0,7,1,12.0,30.5,31.0,52.0
```

A box spans the columns from `left` up to but not with `right`, and rows likewise, so one pixel is a box of 1 by 1 px.
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
"""Of the file."""

JUST = 0.1
"""Share of the shorter of two spans; what shares less time is of another span."""
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""Of identities, in turn: Okabe and Ito's, which colour-blind readers tell apart."""
UNKNOWN = -1
"""The label of a box for whose object nothing speaks for any class."""


def _ours(path: Path) -> bool:
    with path.open("rb") as file:
        return file.readline().decode(errors="replace").strip() == ",".join(COLUMNS)


TABLE = Kind("a table of boxes", _ours)


@dataclass(frozen=True, slots=True, eq=False)
class Boxes:
    """Boxes, one a row; an object has one in each span of time in which it is there.

    Attributes:
        start: (n,) the span's first us.
        stop: (n,) the us after its last.
        identity: (n,) number of the object or the track, the same at all times.
        label: (n,) index of its class, -1 where unknown.
        score: (n,) how sure that is, the larger, the more; 1 for true boxes.
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
        """From rows: start, stop, identity, label, score, box."""
        columns: Any = list(zip(*rows, strict=True)) or [()] * 6
        start, stop, identity, label = (np.array(column, np.int64) for column in columns[:4])
        score, box = (np.array(column, float) for column in columns[4:])
        return cls(start, stop, identity, label, score, box.reshape(-1, 4))

    def __len__(self) -> int:
        """The number of boxes."""
        return len(self.start)

    def __getitem__(self, index: slice | Array) -> Boxes:
        """Some of the rows."""
        return Boxes(*(getattr(self, one.name)[index] for one in fields(self)))

    def spans(self) -> Ints:
        """(spans, 2) start and stop of all spans, in the order of time."""
        return np.unique(np.stack([self.start, self.stop], axis=1), axis=0)

    def within(self, start: int, stop: int) -> Boxes:
        """One box for each identity that is there between two times, us: the mean of its boxes, by shared time.

        Label and score are those of the box that shares the most time. A box whose span only just reaches over an end
        does not count.
        """
        shared = np.minimum(self.stop, stop) - np.maximum(self.start, start)
        there = shared > JUST * np.minimum(self.stop - self.start, stop - start)
        rows = []
        for who in np.unique(self.identity[there]):
            of = np.flatnonzero((self.identity == who) & there)
            most = of[shared[of].argmax()]
            box = np.average(self.box[of], axis=0, weights=shared[of])
            rows.append((start, stop, int(who), int(self.label[most]), float(self.score[most]), box.tolist()))
        return Boxes.of(rows)


def iou(a: Floats, b: Floats) -> Floats:
    """(n, m) shared area of boxes (n, 4) and (m, 4) over the area of both; 0 where both are empty."""
    low, high = np.maximum(a[:, None, :2], b[None, :, :2]), np.minimum(a[:, None, 2:], b[None, :, 2:])
    shared = np.prod(np.maximum(high - low, 0.0), axis=2)
    areas = [np.prod(np.maximum(box[:, 2:] - box[:, :2], 0.0), axis=1) for box in (a, b)]
    both = areas[0][:, None] + areas[1] - shared
    return np.asarray(np.divide(shared, both, out=np.zeros_like(shared), where=both > 0))


def suppressed(box: Floats, score: Floats, most: float) -> Ints:
    """Non-maximum suppression: indices of the boxes that stay, the best first.

    Args:
        box: (n, 4).
        score: (n,) of two boxes that are too much the same, the one with the larger stays.
        most: IoU that two boxes may have.
    """
    left = np.argsort(-score, kind="stable")
    kept: list[int] = []
    while left.size:
        kept.append(int(left[0]))
        left = left[1:][iou(box[left[:1]], box[left[1:]])[0] <= most]
    return np.array(kept, np.int64)


def write_boxes(path: Path, boxes: Boxes, classes: Sequence[str]) -> None:
    """Write a table, in place of another; an unknown class is empty.

    Raises:
        Unwritable: something else has this name, or the file cannot be written.
    """
    out = io.StringIO()
    table = csv.writer(out, lineterminator="\n")
    table.writerow(COLUMNS)
    for k in range(len(boxes)):
        name = "" if boxes.label[k] == UNKNOWN else classes[boxes.label[k]]
        when = boxes.start[k], boxes.stop[k], boxes.identity[k]
        table.writerow((*when, name, f"{boxes.score[k]:.6g}", *(f"{side:.2f}" for side in boxes.box[k])))
    write_text(path, out.getvalue(), TABLE)


def read_boxes(path: Path, classes: Sequence[str]) -> Boxes:
    """Read a table.

    Args:
        path: the file.
        classes: names, by which labels are counted.

    Raises:
        ModelError: there is no such table, a class is unknown, or a number is none; the message has the line.
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
    by_label = ([(a[a.label == label], b[b.label == label]) for a, b in pairs] for label in range(classes))
    of_class = tuple(_of(each, at_least) for each in by_label)
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
        shared, taken, hits = iou(found.box, there.box), np.zeros(len(there), bool), np.zeros(len(found), bool)
        # the surest first, each takes the true box that it shares most with; who finds it taken is wrong
        for k in np.argsort(-found.score, kind="stable") if len(there) else ():
            best = int(shared[k].argmax())
            if shared[k, best] >= at_least and not taken[best]:
                hits[k] = taken[best] = True
        scores.append(found.score)
        right.append(hits)
        true += len(there)
    order = np.argsort(-np.concatenate(scores), kind="stable")
    return average_precision(np.concatenate(right)[order], true)


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
    return dict(zip(there.identity[rows[fits]].tolist(), found.identity[columns[fits]].tolist(), strict=True))
