"""The drone's eye: where points are in the picture, pictures against heavy sampling and PyBullet, what its DVS gets."""

from dataclasses import replace
from math import isinf, radians

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from neuro.events import DVS
from neuro_drone.eye import SIZE, SKY, Eye, pattern, pixels, pyramid, strips, tile
from neuro_drone.geometry import CameraView, Pose, WorldScene
from neuro_drone.parts import Ball, Camera, Ground, Line
from neuro_drone.scenario import Scenario
from refused import refused

POINTS = 100
SPREAD = ((np.indices((POINTS, POINTS)) + np.random.default_rng(0).random((2, POINTS, POINTS))) / POINTS - 0.5).reshape(
    2, -1
)
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
@settings(max_examples=9)
def test_ball_and_horizon_are_exact(camera, pose, place, radius, seed):
    scenario = Scenario(camera=camera, task=Ball(radius=radius, brightness=0.0), ground=Ground(brightness=1.0))
    eye = Eye(scenario)
    eye.view.look(pose)
    x, y = eye.view.ground(*place, radius) or eye.view.ground(63, 127, radius) or (0.0, 0.0)
    ball = (x, y, radius, radius)
    eye.draw(pose, WorldScene(ball=ball))
    check_pixels(eye, lambda ray: on_ball(eye.view, ball, ray), np.random.default_rng(seed))


@pytest.mark.parametrize("place", [(1.5, 0.1, 0.6, 0.37), (1.5, 0.1, 1.1, 0.2), (0.0, 1.1, 2.0, 1.0)])
def test_a_ball_in_the_air_is_exact(place):
    """Beside the camera its outline is no ellipse, as a part of it is behind the camera."""
    eye = Eye(Scenario(task=Ball(radius=1.0, brightness=0.0), ground=Ground(brightness=1.0)))
    eye.draw(Pose(0.0, 0.0, 2.4), WorldScene(place))
    assert eye.image.min() == 0.0
    check_pixels(eye, lambda ray: on_ball(eye.view, place, ray), np.random.default_rng(0))
    assert (1 - eye.image).mean() < 0.95


@given(cameras, poses, st.floats(0.02, 0.5), st.integers(0, 1000))
@settings(max_examples=9)
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
    steps, middle = np.diff(pictures, axis=0), [eye.view.project(*ball[:3])[0] for ball in balls]
    assert np.abs(steps).max() < 1.2 * np.diff(middle).max()
    assert (np.abs(steps) > 1e-3).sum((1, 2)).min() >= 12
    columns = np.arange(128)
    for step, u in zip(steps, middle, strict=False):
        assert step[:, columns > u + 1].max() < 2e-3
        assert step[:, columns < u - 1].min() > -2e-3
    areas = np.array([(1 - p).sum() for p in pictures])
    assert np.ptp(areas) < 2e-3 * areas[0]


def test_the_horizon_light_and_what_failed():
    """tan(30) of 100.46 px above the middle, so between rows 5 and 6."""
    eye = Eye(Scenario(camera=Camera(tilt=30.0)))
    image = eye.draw(Pose(0, 0, 2.4), WorldScene())
    assert (image[:5] == np.float32(SKY)).all()
    assert (image[7:] == np.float32(0.6)).all()
    line = 63.5 - eye.view.focal * np.tan(np.pi / 6)
    assert (image[:, 0] - 0.6).sum() / (SKY - 0.6) == pytest.approx(line + 0.5, abs=1e-3)
    scene, pose = WorldScene(ball=(1.2, 0.0, 0.17, 0.17)), Pose(0, 0, 2.4)
    for ground in GROUNDS:
        one, two = (Eye(Scenario(light=light, ground=ground)).draw(pose, scene) for light in (1.0, 0.25))
        np.testing.assert_allclose(two, 0.25 * one, rtol=1e-5)
    image = Eye(Scenario()).draw(pose, scene)
    assert np.unique(image[[60, 60], [0, 127]]).tolist() == [np.float32(0.6)]
    assert (image == np.float32(0.2)).sum() > 80
    eye, other = Eye(Scenario()), Eye(Scenario())
    for e in (eye, other):
        e.see(Pose(0, 0, 2.4), WorldScene(ball=(1.2, 0.0, 0.17, 0.17)), 0)
    refused(lambda: eye.see(Pose(0, 0, 2.4), WorldScene(ball=(0.8, 0.0, 0.17, 0.17)), 0))
    last = Pose(0, 0, 2.4), WorldScene(ball=(1.0, 0.0, 0.17, 0.17)), 1000
    assert eye.see(*last) == other.see(*last)
    assert refused(lambda: Eye(Scenario(), seed=-1)) == "seed = -1: expected a whole number >= 0"
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


