"""Codes of one spike a value."""

import numpy as np
import pytest
from hypothesis import given, strategies as st

from neuro import ModelError
from neuro.coding import intensity_to_latency, log_intensity_to_latency, rank

CODES = [intensity_to_latency, log_intensity_to_latency]


@pytest.mark.parametrize("code", CODES)
@given(st.lists(st.floats(0.1, 10.0), min_size=2), st.floats(0.1, 1000.0))
def test_larger_values_spike_earlier(code, values, window):
    r = np.sort(values)
    t = code(r, 0.1, 10.0, window)
    assert (np.diff(t) <= 0).all()
    assert (t >= 0).all()
    assert (t <= window * (1 + 1e-12)).all()
    assert code(10.0, 0.1, 10.0, window) == 0.0
    assert code(0.1, 0.1, 10.0, window) == pytest.approx(window)


def test_known_values():
    assert intensity_to_latency([0.0, 5.0, 10.0], 0.0, 10.0, 64.0).tolist() == [64.0, 32.0, 0.0]
    np.testing.assert_allclose(intensity_to_latency([1, 2, 4, 8], 1, 8, 100), [100, 600 / 7, 400 / 7, 0], rtol=1e-15)
    np.testing.assert_allclose(log_intensity_to_latency([1, 2, 4, 8], 1, 8, 100), [100, 200 / 3, 100 / 3, 0])
    np.testing.assert_allclose(log_intensity_to_latency([0.1, 1.0, 10.0], 0.1, 10.0, 64.0), [64.0, 32.0, 0.0])


def test_what_has_no_logarithm_has_no_spike():
    times = log_intensity_to_latency([[0.0, 1.0], [-3.0, 8.0]], 1.0, 8.0, 100.0)
    np.testing.assert_array_equal(times, [[np.nan, 100.0], [np.nan, 0.0]])


@pytest.mark.parametrize("code", CODES)
@pytest.mark.parametrize("shape", [(), (0,), (2, 0), (3, 4)])
def test_times_have_the_shape_of_the_values(code, shape):
    assert code(np.ones(shape), 0.5, 2.0, 10.0).shape == shape
    assert rank(np.ones(shape)).shape == shape


@pytest.mark.parametrize("code", CODES)
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([0.5, 3.0, 4.0], 1.0, 2.0, 1.0), "value 0.5 is outside of [1.0, 2.0]"),
        (([np.nan], 1.0, 2.0, 1.0), "value nan is outside of [1.0, 2.0]"),
        (([-np.inf], 1.0, 2.0, 1.0), "value -inf is outside of [1.0, 2.0]"),
        (([1.0], 1.0, 1.0, 1.0), "r_min is 1.0 and r_max 1.0, expected r_min < r_max"),
        (([1.0], 1.0, np.inf, 1.0), "r_max = .inf: expected a finite number"),
        (([1.0], 1.0, 2.0, 0.0), "window = 0: expected a number > 0"),
        (([1.0], 1.0, 2.0, np.nan), "window = .nan: expected a finite number > 0"),
    ],
)
def test_messages(code, arguments, message):
    with pytest.raises(ModelError) as error:
        code(*arguments)
    assert str(error.value) == message


@pytest.mark.parametrize("code", CODES)
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((None, 1.0, 2.0, 1.0), "r: found None: expected numbers"),
        (("x", 1.0, 2.0, 1.0), "r: found 'x': expected numbers"),
        (([1.0], None, 2.0, 1.0), "r_min has no value: expected a number"),
        (([1.0], 1.0, "x", 1.0), "r_max = 'x': expected a number"),
        (([1.0], 1.0, 2.0, []), "window = []: expected a number > 0"),
        (([1.0], [], [], []), "r_min = []: expected a number"),
    ],
)
def test_no_numbers(code, arguments, message):
    with pytest.raises(ModelError) as error:
        code(*arguments)
    assert str(error.value) == message


def test_logarithm_needs_a_positive_minimum():
    with pytest.raises(ModelError, match=r"r_min = 0: expected a number > 0"):
        log_intensity_to_latency([1.0], 0.0, 2.0, 1.0)


def test_ranks():
    r = [0.2, 0.9, 0.5, 0.9, 0.1]
    assert rank(r).tolist() == [4, 1, 3, 2, 5]
    assert rank(r, "dense").tolist() == [3, 1, 2, 1, 4]
    np.testing.assert_allclose(rank(r, window=100.0), [80, 20, 60, 40, 100])
    np.testing.assert_allclose(rank(r, "dense", 100.0), [60, 20, 40, 20, 80])


def test_equal_values_spike_in_turn_or_together():
    assert rank([[7.0, 7.0], [7.0, 7.0]]).tolist() == [[1, 2], [3, 4]]
    assert rank([[7.0, 7.0], [7.0, 7.0]], "dense").tolist() == [[1, 1], [1, 1]]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([1.0, np.nan],), "r[1] = .nan: expected a finite number"),
        (("x",), "r: found 'x': expected numbers"),
        (([1.0], "shared"), "ties = 'shared': expected one of order, dense\n  hint: known: dense, order"),
        (([1.0], "order", 0.0), "window = 0: expected a number > 0"),
    ],
)
def test_what_cannot_be_ranked(arguments, message):
    with pytest.raises(ModelError) as error:
        rank(*arguments)
    assert str(error.value) == message
