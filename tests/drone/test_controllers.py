"""The controllers: what each does with counts and errors, and its settings."""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays

from neuro import ModelError
from neuro_drone.controllers import CONTROLLERS, Learner, make
from neuro_drone.controllers.fields import DOWN, RIGHT, pattern, shares
from neuro_drone.scenario import load

BALL, LINE = load("B60"), load("line")
COUNTS = arrays(np.int64, (8, 8), elements=st.integers(0, 40))


def seen(row, column, n=10):
    counts = np.zeros((8, 8), np.int64)
    counts[row, column] = n
    return counts


def told(a, b):
    return {"supervised_error": np.array([a, b])}


OWN = ["nothing", "oracle", "centroid", "static", "static-linear", "lms", "snn", "snn-static-init", "snn-eta0"]


@pytest.mark.parametrize("name", OWN)
@pytest.mark.parametrize("scenario", [BALL, LINE], ids=["ball", "line"])
def test_all_act_within_bounds(name, scenario):
    controller = make(name, scenario, 1)
    controller.begin()
    rng = np.random.default_rng(0)
    for _ in range(5):
        action = controller.act(rng.integers(0, 30, (8, 8)), told(0.9, -0.9))
        assert action.shape == (2,)
        assert np.abs(action).max() <= 1.0
        controller.learn(told(0.9, -0.9))


def test_who_learns():
    learning = {"lms", "snn", "snn-static-init", "snn-eta0", "snn-flipped"}
    assert {name for name in [*OWN, "snn-flipped"] if CONTROLLERS[name].learns} == learning
    assert all(isinstance(make(name, BALL), Learner) for name in learning)
    assert not isinstance(make("oracle", BALL), Learner)


def test_oracle_is_proportional():
    oracle = make("oracle", BALL, 0, {"gain": [2.0, 4.0]})
    assert oracle.act(seen(0, 0), told(0.1, -0.1)).tolist() == pytest.approx([0.2, -0.4])
    assert oracle.act(seen(0, 0), told(0.9, -0.9)).tolist() == [1.0, -1.0]


@given(COUNTS)
def test_centroid_turns_with_the_picture(counts):
    centroid = make("centroid", BALL, 0, {"gain": 0.5})
    right, down = centroid.act(counts, {})
    other = centroid.act(counts.T, {})
    assert other.tolist() == pytest.approx([down, right])


def test_centroid_of_nothing_is_no_action():
    assert make("centroid", BALL).act(np.zeros((8, 8), np.int64), {}).tolist() == [0.0, 0.0]


def test_centroid_of_a_ball():
    action = make("centroid", BALL, 0, {"gain": 1.0}).act(seen(0, 5), {})
    assert action.tolist() == pytest.approx([(5 * 16 + 7.5 - 63) / 64, (7.5 - 63) / 64])


def test_centroid_of_a_line():
    upright, leaning = np.zeros((8, 8), np.int64), np.zeros((8, 8), np.int64)
    upright[:, 6] = 5
    np.fill_diagonal(leaning[:, ::-1], 5)  # from bottom left to top right: leans 45 degrees to the right
    centroid = make("centroid", LINE, 0, {"gain": 1.0})
    assert centroid.act(upright, {}).tolist() == pytest.approx([(6 * 16 + 7.5 - 63) / 64, 0.0])
    assert centroid.act(leaning, {}).tolist() == pytest.approx([1 / 64, 0.5])


@pytest.mark.parametrize("shape", ["sign", "linear"])
def test_patterns_speak_for_their_sides(shape):
    ball, line = pattern(BALL, shape), pattern(LINE, shape)
    assert np.abs(ball).max() == np.abs(line).max() == 1.0
    assert (np.sign(ball) == np.sign(np.stack((RIGHT.ravel(), DOWN.ravel()), 1))).all()
    assert line.reshape(8, 8, 2)[0, 7, 1] > 0 > line.reshape(8, 8, 2)[0, 0, 1]  # above and right: leans to the right


