"""Wind and load: what they are in time, and what they do to both bodies."""

from math import atan, exp, hypot

import numpy as np
import pytest
from hypothesis import given, strategies as st

from neuro import ModelError
from neuro_drone.body import GRAVITY, Kinematic
from neuro_drone.bullet import HEIGHT_GAINS, Bullet
from neuro_drone.env import DroneEnv, Weather
from neuro_drone.parts import MASS
from neuro_drone.scenario import Drone, Load, Wind, load


def blown(wind, steps, seconds, seed=0):
    weather = Weather(wind, Load())
    weather.reset(seed)
    rows = []
    for _ in range(steps):
        weather.step(seconds)
        rows.append(weather.wind)
    return np.array(rows)


def test_wind_begins_and_turns_when_it_is_said():
    rows = blown(Wind(speed=4.0, towards=90.0, turning=9.0, since=1.0), 420, 0.05)
    assert (rows[:20] == 0.0).all()
    assert rows[20] == pytest.approx((0.0, 4.0))
    assert rows[220] == pytest.approx((-4.0, 0.0))  # 10 s later, counter-clockwise
    assert np.hypot(*rows[20:].T) == pytest.approx(4.0)


@pytest.mark.parametrize("seconds", [0.01, 0.05, 0.5])
def test_gusts_have_their_spread_and_time_however_time_is_cut(seconds):
    rows = blown(Wind(speed=3.0, towards=0.0, gust=0.7, gust_time=0.5), round(4000.0 / seconds), seconds)
    assert rows.mean(axis=0) == pytest.approx((3.0, 0.0), abs=0.05)
    assert rows.std(axis=0) == pytest.approx(0.7, rel=0.05)
    lag = round(0.5 / seconds)
    x, y = (rows - rows.mean(axis=0)).T
    for one in (x, y):
        assert np.mean(one[lag:] * one[:-lag]) / one.var() == pytest.approx(exp(-1.0), abs=0.06)
    assert abs(np.corrcoef(x, y)[0, 1]) < 0.06


def test_the_same_seed_gives_the_same_gusts():
    wind = Wind(gust=1.0)
    assert (blown(wind, 50, 0.05, 3) == blown(wind, 50, 0.05, 3)).all()
    assert (blown(wind, 50, 0.05, 3) != blown(wind, 50, 0.05, 4)).all()


def test_a_load_is_taken_up_when_it_is_said():
    weather = Weather(Wind(), Load(mass=0.2, since=0.3))
    seen = []
    for _ in range(8):
        weather.step(0.05)
        seen.append(weather.load)
    assert seen == [0.0] * 6 + [0.2] * 2
    weather.reset(1)
    assert weather.load == 0.0


@given(
    st.floats(-5, 5), st.floats(-5, 5), st.floats(-0.5, 1.0), st.lists(st.floats(0.001, 0.5), min_size=1, max_size=5)
)
def test_wind_is_solved_however_time_is_cut(x, y, mass, pieces):
    whole, cut = Kinematic(Drone()), Kinematic(Drone())
    for body in (whole, cut):
        body.feel((x, y), mass)
    whole.step(0.5, 0.3, 0.0, sum(pieces))
    for seconds in pieces:
        cut.step(0.5, 0.3, 0.0, seconds)
    assert (cut.pose.x, cut.pose.y, *cut.velocity) == pytest.approx((whole.pose.x, whole.pose.y, *whole.velocity))


def test_wind_carries_a_drone_that_is_told_to_stand_and_that_leans_against_it():
    body = Kinematic(Drone(drag=0.5))
    body.feel((2.0, -1.0), 0.0)
    body.step(0.0, 0.0, 0.0, 0.01)
    assert body.velocity == pytest.approx((0.01 * 1.0, 0.01 * -0.5), rel=0.05)  # drag times wind, before it is slowed
    assert (body.pose.pitch, body.pose.roll) == pytest.approx((0.0, 0.0), abs=0.006)
    body.step(0.0, 0.0, 0.0, 10.0)
    assert body.velocity == pytest.approx((0.2 * 1.0, 0.2 * -0.5))
    assert body.pose.pitch == pytest.approx(atan(-1.0 / GRAVITY))
    assert body.pose.roll == pytest.approx(atan(-0.5 / GRAVITY))
    body.reset(0.0, 0.0, 0.0)
    body.step(0.0, 0.0, 0.0, 1.0)
    assert (body.pose.x, body.pose.y, body.velocity) == (0.0, 0.0, (0.0, 0.0))


