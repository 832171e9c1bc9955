"""`neuro.model.neurons.integrators`: exact systems, orders of convergence, and the steps that are chosen."""

import itertools
import math

import numpy as np
import pytest

from neuro.model.neurons.integrators import advance, fehlberg, runge_kutta


def circle(y, p):
    """cos and sin of p t."""
    (frequency,) = p
    return -frequency * y[1], frequency * y[0]


def growing(y, p):
    """x' = x^2 from 1: 1 / (1 - t)."""
    return (y[0] * y[0],)


def integrate(attempt, rates, y, p, h, size, tolerance):
    t = 0.0
    while t < h:
        y, t, size = advance(attempt, rates, y, p, t, h, size, tolerance)
    return y, size


def error_of_circle(step, steps: int) -> float:
    y = (1.0, 0.0)
    for _ in range(steps):
        y = step(circle, y, (2.0,), 1.0 / steps)
    return math.hypot(y[0] - math.cos(2.0), y[1] - math.sin(2.0))


def fifth(rates, y, p, h):
    return fehlberg(2)(rates, y, p, h)[0]


@pytest.mark.parametrize(("step", "order"), [(runge_kutta(2), 4), (fifth, 5)])
def test_halving_the_step_divides_the_error_by_two_to_the_order(step, order: int):
    errors = [error_of_circle(step, steps) for steps in (8, 16, 32, 64)]
    measured = [math.log2(a / b) for a, b in itertools.pairwise(errors)]
    assert measured == pytest.approx([order] * 3, abs=0.35)


def test_the_estimated_error_is_that_of_order_four():
    """It falls as h^5 in one step."""
    errors = [fehlberg(2)(circle, (1.0, 0.0), (1.0,), h)[1] for h in (0.2, 0.1, 0.05)]
    measured = [math.log2(a / b) for a, b in itertools.pairwise(errors)]
    assert measured == pytest.approx([5.0, 5.0], abs=0.35)


@pytest.mark.parametrize("tolerance", [1e-4, 1e-7, 1e-10])
def test_adaptive_steps_keep_to_the_tolerance(tolerance: float):
    (found,), size = integrate(fehlberg(1), growing, (1.0,), (), 0.9, 0.0, tolerance)
    assert abs(found - 10.0) < 2e3 * tolerance  # an error made early grows by 1 / (1 - t)^2
    assert 0.0 < size < 0.9


def test_a_step_that_is_too_long_is_shortened_and_grows_again():
    """Against the control of GSL, written out."""
    attempt, tolerance = fehlberg(1), 1e-6
    error = attempt(growing, (1.0,), (), 0.8)[1]
    expected = [0.8]
    while error > 1.1 * tolerance:
        expected.append(expected[-1] * max(0.2, 0.9 / (error / tolerance) ** 0.2))
        error = attempt(growing, (1.0,), (), expected[-1])[1]
    growth = 0.9 / (error / tolerance) ** (1 / 6) if error < 0.5 * tolerance else 1.0
    _, t, size = advance(attempt, growing, (1.0,), (), 0.0, 0.8, 0.0, tolerance)
    assert len(expected) > 1
    assert (t, size) == pytest.approx((expected[-1], expected[-1] * min(max(growth, 1.0), 5.0)), rel=1e-12)


def test_an_easy_step_takes_the_whole_grid_and_says_so_by_0():
    y, size = integrate(fehlberg(2), circle, (1.0, 0.0), (0.01,), 0.1, 0.0, 1e-3)
    assert size == 0.0
    assert y == fehlberg(2)(circle, (1.0, 0.0), (0.01,), 0.1)[0]


def test_what_is_no_number_comes_to_an_end():
    (found,), _ = integrate(fehlberg(1), growing, (math.nan,), (), 0.1, 0.0, 1e-3)
    assert math.isnan(found)
    with np.errstate(all="ignore"):
        integrate(fehlberg(1), growing, (np.float64(1e300),), (), 0.1, 0.0, 1e-3)


def leaking(y, p):
    """A potential that a decaying conductance pulls down."""
    g, rate = y[1], p[0]
    return 1.0 - g * y[0], rate * g


@pytest.mark.parametrize("method", [fehlberg, runge_kutta])
def test_what_only_decays_is_taken_out_of_a_step_and_changes_nothing(method):
    y, p = (1.0, 2.0), (-3.0,)
    assert np.hstack(method(2, 1)(leaking, y, p, 0.1)) == pytest.approx(np.hstack(method(2)(leaking, y, p, 0.1)), 1e-13)


def test_rk4_of_a_decay_is_four_terms_of_the_exponential():
    x = -0.3
    (found,) = runge_kutta(1, 1)(lambda y, p: (p[0] * y[0],), (2.0,), (-3.0,), 0.1)
    assert found == pytest.approx(2.0 * (1.0 + x + x**2 / 2.0 + x**3 / 6.0 + x**4 / 24.0), rel=1e-15)
