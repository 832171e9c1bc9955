"""The star and the hexagon."""

from math import hypot, pi

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

from neuro_drone.paths import hexagon, star

FEW = settings(deadline=None, max_examples=25)
laps = st.floats(0.1, 100.0)


@given(laps)
@FEW
def test_the_star_has_the_length_it_is_given(lap):
    path = star(lap)
    assert path.length == pytest.approx(lap)
    places = np.array([path.at(s) for s in np.linspace(0.0, lap, 4001)])
    assert np.hypot(*np.diff(places, axis=0).T).sum() == pytest.approx(lap, rel=1e-4)


@given(laps, st.floats(-300.0, 300.0), st.integers(-3, 3))
@FEW
def test_the_star_is_closed(lap, s, rounds):
    path = star(lap)
    assert path.at(s + rounds * lap) == pytest.approx(path.at(s), abs=1e-6 * lap)


@given(laps, st.floats(0.0, 1.0))
@FEW
def test_speed_along_the_star_is_even(lap, share):
    path = star(lap)
    (x0, y0), (x1, y1) = path.at(share * lap), path.at((share + 1e-3) * lap)
    assert hypot(x1 - x0, y1 - y0) == pytest.approx(1e-3 * lap, rel=1e-3)


def test_the_star_turns_without_corners_and_has_four_branches():
    points = star(1.0).points
    heading = np.unwrap(np.arctan2(*np.diff(points, axis=0, append=points[:1]).T[::-1]))
    assert np.abs(np.diff(heading)).max() < 0.02
    assert heading[-1] - heading[0] == pytest.approx(2 * pi, abs=0.02)
    radius = np.hypot(*points.T)
    assert ((radius > np.roll(radius, 1)) & (radius >= np.roll(radius, -1))).sum() == 4
    quarter = np.roll(points, -len(points) // 4, 0)
    assert quarter == pytest.approx(points @ np.array([[0.0, 1.0], [-1.0, 0.0]]), abs=1e-5)


def test_the_star_passes_through_its_eight_points():
    points = star(1.0).points
    tips = points[np.hypot(*points.T).argmax()]
    for k in range(8):
        size = np.hypot(*tips) * (0.5 if k % 2 else 1.0)
        corner = size * np.array([np.cos(k * pi / 4), np.sin(k * pi / 4)])
        assert np.hypot(*(points - corner).T).min() < 1e-3


@given(st.floats(0.1, 50.0), st.sampled_from([1, -1]))
def test_the_hexagon(side, direction):
    path = hexagon(side, direction)
    segments = path.segments()
    assert path.length == pytest.approx(6 * side)
    assert segments.shape == (6, 4)
    assert segments[:, 2:] == pytest.approx(np.roll(segments[:, :2], -1, 0))
    assert np.hypot(*(segments[:, 2:] - segments[:, :2]).T) == pytest.approx(np.full(6, side))
    x, y = path.points.T
    area = 0.5 * (x * np.roll(y, -1) - y * np.roll(x, -1)).sum()
    assert np.sign(area) == direction
