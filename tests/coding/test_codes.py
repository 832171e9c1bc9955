"""Codes of latencies, rates and trains, and decoders: against closed forms, and what they refuse."""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from scipy.stats import skellam

from neuro import coding
from neuro.coding import burst, first_to_fire, highest_rate, phase, poisson, population, population_vector, rank
from refused import refusals_of

LATENCIES = [coding.intensity_to_latency, coding.log_intensity_to_latency]
NAN = np.nan


@pytest.mark.parametrize("code", LATENCIES)
@given(st.lists(st.floats(0.1, 10.0), min_size=2), st.floats(0.1, 1000.0))
def test_larger_values_spike_earlier(code, values, window):
    t = code(np.sort(values), 0.1, 10.0, window)
    assert (np.diff(t) <= 0).all()
    assert (t >= 0).all()
    assert (t <= window * (1 + 1e-12)).all()
    assert (code(10.0, 0.1, 10.0, window), code(0.1, 0.1, 10.0, window)) == (0.0, pytest.approx(window))


def test_known_latencies_ranks_and_rates():
    assert coding.intensity_to_latency([0.0, 5.0, 10.0], 0.0, 10.0, 64.0).tolist() == [64.0, 32.0, 0.0]
    np.testing.assert_allclose(
        coding.intensity_to_latency([1, 2, 4, 8], 1, 8, 100), [100, 600 / 7, 400 / 7, 0], rtol=1e-15
    )
    np.testing.assert_allclose(coding.log_intensity_to_latency([1, 2, 4, 8], 1, 8, 100), [100, 200 / 3, 100 / 3, 0])
    np.testing.assert_allclose(coding.log_intensity_to_latency([0.1, 1.0, 10.0], 0.1, 10.0, 64.0), [64.0, 32.0, 0.0])
    times = coding.log_intensity_to_latency(
        [[0.0, 1.0], [-3.0, 8.0]], 1.0, 8.0, 100.0
    )  # what has no logarithm has no spike
    np.testing.assert_array_equal(times, [[NAN, 100.0], [NAN, 0.0]])
    r = [0.2, 0.9, 0.5, 0.9, 0.1]
    assert (rank(r).tolist(), rank(r, "dense").tolist()) == ([4, 1, 3, 2, 5], [3, 1, 2, 1, 4])
    np.testing.assert_allclose(rank(r, window=100.0), [80, 20, 60, 40, 100])
    np.testing.assert_allclose(rank(r, "dense", 100.0), [60, 20, 40, 20, 80])
    assert rank([[7.0, 7.0], [7.0, 7.0]]).tolist() == [[1, 2], [3, 4]]
    assert rank([[7.0, 7.0], [7.0, 7.0]], "dense").tolist() == [[1, 1], [1, 1]]
    assert coding.rate([1.0, 2.0, 3.0], 1.0, 3.0, 50.0).tolist() == [0.0, 25.0, 50.0]
    assert coding.rate([[1.0, 3.0]], 1.0, 3.0, 50.0, min_rate=10.0).tolist() == [[10.0, 50.0]]


@pytest.mark.parametrize("shape", [(), (0,), (2, 0), (3, 4)])
def test_shapes(shape):
    half = np.full(shape, 0.5)
    assert all(code(half, 0.5, 2.0, 10.0).shape == shape for code in LATENCIES)
    assert rank(half).shape == coding.rate(half, 0.0, 1.0, 10.0).shape == shape
    assert population(half, 4, 0.0, 1.0, 10.0).shape == (*shape, 4)
    assert (phase(half, 0.0, 1.0, 8.0).shape, burst(half, 0.0, 1.0).shape) == ((*shape, 8), (*shape, 5))


