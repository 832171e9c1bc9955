"""Pictures of the drone's eye against heavy sampling, and what it hands to its DVS."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from neuro import ModelError
from neuro.events import DVS
from neuro_drone.ball import hop
from neuro_drone.eye import SKY, Eye, pixels
from neuro_drone.geometry import CameraView, Pose, WorldScene
from neuro_drone.scenario import Ball, Camera, Ground, Line, Scenario

SIDE = 100
SPREAD = ((np.indices((SIDE, SIDE)) + np.random.default_rng(0).random((2, SIDE, SIDE))) / SIDE - 0.5).reshape(2, -1)
"""One random point in each small square of a pixel; counting them gives areas with a deviation of less than 1e-3."""

HEXAGON = 3.0 * np.stack([np.cos(np.arange(7) * np.pi / 3), np.sin(np.arange(7) * np.pi / 3)], axis=1)
LINE = np.concatenate([HEXAGON[:-1], HEXAGON[1:]], axis=1)

poses = st.builds(
    Pose,
    st.floats(-2, 2), st.floats(-2, 2), st.floats(1.7, 3), st.floats(-4, 4), st.floats(-0.4, 0.4), st.floats(-0.4, 0.4),
)  # fmt: skip
cameras = st.builds(Camera, tilt=st.floats(10, 90), mount=st.sampled_from(["gimbal", "body"]))
places = st.tuples(st.floats(0, 127), st.floats(0, 127))


def rays(view, x, y):
    """Directions in the world of all samples of some pixels, (pixels, samples, 3)."""
    a, b = ((p[:, None] + s - view.middle) / view.focal for p, s in zip((x, y), SPREAD, strict=True))
    right, down, forward, _ = view.matrix
    return a[..., None] * right + b[..., None] * down + forward


def on_ball(view, ball, ray):
    middle = np.array(ball[:3]) - view.matrix[3]
    along = ray @ middle
    return (along > 0) & (along**2 >= (ray**2).sum(-1) * (middle @ middle - ball[3] ** 2))


def on_ring(view, ray, width):
    """On the hexagon's line: between one hexagon and another, by the distances of their sides."""
    with np.errstate(divide="ignore", invalid="ignore"):
        place = view.matrix[3, :2] - view.matrix[3, 2] / ray[..., 2:] * ray[..., :2]
    angle = np.pi / 6 + np.arange(6) * np.pi / 3
    apart = (place @ np.array([np.cos(angle), np.sin(angle)])).max(-1) - 3.0 * np.cos(np.pi / 6)
    return (ray[..., 2] < 0) & (np.abs(apart) <= width / 2)


def check_pixels(eye, shape, rng):
    """The pixels at edges, and some others, against samples; `shape` tells which rays meet it."""
    image = eye.image.astype(float)
    steps = np.zeros(image.shape, bool)
    for axis in (0, 1):
        step = np.abs(np.diff(image, axis=axis)) > 1e-6
        steps |= np.pad(step, [(1, 0) if k == axis else (0, 0) for k in (0, 1)])
        steps |= np.pad(step, [(0, 1) if k == axis else (0, 0) for k in (0, 1)])
    y, x = np.nonzero(steps)
    some = rng.permutation(len(x))[:30]
    x, y = np.append(x[some], rng.integers(0, 128, 6)), np.append(y[some], rng.integers(0, 128, 6))
    ray = rays(eye.view, x, y)
    light = np.where(shape(ray), 0.0, np.where(ray[..., 2] < 0, 1.0, SKY)).mean(1)
    np.testing.assert_allclose(image[y, x], light, atol=1 / 200)


