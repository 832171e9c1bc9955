"""The kinematic drone: lag, largest acceleration, and no dependence on how time is cut."""

from math import atan, cos, exp, hypot, sin

import numpy as np
import pytest
from hypothesis import given, strategies as st

from neuro_drone.body import GRAVITY, Kinematic
from neuro_drone.bullet import body_of
from neuro_drone.scenario import Drone

speeds = st.floats(-3.0, 3.0)


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
    body.reset(0.0, 0.0, 0.0)
    body.step(*command, 0.0, 0.9)
    x, y, _, vx, vy = euler(*command, 0.0, 0.9)
    assert (body.pose.x, body.pose.y, *body.velocity) == pytest.approx((x, y, vx, vy), abs=3e-4)


@given(speeds, speeds, speeds, speeds, st.floats(-3, 3), st.lists(st.floats(0.001, 0.5), min_size=1, max_size=6))
def test_it_does_not_matter_how_time_is_cut(right, forward, v_right, v_forward, yaw, pieces):
    whole, cut = Kinematic(Drone()), Kinematic(Drone())
    for body in (whole, cut):
        body.reset(1.0, 2.0, yaw, v_right, v_forward)
    whole.step(right, forward, 0.0, sum(pieces))
    for seconds in pieces:
        cut.step(right, forward, 0.0, seconds)
    assert (cut.pose.x, cut.pose.y, *cut.velocity) == pytest.approx((whole.pose.x, whole.pose.y, *whole.velocity))


def test_turning_flight_converges_with_second_order():
    x, y, yaw, _, _ = euler(0.2, 0.5, 0.8, 1.0, n=100_000)
    wrong = []
    for n in (5, 10, 20):
        body = Kinematic(Drone())
        body.reset(0.0, 0.0, 0.0)
        for _ in range(n):
            body.step(0.2, 0.5, 0.8, 1.0 / n)
        assert body.pose.yaw == pytest.approx(yaw, abs=1e-4)
        wrong.append(hypot(body.pose.x - x, body.pose.y - y))
    assert wrong[0] < 0.005
    assert wrong[1] < 0.35 * wrong[0]


@given(speeds, speeds, st.floats(0.001, 0.2))
def test_acceleration_is_limited_and_the_command_is_reached(right, forward, seconds):
    body = Kinematic(Drone())
    body.reset(0.0, 0.0, 0.5)
    before = (0.0, 0.0)
    for _ in range(30):
        body.step(right, forward, 0.0, seconds)
        assert hypot(body.velocity[0] - before[0], body.velocity[1] - before[1]) <= 3.0 * seconds + 1e-9
        before = body.velocity
    body.step(right, forward, 0.0, 20.0)
    c, s = cos(0.5), sin(0.5)
    assert body.velocity == pytest.approx((forward * c + right * s, forward * s - right * c), abs=1e-9)
    assert (body.pose.pitch, body.pose.roll) == pytest.approx((0.0, 0.0), abs=1e-6)


def test_commands_are_in_the_frame_of_the_heading():
    body = Kinematic(Drone())
    for command, way in (((0.5, 0.0), (0.0, -1.0)), ((0.0, 0.5), (1.0, 0.0))):
        body.reset(0.0, 0.0, 0.0)
        body.step(*command, 0.0, 5.0)
        assert np.sign(np.round([body.pose.x, body.pose.y], 9)).tolist() == list(way)
    body.step(0.0, 0.0, 0.4, 1.0)
    assert body.pose.yaw == pytest.approx(-0.4 * (1.0 - 0.2 * (1.0 - exp(-5.0))))


def test_it_leans_into_its_acceleration():
    body = Kinematic(Drone())
    body.reset(0.0, 0.0, 0.7)
    body.step(0.0, 2.0, 0.0, 0.01)
    assert body.pose.pitch == pytest.approx(atan(3.0 / GRAVITY))
    assert body.pose.roll == pytest.approx(0.0)
    body.reset(0.0, 0.0, 0.7)
    body.step(2.0, 0.0, 0.0, 0.01)
    assert body.pose.roll == pytest.approx(atan(3.0 / GRAVITY))


def test_a_reset_forgets_everything():
    body = body_of(Drone())
    body.step(1.0, 1.0, 0.5, 0.3)
    body.reset(3.0, 4.0, 1.0, forward=0.5)
    assert (body.pose.x, body.pose.y, body.pose.z, body.pose.yaw, body.pose.pitch) == (3.0, 4.0, 2.4, 1.0, 0.0)
    assert body.velocity == pytest.approx((0.5 * cos(1.0), 0.5 * sin(1.0)))
    body.close()