def test_fields_of_populations():
    """Centres (2i - 3)/2 (max - min)/(m - 2) for i from 1, width (max - min)/(1.5 (m - 2))."""
    low, high, n = -2.0, 4.0, 8
    centres = low + (2 * np.arange(1, n + 1) - 3) / 2 * (high - low) / (n - 2)
    width, r = (high - low) / (1.5 * (n - 2)), np.array([[-2.0, 0.3], [1.5, 4.0]])
    expected = 80.0 * np.exp(-0.5 * ((r[..., None] - centres) / width) ** 2)
    np.testing.assert_allclose(population(r, n, low, high, 80.0), expected, rtol=1e-12)
    np.testing.assert_allclose(population(centres[1:-1], n, low, high, 80.0).max(axis=1), 80.0)
    times = coding.intensity_to_latency(population([0.5], 5, 0.0, 1.0, 1.0), 0.0, 1.0, 10.0)
    assert (times.argmin(), times[0, 2]) == (2, 0.0)
    r = np.array([0.0, 45.0, 360.0])
    expected = np.maximum(np.cos(np.deg2rad(r[:, None] - np.arange(0, 360, 45))), 0.0)
    np.testing.assert_allclose(population(r, 8, 0.0, 360.0, 1.0, "cosine"), expected, atol=1e-15)
    angles = np.linspace(-np.pi, np.pi, 1001)[1:]
    told = population_vector(population(angles, 8, -np.pi, np.pi, 1.0, "cosine"), -np.pi + np.arange(8) * np.pi / 4)
    assert abs(np.angle(np.exp(1j * (told - angles)))).max() < 1e-15
    angles, preferred = np.linspace(-3.0, 3.0, 1001), np.arange(8) * np.pi / 4
    told = population_vector(np.exp(2.0 * np.cos(angles[:, None] - preferred)), preferred)
    assert abs(told - angles).max() == pytest.approx(1.4e-4, abs=5e-6)
    assert population_vector([3.0, 1.0], [0.5, 0.5]) == pytest.approx(0.5)
    np.testing.assert_array_equal(population_vector([[0.0, 0.0], [0.0, 1.0]], [1.0, 2.0]), [NAN, 2.0])


def test_poisson_trains():
    """50 Hz in bins of 1 ms: one spike a bin would have the Fano factor .95, or 48.77 Hz."""
    times = poisson(np.full(2000, 50.0), window=500.0, seed=1)
    per_train = np.isfinite(times).sum(axis=1)
    assert per_train.mean() == pytest.approx(25.0, abs=4 * np.sqrt(25 / 2000))
    assert per_train.var() == pytest.approx(25.0, rel=4 * np.sqrt(2 / 2000))
    bins = np.floor(times[np.isfinite(times)]).astype(int)
    per_bin = np.bincount(np.nonzero(np.isfinite(times))[0] * 500 + bins, minlength=2000 * 500)
    assert per_bin.mean() == pytest.approx(0.05, abs=4 * np.sqrt(0.05 / 1e6))
    assert per_bin.var() / per_bin.mean() == pytest.approx(1.0, abs=0.01)
    rates = [[10.0, 0.0], [100.0, 40.0]]
    times = poisson(rates, 200.0, seed=3)
    assert times.shape[:2] == (2, 2)
    np.testing.assert_array_equal(times, poisson(rates, 200.0, seed=3))
    assert not np.array_equal(times, poisson(rates, 200.0, seed=4), equal_nan=True)
    assert np.isnan(times[0, 1]).all()
    assert (np.diff(times, axis=-1)[np.isfinite(np.diff(times, axis=-1))] >= 0).all()
    assert (poisson([], 10.0).shape, poisson(0.0, 10.0).shape) == ((0, 0), (0,))


def test_phases_and_bursts():
    times = phase(0.7, 0.0, 1.0, 8.0)
    np.testing.assert_array_equal(times, [0, NAN, 2, 3, NAN, NAN, 6, 7])
    assert (2.0 ** -(1 + np.arange(8)))[np.isfinite(times)].sum() == 0.69921875
    np.testing.assert_array_equal(phase([5.0], -5.0, 5.0, 9.0, bits=3), [[0.0, 3.0, 6.0]])
    assert np.isnan(phase([-5.0], -5.0, 5.0, 9.0, bits=3)).all()
    times = burst([0.0, 0.1, 0.3, 0.5, 0.8, 1.0], 0.0, 1.0)
    spikes = [[], [0], [0, 15], [0, 11, 22], [0, 6, 12, 18], [0, 2, 4, 6, 8]]
    assert [row[np.isfinite(row)].tolist() for row in times] == spikes
    assert [np.isfinite(row[: len(some)]).all() for row, some in zip(times, spikes, strict=True)] == [True] * 6
    r = np.arange(1, 8) * 0.1 + 0.2  # 0.7000000000000001 is 0.7: rounding adds no spike
    assert np.isfinite(burst(r, 0.2, 1.2, n_max=10)).sum(axis=1).tolist() == [1, 2, 3, 4, 5, 6, 7]


@given(st.floats(0.0, 1.0), st.integers(1, 52))
def test_phases_weigh_the_value(p, bits):
    spikes = np.isfinite(phase(p, 0.0, 1.0, 1.0, bits))
    error = abs((2.0 ** -(1 + np.arange(bits)))[spikes].sum() - p)
    assert error <= 2.0 ** -(bits + 1) or (p > 1 - 2.0**-bits and spikes.all())