@given(cameras, poses, places, st.floats(0.03, 0.6), st.integers(0, 1000))
@settings(max_examples=12, deadline=None)
def test_ball_and_horizon_are_exact(camera, pose, place, radius, seed):
    scenario = Scenario(camera=camera, task=Ball(radius=radius, brightness=0.0), ground=Ground(brightness=1.0))
    eye = Eye(scenario)
    eye.view.look(pose)
    x, y = eye.view.ground(*place, radius) or eye.view.ground(63, 127, radius) or (0.0, 0.0)
    ball = (x, y, radius, radius)
    eye.draw(pose, WorldScene(ball=ball))
    check_pixels(eye, lambda ray: on_ball(eye.view, ball, ray), np.random.default_rng(seed))


@pytest.mark.parametrize("time", [0.3, 7.1, 12.5])
def test_a_ball_in_the_air_is_exact(time):
    ball = Ball(radius=0.3, bounce=0.3, rise=0.6, swell=0.4, brightness=0.0)
    eye = Eye(Scenario(task=ball, ground=Ground(brightness=1.0)))
    up, radius = hop(ball, time)
    place = (1.5, 0.1, up, radius)
    eye.draw(Pose(0.2, 0.0, 2.4, 0.1), WorldScene(place))
    assert eye.image.min() == 0.0
    check_pixels(eye, lambda ray: on_ball(eye.view, place, ray), np.random.default_rng(0))


@given(cameras, poses, st.floats(0.02, 0.5), st.integers(0, 1000))
@settings(max_examples=12, deadline=None)
def test_a_line_and_its_corners_are_exact(camera, pose, width, seed):
    scenario = Scenario(camera=camera, task=Line(width=width, brightness=0.0), ground=Ground(brightness=1.0))
    eye = Eye(scenario)
    eye.draw(pose, WorldScene(line=LINE))
    check_pixels(eye, lambda ray: on_ring(eye.view, ray, width), np.random.default_rng(seed))


@pytest.mark.parametrize("tilt", [30.0, 60.0, 90.0])
def test_a_ball_that_moves_by_a_millimetre_and_a_half_changes_the_picture_a_little(tilt):
    """Pixels at its front fill and pixels at its back empty, none by more than the way; in each step many change."""
    eye = Eye(Scenario(camera=Camera(tilt=tilt), task=Ball(brightness=0.0), ground=Ground(brightness=1.0)))
    pose = Pose(0.0, 0.0, 2.4)
    eye.view.look(pose)
    x, y = eye.view.ground(63, 70, 0.17)
    balls = [(x, y - 0.0015 * k, 0.17, 0.17) for k in range(60)]  # to the right
    pictures = [eye.draw(pose, WorldScene(ball=ball)).astype(float) for ball in balls]
    steps = np.diff(pictures, axis=0)
    middle = [eye.view.project(*ball[:3])[0] for ball in balls]
    way = np.diff(middle).max()
    assert np.abs(steps).max() < 1.2 * way
    assert (np.abs(steps) > 1e-3).sum((1, 2)).min() >= 12
    columns = np.arange(128)
    for step, u in zip(steps, middle, strict=False):
        assert step[:, columns > u + 1].max() < 2e-3
        assert step[:, columns < u - 1].min() > -2e-3
    areas = np.array([(1 - p).sum() for p in pictures])
    assert np.ptp(areas) < 2e-3 * areas[0]


def test_the_horizon_at_30_degrees():
    """tan(30) of 100.46 px above the middle, so between rows 5 and 6."""
    eye = Eye(Scenario(camera=Camera(tilt=30.0)))
    image = eye.draw(Pose(0, 0, 2.4), WorldScene())
    assert (image[:5] == np.float32(SKY)).all()
    assert (image[7:] == np.float32(0.6)).all()
    line = 63.5 - eye.view.focal * np.tan(np.pi / 6)
    assert (image[:, 0] - 0.6).sum() / (SKY - 0.6) == pytest.approx(line + 0.5, abs=1e-3)


def draw_one(ball, radius=0.17, tilt=60.0):
    eye = Eye(Scenario(camera=Camera(tilt=tilt), task=Ball(radius=radius)))
    return eye.draw(Pose(0, 0, 2.4), WorldScene(ball=ball)).copy(), eye


