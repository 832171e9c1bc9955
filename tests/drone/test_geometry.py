"""The camera: where points are in the picture, and where pixels look."""

from math import isinf, radians

import numpy as np
import pytest
from hypothesis import given, strategies as st

from neuro_drone.geometry import CameraView, Pose

angles = st.floats(-3.0, 3.0)
poses = st.builds(
    Pose, st.floats(-9, 9), st.floats(-9, 9), st.floats(0.5, 5), angles, st.floats(-0.3, 0.3), st.floats(-0.3, 0.3)
)
pixels = st.floats(-0.5, 127.4)


@pytest.mark.parametrize(("tilt", "right", "down"), [(60.0, 36.2, 31.4), (30.0, 20.9, 10.5)])
def test_a_metre_at_the_middle_of_the_picture(tilt, right, down):
    view = CameraView(tilt=tilt)
    view.look(Pose(0.0, 0.0, 2.4))
    x, y = view.ground(63.5, 63.5)
    assert view.project(x, y - 0.001, 0.0)[0] - 63.5 == pytest.approx(0.001 * right, rel=0.01)
    assert view.project(x - 0.001, y, 0.0)[1] - 63.5 == pytest.approx(0.001 * down, rel=0.01)


def test_the_field_of_view_spans_the_picture():
    view = CameraView(fov=65.0)
    left, right = np.array(view.ray(-0.5, 63.5)), np.array(view.ray(127.5, 63.5))
    cosine = left @ right / np.linalg.norm(left) / np.linalg.norm(right)
    assert np.degrees(np.arccos(cosine)) == pytest.approx(65.0)


@given(poses, st.floats(45, 90), pixels, pixels, st.booleans(), st.floats(0, 0.3))
def test_what_a_pixel_sees_is_seen_there(pose, tilt, u, v, fixed, height):
    view = CameraView(tilt=tilt, fixed=fixed)
    view.look(pose)
    place = view.ground(u, v, height)
    if place is not None:
        assert view.project(*place, height)[:2] == pytest.approx((u, v), abs=1e-6)


@given(poses, pixels, pixels)
def test_a_row_is_at_right_angles_to_its_normal(pose, u, v):
    view = CameraView(fixed=True)
    view.look(pose)
    assert np.dot(view.row(v), view.ray(u, v)) == pytest.approx(0.0, abs=1e-12)
    assert np.dot(view.row(v), view.ray(u, v - 1.0)) > 0.0


@given(poses)
def test_the_axes_are_a_right_handed_frame(pose):
    view = CameraView(fixed=True)
    view.look(pose, (0.01, -0.02))
    axes = view.matrix[:3]
    assert axes @ axes.T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.cross(axes[0], axes[1]) == pytest.approx(axes[2], abs=1e-12)


@given(st.floats(-9, 9), angles)
def test_a_gimbal_ignores_the_lean_and_a_fixed_camera_shares_it(x, yaw):
    level, free, fixed = CameraView(), CameraView(), CameraView(fixed=True)
    level.look(Pose(x, 1.0, 2.0, yaw))
    free.look(Pose(x, 1.0, 2.0, yaw, 0.2, 0.1))
    assert np.array_equal(level.matrix, free.matrix)
    fixed.look(Pose(x, 1.0, 2.0, yaw))
    assert fixed.matrix == pytest.approx(level.matrix, abs=1e-12)


def test_directions_of_lean():
    view = CameraView(tilt=60.0, fixed=True)
    view.look(Pose(0.0, 0.0, 2.0))
    x, y = view.ground(63.5, 63.5)
    view.look(Pose(0.0, 0.0, 2.0, pitch=0.05))
    assert view.project(x, y, 0.0)[1] < 63.0  # nose down: the ground goes up the picture
    view.look(Pose(0.0, 0.0, 2.0, roll=0.05))
    assert view.project(x, y, 0.0)[0] > 64.0  # right side down: what is below goes to the right


def test_shake_turns_the_camera_right_and_down():
    view = CameraView()
    view.look(Pose(0.0, 0.0, 2.0))
    x, y = view.ground(63.5, 63.5)
    view.look(Pose(0.0, 0.0, 2.0), (radians(1.0), radians(0.5)))
    u, v, _ = view.project(x, y, 0.0)
    assert u < 63.0
    assert v < 63.0


def test_behind_and_above():
    view = CameraView(tilt=30.0)
    view.look(Pose(0.0, 0.0, 2.0))
    u, v, depth = view.project(-9.0, 0.0, 0.0)
    assert isinf(u)
    assert isinf(v)
    assert depth <= 0.0
    assert view.ground(63.0, 0.0) is None
    assert view.sees(-0.5, 127.4)
    assert not view.sees(127.5, 3.0)
