"""The rigid body in PyBullet beside the kinematic one."""

import copy
import gc
import pickle
import sys
from math import cos, hypot, sin

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from neuro import ModelError
from neuro.core.extras import install
from neuro_drone.body import Kinematic
from neuro_drone.bullet import ARM, DRAG_TO_THRUST, MOST_THRUST, Bullet, _rotors, body_of
from neuro_drone.env import DroneEnv
from neuro_drone.scenario import Drone

YAW = 0.4


def pybullet():
    return pytest.importorskip("pybullet", reason="pybullet has wheels for Python 3.11 only")


def response(body, right, forward, turn=0.0, seconds=3.0, dt=0.005):
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


@pytest.mark.parametrize(
    "command", [(0.075, 0.0), (0.0, 0.3), (0.5, 0.0), (0.0, -1.0), (2.0, 0.0), (1.4, 1.4), (0.0, 0.0, 0.8)]
)
def test_steps_agree_with_the_kinematic_body(command):
    pybullet()
    rise, over, _ = response(Kinematic(Drone()), *command)
    body = Bullet(Drone())
    rise_b, over_b, heights = response(body, *command)
    body.close()
    assert rise_b == pytest.approx(rise, rel=0.15)
    assert abs(over_b - over) <= 0.05
    assert max(abs(z - 2.4) for z in heights) < 0.01


def test_it_flies_where_the_kinematic_body_flies():
    pybullet()
    bodies = Bullet(Drone()), Kinematic(Drone())
    for body in bodies:
        body.reset(1.0, 2.0, 3.0, forward=0.2)
    rng = np.random.default_rng(1)
    for _ in range(60):
        command = (*rng.uniform(-0.3, 0.3, 2), rng.uniform(-0.8, 0.8))
        for body in bodies:
            body.step(*command, 0.1)
        a, b = (body.pose for body in bodies)
        assert hypot(a.x - b.x, a.y - b.y) < 0.15
        assert a.yaw == pytest.approx(b.yaw, abs=0.05)
    bodies[0].close()


def test_it_leans_to_accelerate_and_never_more_than_the_limit():
    pybullet()
    body = Bullet(Drone())
    body.step(0.0, 2.0, 0.0, 0.2)
    assert body.pose.pitch == pytest.approx(np.arctan(3.0 / 9.81), abs=0.03)
    assert abs(body.pose.roll) < 1e-3
    body.reset(0.0, 0.0, 0.0)
    assert (body.pose.pitch, body.pose.roll, body.velocity) == (0.0, 0.0, (0.0, 0.0))
    body.step(2.0, 0.0, 0.0, 0.2)
    assert body.pose.roll == pytest.approx(np.arctan(3.0 / 9.81), abs=0.03)
    for _ in range(100):
        before = body.velocity
        body.step(-2.0, 2.0, 0.0, 0.05)
        assert hypot(body.velocity[0] - before[0], body.velocity[1] - before[1]) / 0.05 < 3.3
    body.close()


@pytest.mark.parametrize("a_max", [3.0, 8.0])
def test_commands_that_jump_to_and_fro_do_not_bring_it_down(a_max):
    pybullet()
    body, rng = Bullet(Drone(a_max=a_max)), np.random.default_rng(1)
    for _ in range(200):
        body.step(*(2.0 * rng.choice([-1, 1], 2)), rng.uniform(-0.8, 0.8), 0.05)
        assert abs(body.pose.z - 2.4) < 0.1 * a_max / 3.0
        assert max(abs(body.pose.pitch), abs(body.pose.roll)) < 0.8
    body.close()


def test_several_at_once_do_the_same_as_one_alone_and_again():
    pybullet()
    rng = np.random.default_rng(2)
    commands = rng.uniform(-1, 1, (30, 3))

    def flown(*bodies):
        for body in bodies:
            body.reset(0.0, 0.0, 0.0)
        for command in commands.tolist():
            for body in bodies:
                body.step(*command, 0.05)
        return [(b.pose.x, b.pose.y, b.pose.z, b.pose.yaw, b.pose.pitch, b.velocity) for b in bodies]

    one, two, three = Bullet(Drone()), Bullet(Drone()), Bullet(Drone())
    alone = flown(one)
    assert flown(one) == alone
    assert flown(two, three) == alone * 2
    for body in (one, two, three):
        body.close()


def test_clients_are_closed():
    p = pybullet()
    body = Bullet(Drone())
    client = body._client
    assert p.isConnected(client)
    body.close()
    body.close()
    assert not p.isConnected(client)
    body = Bullet(Drone())
    client = body._client
    del body
    gc.collect()
    assert not p.isConnected(client)
    env = DroneEnv("B60", **{"drone.physics": "bullet"})
    client = env.body._client
    env.close()
    assert not p.isConnected(client)
    with pytest.raises(ModelError, match="call reset first"):
        env.step([0.0, 0.0])
    env.reset()
    env.step([0.0, 0.0])
    env.close()


@given(st.floats(0, 30), *[st.floats(-3, 3)] * 3)
@settings(deadline=None)
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


def test_the_environment_with_it():
    pybullet()
    env = DroneEnv("A60", **{"drone.physics": "bullet"})
    _, info = env.reset(options={"start": (-20.0, 20.0)})
    for _ in range(150):
        _, _, _, _, info = env.step(np.clip(3.0 * info["supervised_error"], -1.0, 1.0))
    assert info["error_px"] < 3.0
    env.close()


@pytest.mark.parametrize("again", [copy.deepcopy, lambda env: pickle.loads(pickle.dumps(env))])
def test_a_copy_in_flight_flies_on_like_the_first(again):
    pybullet()
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


def test_without_pybullet(monkeypatch):
    monkeypatch.setitem(sys.modules, "pybullet", None)
    with pytest.raises(ModelError) as error:
        body_of(Drone(physics="bullet"))
    version = f"{sys.version_info.major}.{sys.version_info.minor}"
    assert str(error.value) == (
        "drone.physics = 'bullet': the package pybullet is not installed\n"
        f"  hint: {install('bullet')}; pybullet has wheels for Python 3.11 only, and this is {version}"
    )
