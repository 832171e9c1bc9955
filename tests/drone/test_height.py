"""Three axes: how tall a ball is seen, bodies that climb, and controllers with a third pair of motors."""

from math import copysign, exp

import numpy as np
import pytest
from hypothesis import given, strategies as st

from neuro import ModelError
from neuro_drone.body import GRAVITY, Kinematic
from neuro_drone.bullet import Bullet
from neuro_drone.controllers import make
from neuro_drone.controllers.fields import pattern
from neuro_drone.env import ACTIONS, DroneEnv
from neuro_drone.evaluate import Start, begin, fly_lap, grid, try_out
from neuro_drone.geometry import CameraView, Pose
from neuro_drone.parts import MASS
from neuro_drone.pictures import weight_maps
from neuro_drone.report import axes
from neuro_drone.scenario import Drone, load
from neuro_drone.train import train

WORLD = load("B60-height")
SHORT = load(WORLD, **{"task.ball.lap": 1.5, "task.ball.speed": 0.06})  # 500 steps


def told(make_it):
    with pytest.raises(ModelError) as error:
        make_it()
    return str(error.value)


@given(st.floats(-1, 1), st.floats(-1, 1), st.floats(0.05, 0.6), st.floats(35, 90))
def test_tall_is_the_span_of_the_balls_rows(x, y, radius, tilt):
    view = CameraView(tilt=tilt)
    view.look(Pose(0.0, 0.0, 2.4, 0.3))
    right, down, forward, place = view.matrix
    ball = place + 2.5 * forward + x * right + y * down
    middle = ball - place
    far2 = middle @ middle
    # the circle along which rays touch the ball
    a = np.cross(middle, (1.0, 0.2, 0.1))
    a /= np.linalg.norm(a)
    b = np.cross(middle, a) / np.sqrt(far2)
    angle = np.linspace(0, 2 * np.pi, 721)[:, None]
    wide = radius * np.sqrt(1 - radius**2 / far2)
    circle = ball - radius**2 / far2 * middle + wide * (np.cos(angle) * a + np.sin(angle) * b)
    rows = [view.project(*point)[1] for point in circle]
    assert view.tall(*ball, radius) == pytest.approx(max(rows) - min(rows), abs=2e-3)


@given(st.floats(0, 127), st.floats(0.05, 1.0), st.floats(4, 60))
def test_depth_is_that_at_which_a_ball_is_so_tall(v, radius, tall):
    view = CameraView()
    view.look(Pose(1.0, 2.0, 2.4, 0.5))
    middle = view.matrix[3] + view.depth_of(v, radius, tall) * np.array(view.ray(20.0, v))
    assert view.tall(*middle, radius) == pytest.approx(tall)
    assert view.project(*middle)[1] == pytest.approx(v)


def test_a_ball_round_the_camera_has_no_height():
    view = CameraView()
    view.look(Pose(0.0, 0.0, 1.0))
    assert view.tall(0.0, 0.0, 1.0, 0.2) == np.inf


@pytest.mark.parametrize("start", [(0.0, 0.0, 0.0), (20.0, -10.0, 15.0), (-35.0, 30.0, -12.0)])
def test_starts(start):
    env = DroneEnv(WORLD)
    info = env.reset(options={"start": start})[1]
    assert info["error"] == pytest.approx(start)
    assert info["supervised_error"] == pytest.approx((start[0] / 64, start[1] / 64, start[2] / 40))
    away = np.hypot(start[0], start[1]) / np.hypot(64.5, 64.5)
    assert info["reward"] == pytest.approx(1.0 - 0.5 * (away + abs(start[2]) / 40))
    assert env.reset(options={"start": start[:2]})[1]["error"] == pytest.approx((*start[:2], 0.0))
    drawn = np.array([env.reset(seed=seed)[1]["error"] for seed in range(30)])
    assert np.abs(drawn).max(axis=0) == pytest.approx((50, 50, 16), abs=6)
    assert (np.abs(drawn).max(axis=0) <= (50, 50, 16)).all()


