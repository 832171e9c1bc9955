"""The kinematic drone, and the rigid one in PyBullet: commands, wind, loads and climbs."""

import copy
import gc
import pickle
from functools import partial
from math import atan, copysign, cos, exp, hypot, sin

import numpy as np
import pytest
from hypothesis import given, strategies as st

from neuro_drone.body import ARM, DRAG_TO_THRUST, HEIGHT_GAINS, MOST_THRUST, Bullet, Kinematic, _rotors, body_of
from neuro_drone.env import DroneEnv, Weather
from neuro_drone.parts import GRAVITY, MASS, Drone, Load, Wind
from refused import refused

speeds = st.floats(-3.0, 3.0)
pieces = st.lists(st.floats(0.001, 0.5), min_size=1, max_size=6)


def euler(right, forward, turn, seconds, n=20000, lag=0.2, a_max=3.0, rate=0.0):
    """The differential equation itself, in small steps."""
    x = y = yaw = vx = vy = 0.0
    h = seconds / n
    for _ in range(n):
        c, s = cos(yaw), sin(yaw)
        ax, ay = (forward * c + right * s - vx) / lag, (forward * s - right * c - vy) / lag
        size = hypot(ax, ay)
        k = min(1.0, a_max / size) if size else 1.0
        vx, vy = vx + h * k * ax, vy + h * k * ay
        x, y, yaw, rate = x + h * vx, y + h * vy, yaw + h * rate, rate + h * (-turn - rate) / lag
    return x, y, yaw, vx, vy


@pytest.mark.parametrize("command", [(0.3, 0.1), (2.0, 0.0), (-1.4, 1.4), (0.0, -0.5)])
def test_straight_flight_is_the_solution_of_its_equation(command):
    body = Kinematic(Drone())
    body.step(*command, 0.0, 0.9)
    x, y, _, vx, vy = euler(*command, 0.0, 0.9)
    assert (body.pose.x, body.pose.y, *body.velocity) == pytest.approx((x, y, vx, vy), abs=3e-4)


@given(speeds, speeds, speeds, speeds, st.floats(-3, 3), st.floats(-5, 5), st.floats(-0.5, 1.0), pieces)
def test_it_does_not_matter_how_time_is_cut(right, forward, v_right, v_forward, yaw, wind, mass, pieces):
    whole, cut = Kinematic(Drone()), Kinematic(Drone())
    for body in (whole, cut):
        body.reset(1.0, 2.0, yaw, v_right, v_forward)
        body.feel((wind, 1.0 - wind), mass)
    whole.step(right, forward, 0.0, sum(pieces))
    for seconds in pieces:
        cut.step(right, forward, 0.0, seconds)
    assert (cut.pose.x, cut.pose.y, *cut.velocity) == pytest.approx((whole.pose.x, whole.pose.y, *whole.velocity))


@given(speeds, speeds, st.floats(0.001, 0.2))
def test_acceleration_is_limited_and_the_command_is_reached(right, forward, seconds):
    body = Kinematic(Drone())
    body.reset(0.0, 0.0, 0.5)
    for _ in range(30):
        before = body.velocity
        body.step(right, forward, 0.0, seconds)
        assert hypot(body.velocity[0] - before[0], body.velocity[1] - before[1]) <= 3.0 * seconds + 1e-9
    body.step(right, forward, 0.0, 20.0)
    c, s = cos(0.5), sin(0.5)
    assert body.velocity == pytest.approx((forward * c + right * s, forward * s - right * c), abs=1e-9)
    assert (body.pose.pitch, body.pose.roll) == pytest.approx((0.0, 0.0), abs=1e-6)


