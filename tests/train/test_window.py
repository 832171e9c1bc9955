"""A network sees a part of a larger sensor: from a pixel on, or round what each recording shows."""

from pathlib import Path

import numpy as np
import pytest

import neuro as snn
from neuro import ModelError
from neuro.events import Events, recordings, save
from neuro.events.parts import windowed
from neuro_models import path as path_of
from neuro_train.data import show
from neuro_train.plan import TrainingPlan

pytest.importorskip("torch", reason="PyTorch is not installed")
SENSOR = (60, 40)
SIDE = 12


def on_sensor(events, left, top, noise=0):
    """A recording of a small field, at a place of a larger one; some events of noise at its last pixel."""
    far = np.linspace(0, len(events) - 1, noise).astype(int)
    x, y = events.x + np.uint16(left), events.y + np.uint16(top)
    x[far], y[far] = SENSOR[0] - 1, SENSOR[1] - 1
    return Events(events.t, x, y, events.p, SENSOR)


@pytest.fixture
def square():
    """A full square of 12 x 12 px, twice."""
    y, x = np.tile(np.mgrid[:SIDE, :SIDE].reshape(2, -1), 2)
    return Events(100 * np.arange(x.size), x, y, np.arange(x.size) % 2, (SIDE, SIDE))


@pytest.fixture(scope="module")
def sparse(folder, tmp_path_factory):
    """The recordings of bars, each somewhere on a larger sensor."""
    large, rng = tmp_path_factory.mktemp("large"), np.random.default_rng(4)
    for item in recordings(folder, part="Train"):
        path = large / Path(item.path).parent.name / Path(item.path).name
        path.parent.mkdir(parents=True, exist_ok=True)
        save(on_sensor(item.load(), rng.integers(0, 48), rng.integers(0, 28)), path)
    return large


def trains(shown):
    """Each recording's spikes as pixels that sent, from its own first row and column."""
    dense = shown.events.dense("pixels", 2 * SIDE * SIDE).reshape(len(shown), -1, 2, SIDE, SIDE)
    for one in dense:
        sent = one.any(axis=(0, 1))
        top, left = (int(sent.any(axis=axis).argmax()) for axis in (1, 0))
        yield np.roll(one, (-top, -left), axis=(2, 3))


@pytest.mark.parametrize("place", [(0, 0), (17, 5), (48, 28)])
@pytest.mark.parametrize("noise", [0, 2])
def test_round_what_is_shown_wherever_it_lies(square, place, noise):
    found = windowed(on_sensor(square, *place, noise), (SIDE, SIDE), None, 0.0, 1000.0, "one")
    kept = np.ones(len(square), bool)
    kept[np.linspace(0, len(square) - 1, noise).astype(int)] = False
    if place == (48, 28):  # what is noise elsewhere is the last pixel of the square
        assert len(found) == len(square)
        found = found[kept]
    assert found.sensor_size == (SIDE, SIDE)
    for name in "txyp":
        np.testing.assert_array_equal(getattr(found, name), getattr(square[kept], name), err_msg=name)


def test_windows(square):
    found = windowed(on_sensor(square, 0, 28), (20, 18), None, 0.0, 1000.0, "one")
    assert (found.x.min(), found.x.max(), found.y.min(), found.y.max()) == (4, 15, 3, 14)
    early, late = on_sensor(square, 3, 3), on_sensor(square, 40, 20)
    both = Events(np.r_[early.t, late.t + 50_000], np.r_[early.x, late.x], np.r_[early.y, late.y],
                  np.r_[early.p, late.p], SENSOR)  # fmt: skip
    for start in (0.0, 50.0):
        np.testing.assert_array_equal(windowed(both, (SIDE, SIDE), None, start, 40.0, "one").x, square.x)
    found = windowed(on_sensor(square, 20, 9), (15, 14), (18, 8), 0.0, 1000.0, "one")
    np.testing.assert_array_equal(found.x, square.x + 2)
    np.testing.assert_array_equal(found.y, square.y + 1)
    told = "one: 24 of 288 events lie outside of the window of 12x12 px at 21,9: expected at most 5%"
    with pytest.raises(ModelError, match=told):
        windowed(on_sensor(square, 20, 9), (SIDE, SIDE), (21, 9), 0.0, 1000.0, "one")
    found = windowed(Events([], [], [], [], SENSOR), (SIDE, SIDE), None, 0.0, 100.0, "one")
    assert (len(found), found.sensor_size) == (0, (SIDE, SIDE))


def test_a_network_sees_the_same_on_a_larger_sensor(folder, file, sparse):
    words, net = {"input": "pixels", "output": "out", "duration": 60.0}, snn.load(file)
    small = show(net, recordings(folder, part="Train"), TrainingPlan(**words), lambda *told: None)
    large = show(net, recordings(sparse), TrainingPlan(**words, window="centred"), lambda *told: None)
    np.testing.assert_array_equal(small.labels, large.labels)
    for one, other in zip(trains(small), trains(large), strict=True):
        np.testing.assert_array_equal(one, other)


def test_the_command_learns_and_tests_through_the_window(neuro, file, sparse):
    quick = ("--for", 60, "--epochs", 8, "--batch", 6, "--window", "centred", "--augment", "shift=1")
    status, out, err = neuro(file, "--data", sparse, *quick, "--test", sparse, "--backends", "event")
    assert (status, err) == (0, "")
    assert "24 of 24" in out


def test_recognisers_see_the_same_field(tmp_path, square):
    from neuro_recognise.recogniser import method_of

    path = tmp_path / "square" / "one.npz"
    path.parent.mkdir()
    save(on_sensor(square, 0, 0), path)
    data, net = recordings(tmp_path), snn.load(path_of("dense"), params={"height": SIDE, "width": SIDE, "classes": 1})
    plan = TrainingPlan(input="pixels", output="out", duration=60.0, window="0,0")
    shown = show(net, data, plan, lambda *told: None)
    method = method_of("dense", values={"size": [SIDE, SIDE], "duration": 60.0})
    seen, train = method.observe(data[0].load()), shown.events.trains["pixels"]
    np.testing.assert_array_equal(seen["step"], train.step)
    np.testing.assert_array_equal(seen["neuron"], train.neuron)
