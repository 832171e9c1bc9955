"""Codes that give rates."""

import numpy as np
import pytest

from neuro import ModelError
from neuro.coding import intensity_to_latency, population, rate


def test_rates_are_in_proportion():
    assert rate([1.0, 2.0, 3.0], 1.0, 3.0, 50.0).tolist() == [0.0, 25.0, 50.0]
    assert rate([[1.0, 3.0]], 1.0, 3.0, 50.0, min_rate=10.0).tolist() == [[10.0, 50.0]]


def test_gaussian_fields_lie_where_bohte_puts_them():
    """Centres (2i - 3)/2 (max - min)/(m - 2) for i from 1, width (max - min)/(1.5 (m - 2))."""
    low, high, n = -2.0, 4.0, 8
    i = np.arange(1, n + 1)
    centres = low + (2 * i - 3) / 2 * (high - low) / (n - 2)
    width = (high - low) / (1.5 * (n - 2))
    r = np.array([[-2.0, 0.3], [1.5, 4.0]])
    expected = 80.0 * np.exp(-0.5 * ((r[..., None] - centres) / width) ** 2)
    np.testing.assert_allclose(population(r, n, low, high, 80.0), expected, rtol=1e-12)
    np.testing.assert_allclose(population(centres[1:-1], n, low, high, 80.0).max(axis=1), 80.0)


def test_cosine_fields_lie_on_a_circle():
    r = np.array([0.0, 45.0, 360.0])
    expected = np.maximum(np.cos(np.deg2rad(r[:, None] - np.arange(0, 360, 45))), 0.0)
    np.testing.assert_allclose(population(r, 8, 0.0, 360.0, 1.0, "cosine"), expected, atol=1e-15)


def test_fields_become_latencies():
    times = intensity_to_latency(population([0.5], 5, 0.0, 1.0, 1.0), 0.0, 1.0, 10.0)
    assert times.shape == (1, 5)
    assert times.argmin() == 2
    assert times[0, 2] == 0.0


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: rate([1.0], 0.0, 1.0, 0.0), "min_rate is 0.0 and max_rate 0.0, expected 0 <= min_rate < max_rate"),
        (
            lambda: rate([1.0], 0.0, 1.0, 5.0, -1.0),
            "min_rate is -1.0 and max_rate 5.0, expected 0 <= min_rate < max_rate",
        ),
        (lambda: rate([np.nan], 0.0, 1.0, 5.0), "value nan is outside of [0.0, 1.0]"),
        (lambda: rate([1.0], 1.0, 1.0, 5.0), "r_min is 1.0 and r_max 1.0, expected r_min < r_max"),
        (lambda: population([0.5], 2, 0.0, 1.0, 5.0), "n = 2: expected a whole number >= 3 and <= 1048576"),
        (lambda: population([0.5], 8, 0.0, 1.0, 0), "max_rate = 0: expected a number > 0"),
        (lambda: population([1.5], 8, 0.0, 1.0, 1), "value 1.5 is outside of [0.0, 1.0]"),
        (
            lambda: population([0.5], 8, 0.0, 1.0, 1, "square"),
            "fields = 'square': expected one of gaussian, cosine\n  hint: known: cosine, gaussian",
        ),
    ],
)
def test_messages(call, message):
    with pytest.raises(ModelError) as error:
        call()
    assert str(error.value) == message


@pytest.mark.parametrize("shape", [(), (0,), (2, 3)])
def test_shapes(shape):
    assert rate(np.full(shape, 0.5), 0.0, 1.0, 10.0).shape == shape
    assert population(np.full(shape, 0.5), 4, 0.0, 1.0, 10.0).shape == (*shape, 4)