@pytest.mark.parametrize(
    "ball", [None, (-5.0, 0.0, 0.17, 0.17), (0.0, 0.0, 2.4, 0.17), (0.0, 4.0, 2.4, 1.0), (0.0, -4.0, 2.4, 1.0)]
)
def test_what_is_not_in_view_leaves_the_ground(ball):
    """No ball, one behind the camera, one round it, one to its left and right."""
    image, eye = draw_one(ball)
    assert (image == np.float32(0.6)).all()
    assert eye.box == (0, 0, 128, 128)  # the first picture is all new
    eye.draw(Pose(0, 0, 2.4), WorldScene())
    assert eye.box == (0, 0, 0, 0)


def test_a_ball_beside_the_camera_fills_the_view_to_one_side():
    """Its outline is no ellipse: a part of it is behind the camera."""
    ball = (0.0, 1.1, 2.0, 1.0)
    eye = Eye(Scenario(task=Ball(radius=1.0, brightness=0.0), ground=Ground(brightness=1.0)))
    eye.draw(Pose(0, 0, 2.4), WorldScene(ball=ball))
    check_pixels(eye, lambda ray: on_ball(eye.view, ball, ray), np.random.default_rng(0))
    assert 0.05 < (1 - eye.image).mean() < 0.95


GROUNDS = [Ground(), Ground(texture=0.5)]


@given(st.integers(0, 10_000), st.sampled_from(GROUNDS), st.floats(20, 90), st.sampled_from(["gimbal", "body"]))
@settings(max_examples=20, deadline=None)
def test_drawing_over_the_picture_before_is_as_drawing_anew(seed, ground, tilt, mount):
    """And nothing differs outside of the box."""
    rng = np.random.default_rng(seed)
    scenario = Scenario(camera=Camera(tilt=tilt, mount=mount), task=Line(), ground=ground)
    eye, fresh = Eye(scenario), Eye(scenario)
    pose, scene = Pose(0, 0, 2.4), WorldScene()
    for _ in range(12):
        if rng.random() < 0.5:
            pose = replace(pose, x=rng.normal(), y=rng.normal(), yaw=rng.normal() if rng.random() < 0.5 else 0.0)
        if rng.random() < 0.3:
            pose = replace(pose, z=2.0 + rng.random(), pitch=0.2 * rng.normal(), roll=0.2 * rng.normal())
        if rng.random() < 0.5:
            ball = None if rng.random() < 0.3 else (*rng.normal(0, 2, 2), 0.17, 0.17)
            scene = WorldScene(ball=ball, line=LINE if rng.random() < 0.5 else None)
        before = eye.image.copy()
        image = eye.draw(pose, scene)
        fresh.reset(0)
        np.testing.assert_allclose(image, fresh.draw(pose, scene), atol=1e-4)  # the horizon's height
        x0, y0, x1, y1 = eye.box
        changed = image != before
        changed[y0:y1, x0:x1] = False
        assert not changed.any()


def test_only_what_can_have_changed_is_drawn():
    ball = WorldScene(ball=(0.5, 0.0, 0.17, 0.17))
    plain, pattern = Eye(Scenario()), Eye(Scenario(ground=Ground(texture=0.3)))
    for eye in (plain, pattern):
        eye.draw(Pose(0, 0, 2.4), ball)
        eye.draw(Pose(0, 0, 2.4), WorldScene(ball=(0.52, 0.0, 0.17, 0.17)))
        x0, y0, x1, y1 = eye.box
        assert max(x1 - x0, y1 - y0) < 20
    for eye, wide in ((plain, False), (pattern, True)):
        eye.draw(Pose(0.01, 0, 2.4), ball)
        assert (eye.box == (0, 0, 128, 128)) is wide


