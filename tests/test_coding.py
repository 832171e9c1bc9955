import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from neuro import ModelError
from neuro.coding import intensity_to_latency, log_intensity_to_latency

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
    np.testing.assert_allclose(log_intensity_to_latency([0.1, 1.0, 10.0], 0.1, 10.0, 64.0), [64.0, 32.0, 0.0])


@pytest.mark.parametrize("code", CODES)
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([0.5, 3.0, 4.0], 1.0, 2.0, 1.0), "value 0.5 is outside of [1.0, 2.0]"),
        (([np.nan], 1.0, 2.0, 1.0), "value nan is outside of [1.0, 2.0]"),
        (([1.0], 1.0, 1.0, 1.0), "r_min is 1.0 and r_max 1.0, expected r_min < r_max"),
        (([1.0], 1.0, 2.0, 0.0), "window is 0.0, expected more than 0"),
    ],
)
def test_messages(code, arguments, message):
    with pytest.raises(ValueError) as error:  # noqa: PT011 (the text is compared below)
        code(*arguments)
    assert str(error.value) == message


@pytest.mark.parametrize("code", CODES)
@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((None, 1.0, 2.0, 1.0), "r: found None: expected numbers"),
        (("x", 1.0, 2.0, 1.0), "r: found 'x': expected numbers"),
        (([1.0], None, 2.0, 1.0), "r_min is None, expected a number"),
        (([1.0], 1.0, "x", 1.0), "r_max is 'x', expected a number"),
        (([1.0], 1.0, 2.0, []), "window is [], expected a number"),
        (([1.0], [], [], []), "r_min is [], expected a number"),
    ],
)
def test_no_numbers(code, arguments, message):
    with pytest.raises(ModelError) as error:
        code(*arguments)
    assert str(error.value) == message


def test_logarithm_needs_a_positive_minimum():
    with pytest.raises(ValueError, match=r"r_min is 0\.0, expected more than 0 for a logarithmic code"):
        log_intensity_to_latency([1.0], 0.0, 2.0, 1.0)
