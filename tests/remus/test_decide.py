import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import binomtest

from neuro_recognise.evaluate import evaluate, wilson
from neuro_remus.decide import SILENT, Decisions, decide
from neuro_remus.train import train


def test_votes():
    counts = np.array([[3, 1, 0], [2, 2, 0], [0, 0, 0], [0, 0, 0], [1, 0, 0]])
    sums = np.array([[5.0, 9.0, 0.0], [1.0, 2.0, 9.0], [0.0, 1.0, 0.5], [0.0, 0.0, 0.0], [4.0, 1.0, 0.0]])
    decisions = Decisions(counts, sums)
    assert decisions.majority.tolist() == [0, 1, SILENT, SILENT, 0]
    assert decisions.potentials.tolist() == [1, 2, 1, SILENT, 0]
    assert decisions.by("majority").tolist() == decisions.majority.tolist()


def test_recordings_without_frames_are_silent(letters, small):
    decisions = decide(train(letters, small).simulation(), letters)
    for decided in (decisions.majority, decisions.potentials):
        assert (decided[:24] >= 0).all()
        assert decided[24:].tolist() == [SILENT, SILENT]


def test_a_batch_without_any_frame_is_silent(letters, small):
    sim = train(letters, small).simulation()
    nothing = letters.take(np.flatnonzero(np.bincount(letters.sample, minlength=len(letters)) == 0))
    assert len(nothing)
    decisions = decide(sim, nothing)
    assert (decisions.majority == SILENT).all()
    assert (decisions.potentials == SILENT).all()


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