@pytest.mark.parametrize(
    "ball", [None, (-5.0, 0.0, 0.17, 0.17), (0.0, 0.0, 2.4, 0.17), (0.0, 4.0, 2.4, 1.0), (0.0, -4.0, 2.4, 1.0)]
)
def test_what_is_not_in_view_leaves_the_ground(ball):
    """No ball, one behind the camera, one round it, one to its left and right."""
    eye = Eye(Scenario())
    assert (eye.draw(Pose(0, 0, 2.4), WorldScene(ball=ball)) == np.float32(0.6)).all()
    assert eye.box == (0, 0, 128, 128)  # the first picture is all new
    eye.draw(Pose(0, 0, 2.4), WorldScene())
    assert eye.box == (0, 0, 0, 0)


GROUNDS = [Ground(), Ground(texture=0.5)]


@given(st.integers(0, 10_000), st.sampled_from(GROUNDS), st.floats(20, 90), st.sampled_from(["gimbal", "body"]))
@settings(max_examples=14)
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
        before, image = eye.image.copy(), eye.draw(pose, scene)
        fresh.reset(0)
        np.testing.assert_allclose(image, fresh.draw(pose, scene), atol=1e-4)  # the horizon's height
        x0, y0, x1, y1 = eye.box
        changed = image != before
        changed[y0:y1, x0:x1] = False
        assert not changed.any()


@pytest.mark.parametrize("noise", [0.0, 3.0])
@pytest.mark.parametrize("ground", GROUNDS)
def test_events_are_those_of_a_dvs_that_is_shown_the_pictures(noise, ground):
    camera = Camera(leak_rate_hz=noise, shot_noise_rate_hz=noise, sigma_thres=0.01, shake=0.1)
    eye, dvs, total = Eye(Scenario(camera=camera, ground=ground), seed=3), DVS((128, 128), pixels(camera), seed=3), 0
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


def test_shake():
    """Half of the turn to the right is seen where the camera looks down by 60 degrees."""
    eye, straight, pose = Eye(Scenario(camera=Camera(shake=0.5))), CameraView(), Pose(0, 0, 2.4)
    straight.look(pose)
    turns = []
    for _ in range(400):
        eye.draw(pose, WorldScene())
        turns.append(straight.matrix[:2] @ eye.view.matrix[2])
    assert np.degrees(np.std(turns, axis=0)) == pytest.approx([0.25, 0.5], rel=0.15)
    view = CameraView()
    view.look(Pose(0.0, 0.0, 2.0))
    x, y = view.ground(63.5, 63.5)
    view.look(Pose(0.0, 0.0, 2.0), (radians(1.0), radians(0.5)))
    u, v, _ = view.project(x, y, 0.0)
    assert u < 63.0
    assert v < 63.0
    view = CameraView(tilt=60.0, fixed=True)
    view.look(Pose(0.0, 0.0, 2.0))
    x, y = view.ground(63.5, 63.5)
    view.look(Pose(0.0, 0.0, 2.0, pitch=0.05))
    assert view.project(x, y, 0.0)[1] < 63.0  # nose down: the ground goes up the picture
    view.look(Pose(0.0, 0.0, 2.0, roll=0.05))
    assert view.project(x, y, 0.0)[0] > 64.0  # right side down: what is below goes to the right
    view = CameraView(tilt=30.0)
    view.look(Pose(0.0, 0.0, 2.0))
    u, v, depth = view.project(-9.0, 0.0, 0.0)
    assert isinf(u)
    assert isinf(v)
    assert depth <= 0.0
    assert view.ground(63.0, 0.0) is None
    assert view.sees(-0.5, 127.4)
    assert not view.sees(127.5, 3.0)


# outlines of a painted line


def area(corners):
    x, y = corners[..., 0], corners[..., 1]
    return 0.5 * np.abs((x * np.roll(y, -1, -1) - np.roll(x, -1, -1) * y).sum(-1))


def polygon(n, radius, direction=1):
    angle = direction * np.arange(n + 1) * 2 * np.pi / n
    corners = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return np.concatenate([corners[:-1], corners[1:]], axis=1)