def test_commands_are_in_the_frame_of_the_heading_and_a_reset_forgets_everything():
    body = Kinematic(Drone())
    for command, way in (((0.5, 0.0), (0.0, -1.0)), ((0.0, 0.5), (1.0, 0.0))):
        body.reset(0.0, 0.0, 0.0)
        body.step(*command, 0.0, 5.0)
        assert np.sign(np.round([body.pose.x, body.pose.y], 9)).tolist() == list(way)
    body.step(0.0, 0.0, 0.4, 1.0)
    assert body.pose.yaw == pytest.approx(-0.4 * (1.0 - 0.2 * (1.0 - exp(-5.0))))
    for command, lean in (((0.0, 2.0), (atan(3.0 / GRAVITY), 0.0)), ((2.0, 0.0), (0.0, atan(3.0 / GRAVITY)))):
        body.reset(0.0, 0.0, 0.7)
        body.step(*command, 0.0, 0.01)
        assert (body.pose.pitch, body.pose.roll) == pytest.approx(lean)
    body = body_of(Drone())
    body.feel((1.0, 1.0), 0.2)
    body.step(1.0, 1.0, 0.5, 0.3)
    body.reset(3.0, 4.0, 1.0, forward=0.5)
    assert (body.pose.x, body.pose.y, body.pose.z, body.pose.yaw, body.pose.pitch) == (3.0, 4.0, 2.4, 1.0, 0.0)
    assert body.velocity == pytest.approx((0.5 * cos(1.0), 0.5 * sin(1.0)))
    body.reset(0.0, 0.0, 0.0)
    body.step(0.0, 0.0, 0.0, 1.0)
    assert (body.pose.x, body.pose.y, body.velocity) == (0.0, 0.0, (0.0, 0.0))
    body.close()
    x, y, yaw, _, _ = euler(0.2, 0.5, 0.8, 1.0, n=100_000)
    wrong = []
    for n in (5, 10, 20):
        body = Kinematic(Drone())
        for _ in range(n):
            body.step(0.2, 0.5, 0.8, 1.0 / n)
        assert body.pose.yaw == pytest.approx(yaw, abs=1e-4)
        wrong.append(hypot(body.pose.x - x, body.pose.y - y))
    assert wrong[1] < 0.35 * wrong[0] < 0.35 * 0.005


# wind and load


def blown(wind, steps, seconds, seed=0):
    weather = Weather(wind, Load())
    weather.reset(seed)
    rows = []
    for _ in range(steps):
        weather.step(seconds)
        rows.append(weather.wind)
    return np.array(rows)


def test_wind_and_load_begin_when_they_are_said():
    rows = blown(Wind(speed=4.0, towards=90.0, turning=9.0, since=1.0), 420, 0.05)
    assert (rows[:20] == 0.0).all()
    assert rows[20] == pytest.approx((0.0, 4.0))
    assert rows[220] == pytest.approx((-4.0, 0.0))  # 10 s later, counter-clockwise
    assert np.hypot(*rows[20:].T) == pytest.approx(4.0)
    weather, seen = Weather(Wind(), Load(mass=0.2, since=0.3)), []
    for _ in range(8):
        weather.step(0.05)
        seen.append(weather.load)
    assert seen == [0.0] * 6 + [0.2] * 2
    weather.reset(1)
    assert weather.load == 0.0


@pytest.mark.parametrize("seconds", [0.01, 0.05, 0.5])
def test_gusts_have_their_spread_and_time_however_time_is_cut(seconds):
    wind = Wind(speed=3.0, towards=0.0, gust=0.7, gust_time=0.5)
    rows = blown(wind, round(1500.0 / seconds), seconds)
    assert rows.mean(axis=0) == pytest.approx((3.0, 0.0), abs=0.08)
    assert rows.std(axis=0) == pytest.approx(0.7, rel=0.08)
    lag = round(0.5 / seconds)
    x, y = (rows - rows.mean(axis=0)).T
    assert all(np.mean(one[lag:] * one[:-lag]) / one.var() == pytest.approx(exp(-1.0), abs=0.09) for one in (x, y))
    assert abs(np.corrcoef(x, y)[0, 1]) < 0.09
    assert (blown(wind, 9, seconds, 3) == blown(wind, 9, seconds, 3)).all()
    assert (blown(wind, 9, seconds, 3) != blown(wind, 9, seconds, 4)).all()