def test_up_makes_the_ball_smaller_and_discrete_actions_have_it_too():
    seen = {}
    for name, actions, up, down in (("c", "continuous", (0, 0, 1), (0, 0, -1)), ("d", "discrete", 9, 10)):
        env = DroneEnv(WORLD, actions=actions)
        for way, action in (("up", up), ("down", down)):
            env.reset(seed=1, options={"start": (0.0, 0.0, 0.0)})
            z = env.body.pose.z
            for _ in range(5):
                info = env.step(action)[4]
            seen[name, way] = info["error"]
            assert env.body.pose.z > z if way == "up" else env.body.pose.z < z
    assert seen["c", "up"] == seen["d", "up"]
    assert seen["c", "up"][2] < -1.0 < 1.0 < seen["c", "down"][2]
    assert DroneEnv(WORLD, actions="discrete").action_space.n == len(ACTIONS) + 2


def test_a_ball_half_or_twice_as_tall_is_lost():
    for way, sign in ((-1.0, 1.0), (1.0, -1.0)):
        env = DroneEnv(WORLD)
        env.reset(seed=1, options={"start": (0.0, 0.0, 0.0)})
        lost, steps, rewards = False, 0, []
        while not lost and steps < 200:
            held = np.clip(4.0 * env.task.judge(env.view, env.body.pose).scaled[1], -1, 1)
            _, reward, lost, _, info = env.step((0.0, held, way))
            rewards.append(reward)
            steps += 1
        assert lost
        assert abs(info["error"][0]) < 64 > abs(info["error"][1])
        assert info["error"][2] == pytest.approx(sign * 40 if sign > 0 else -20, abs=3)
        assert rewards[-1] == 0.0 < rewards[-2] < rewards[5]


@given(st.floats(-2, 2), st.floats(-0.3, 0.5), st.lists(st.floats(0.01, 0.5), min_size=1, max_size=4))
def test_climbing_is_the_solution_of_its_equation(climb, mass, pieces):
    body = Kinematic(Drone())
    body.feel((0.0, 0.0), mass)
    for seconds in pieces:
        body.step(0.0, 0.0, 0.0, seconds, climb)
    r, z, v, h, n = 1.0 + mass / MASS, 2.4, 0.0, sum(pieces) / 3000, 3000
    for _ in range(n):
        a = (climb - v) / 0.2 / r - GRAVITY * (r - 1.0) / r  # the thrust is that of the mass without load
        a = copysign(min(abs(a), 3.0 / r), a)
        z, v = z + h * v, v + h * a
    assert (body.pose.z, body.climb) == pytest.approx((z, v), abs=5e-3)


def test_a_load_lets_it_sink_only_where_its_height_is_commanded():
    body = Kinematic(Drone())
    body.feel((0.0, 0.0), 0.2)
    body.step(0.0, 0.0, 0.0, 5.0)
    assert body.pose.z == 2.4
    body.step(0.0, 0.0, 0.0, 20.0, 0.0)
    assert body.climb == pytest.approx(-0.2 * GRAVITY * 0.2 / MASS)
    body.reset(0.0, 0.0, 0.0, z=3.0)
    body.step(0.0, 0.0, 0.0, 0.2, 0.5)
    assert (body.pose.z, body.climb) == pytest.approx((3.0 + 0.5 * 0.2 * exp(-1.0), 0.5 * (1.0 - exp(-1.0))))


@pytest.mark.parametrize("load_kg", [0.0, 0.2])
def test_the_rigid_body_climbs_as_the_kinematic_one(load_kg):
    pytest.importorskip("pybullet", reason="pybullet has wheels for Python 3.11 only")
    bodies = Bullet(Drone()), Kinematic(Drone())
    rng = np.random.default_rng(1)
    for body in bodies:
        body.reset(0.0, 0.0, 0.0, z=3.0)
        body.feel((0.0, 0.0), load_kg)
    for _ in range(40):
        command = (*rng.uniform(-0.3, 0.3, 2), 0.0, 0.1, rng.uniform(-0.5, 0.8))
        for body in bodies:
            body.step(*command)
        rigid, ideal = (body.pose for body in bodies)
        assert rigid.z == pytest.approx(ideal.z, abs=0.06)
        assert np.hypot(rigid.x - ideal.x, rigid.y - ideal.y) < 0.15
    bodies[0].close()