def test_a_load_makes_it_slower_and_changes_no_drift():
    light, heavy = Kinematic(Drone()), Kinematic(Drone())
    heavy.feel((0.0, 3.0), MASS)  # twice as heavy
    light.feel((0.0, 3.0), 0.0)
    for body, lag in ((light, 0.2), (heavy, 0.4)):
        body.step(0.0, 0.3, 0.0, lag)
        assert body.velocity[0] == pytest.approx(0.3 * (1.0 - exp(-1.0)))
        body.step(0.0, 0.3, 0.0, 20.0)
        assert body.velocity == pytest.approx((0.3, 0.2 * 0.4 * 3.0))
    heavy.reset(0.0, 0.0, 0.0)
    heavy.feel((0.0, 0.0), MASS)
    heavy.step(0.0, 2.0, 0.0, 0.1)
    assert heavy.velocity[0] == pytest.approx(0.15)  # half of 3 m/s^2


def test_the_rigid_body_drifts_as_the_kinematic_one_and_sinks_under_a_load():
    pytest.importorskip("pybullet", reason="pybullet has wheels for Python 3.11 only")
    bodies = Bullet(Drone()), Kinematic(Drone())
    for body in bodies:
        body.feel((4.0, -2.0), 0.2)
        body.step(0.0, 0.3, 0.0, 10.0)
    rigid, ideal = bodies
    assert rigid.velocity == pytest.approx(ideal.velocity, abs=0.01)
    assert hypot(rigid.pose.x - ideal.pose.x, rigid.pose.y - ideal.pose.y) < 0.3
    assert (rigid.pose.pitch, rigid.pose.roll) == pytest.approx((ideal.pose.pitch, ideal.pose.roll), abs=0.02)
    assert rigid.pose.z == pytest.approx(2.4 - 0.2 / MASS * GRAVITY / HEIGHT_GAINS[0], abs=0.02)
    rigid.reset(0.0, 0.0, 0.0)
    rigid.step(0.0, 0.0, 0.0, 1.0)
    assert (rigid.pose.x, rigid.pose.z) == pytest.approx((0.0, 2.4), abs=1e-6)
    rigid.close()


def test_an_environment_in_the_wind():
    calm, windy = DroneEnv("B60"), DroneEnv("B60", wind={"speed": 5, "towards": 90, "since": 0.5})
    seen = []
    for env in (calm, windy):
        env.reset(seed=1, options={"start": (0.0, 0.0)})
        seen.append([env.step((0.0, 0.0))[4]["error"] for _ in range(30)])
    assert seen[0][:10] == seen[1][:10]
    assert windy.weather.wind == pytest.approx((0.0, 5.0))
    assert seen[1][29][0] > seen[0][29][0] + 5.0  # blown to its left, so that the ball is on the right


def test_wind_that_is_too_strong():
    with pytest.raises(ModelError) as error:
        load("B60", wind={"speed": 8})
    assert str(error.value) == (
        "wind.speed = 8: it accelerates the drone by 3.2 m/s^2, and the drone has at most 3 against it"
    )


def test_a_load_that_is_too_heavy():
    assert load("B60", load={"mass": 0.5}).load.mass == 0.5  # it holds its height
    with pytest.raises(ModelError) as error:
        load("B60-height", load={"mass": 0.5})
    assert str(error.value) == "load.mass = 0.5: the drone sinks or rises by 1.37 m/s, and climb_max is 1"