def test_wind_and_loads_carry_a_drone():
    body = Kinematic(Drone(drag=0.5))
    body.feel((2.0, -1.0), 0.0)
    body.step(0.0, 0.0, 0.0, 0.01)
    assert body.velocity == pytest.approx((0.01 * 1.0, 0.01 * -0.5), rel=0.05)  # drag times wind, before it is slowed
    assert (body.pose.pitch, body.pose.roll) == pytest.approx((0.0, 0.0), abs=0.006)
    body.step(0.0, 0.0, 0.0, 10.0)
    assert body.velocity == pytest.approx((0.2 * 1.0, 0.2 * -0.5))
    assert (body.pose.pitch, body.pose.roll) == pytest.approx((atan(-1.0 / GRAVITY), atan(-0.5 / GRAVITY)))
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
    calm, windy, seen = DroneEnv("B60"), DroneEnv("B60", wind={"speed": 5, "towards": 90, "since": 0.5}), []
    for env in (calm, windy):
        env.reset(seed=1, options={"start": (0.0, 0.0)})
        seen.append([env.step((0.0, 0.0))[4]["error"] for _ in range(30)])
    assert (seen[0][:10], windy.weather.wind) == (seen[1][:10], pytest.approx((0.0, 5.0)))
    assert seen[1][29][0] > seen[0][29][0] + 5.0  # blown to its left, so that the ball is on the right
    body = Kinematic(Drone())
    body.feel((0.0, 0.0), 0.2)
    body.step(0.0, 0.0, 0.0, 5.0)
    assert body.pose.z == 2.4
    body.step(0.0, 0.0, 0.0, 20.0, 0.0)
    assert body.climb == pytest.approx(-0.2 * GRAVITY * 0.2 / MASS)
    body.reset(0.0, 0.0, 0.0, z=3.0)
    body.step(0.0, 0.0, 0.0, 0.2, 0.5)
    assert (body.pose.z, body.climb) == pytest.approx((3.0 + 0.5 * 0.2 * exp(-1.0), 0.5 * (1.0 - exp(-1.0))))


@given(st.floats(-2, 2), st.floats(-0.3, 0.5), st.lists(st.floats(0.01, 0.5), min_size=1, max_size=4))
def test_climbing_is_the_solution_of_its_equation(climb, mass, pieces):
    body = Kinematic(Drone())
    body.feel((0.0, 0.0), mass)
    for seconds in pieces:
        body.step(0.0, 0.0, 0.0, seconds, climb)
    r, z, v, n = 1.0 + mass / MASS, 2.4, 0.0, 1500
    h = sum(pieces) / n
    for _ in range(n):
        a = (climb - v) / 0.2 / r - GRAVITY * (r - 1.0) / r  # the thrust is that of the mass without load
        a = copysign(min(abs(a), 3.0 / r), a)
        z, v = z + h * v, v + h * a
    assert (body.pose.z, body.climb) == pytest.approx((z, v), abs=1e-2)


# the rigid body

YAW = 0.4


def response(body, right, forward, turn=0.0, seconds=2.0, dt=0.005):
    """Rise time from 10 to 90 %, s, overshoot, and heights of a step of the command."""
    body.reset(0.0, 0.0, YAW)
    c, s, size = cos(YAW), sin(YAW), hypot(right, forward)
    way = (forward * c + right * s) / (size or 1.0), (forward * s - right * c) / (size or 1.0)
    out, heights = [], []
    for _ in range(round(seconds / dt)):
        before = body.pose.yaw
        body.step(right, forward, turn, dt)
        straight = (body.velocity[0] * way[0] + body.velocity[1] * way[1]) / (size or 1.0)
        out.append((before - body.pose.yaw) / dt / turn if turn else straight)
        heights.append(body.pose.z)
    v, t = np.array(out), dt * np.arange(1, len(out) + 1)
    top = int(v.argmax()) + 1
    low, high = np.interp([0.1, 0.9], v[:top], t[:top])
    return high - low, v.max() - 1.0, heights


