"""The eye's pictures against PyBullet's renderer, which tells for each pixel's middle what is seen there."""

import numpy as np
import pytest
from numpy.lib.stride_tricks import sliding_window_view

from neuro_drone.eye import Eye
from neuro_drone.geometry import Pose, WorldScene
from neuro_drone.scenario import Ball, Camera, Ground, Line, Scenario

bullet = pytest.importorskip("pybullet", reason="pybullet has wheels for Python 3.11 only")


@pytest.fixture
def world():
    client = bullet.connect(bullet.DIRECT)
    yield client
    bullet.disconnect(client)


FINER = 4
"""PyBullet's picture has so many pixels for each of the eye's: its outlines are whole pixels, off by up to one."""


def seen(client, view, bodies):
    """The share of each pixel that shows some bodies, from the same place with the same angle of view."""
    _, down, forward, place = view.matrix
    looking = bullet.computeViewMatrix(place.tolist(), (place + forward).tolist(), (-down).tolist())
    angle = 2 * np.degrees(np.arctan(0.5 * view.size / view.focal))
    lens = bullet.computeProjectionMatrixFOV(angle, 1.0, 0.05, 50.0)
    flags = {"renderer": bullet.ER_TINY_RENDERER, "physicsClientId": client}
    side = FINER * view.size
    mask = bullet.getCameraImage(side, side, looking, lens, **flags)[4]
    return np.isin(mask, bodies).reshape(view.size, FINER, view.size, FINER).mean((1, 3))


def globe(radius, n=40):
    """A mesh of n x 2n corners: PyBullet's own sphere is so coarse that it covers 7 % less."""
    lat, lon = np.meshgrid(np.linspace(0, np.pi, n), np.linspace(0, 2 * np.pi, 2 * n, endpoint=False), indexing="ij")
    corners = radius * np.stack([np.sin(lat) * np.cos(lon), np.sin(lat) * np.sin(lon), np.cos(lat)], axis=-1)
    i, j = (k.ravel() for k in np.meshgrid(np.arange(n - 1), np.arange(2 * n), indexing="ij"))
    a, b = 2 * n * i + j, 2 * n * i + (j + 1) % (2 * n)
    faces = np.concatenate([np.stack([a, a + 2 * n, b], 1), np.stack([b, a + 2 * n, b + 2 * n], 1)])
    return {"vertices": corners.reshape(-1, 3).tolist(), "indices": faces.ravel().tolist()}


def put(client, shape, position, yaw=0.0, **size):
    visual = bullet.createVisualShape(shape, physicsClientId=client, **size)
    turn = bullet.getQuaternionFromEuler((0, 0, yaw))
    return bullet.createMultiBody(0, -1, visual, position, turn, physicsClientId=client)


def check(theirs, ours):
    """The same silhouette within a pixel, and the same area within a few per cent."""
    near = sliding_window_view(theirs, (3, 3))
    assert (ours[1:-1, 1:-1] >= near.min((2, 3)) - 1e-3).all()
    assert (ours[1:-1, 1:-1] <= near.max((2, 3)) + 1e-3).all()
    assert ours.sum() == pytest.approx(theirs.sum(), rel=0.03)
    assert np.abs(ours - theirs).max() < 0.5
    assert theirs.sum() > 60


POSES = [Pose(0.0, 0.0, 2.4), Pose(0.7, -1.3, 2.0, 2.0), Pose(-0.4, 0.5, 2.4, -0.7, 0.15, -0.2)]


@pytest.mark.parametrize("pose", POSES)
@pytest.mark.parametrize("mount", ["gimbal", "body"])
@pytest.mark.parametrize(("tilt", "radius"), [(30.0, 0.27), (60.0, 0.17), (90.0, 0.17)])
def test_ball(world, tilt, radius, mount, pose):
    camera = Camera(tilt=tilt, mount=mount)
    eye = Eye(Scenario(camera=camera, task=Ball(radius=radius, brightness=0.0), ground=Ground(brightness=1.0)))
    eye.view.look(pose)
    place = (*eye.view.ground(40, 80, radius), radius)
    ball = put(world, bullet.GEOM_MESH, place, **globe(radius))
    empty = eye.draw(pose, WorldScene()).copy()
    check(seen(world, eye.view, [ball]), 1.0 - eye.draw(pose, WorldScene(ball=(*place, radius))) / empty)


@pytest.mark.parametrize("mount", ["gimbal", "body"])
@pytest.mark.parametrize("tilt", [30.0, 60.0, 90.0])
def test_line(world, tilt, mount):
    """A box of a fifth of a millimetre on the ground; one of its ends is in the picture."""
    camera, task = Camera(tilt=tilt, mount=mount), Line(brightness=0.0, width=0.2)
    eye = Eye(Scenario(camera=camera, task=task, ground=Ground(brightness=1.0)))
    pose = Pose(2.2, -0.7, 2.4, 2.0, 0.1, -0.15)
    eye.view.look(pose)
    (x0, y0), (x1, y1) = eye.view.ground(40, 60), eye.view.ground(100, 200)
    half = [0.5 * np.hypot(x1 - x0, y1 - y0), 0.1, 1e-4]
    place = (0.5 * (x0 + x1), 0.5 * (y0 + y1), 0.0)
    box = put(world, bullet.GEOM_BOX, place, np.arctan2(y1 - y0, x1 - x0), halfExtents=half)
    empty = eye.draw(pose, WorldScene()).copy()
    line = np.array([[x0, y0, x1, y1]])
    check(seen(world, eye.view, [box]), 1.0 - eye.draw(pose, WorldScene(line=line)) / empty)