def test_a_lap_needs_the_right_size():
    env = DroneEnv(SHORT)
    start = Start((0.0, 0.0, 0.3 * 40))
    follows = fly_lap(env, make("oracle", SHORT), start)
    assert follows.lap
    assert follows.track.shape == (500, 3)
    assert follows.absolute[2] < 2.0
    info = begin(env, start)
    oracle, over, lost = make("oracle", SHORT), False, False
    while not (over or lost):  # in the middle, but never higher
        _, _, lost, over, info = env.step(oracle.act(info["counts"], info) * (1.0, 1.0, 0.0))
    assert not lost
    assert info["error_px"] < 5.0
    assert not info["lap"]


def test_the_network_learns_the_third_axis():
    taught, untaught = train(SHORT, steps=2000, seed=1), train(SHORT, "snn-eta0", steps=1)
    maps = weight_maps(taught)
    assert list(maps) == ["right", "left", "backwards", "forward", "up", "down"]
    middle, ring = np.zeros((8, 8), bool), np.zeros((8, 8), bool)
    middle[3:5, 3:5] = ring[2:6, 2:6] = True
    ring &= ~middle
    speaks = maps["up"] - maps["down"]
    assert speaks[ring].mean() > 200.0 > -200.0 > speaks[middle].mean()
    starts = [Start((0.0, 0.0, tall)) for tall in (-12.0, 12.0)]
    good, bad = (try_out(model, starts=starts) for model in (taught, untaught))
    assert good.laps == 2
    assert good.absolute[2] < 5.0
    assert bad.laps == 0


def test_hand_made_controllers_have_three_axes():
    assert make("nothing", WORLD).act(np.zeros((8, 8), int), {}).tolist() == [0.0, 0.0, 0.0]
    error = {"supervised_error": np.array([0.1, -0.1, 0.2])}
    assert make("oracle", WORLD).act(np.zeros((8, 8), int), error) == pytest.approx((0.4, -0.4, 0.8))
    centroid = make("centroid", WORLD, 0, {"gain": 1.0})
    assert centroid.act(np.zeros((8, 8), int), {}).tolist() == [0.0, 0.0, 0.0]
    inner, outer = np.zeros((8, 8), int), np.zeros((8, 8), int)
    inner[3:5, 3:5] = 1
    outer[2, 3:5] = outer[5, 3:5] = outer[3:5, 2] = outer[3:5, 5] = 1
    assert centroid.act(inner, {})[2] < -0.3
    assert centroid.act(outer, {})[2] > 0.1
    for shape in ("sign", "linear"):
        third = pattern(WORLD, shape)[:, 2].reshape(8, 8)
        assert third.max() == third[7, 7] == 1.0
        assert third[3, 3] < 0.0


def test_tables_and_grids_have_three_axes():
    assert axes(WORLD) == ("right, px", "down, px", "taller, px")
    assert axes(load("B60")) == ("right, px", "down, px")
    starts = grid(WORLD)
    assert len(starts) == 25
    assert sorted({start.error[2] for start in starts}) == pytest.approx([-12.0, 0.0, 12.0])


def test_mistakes(tmp_path):
    env = DroneEnv(WORLD)
    env.reset()
    assert told(lambda: env.step((0.0, 0.0))) == "action (0.0, 0.0): expected three numbers in [-1, 1]"
    assert told(lambda: env.reset(options={"start": (1, 2, 3, 4)})) == (
        "option start = (1, 2, 3, 4): expected two or three numbers, the error on each axis"
    )
    assert told(lambda: env.reset(options={"start": (1, 2, 41)})) == (
        "start [1, 2, 41] px: expected a place of the picture below the horizon and a ball from half to twice as tall "
        "as it shall be"
    )
    for name in ("dqn", "ddpg", "ppo"):
        assert told(lambda name=name: make(name, WORLD)) == (
            f"controller '{name}' has two axes: expected a scenario with task.ball.axes = 2"
        )
    assert told(lambda: make("oracle", WORLD, 0, {"gain": [1.0, 2.0]})) == (
        "gain = [1.0, 2.0]: expected a number or a list of 3, one an axis"
    )
    assert told(lambda: make("snn", WORLD, 0, {"network": "examples/drone_own_network.yaml"})) == (
        "network 'own': expected a population 'motors' of 6, two an axis: found one of shape [4]"
    )
