"""Balls that rise, jump and swell, and a drone that is turned."""

from dataclasses import replace
from math import cos, pi, sin

import numpy as np
import pytest

from neuro import ModelError
from neuro_drone.ball import hop
from neuro_drone.body import GRAVITY
from neuro_drone.controllers import make
from neuro_drone.env import DroneEnv
from neuro_drone.evaluate import Start, begin, fly_lap, grid
from neuro_drone.paths import Variation
from neuro_drone.scenario import Ball, load


def test_a_ball_on_the_ground_stays_as_it_is():
    for time in (0.0, 0.7, 31.0):
        assert hop(Ball(), time) == (0.17, 0.17)


def test_jumps_are_parabolas_of_gravity():
    ball, h = Ball(bounce=0.2), 1e-3
    time = np.arange(0.0, 1.0, h)
    up = np.array([hop(ball, t)[0] for t in time]) - ball.radius
    assert up[0] == 0.0
    assert up.min() >= 0.0
    assert up.max() == pytest.approx(0.2, abs=1e-5)
    falls = np.diff(up, 2) / h**2
    assert np.median(falls) == pytest.approx(-GRAVITY, abs=1e-4)
    assert (np.abs(falls + GRAVITY) > 1e-3).sum() <= 2 * 3  # the ground, at two moments


def test_it_rises_and_swells_as_it_is_told():
    ball = Ball(radius=0.2, rise=0.6, rise_time=10.0, swell=0.5, swell_time=8.0)
    for time in (0.0, 1.0, 5.0, 10.0, 14.0):
        up, radius = hop(ball, time)
        assert radius == pytest.approx(0.2 * (1.0 + 0.5 * sin(2 * pi * time / 8.0)))
        assert up - radius == pytest.approx(0.3 * (1.0 - cos(2 * pi * time / 10.0)))


def test_the_environment_shows_and_judges_the_ball_where_it_is():
    env = DroneEnv("B60-bounce")
    env.reset(seed=1, options={"start": (0.0, 0.0)})
    seen = []
    for step in range(1, 30):
        info = env.step((0.0, 0.0))[4]
        up, radius = hop(env.scenario.task, 0.05 * step)
        x, y, z, r = env.task.scene().ball
        assert (z, r) == pytest.approx((up, radius))
        assert info["target"] == pytest.approx(env.view.project(x, y, z)[:2])
        seen.append(info["error"][1])
    assert min(seen) < -4.0  # it jumps up the picture
    begin(env, Start((0.0, 0.0)))
    assert env.task.scene().ball[2:] == (0.17, 0.17)


def test_a_varied_path_leaves_rising_and_swelling_as_they_are():
    """The clock of a ball's height begins with the lap, whatever the speed and wherever the path is begun."""
    env, start = DroneEnv("B60-rise"), (20.0, -10.0, 6.0)
    for varied in (Variation(1.3, 70.0, 1.0, 1.4, 0.6), Variation(0.8, -20.0, 1.0, 0.8, 0.1)):
        info = begin(env, Start(start, path=varied))
        assert info["error"] == pytest.approx(start, abs=1e-3)
        for step in range(1, 20):
            env.step((0.0, 0.0, 0.0))
            place, ball = env.task.scene().ball, env.scenario.task
            assert place[2:] == pytest.approx(hop(ball, 0.05 * step))
            along = varied.begin * env.task.path.length + ball.speed * varied.speed * 0.05 * step
            assert place[:2] == pytest.approx(env.task.path.at(along))


@pytest.mark.parametrize("name", ["B60-height", "B60-rise", "B60-bounce", "B60-wind", "B60-spin"])
def test_an_oracle_finishes_laps_of_varied_paths(name):
    world = load(name, step=100)
    env, starts = DroneEnv(world), grid(world, 2)
    assert len({start.path for start in starts}) == 4
    assert all(fly_lap(env, make("oracle", world), start, i).lap for i, start in enumerate(starts))


def test_a_drone_that_climbs_follows_a_ball_that_rises():
    world = load("B60-rise", **{"task.ball.lap": 3.0, "task.ball.speed": 0.12})
    lap = fly_lap(DroneEnv(world), make("oracle", world), Start((0.0, 0.0, 0.0)))
    assert lap.lap
    assert lap.absolute[2] < 2.0


def test_a_drone_that_is_turned_still_follows():
    env = DroneEnv(load("B60-spin", **{"task.ball.lap": 1.5, "task.ball.speed": 0.06}))
    info = begin(env, Start((0.0, 0.0)))
    oracle, over, lost = make("oracle", env.scenario), False, False
    while not (over or lost):
        _, _, lost, over, info = env.step(oracle.act(info["counts"], info))
    assert info["lap"]
    assert env.body.pose.yaw == pytest.approx(0.3 * 25.0, abs=0.1)  # anticlockwise


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        (
            {"task.ball.rise": 2.1},
            "task.ball.radius = 0.17: expected a ball below the drone, whose height is 2.4 m: it reaches 2.44 m",
        ),
        ({"task.ball.axes": 4}, "task.ball.axes = 4: expected a whole number >= 2 and <= 3"),
        ({"task.ball.swell": 1.0}, "task.ball.swell = 1: expected a number >= 0 and <= 0.9"),
    ],
)
def test_mistakes(changes, message):
    with pytest.raises(ModelError) as error:
        load("B60", **changes)
    assert str(error.value) == message


def test_a_line_has_no_spin():
    with pytest.raises(ModelError) as error:
        load("line", **{"drone.spin": 0.1})
    assert str(error.value) == "drone.spin = 0.1: expected 0 along a line, where actions turn"
    assert replace(load("B60"), task=load("B60-bounce").task).axes == 2
