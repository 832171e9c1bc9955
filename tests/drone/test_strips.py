"""Outlines of a painted line."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from neuro_drone.eye import strips


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
    parts = strips(polygon(n, 2.0, direction), width)
    apothem = 2.0 * np.cos(np.pi / n)
    ring = n * np.tan(np.pi / n) * ((apothem + width / 2) ** 2 - (apothem - width / 2) ** 2)
    assert area(parts).sum() == pytest.approx(ring)
    for one, other in zip(parts, np.roll(parts, -1, axis=0), strict=True):
        np.testing.assert_allclose(one[[1, 2]], other[[0, 3]], atol=1e-12)


def test_ends_are_square():
    parts = strips(np.array([[0.0, 0.0, 2.0, 0.0], [5.0, 0.0, 5.0, 1.0]]), 0.2)
    assert parts[0].tolist() == [[0, 0.1], [2, 0.1], [2, -0.1], [0, -0.1]]
    assert area(parts) == pytest.approx([0.4, 0.2])


def test_a_sharp_turn_is_not_mitred():
    back = strips(np.array([[0.0, 0.0, 2.0, 0.0], [2.0, 0.0, 0.0, 0.1]]), 0.2)
    assert area(back) == pytest.approx([0.4, 0.2 * np.hypot(2, 0.1)])


def test_a_segment_without_a_length_is_nothing():
    parts = strips(np.array([[0.0, 0.0, 1.0, 0.0], [1.0, 0.0, 1.0, 0.0]]), 0.2)
    assert area(parts) == pytest.approx([0.2, 0.0])
    assert strips(np.zeros((0, 4)), 0.2).shape == (0, 4, 2)