@pytest.fixture(scope="module")
def rigid(pybullet):
    """A body that all tests share; each of them resets it."""
    body = Bullet(Drone())
    yield body
    body.close()


@pytest.mark.parametrize(
    "command", [(0.075, 0.0), (0.0, 0.3), (0.5, 0.0), (0.0, -1.0), (2.0, 0.0), (1.4, 1.4), (0.0, 0.0, 0.8)]
)
def test_steps_agree_with_the_kinematic_body(rigid, command):
    rise, over, _ = response(Kinematic(Drone()), *command)
    rise_b, over_b, heights = response(rigid, *command)
    assert rise_b == pytest.approx(rise, rel=0.15)
    assert abs(over_b - over) <= 0.05
    assert max(abs(z - 2.4) for z in heights) < 0.01


@pytest.mark.parametrize(("load_kg", "climbs"), [(0.0, False), (0.0, True), (0.2, True)])
def test_it_flies_where_the_kinematic_body_flies(rigid, load_kg, climbs):
    ideal, rng = Kinematic(Drone()), np.random.default_rng(1)
    for body in (rigid, ideal):
        body.reset(1.0, 2.0, 3.0, forward=0.2, z=3.0)
        body.feel((0.0, 0.0), load_kg)
    for _ in range(50):
        turn = 0.0 if climbs else rng.uniform(-0.8, 0.8)
        command = (*rng.uniform(-0.3, 0.3, 2), turn, 0.1, rng.uniform(-0.5, 0.8) if climbs else None)
        for body in (rigid, ideal):
            body.step(*command)
        a, b = rigid.pose, ideal.pose
        assert hypot(a.x - b.x, a.y - b.y) < 0.15
        assert (a.yaw, a.z) == (pytest.approx(b.yaw, abs=0.05), pytest.approx(b.z, abs=0.06))


def test_it_leans_to_accelerate_and_never_more_than_the_limit(rigid):
    lean = pytest.approx(np.arctan(3.0 / 9.81), abs=0.03)
    rigid.reset(0.0, 0.0, 0.0)
    rigid.step(0.0, 2.0, 0.0, 0.2)
    assert rigid.pose.pitch == lean
    assert abs(rigid.pose.roll) < 1e-3
    rigid.reset(0.0, 0.0, 0.0)
    assert (rigid.pose.pitch, rigid.pose.roll, rigid.velocity) == (0.0, 0.0, (0.0, 0.0))
    rigid.step(2.0, 0.0, 0.0, 0.2)
    assert rigid.pose.roll == lean
    for _ in range(100):
        before = rigid.velocity
        rigid.step(-2.0, 2.0, 0.0, 0.05)
        assert hypot(rigid.velocity[0] - before[0], rigid.velocity[1] - before[1]) / 0.05 < 3.3


@pytest.mark.parametrize("a_max", [3.0, 8.0])
@pytest.mark.usefixtures("pybullet")
def test_commands_that_jump_to_and_fro_do_not_bring_it_down(a_max):
    body, rng = Bullet(Drone(a_max=a_max)), np.random.default_rng(1)
    for _ in range(150):
        body.step(*(2.0 * rng.choice([-1, 1], 2)), rng.uniform(-0.8, 0.8), 0.05)
        assert abs(body.pose.z - 2.4) < 0.1 * a_max / 3.0
        assert max(abs(body.pose.pitch), abs(body.pose.roll)) < 0.8
    body.close()


def test_it_drifts_as_the_kinematic_one_and_sinks_under_a_load(rigid):
    ideal = Kinematic(Drone())
    for body in (rigid, ideal):
        body.reset(0.0, 0.0, 0.0)
        body.feel((4.0, -2.0), 0.2)
        body.step(0.0, 0.3, 0.0, 8.0)
    assert rigid.velocity == pytest.approx(ideal.velocity, abs=0.01)
    assert hypot(rigid.pose.x - ideal.pose.x, rigid.pose.y - ideal.pose.y) < 0.3
    assert (rigid.pose.pitch, rigid.pose.roll) == pytest.approx((ideal.pose.pitch, ideal.pose.roll), abs=0.02)
    assert rigid.pose.z == pytest.approx(2.4 - 0.2 / MASS * GRAVITY / HEIGHT_GAINS[0], abs=0.02)
    rigid.reset(0.0, 0.0, 0.0)
    rigid.step(0.0, 0.0, 0.0, 1.0)
    assert (rigid.pose.x, rigid.pose.z) == pytest.approx((0.0, 2.4), abs=1e-6)