def test_the_higher_rate_and_the_first_spike_win_as_often_as_they_should():
    """Two Poisson trains of 60 and 40 Hz for 200 ms, 2,000 times; chances near .6 to .8 are then known to .011."""
    races = poisson(np.tile([60.0, 40.0], (2000, 1)), 200.0, seed=5)
    expected = skellam.sf(0, 12, 8) + skellam.pmf(0, 12, 8) / 2
    assert expected == pytest.approx(0.8141, abs=5e-5)
    right = [np.mean(highest_rate(pair) == 0) for pair in np.isfinite(races).sum(axis=2)]  # 1/2 where both are listed
    assert np.mean(right) == pytest.approx(expected, abs=0.03)
    first = [first_to_fire(trial).tolist() == [0] for trial in races]
    assert np.mean(first) == pytest.approx(60 / (60 + 40), abs=0.035)


def test_winners_and_rank_order():
    assert (highest_rate([3, 5, 5, 0]).tolist(), first_to_fire([4.0, NAN, 2.0, 2.0]).tolist()) == ([1, 2], [2, 3])
    assert first_to_fire([[4.0, 9.0], [NAN, 1.0], [NAN, NAN]]).tolist() == [1]
    for silent in (highest_rate([0.0, 0.0]), highest_rate([]), first_to_fire([NAN, NAN]), first_to_fire([])):
        assert silent.tolist() == []
    assert first_to_fire(np.zeros((3, 0))).tolist() == []
    weights = [0.5, 0.25, 0.125]
    assert coding.rank_order([1.0, 2.0, 3.0], weights) == pytest.approx(0.78, rel=1e-15)
    assert coding.rank_order([3.0, 2.0, 1.0], weights) == pytest.approx(0.645, rel=1e-15)
    assert coding.rank_order([1.0, NAN, 3.0], weights) == pytest.approx(0.5 + 0.8 * 0.125)
    assert coding.rank_order([1.0, 1.0, 3.0], weights, ties="dense") == pytest.approx(0.75 + 0.8 * 0.125)
    np.testing.assert_allclose(coding.rank_order([3.0, 1.0], [[1.0, 0.0], [0.0, 1.0]], 0.5), [0.5, 1.0])
    assert coding.rank_order([NAN], [2.0]) == 0.0


@pytest.mark.parametrize("counts", [[1, 0, 1, 0], [5, 5], [5] * 8, [3, 0, 0, 3, 0, 0, 3, 0, 0], [0.1] * 360])
@pytest.mark.parametrize("first", [0.0, -np.pi, 0.3])
def test_activity_that_cancels_has_no_direction(counts, first):
    directions = first + np.arange(len(counts)) * 2 * np.pi / len(counts)
    assert np.isnan(population_vector(counts, directions))
    slightly = np.asarray(counts, float)
    slightly[0] *= 1 + 1e-9
    assert np.exp(1j * population_vector(slightly, directions)) == pytest.approx(np.exp(1j * first), abs=1e-3)


def test_the_filter_sums_what_is_left_of_each_spike():
    spikes, at = np.array([20.0, 5.0, NAN, 5.0, 400.0]), np.array([[0.0, 5.0], [19.9, 20.0], [100.0, 1e5]])
    gone = at[..., None] - spikes[np.isfinite(spikes)]
    expected = np.where(gone >= 0, np.exp(-np.maximum(gone, 0) / 10.0), 0.0).sum(axis=-1)
    np.testing.assert_allclose(coding.van_rossum(spikes, 10.0, at), expected, rtol=1e-13)
    assert coding.van_rossum([], 10.0, [1.0, 2.0]).tolist() == [0.0, 0.0]


@pytest.mark.parametrize(("other", "squared"), [([], 0.5), ([33.0], 1 - np.exp(-0.3)), ([30.0], 0.0)])
def test_the_distance_of_two_trains(other, squared):
    """One spike that is missing, or moved by 3 ms, with tau = 10 ms."""
    t = np.arange(0.0, 200.0, h := 0.001)
    difference = coding.van_rossum([30.0], 10.0, t) - coding.van_rossum(other, 10.0, t)
    assert (difference**2).sum() * h / 10.0 == pytest.approx(squared, abs=1e-4)


def test_messages(messages):
    messages(refusals_of(messages.cases, {name: getattr(coding, name) for name in dir(coding)} | vars(np)))