@given(COUNTS)
def test_shares_say_how_events_are_spread(counts):
    of_all, of_rows = shares(counts, "shares"), shares(counts, "rows").reshape(8, 8)
    assert of_all.sum() == pytest.approx(float(counts.any()))
    assert of_rows.sum(1) == pytest.approx(counts.any(axis=1) / 8)
    assert of_all * counts.sum() == pytest.approx(counts.ravel())
    of_peaks = shares(counts, "peaks")
    assert of_peaks.sum() == pytest.approx(float((counts > 2 * counts.mean()).any()))
    assert ((of_peaks > 0) == (counts > 2 * counts.mean()).ravel()).all()
    assert shares(counts * np.arange(1, 9)[:, None], "rows").reshape(8, 8) == pytest.approx(of_rows)


def test_a_line_has_defaults_of_its_own():
    error = told(0.1, 0.1)
    assert make("oracle", LINE).act(seen(0, 0), error).tolist() == pytest.approx([0.8, 0.4])
    assert make("oracle", LINE, 0, {"gain": 1.0}).act(seen(0, 0), error).tolist() == pytest.approx([0.1, 0.1])
    assert make("oracle", BALL).act(seen(0, 0), error).tolist() == pytest.approx([0.8, 0.8])
    lms, upright = make("lms", LINE), np.ones((8, 8), np.int64)
    upright[:, 3] += np.arange(8) * 5  # more events in near rows
    lms.act(upright, {})
    assert lms._shares.reshape(8, 8).sum(1) == pytest.approx(np.full(8, 0.125))


def test_lms_learns_where_fields_are():
    lms = make("lms", BALL, 0, {"mu": 0.2, "gain": 1.0})
    rng = np.random.default_rng(1)
    for _ in range(3000):
        row, column = rng.integers(0, 8, 2)
        lms.act(seen(row, column), {})
        lms.learn(told(RIGHT[row, column], DOWN[row, column]))
    frozen = lms.frozen()
    assert frozen.act(seen(1, 6), {}).tolist() == pytest.approx([RIGHT[1, 6], DOWN[1, 6]], abs=0.01)
    before = frozen.learnt()["weights"]
    frozen.learn(told(1.0, 1.0))
    assert (frozen.learnt()["weights"] == before).all()


def test_lms_goes_on_from_its_state():
    one, other = make("lms", BALL), make("lms", BALL, 7)
    for k in range(20):
        one.act(seen(k % 8, 3), {})
        one.learn(told(0.3, 0.1))
    other.restore(one.state())
    assert (one.act(seen(4, 3), {}) == other.act(seen(4, 3), {})).all()


@pytest.mark.parametrize(
    ("name", "settings", "message"),
    [
        ("sn", {}, "unknown controller 'sn'\n  hint: did you mean 'snn'?"),
        ("oracle", {"gian": 1.0}, "unknown setting of controller 'oracle' 'gian'\n  hint: did you mean 'gain'?"),
        ("nothing", {"gain": 1.0}, "unknown setting of controller 'nothing' 'gain'\n  hint: none is defined"),
        (
            "oracle",
            {"gain": 0.0},
            "controller 'oracle': gain = 0: expected a number > 0 or a list of two or three, one an axis",
        ),
        (
            "centroid",
            {"gain": [1.0]},
            "controller 'centroid': gain = [1]: expected a number > 0 or a list of two or three, one an axis",
        ),
        ("lms", {"mu": True}, "controller 'lms': mu = true: expected a number >= 0"),
        ("lms", {"mu": float("nan")}, "controller 'lms': mu = .nan: expected a finite number >= 0"),
        ("snn", {"eta": "much"}, "controller 'snn': eta = 'much': expected a number"),
        (
            "snn",
            {"start": "random"},
            "controller 'snn': start = 'random': expected one of equal, sign, linear\n  hint: known: "
            "equal, linear, sign",
        ),
    ],
)
def test_mistakes(name, settings, message):
    with pytest.raises(ModelError) as error:
        make(name, BALL, 0, settings)
    assert str(error.value) == message