@given(st.integers(3, 12), st.floats(0.01, 0.3), st.sampled_from([1, -1]))
def test_a_closed_line_is_a_ring(n, width, direction):
    """Its strips meet without gaps or overlaps: their areas are the outer polygon's without the inner one's."""
    parts, apothem = strips(polygon(n, 2.0, direction), width), 2.0 * np.cos(np.pi / n)
    ring = n * np.tan(np.pi / n) * ((apothem + width / 2) ** 2 - (apothem - width / 2) ** 2)
    assert area(parts).sum() == pytest.approx(ring)
    for one, other in zip(parts, np.roll(parts, -1, axis=0), strict=True):
        np.testing.assert_allclose(one[[1, 2]], other[[0, 3]], atol=1e-12)


def test_strips():
    parts = strips(np.array([[0.0, 0.0, 2.0, 0.0], [5.0, 0.0, 5.0, 1.0]]), 0.2)
    assert (parts[0].tolist(), area(parts)) == ([[0, 0.1], [2, 0.1], [2, -0.1], [0, -0.1]], pytest.approx([0.4, 0.2]))
    back = strips(np.array([[0.0, 0.0, 2.0, 0.0], [2.0, 0.0, 0.0, 0.1]]), 0.2)
    assert area(back) == pytest.approx([0.4, 0.2 * np.hypot(2, 0.1)])
    parts = strips(np.array([[0.0, 0.0, 1.0, 0.0], [1.0, 0.0, 1.0, 0.0]]), 0.2)
    assert (area(parts), strips(np.zeros((0, 4)), 0.2).shape) == (pytest.approx([0.2, 0.0]), (0, 4, 2))


# the pattern on the ground


def ground_of(view, fine):
    """Places on the ground of fine x fine points in each pixel, m."""
    side = (np.arange(view.size * fine) + 0.5) / fine - 0.5
    a, b = np.meshgrid((side - view.middle) / view.focal, (side - view.middle) / view.focal)
    right, down, forward, place = view.matrix
    ray = a[..., None] * right + b[..., None] * down + forward
    return place[:2] - place[2] / ray[..., 2:] * ray[..., :2]


def sampled(view, levels, size, texel, fine=8):
    """Means of the pattern over pixels, by sampling its nearest texels."""
    i, j = np.moveaxis(np.floor(ground_of(view, fine) / texel).astype(int) % size, -1, 0)
    return levels[: size * size].reshape(size, size)[j, i].reshape(view.size, fine, view.size, fine).mean((1, 3))


def test_the_tile():
    one = tile(np.random.default_rng(0))
    assert one.shape == (SIZE, SIZE)
    assert abs(one.mean()) < 1e-12
    assert np.abs(one).max() == pytest.approx(1.0)
    assert one.std() > 0.2
    quarters = [one[:256, :256], one[256:, 256:]]
    assert quarters[0].std() == pytest.approx(quarters[1].std(), rel=0.1)  # the same everywhere
    steps = np.abs(np.diff(one, axis=1)).max()
    assert np.abs(one[:, 0] - one[:, -1]).max() <= steps  # it goes on where it is repeated
    assert np.abs(one[0] - one[-1]).max() <= 1.2 * steps


def test_the_pyramid_is_of_means():
    one = tile(np.random.default_rng(1))
    levels = pyramid(one)
    assert levels.size == sum((SIZE >> k) ** 2 for k in range(10))
    np.testing.assert_allclose(levels[SIZE**2 : SIZE**2 + 256], one.reshape(256, 2, 256, 2).mean((1, 3))[0], atol=1e-6)
    assert levels[-1] == pytest.approx(one.mean(), abs=1e-6)


def test_contrast_grain_light_and_seed():
    levels, size, texel = pattern(Ground(brightness=0.5, texture=0.4, grain=0.32), 0.5, 3)
    assert size * texel == pytest.approx(32 * 0.32)
    fine = levels[: size * size]
    assert fine.mean() == pytest.approx(0.25, rel=1e-5)
    assert np.abs(fine - 0.25).max() == pytest.approx(0.4 * 0.25, rel=1e-4)
    ground = Ground(texture=0.4)
    assert not np.array_equal(pattern(ground, 1.0, 0)[0], pattern(ground, 1.0, 1)[0])
    assert np.array_equal(pattern(ground, 1.0, 1)[0], pattern(ground, 1.0, 1)[0])
    assert pattern(Ground(), 1.0, 0)[0].size == 0


