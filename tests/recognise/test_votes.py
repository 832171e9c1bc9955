import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.stats import binomtest

from neuro_recognise.evaluate import evaluate, wilson
from neuro_recognise.method import SILENT, choose
from neuro_recognise.parts.frames import majority, potentials


def test_votes():
    wins = np.array([[3, 1, 0], [2, 2, 0], [0, 0, 0], [0, 0, 0], [1, 0, 0]])
    sums = np.array([[5.0, 9.0, 0.0], [1.0, 2.0, 9.0], [0.0, 1.0, 0.5], [0.0, 0.0, 0.0], [4.0, 1.0, 0.0]])
    assert choose(majority(wins, sums)).tolist() == [0, 1, SILENT, SILENT, 0]
    assert choose(potentials(sums)).tolist() == [1, 2, 1, SILENT, 0]
    np.testing.assert_allclose(majority(wins, sums)[1], [2, 2 + 1 / 3, 2 / 3])  # the whole part are frames


@given(st.lists(st.tuples(st.integers(0, 4), st.sampled_from([-1.0, 0.0, 0.5, 2.0])), min_size=2, max_size=5))
def test_equals_are_told_apart_by_their_sums(classes):
    wins, sums = (np.array([column], float) for column in zip(*classes, strict=True))
    found = majority(wins, sums)
    if not wins.any():
        assert np.isnan(found).all()
        return
    assert np.array_equal(np.floor(found), wins)
    assert choose(found)[0] == max(range(len(classes)), key=lambda k: (wins[0, k], sums[0, k], -k))


def test_recordings_without_frames_are_silent(letters, small, train):
    made = train(letters, small)
    for scores in made.method.answer(made.learnt, letters).votes.values():
        assert (choose(scores)[:24] >= 0).all()
        assert choose(scores)[24:].tolist() == [SILENT, SILENT]


def test_a_batch_without_any_frame_is_silent(letters, small, train):
    made = train(letters, small)
    for nothing in (letters.take([24, 25]), letters.take([])):
        for scores in made.method.answer(made.learnt, nothing).votes.values():
            assert scores.shape == (len(nothing), 3)
            assert np.isnan(scores).all()


def test_evaluation():
    found = evaluate(np.array([0, 1, 1, -1]), np.array([0, 1, 0, 1]), ("a", "b"))
    assert found.confusion.tolist() == [[1, 1, 0], [0, 1, 1]]
    assert (found.n, found.correct, found.accuracy) == (4, 2, 0.5)
    assert found.as_words()["silent"] == 1
    assert evaluate(np.array([], int), np.array([], int), ("a",)).interval == (0.0, 1.0)


@given(st.data(), st.integers(1, 5000))
def test_wilson_is_scipys(data, n):
    correct = data.draw(st.integers(0, n))
    expected = binomtest(correct, n).proportion_ci(method="wilson")
    assert wilson(correct, n) == pytest.approx((expected.low, expected.high), abs=1e-12)