@pytest.mark.parametrize("noise", [0.0, 3.0])
@pytest.mark.parametrize("ground", GROUNDS)
def test_events_are_those_of_a_dvs_that_is_shown_the_pictures(noise, ground):
    camera = Camera(leak_rate_hz=noise, shot_noise_rate_hz=noise, sigma_thres=0.01, shake=0.1)
    eye = Eye(Scenario(camera=camera, ground=ground), seed=3)
    dvs = DVS((128, 128), pixels(camera), seed=3)
    total = 0
    for k in range(20):
        pose, scene = Pose(0.02 * k, 0, 2.4), WorldScene(ball=(1.0, 0.01 * k, 0.17, 0.17))
        if k == 10:
            eye.draw(Pose(1, 1, 2.4), WorldScene())  # a look aside
        events = eye.see(pose, scene, 50_000 * k)
        assert events == dvs.see(eye.image, 50_000 * k)
        assert k or not len(events)
        total += len(events)
    assert total > 100


def test_the_same_seed_is_the_same_episode():
    """Shake, noise and a pattern that is drawn anew are of the reset's seed alone."""
    camera = Camera(shake=0.3, leak_rate_hz=1.0, shot_noise_rate_hz=1.0)
    scenario = Scenario(camera=camera, ground=Ground(texture=0.3, redraw=True))
    scene = WorldScene(ball=(1.0, 0.0, 0.17, 0.17))

    def episode(eye, seed):
        eye.reset(seed)
        return [(eye.see(Pose(0, 0, 2.4), scene, 1000 * k), eye.image.tobytes()) for k in range(5)]

    eye = Eye(scenario, seed=1)
    first = episode(eye, 7)
    assert episode(eye, 8) != first
    assert episode(eye, 7) == first == episode(Eye(scenario, seed=2), 7)
    kept = replace(scenario, ground=Ground(texture=0.3), camera=Camera())
    one, other = Eye(kept, seed=1), Eye(kept, seed=2)
    assert episode(one, 7) == episode(one, 8) != episode(other, 7)


def test_shake_has_its_size():
    """Half of the turn to the right is seen where the camera looks down by 60 degrees."""
    eye = Eye(Scenario(camera=Camera(shake=0.5)))
    straight = CameraView()
    pose = Pose(0, 0, 2.4)
    straight.look(pose)
    turns = []
    for _ in range(400):
        eye.draw(pose, WorldScene())
        turns.append(straight.matrix[:2] @ eye.view.matrix[2])
    assert np.degrees(np.std(turns, axis=0)) == pytest.approx([0.25, 0.5], rel=0.15)


def test_light_is_a_factor_and_nothing_is_shaded():
    scene, pose = WorldScene(ball=(1.2, 0.0, 0.17, 0.17)), Pose(0, 0, 2.4)
    for ground in GROUNDS:
        one, two = (Eye(Scenario(light=light, ground=ground)).draw(pose, scene) for light in (1.0, 0.25))
        np.testing.assert_allclose(two, 0.25 * one, rtol=1e-5)
    image = Eye(Scenario()).draw(pose, scene)
    assert np.unique(image[[60, 60], [0, 127]]).tolist() == [np.float32(0.6)]
    assert (image == np.float32(0.2)).sum() > 80


def test_a_wrong_seed_is_told():
    with pytest.raises(ModelError) as error:
        Eye(Scenario(), seed=-1)
    assert str(error.value) == "seed = -1: expected a whole number >= 0"


def test_a_look_that_failed_is_made_up_for():
    eye, other = Eye(Scenario()), Eye(Scenario())
    for e in (eye, other):
        e.see(Pose(0, 0, 2.4), WorldScene(ball=(1.2, 0.0, 0.17, 0.17)), 0)
    with pytest.raises(ModelError):
        eye.see(Pose(0, 0, 2.4), WorldScene(ball=(0.8, 0.0, 0.17, 0.17)), 0)
    last = Pose(0, 0, 2.4), WorldScene(ball=(1.0, 0.0, 0.17, 0.17)), 1000
    assert eye.see(*last) == other.see(*last)