@pytest.mark.parametrize(("tilt", "grain", "roll"), [(60.0, 0.2, 0.0), (90.0, 0.2, 0.0), (60.0, 1.0, 0.3)])
def test_pixels_are_means_of_what_they_see(tilt, grain, roll):
    """Nearly: the square of a pixel on the ground is taken as wide as it is long."""
    ground = Ground(texture=0.5, grain=grain)
    eye = Eye(Scenario(camera=Camera(tilt=tilt, mount="body"), ground=ground))
    image = eye.draw(Pose(0.3, -7.1, 2.4, 1.0, 0.0, roll), WorldScene())
    true = sampled(eye.view, *pattern(ground, 1.0, 0))
    assert np.corrcoef(image.ravel(), true.ravel())[0, 1] > 0.96
    assert (image - true).std() < 0.3 * true.std()
    assert image.std() < true.std()


def test_the_pattern_does_not_flicker():
    """A way of a tenth of a pixel changes pixels by no more than it truly does, near and far."""
    ground = Ground(texture=0.5, grain=0.1)
    eye, baked = Eye(Scenario(camera=Camera(tilt=30.0), ground=ground)), pattern(ground, 1.0, 0)
    images, true = [], []
    for k in range(3):
        images.append(eye.draw(Pose(0.003 * k, 0.001 * k, 2.4), WorldScene())[12:].astype(float))
        true.append(sampled(eye.view, *baked, fine=10)[12:])
    ours, theirs = (np.diff(p, axis=0).reshape(2, 4, -1).std((0, 2)) for p in (images, true))
    assert (ours < 1.1 * theirs).all()


def test_far_away_is_the_mean_and_the_sky_stays():
    eye = Eye(Scenario(camera=Camera(tilt=30.0), ground=Ground(texture=0.5)))
    one, other = (e.draw(Pose(0, 0, 2.4), WorldScene()) for e in (eye, Eye(Scenario(camera=Camera(tilt=30.0)))))
    assert np.array_equal(one[:7], other[:7])
    spread = one.reshape(16, 8, 128).std((1, 2))
    assert spread[2] < spread[8] < spread[15]


def test_heading_and_place_do_not_change_how_sharp_it_is():
    """What is kept of it from picture to picture is right after a flight, a turn, a climb and a tilt."""
    scenario = Scenario(camera=Camera(tilt=45.0, mount="body"), ground=Ground(texture=0.5))
    eye = Eye(scenario)
    poses = [Pose(0, 0, 2.4), Pose(5, 0, 2.4, 2.0), Pose(5, 0, 1.0, 2.0), Pose(5, 0, 1.0, 2.0, 0.1, 0.3)]
    for pose in poses:
        image = eye.draw(pose, WorldScene()).copy()
        np.testing.assert_allclose(image, Eye(scenario).draw(pose, WorldScene()), atol=1e-5)


def test_a_view_from_below_the_ground_is_drawn():
    assert np.isfinite(Eye(Scenario(ground=Ground(texture=0.5))).draw(Pose(0, 0, -0.1), WorldScene())).all()


# where points are in the picture, and where pixels look

angles = st.floats(-3.0, 3.0)
anywhere = st.builds(
    Pose, st.floats(-9, 9), st.floats(-9, 9), st.floats(0.5, 5), angles, st.floats(-0.3, 0.3), st.floats(-0.3, 0.3)
)
columns = st.floats(-0.5, 127.4)


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
    assert np.degrees(np.arccos(left @ right / np.linalg.norm(left) / np.linalg.norm(right))) == pytest.approx(65.0)


@given(anywhere, st.floats(45, 90), columns, columns, st.booleans(), st.floats(0, 0.3))
def test_what_a_pixel_sees_is_seen_there(pose, tilt, u, v, fixed, height):
    view = CameraView(tilt=tilt, fixed=fixed)
    view.look(pose)
    place = view.ground(u, v, height)
    if place is not None:
        assert view.project(*place, height)[:2] == pytest.approx((u, v), abs=1e-6)


@given(anywhere, columns, columns)
def test_a_row_is_at_right_angles_to_its_normal(pose, u, v):
    view = CameraView(fixed=True)
    view.look(pose)
    assert np.dot(view.row(v), view.ray(u, v)) == pytest.approx(0.0, abs=1e-12)
    assert np.dot(view.row(v), view.ray(u, v - 1.0)) > 0.0


@given(anywhere)
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
