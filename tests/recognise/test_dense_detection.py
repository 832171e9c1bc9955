"""The dense way of detection: a learnt network slid over the whole sensor, in which several neurons win."""

import numpy as np
import pytest

from neuro.events import Events
from neuro_recognise import Recogniser  # noqa: F401  (named in messages.yaml, as Hats)
from neuro_recognise.detection import Detector
from neuro_recognise.detection.boxes import iou
from neuro_recognise.methods.descriptor import Hats  # noqa: F401
from neuro_recognise.methods.frame_networks import Remus
from neuro_recognise.recogniser import learn
from neuro_recognise.shown import Features
from refused import refusals_of

UPRIGHT, LYING = 0, 1
PLACES = {UPRIGHT: (12, 10), LYING: (60, 44)}
"""Where the middle of each object is, px."""


def bars(label, middle, n, seed):
    """Three bars of 21 px, 6 px apart, that flicker for 300 ms round a place."""
    rng = np.random.default_rng([label, seed])
    along, across = rng.integers(-10, 11, n), 6 * rng.integers(-1, 2, n) + rng.integers(0, 2, n)
    x, y = (across, along) if label == UPRIGHT else (along, across)
    return np.sort(rng.integers(0, 300_000, n)), x + middle[0], y + middle[1]


def recording(label, seed):
    t, x, y = bars(label, (16 + seed % 2, 17), 3000, seed)
    return Events(t, x, y, np.ones(3000, int), (34, 34))


@pytest.fixture(scope="module")
def recogniser():
    method, labels = Remus().changed({"epochs": 2, "per_class": 2, "size": [34, 34]}), np.arange(8) % 2
    evidence = [method.observe(recording(int(label), k)) for k, label in enumerate(labels)]
    shown = Features(evidence, labels, tuple(f"{k}.bin" for k in range(8)), ("upright", "lying"))
    return learn(method, shown, "bars")


def scene(strong=3000, faint=3000, noise=0, sensor=(80, 60)):
    """Both objects on a larger sensor."""
    rng = np.random.default_rng(7)
    parts = [bars(UPRIGHT, PLACES[UPRIGHT], strong, 50), bars(LYING, PLACES[LYING], faint, 51)]
    parts.append(tuple(rng.integers(0, end, noise) for end in (300_000, *sensor)))
    t, x, y = (np.concatenate([part[k] for part in parts]) for k in range(3))
    order = np.argsort(t, kind="stable")
    return Events(t[order], x[order], y[order], np.ones(len(t), int), sensor)


@pytest.mark.parametrize("more", [{}, {"faint": 1500}, {"noise": 1500}], ids=["plain", "one is faint", "noise"])
def test_every_object_is_found_where_it_is(recogniser, more):
    found = Detector(recogniser, way="dense").detect(scene(**more))
    assert (len(found.spans()), len(found)) == (3, 6)
    for label, (x, y) in PLACES.items():
        of = found[found.label == label]
        assert (len(of), len(set(of.identity.tolist()))) == (3, 1)
        across = (x - 6, x + 8) if label == UPRIGHT else (y - 6, y + 8)
        true = (across[0], y - 10, across[1], y + 11) if label == UPRIGHT else (x - 10, across[0], x + 11, across[1])
        assert iou(of.box, np.array([true], float)).min() > 0.8


def test_a_stream_gives_the_same_places(recogniser):
    events = scene()
    whole = Detector(recogniser, way="dense").detect(events)
    assert np.all((whole.score > 0) & (whole.score <= 9)), "of three frames, each with few winners at a place"
    assert len(Detector(recogniser, way="dense").detect(events[:0])) == 0
    assert len(Detector(recogniser, way="dense").detect(events[:30])) == 0
    stream = Detector(recogniser, way="dense")
    fed = [stream.feed(events[:4000]), stream.feed(events[4000:]), stream.finish()]
    np.testing.assert_array_equal(np.concatenate([part.box for part in fed]), whole.box)


def test_mistakes(recogniser, messages):
    messages(refusals_of(messages.cases, globals() | locals()))