def test_several_at_once_do_the_same_as_one_alone_and_again(rigid):
    commands = np.random.default_rng(2).uniform(-1, 1, (30, 3))

    def flown(*bodies):
        for body in bodies:
            body.reset(0.0, 0.0, 0.0)
        for command in commands.tolist():
            for body in bodies:
                body.step(*command, 0.05)
        return [(b.pose.x, b.pose.y, b.pose.z, b.pose.yaw, b.pose.pitch, b.velocity) for b in bodies]

    others, alone = (Bullet(Drone()), Bullet(Drone())), flown(rigid)
    assert (flown(rigid), flown(*others)) == (alone, alone * 2)
    for body in others:
        body.close()


def test_clients_are_closed(pybullet):
    body = Bullet(Drone())
    client = body._client
    assert pybullet.isConnected(client)
    body.close()
    body.close()
    assert not pybullet.isConnected(client)
    gc.freeze()  # what was there before is not looked at
    body = Bullet(Drone())
    client = body._client
    del body
    gc.collect()
    gc.unfreeze()
    assert not pybullet.isConnected(client)
    env = DroneEnv("B60", **{"drone.physics": "bullet"})
    client = env.body._client
    env.close()
    assert not pybullet.isConnected(client)
    assert "call reset first" in refused(partial(env.step, [0.0, 0.0]))
    env.reset()
    env.step([0.0, 0.0])
    env.close()


@given(st.floats(0, 30), *[st.floats(-3, 3)] * 3)
def test_rotors_give_what_is_asked_where_they_can(thrust, roll, pitch, yaw):
    made, (x, y, z) = _rotors(thrust, roll, pitch, yaw)
    share, about = 0.25 * made, 0.25 * z / DRAG_TO_THRUST
    for lean, sign in ((x, -1.0), (y, 1.0)):
        for side in (1.0, -1.0):
            assert -1e-9 <= share + side * 0.5 * lean / ARM + sign * about <= MOST_THRUST + 1e-9
    assert made == pytest.approx(min(thrust, 4 * MOST_THRUST))
    room = min(0.25 * thrust, MOST_THRUST - 0.25 * thrust)
    if max(abs(roll), abs(pitch)) / ARM / 2 + abs(yaw) / DRAG_TO_THRUST / 4 <= 0.4 * room:
        assert (made, x, y, z) == pytest.approx((thrust, roll, pitch, yaw), abs=1e-9)


@pytest.mark.usefixtures("pybullet")
def test_the_environment_with_it():
    env = DroneEnv("A60", **{"drone.physics": "bullet"})
    _, info = env.reset(options={"start": (-20.0, 20.0)})
    for _ in range(150):
        _, _, _, _, info = env.step(np.clip(3.0 * info["supervised_error"], -1.0, 1.0))
    assert info["error_px"] < 3.0
    env.close()


@pytest.mark.usefixtures("pybullet")
@pytest.mark.parametrize("again", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_in_flight_flies_on_like_the_first(again):
    env = DroneEnv("B60", **{"drone.physics": "bullet", "drone.v_max": 0.3})
    env.reset(seed=1)
    actions = np.random.default_rng(2).uniform(-1.0, 1.0, (40, 2))
    for action in actions[:20]:
        env.step(action)
    other = again(env)
    first, second = ([one.step(a)[4]["target"] for a in actions[20:]] for one in (env, other))
    assert np.allclose(first, second, rtol=0.0, atol=1e-9)
    env.close()
    other.step(actions[0])
    other.close()
