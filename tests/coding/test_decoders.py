"""Decoders against closed forms."""

import numpy as np
import pytest
from scipy.stats import skellam

from neuro import ModelError
from neuro.coding import (
    first_to_fire,
    highest_rate,
    poisson,
    population,
    population_vector,
    rank_order,
    van_rossum,
)

TIMES = 4000
"""How often a race is run; chances near .6 to .8 are then known to .008."""


@pytest.fixture(scope="module")
def races():
    """Two Poisson trains of 60 and 40 Hz for 200 ms, many times."""
    return poisson(np.tile([60.0, 40.0], (TIMES, 1)), 200.0, seed=5)


def test_the_higher_rate_has_more_spikes_as_skellam_says(races):
    expected = skellam.sf(0, 12, 8) + skellam.pmf(0, 12, 8) / 2
    assert expected == pytest.approx(0.8141, abs=5e-5)
    counts = np.isfinite(races).sum(axis=2)
    right = [np.mean(highest_rate(pair) == 0) for pair in counts]  # 1/2 where both are listed
    assert np.mean(right) == pytest.approx(expected, abs=0.02)


def test_the_first_spike_is_a_race(races):
    first = [first_to_fire(trial).tolist() for trial in races]
    assert np.mean([winner == [0] for winner in first]) == pytest.approx(60 / (60 + 40), abs=0.025)


def test_ties_are_listed_and_silence_has_no_winner():
    assert highest_rate([3, 5, 5, 0]).tolist() == [1, 2]
    assert highest_rate([0.0, 0.0]).tolist() == []
    assert highest_rate([]).tolist() == []
    assert first_to_fire([4.0, np.nan, 2.0, 2.0]).tolist() == [2, 3]
    assert first_to_fire([[4.0, 9.0], [np.nan, 1.0], [np.nan, np.nan]]).tolist() == [1]
    assert first_to_fire([np.nan, np.nan]).tolist() == []
    assert first_to_fire(np.zeros((3, 0))).tolist() == []
    assert first_to_fire([]).tolist() == []


def test_rank_order_is_largest_in_the_order_of_the_weights():
    weights = [0.5, 0.25, 0.125]
    assert rank_order([1.0, 2.0, 3.0], weights) == pytest.approx(0.78, rel=1e-15)
    assert rank_order([3.0, 2.0, 1.0], weights) == pytest.approx(0.645, rel=1e-15)
    assert rank_order([1.0, np.nan, 3.0], weights) == pytest.approx(0.5 + 0.8 * 0.125)
    assert rank_order([1.0, 1.0, 3.0], weights, ties="dense") == pytest.approx(0.75 + 0.8 * 0.125)
    np.testing.assert_allclose(rank_order([3.0, 1.0], [[1.0, 0.0], [0.0, 1.0]], 0.5), [0.5, 1.0])
    assert rank_order([np.nan], [2.0]) == 0.0


def test_eight_rectified_cosines_tell_the_angle_exactly():
    angles = np.linspace(-np.pi, np.pi, 1001)[1:]
    activity = population(angles, 8, -np.pi, np.pi, 1.0, "cosine")
    told = population_vector(activity, -np.pi + np.arange(8) * np.pi / 4)
    assert abs(np.angle(np.exp(1j * (told - angles)))).max() < 1e-15


def test_eight_von_mises_fields_tell_it_nearly():
    angles = np.linspace(-3.0, 3.0, 1001)
    preferred = np.arange(8) * np.pi / 4
    told = population_vector(np.exp(2.0 * np.cos(angles[:, None] - preferred)), preferred)
    assert abs(told - angles).max() == pytest.approx(1.4e-4, abs=5e-6)


def test_a_silent_population_has_no_direction():
    assert population_vector([3.0, 1.0], [0.5, 0.5]) == pytest.approx(0.5)
    np.testing.assert_array_equal(population_vector([[0.0, 0.0], [0.0, 1.0]], [1.0, 2.0]), [np.nan, 2.0])


@pytest.mark.parametrize("counts", [[1, 0, 1, 0], [5, 5], [5] * 8, [3, 0, 0, 3, 0, 0, 3, 0, 0], [0.1] * 360])
@pytest.mark.parametrize("first", [0.0, -np.pi, 0.3])
def test_activity_that_cancels_has_no_direction(counts, first):
    directions = first + np.arange(len(counts)) * 2 * np.pi / len(counts)
    assert np.isnan(population_vector(counts, directions))
    slightly = np.asarray(counts, float)
    slightly[0] *= 1 + 1e-9
    told = population_vector(slightly, directions)
    assert np.exp(1j * told) == pytest.approx(np.exp(1j * first), abs=1e-3)


def test_the_filter_sums_what_is_left_of_each_spike():
    spikes, at = np.array([20.0, 5.0, np.nan, 5.0, 400.0]), np.array([[0.0, 5.0], [19.9, 20.0], [100.0, 1e5]])
    gone = at[..., None] - spikes[np.isfinite(spikes)]
    expected = np.where(gone >= 0, np.exp(-np.maximum(gone, 0) / 10.0), 0.0).sum(axis=-1)
    np.testing.assert_allclose(van_rossum(spikes, 10.0, at), expected, rtol=1e-13)
    assert van_rossum([], 10.0, [1.0, 2.0]).tolist() == [0.0, 0.0]


@pytest.mark.parametrize(("other", "squared"), [([], 0.5), ([33.0], 1 - np.exp(-0.3)), ([30.0], 0.0)])
def test_the_distance_of_two_trains(other, squared):
    """One spike that is missing, or moved by 3 ms, with tau = 10 ms."""
    h = 0.001
    t = np.arange(0.0, 200.0, h)
    difference = van_rossum([30.0], 10.0, t) - van_rossum(other, 10.0, t)
    assert (difference**2).sum() * h / 10.0 == pytest.approx(squared, abs=1e-4)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: highest_rate([1.0, -1.0]), "counts[1] = -1: expected a number >= 0"),
        (lambda: highest_rate([[1.0]]), "counts has the shape [1, 1], expected one axis"),
        (lambda: highest_rate([np.nan]), "counts[0] = .nan: expected a finite number >= 0"),
        (lambda: first_to_fire(1.0), "times has the shape [], expected [neurons] or [neurons, spikes]"),
        (lambda: first_to_fire([np.inf]), "times has an infinite value, expected times, or NaN for no spike"),
        (lambda: rank_order([1.0], [1.0], 0.0), "modulation = 0: expected a number > 0 and <= 1"),
        (
            lambda: rank_order([1.0], [1.0, 2.0]),
            "weights has the shape [2], expected [..., 1], a weight for each time",
        ),
        (
            lambda: rank_order([1.0], [1.0], ties="x"),
            "ties = 'x': expected one of order, dense\n  hint: known: dense, order",
        ),
        (lambda: population_vector([-1.0], [0.0]), "activity[0] = -1: expected a number >= 0"),
        (
            lambda: population_vector([1.0, 2.0], [0.0]),
            "activity has the shape [2], expected [..., 1], one for each direction",
        ),
        (lambda: van_rossum([1.0], 0.0, [1.0]), "tau = 0: expected a number > 0"),
        (lambda: van_rossum([1.0], 5.0, [np.nan]), "at[0] = .nan: expected a finite number"),
        (lambda: van_rossum(["x"], 5.0, [1.0]), "times: found ['x']: expected numbers"),
    ],
)
def test_messages(call, message):
    with pytest.raises(ModelError) as error:
        call()
    assert str(error.value) == message
