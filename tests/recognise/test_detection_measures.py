"""Measures of boxes against closed forms and naive versions."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from neuro_recognise.detection.boxes import Boxes, average_precision, identity_switches, iou, precision, suppressed

sides = st.integers(0, 12)
boxes = st.lists(st.tuples(sides, sides, sides, sides), min_size=1, max_size=6).map(
    lambda rows: np.array([[x, y, x + w, y + h] for x, y, w, h in rows], float)
)


def pixels(box):
    left, top, right, bottom = box.astype(int)
    return {(x, y) for x in range(left, right) for y in range(top, bottom)}


@given(boxes, boxes)
@settings(max_examples=20)
def test_iou_counts_pixels(a, b):
    for i, j in np.ndindex(len(a), len(b)):
        one, other = pixels(a[i]), pixels(b[j])
        either = len(one | other)
        assert iou(a, b)[i, j] == pytest.approx(len(one & other) / either if either else 0.0)


@given(boxes, st.floats(0.1, 0.9))
def test_suppression_leaves_the_best_and_what_is_apart(box, most):
    score = np.linspace(0.0, 1.0, len(box))
    kept = suppressed(box, score, most)
    assert kept[0] == len(box) - 1
    shared = iou(box, box)
    assert all(shared[i, j] <= most for i in kept for j in kept if i != j)
    gone = set(range(len(box))) - set(kept.tolist())
    assert all(any(shared[k, i] > most and score[i] > score[k] for i in kept) for k in gone)


@pytest.mark.parametrize(
    ("right", "true", "expected"),
    [((1, 1), 2, 1.0), ((1,), 2, 0.5), ((0, 1), 1, 0.5), ((1, 0, 1), 2, 5 / 6), ((0, 0, 1, 1), 4, 0.25), ((), 3, 0.0)],
)  # fmt: skip
def test_average_precision_by_hand(right, true, expected):
    assert average_precision(np.array(right, bool), true) == pytest.approx(expected)


@given(st.lists(st.booleans(), max_size=30), st.integers(0, 5))
def test_average_precision_is_the_area_under_the_best_precision(right, missed):
    true = sum(right) + missed
    if not true:
        assert np.isnan(average_precision(np.array(right, bool), 0))
        return
    points = [(sum(right[: k + 1]) / true, sum(right[: k + 1]) / (k + 1)) for k in range(len(right))]
    area = sum(max((p for r, p in points if r >= (n + 1) / true - 1e-12), default=0.0) / true for n in range(true))
    assert average_precision(np.array(right, bool), true) == pytest.approx(area)


def table(*rows):
    """Boxes of (identity, label, score, left) with sides of 10 px, in one slice."""
    return Boxes.of((0, 100, who, label, score, (left, 0, left + 10, 10)) for who, label, score, left in rows)


def test_precision_by_hand():
    there = table((0, 0, 1.0, 0), (1, 1, 1.0, 50))
    result = precision([(there, table((0, 0, 0.9, 1), (1, 0, 0.8, 2), (2, 0, 0.7, 50)))], 3)
    assert result.of_class[:2] == (1.0, 0.0)
    assert np.isnan(result.of_class[2])
    assert result.mean == 0.5
    assert result.box == pytest.approx((1 + 2 / 3) / 2)  # the second box is a double
    assert result.pictures == 1
    there, sure, wrong = table((0, 0, 1.0, 0)), table((0, 0, 0.9, 0)), table((0, 0, 0.95, 50))
    assert precision([(there, sure), (there, wrong)], 1).mean == pytest.approx(0.25)
    assert precision([(there, sure), (there, table((0, 0, 0.1, 50)))], 1).mean == pytest.approx(0.5)
    there = table((0, 0, 1.0, 0))
    assert precision([(there, table((0, 0, 1.0, 3)))], 1).box == 1.0  # 7 of 13
    assert precision([(there, table((0, 0, 1.0, 4)))], 1).box == 0.0  # 6 of 14


def test_identities():
    there = table((0, 0, 1.0, 0), (1, 0, 1.0, 50))
    same, swapped = table((5, 0, 1.0, 0), (6, 0, 1.0, 50)), table((6, 0, 1.0, 0), (5, 0, 1.0, 50))
    lost = table((6, 0, 1.0, 50))
    assert identity_switches([(there, same), (there, same)]).switches == 0
    assert identity_switches([(there, same), (there, swapped)]).switches == 2
    result = identity_switches([(there, same), (there, lost), (there, swapped), (there, swapped)])
    assert (result.switches, result.objects, result.missed, result.boxes) == (2, 2, 1, 8)
    there, both = table((0, 0, 1.0, 0)), table((5, 0, 1.0, 3), (6, 0, 1.0, 0))
    assert identity_switches([(there, table((5, 0, 1.0, 0))), (there, both)]).switches == 0


def test_boxes_of_shorter_spans_are_averaged_by_time():
    rows = [(0, 30, 7, 1, 0.5, (0, 0, 10, 10)), (30, 100, 7, 2, 0.6, (10, 0, 20, 10))]
    rows += [(100, 200, 7, 1, 0.5, (99, 0, 109, 10)), (0, 30, 8, 0, 0.1, (5, 5, 6, 6))]
    found = Boxes.of(rows)
    now = found.within(0, 100)
    assert now.identity.tolist() == [7, 8]
    np.testing.assert_allclose(now.box, [[7, 0, 17, 10], [5, 5, 6, 6]])
    assert (now.label.tolist(), len(found.within(200, 300))) == ([2, 0], 0)
    assert len(found.within(195, 300)) == 0  # 5 of 100 us are no share
