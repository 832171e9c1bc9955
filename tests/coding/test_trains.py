"""Codes of several spikes a value."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from neuro import ModelError
from neuro.coding import burst, phase, poisson


def test_a_poisson_train_keeps_rate_and_variance_in_any_bin():
    """50 Hz in bins of 1 ms: one spike a bin would have the Fano factor .95, or 48.77 Hz."""
    times = poisson(np.full(2000, 50.0), window=500.0, seed=1)
    per_train = np.isfinite(times).sum(axis=1)
    assert per_train.mean() == pytest.approx(25.0, abs=4 * np.sqrt(25 / 2000))
    assert per_train.var() == pytest.approx(25.0, rel=4 * np.sqrt(2 / 2000))
    bins = np.floor(times[np.isfinite(times)]).astype(int)
    neurons = np.nonzero(np.isfinite(times))[0]
    per_bin = np.bincount(neurons * 500 + bins, minlength=2000 * 500)
    assert per_bin.mean() == pytest.approx(0.05, abs=4 * np.sqrt(0.05 / 1e6))
    assert per_bin.var() / per_bin.mean() == pytest.approx(1.0, abs=0.01)


def test_poisson_draws_follow_from_the_seed():
    rates = [[10.0, 0.0], [100.0, 40.0]]
    times = poisson(rates, 200.0, seed=3)
    assert times.shape[:2] == (2, 2)
    np.testing.assert_array_equal(times, poisson(rates, 200.0, seed=3))
    assert not np.array_equal(times, poisson(rates, 200.0, seed=4), equal_nan=True)
    assert np.isnan(times[0, 1]).all()
    assert (np.diff(times, axis=-1)[np.isfinite(np.diff(times, axis=-1))] >= 0).all()
    assert poisson([], 10.0).shape == (0, 0)
    assert poisson(0.0, 10.0).shape == (0,)


def test_phases_are_binary_digits():
    times = phase(0.7, 0.0, 1.0, 8.0)
    np.testing.assert_array_equal(times, [0, np.nan, 2, 3, np.nan, np.nan, 6, 7])
    weights = 2.0 ** -(1 + np.arange(8))
    assert weights[np.isfinite(times)].sum() == 0.69921875
    np.testing.assert_array_equal(phase([5.0], -5.0, 5.0, 9.0, bits=3), [[0.0, 3.0, 6.0]])
    assert np.isnan(phase([-5.0], -5.0, 5.0, 9.0, bits=3)).all()


@given(st.floats(0.0, 1.0), st.integers(1, 52))
def test_phases_weigh_the_value(p, bits):
    spikes = np.isfinite(phase(p, 0.0, 1.0, 1.0, bits))
    error = abs((2.0 ** -(1 + np.arange(bits)))[spikes].sum() - p)
    assert error <= 2.0 ** -(bits + 1) or (p > 1 - 2.0**-bits and spikes.all())


def test_bursts():
    times = burst([0.0, 0.1, 0.3, 0.5, 0.8, 1.0], 0.0, 1.0)
    nan = np.nan
    expected = [
        [nan, nan, nan, nan, nan],
        [0, nan, nan, nan, nan],
        [0, 15, nan, nan, nan],
        [0, 11, 22, nan, nan],
        [0, 6, 12, 18, nan],
        [0, 2, 4, 6, 8],
    ]
    np.testing.assert_array_equal(times, expected)


def test_a_burst_does_not_gain_a_spike_by_rounding():
    r = np.arange(1, 8) * 0.1 + 0.2  # 0.7000000000000001 is 0.7
    assert np.isfinite(burst(r, 0.2, 1.2, n_max=10)).sum(axis=1).tolist() == [1, 2, 3, 4, 5, 6, 7]


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: poisson([-1.0], 10.0), "r[0] = -1: expected a number >= 0 Hz"),
        (lambda: poisson([np.nan], 10.0), "r[0] = .nan: expected a finite number >= 0 Hz"),
        (lambda: poisson([1.0], -1), "window = -1: expected a number > 0"),
        (lambda: poisson([1.0], 1.0, 0.5), "seed = 0.5: expected a whole number >= 0 and <= 18446744073709551615"),
        (
            lambda: poisson([1e9, 0.0], 1e3),
            "up to 1e+09 spikes of each of 2 trains, expected a table of at most 268435456 times",
        ),
        (lambda: phase([2.0], 0.0, 1.0, 8.0), "value 2.0 is outside of [0.0, 1.0]"),
        (lambda: phase([np.nan], 0.0, 1.0, 8.0), "value nan is outside of [0.0, 1.0]"),
        (lambda: phase([0.5], 1.0, 1.0, 8.0), "r_min is 1.0 and r_max 1.0, expected r_min < r_max"),
        (lambda: phase([0.5], 0.0, 1.0, 8.0, 0), "bits = 0: expected a whole number >= 1 and <= 52"),
        (lambda: phase([0.5], 0.0, 1.0, 8.0, True), "bits = true: expected a whole number >= 1 and <= 52"),
        (lambda: burst([0.5], 0.0, 1.0, 2.5), "n_max = 2.5: expected a whole number >= 1 and <= 1000"),
        (lambda: burst([0.5], 0.0, 1.0, t_min=30.0), "t_min is 30.0 and t_max 20.0, expected t_min <= t_max"),
        (lambda: burst([0.5], 0.0, 1.0, t_min=0.0), "t_min = 0: expected a number > 0"),
        (lambda: burst([None], 0.0, 1.0), "r: found [None]: expected numbers"),
    ],
)
def test_messages(call, message):
    with pytest.raises(ModelError) as error:
        call()
    assert str(error.value) == message


@pytest.mark.parametrize("shape", [(), (0,), (2, 3)])
def test_times_have_one_more_axis(shape):
    assert phase(np.full(shape, 0.5), 0.0, 1.0, 8.0).shape == (*shape, 8)
    assert burst(np.full(shape, 0.5), 0.0, 1.0).shape == (*shape, 5)
