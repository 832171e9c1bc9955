"""The pattern on the ground, and how the eye filters it."""

import numpy as np
import pytest

from neuro_drone.eye import SIZE, Eye, pattern, pyramid, tile
from neuro_drone.geometry import CameraView, Pose, WorldScene
from neuro_drone.scenario import Camera, Ground, Scenario


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
    light = levels[: size * size].reshape(size, size)[j, i]
    return light.reshape(view.size, fine, view.size, fine).mean((1, 3))


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


@pytest.mark.parametrize("tilt", [30.0, 60.0])
def test_the_pattern_does_not_flicker(tilt):
    """A way of a tenth of a pixel changes pixels by no more than it truly does, near and far."""
    ground = Ground(texture=0.5, grain=0.1)
    eye = Eye(Scenario(camera=Camera(tilt=tilt), ground=ground))
    baked = pattern(ground, 1.0, 0)
    images, true = [], []
    for k in range(3):
        images.append(eye.draw(Pose(0.003 * k, 0.001 * k, 2.4), WorldScene())[12:].astype(float))
        true.append(sampled(eye.view, *baked, fine=10)[12:])
    ours, theirs = (np.diff(p, axis=0).reshape(2, 4, -1).std((0, 2)) for p in (images, true))
    assert (ours < 1.1 * theirs).all()


def test_far_away_is_the_mean_and_the_sky_stays():
    eye = Eye(Scenario(camera=Camera(tilt=30.0), ground=Ground(texture=0.5)))
    plain = Eye(Scenario(camera=Camera(tilt=30.0)))
    one, other = (e.draw(Pose(0, 0, 2.4), WorldScene()) for e in (eye, plain))
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
    eye = Eye(Scenario(ground=Ground(texture=0.5)))
    assert np.isfinite(eye.draw(Pose(0, 0, -0.1), WorldScene())).all()
    assert CameraView().size == 128
