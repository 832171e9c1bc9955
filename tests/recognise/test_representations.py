"""What filters are shown at the end of each segment, and deciding from it while events arrive."""

from dataclasses import replace
from itertools import pairwise

import hypothesis.strategies as st
import numpy as np
import pytest
from hypothesis import given, settings

from neuro.events import Events
from neuro_recognise.methods.frame_networks import Remus
from neuro_recognise.observations import observed
from neuro_recognise.parts.banks import Counts, Leaky, Surface
from neuro_recognise.recogniser import learn, method_of
from refused import refused

SIZE = (9, 7)


def some(seed, n=120, length=60_000):
    """Events, some at the same time, with a long pause."""
    rng = np.random.default_rng(seed)
    t = np.sort(rng.integers(0, length, n) // 500 * 500)
    t = np.where(t > length // 2, t + 900_000, t)
    return Events(t, rng.integers(0, 9, n), rng.integers(0, 7, n), rng.integers(0, 2, n), SIZE)


@given(seed=st.integers(0, 99), cuts=st.lists(st.integers(1, 120), min_size=1, max_size=8))
@settings(max_examples=25, deadline=None)
@pytest.mark.parametrize("seen", [Counts(), Leaky(tau=8.0), Surface(tau=8.0)])
def test_by_hand(seen, seed, cuts):
    """Segments may be empty or end amid events of one time, which their places then tell apart."""
    events, bounds, expected = some(seed), np.array([0, *sorted(cuts)]), np.zeros((len(cuts), 7, 9))
    for k, (begin, end) in enumerate(pairwise(bounds)):
        for i in range(begin if seen == Counts() else 0, end):
            share = 1.0 if seen == Counts() else np.exp((events.t[i] - events.t[end - 1]) / 8000.0)
            place = (k, events.y[i], events.x[i])
            expected[place] = share if isinstance(seen, Surface) else expected[place] + share
    found = seen.pixels(events, bounds)
    np.testing.assert_allclose(found.pictures(SIZE), expected, rtol=1e-12, atol=1e-30)
    assert (found.value > 0).all()


@pytest.mark.parametrize("name", ["counts", "leaky", "surface"])
def test_of_nothing(name):
    method = Remus().changed({"representation": name, "size": [34, 34]})
    assert [len(part) for part in method.representation.pixels(some(0)[:0], np.array([0]))] == [0, 0, 0, 1]
    assert len(method.observe(Events([], [], [], [], (34, 34)))["ends"]) == 0


def moving(label, seed, n=1500):
    """A bar that stands or lies, and moves across a small field in 90 ms."""
    rng = np.random.default_rng([seed, label])
    t = np.sort(rng.integers(0, 90_000, n))
    along, across = rng.integers(4, 14, n), 4 + t * 8 // 90_000 + rng.integers(0, 2, n)
    x, y = (across, along) if label else (along, across)
    return Events(t, x, y, rng.integers(0, 2, n), (18, 18))


NET = {"epochs": 2, "field": 5, "theta": 12.0, "per_class": 2, "size": [18, 18]}


@pytest.fixture(scope="module")
def early():
    method = method_of("remus", "early", NET)
    shown = observed(method, [moving(k % 2, k) for k in range(16)], ("lying", "standing"))
    return learn(method, replace(shown, labels=np.arange(16) % 2), "")


def test_the_preset_by_words(early):
    words = {"representation": "leaky", "segmenter": "hes", "segmenter.window": 5}
    assert Remus().changed({**words, **NET}) == early.method


@pytest.mark.parametrize("name", ["leaky", "surface"])
def test_early_decisions_look_at_nothing_later(early, name):
    """Also of a net that learnt from other frames: what precedes it may be changed."""
    recogniser = early.changed({"representation": name})
    for label in (0, 1):
        events, times = moving(label, 50), [3.0, 5.5, 20.0, 60.0, 1000.0]
        scores = recogniser.scores_at(events, times)
        for time, row in zip(times, scores, strict=True):
            np.testing.assert_array_equal(recogniser.scores(events[events.t <= events.t[0] + 1000 * time])[0], row)
        assert np.isnan(scores[0]).all()  # no segment is complete
        assert scores[1:].argmax(axis=1).tolist() == [label] * 4
        session = recogniser.session(every_ms=10.0, window_ms=100.0)
        decided = session.feed(events) + session.end()
        np.testing.assert_array_equal(
            [one.scores for one in decided], recogniser.scores_at(events, [one.after_ms for one in decided])
        )


def test_what_can_be_changed_after_training(early):
    """How recordings are cut and seen, not what the network was made for."""
    assert early.changed({}) is early
    frames = early.changed({"representation": "counts", "segmenter": "msd", "threshold": 40.0})
    assert frames.learnt is early.learnt
    assert [frames.predict(moving(label, 60))[0] for label in (0, 1)] == [0, 1]
    assert "'layer' cannot be changed after training" in refused(early.changed, {"theta": 3.0})
