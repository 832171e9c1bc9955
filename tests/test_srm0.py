"""srm0 beside its closed forms: periods, a LIF whose spikes subtract, the rate of escape."""

from dataclasses import replace

import numpy as np
import pytest

import neuro
from beside import beside
from closed_forms import NOISY, escapes

DRIVEN = {"tau_m": 20.0, "C_m": 200.0, "E_L": 0.0, "V_th": 15.0, "eta_0": 15.0, "I_e": 250.0, "t_ref": 0.0}
"""u0 = 25 mV, theta = 15 mV, eta0 = 15 mV."""


def spikes(model: neuro.srm0, h: float, ms: float, v_0: float, n: int = 1, **compiled):
    net = neuro.Network("alone", resolution=h)
    net.population("cells", n, model, initial={"V_m": v_0})
    sim = neuro.compile(net, **compiled)
    sim.run(ms)
    return sim.spikes("cells")


@pytest.mark.parametrize(("h", "period"), [(0.01, 8.11), (0.1, 8.2)])
def test_the_period_of_the_last_after_potential(h, period):
    """tau ln(eta0/(u0 - theta)) = 8.1093 ms; the next step fires."""
    times, _ = spikes(neuro.srm0(**DRIVEN), h, 100.0, v_0=25.0)
    np.testing.assert_allclose(np.diff(times), period, rtol=1e-12)


@pytest.mark.parametrize("h", [0.01, 0.1])
def test_the_period_of_the_sum_of_after_potentials(h):
    """tau ln(1 + eta0/(u0 - theta)) = 18.3258 ms; what V_m exceeds theta by at a spike brings the next one forward."""
    times, _ = spikes(neuro.srm0(eta_sum=True, **DRIVEN), h, 300.0, v_0=15.0)
    periods = np.diff(times)
    assert periods.size == 16
    assert np.all(np.abs(periods - 20.0 * np.log(2.5)) < h)


(SUBTRACTING,) = beside(__file__, "SUBTRACTING")
"""A LIF of equations whose spikes subtract eta_0 from V_m."""


def test_the_sum_of_after_potentials_is_a_lif_whose_spikes_subtract():
    found = []
    for model in (neuro.equations("subtracting", **SUBTRACTING)(), neuro.srm0(eta_sum=True, t_ref=0.0, I_e=300.0)):
        net = neuro.Network("twins")
        net.population("noise", 50, neuro.poisson_generator(rate=100.0))
        net.population("cells", 10, model)
        net.connect("noise", "cells", neuro.all_to_all(), weight=neuro.uniform(low=-60.0, high=100.0))
        net.probe("v", "cells", "V_m", every=0.1)
        sim = neuro.compile(net, seed=1)
        sim.run(300.0)
        found.append((np.array(sim.spikes("cells")), sim.trace("v")[1]))
    (expected, v), (times, w) = found
    assert expected.shape[1] > 100
    np.testing.assert_array_equal(times, expected)
    np.testing.assert_allclose(w, v, rtol=0.0, atol=1e-12)


def test_the_last_after_potential_takes_the_place_of_the_one_before():
    net = neuro.Network("alone")
    net.population("cell", 1, neuro.srm0(**DRIVEN), initial={"V_m": 25.0})
    for state in ("eta", "V_m"):
        net.probe(state, "cell", state, every=0.1)
    sim = neuro.compile(net)
    sim.run(60.0)
    (t, eta), (_, v), (times, _) = sim.trace("eta"), sim.trace("V_m"), sim.spikes("cell")
    since = t[:, None] - times
    since = np.where(since > -0.05, since, np.inf).min(axis=1)  # a state is read after the spike of its step
    expected = -15.0 * np.exp(-since / 20.0)
    np.testing.assert_allclose(eta[:, 0], expected, atol=1e-12)
    np.testing.assert_allclose(v[:, 0], 25.0 + expected, atol=1e-11)


def test_the_rate_of_escape_is_that_of_the_formula():
    n, h, ms = 1000, 0.1, 1000.0
    counts = escapes(n, ms, h)
    p = 1.0 - np.exp(-h * 0.06 * np.exp(-1.0))
    assert p / h == pytest.approx(0.02207, rel=2e-3)
    steps = n * ms / h
    assert abs(counts.sum() - p * steps) < 4.0 * np.sqrt(p * steps)
    assert counts.var() / counts.mean() == pytest.approx(1.0, abs=4.0 * np.sqrt(2.0 / n))


@pytest.mark.parametrize("compiled", [{"threads": 2}, {"backend": "reference"}])
def test_neither_threads_nor_the_backend_change_what_is_drawn(compiled):
    model = neuro.srm0(lambda_0=neuro.uniform(low=20.0, high=100.0), E_L=-58.0)
    expected = spikes(model, 0.1, 15.0, v_0=-58.0, n=600)
    assert expected[0].size > 100
    np.testing.assert_array_equal(spikes(model, 0.1, 15.0, v_0=-58.0, n=600, **compiled), expected)


def test_seed_and_name_change_what_is_drawn():
    model = NOISY
    times = [spikes(model, 0.1, 50.0, v_0=-57.0, n=20, seed=seed)[0].tolist() for seed in (0, 0, 1)]
    assert times[0] == times[1] != times[2]


def test_certain_escape_is_no_overflow():
    times, _ = spikes(replace(NOISY, Delta_V=1e-3), 1.0, 5.0, v_0=0.0, backend="reference")
    assert times.tolist() == [1.0, 2.0, 3.0, 4.0, 5.0]


def test_the_refractory_period_bounds_the_rate():
    times, _ = spikes(neuro.srm0(**DRIVEN | {"t_ref": 3.0, "I_e": 1000.0}), 0.1, 50.0, v_0=100.0)
    np.testing.assert_allclose(np.diff(times), 3.1)


WARNED = "I_e drives V_m beyond V_th + eta_0 and t_ref is 0, so it fires in every step: set t_ref or eta_sum"


def test_it_warns_where_it_would_fire_in_every_step():
    with pytest.warns(neuro.ModelWarning) as told:
        times, _ = spikes(neuro.srm0(**DRIVEN | {"I_e": 305.0}), 0.1, 50.0, v_0=30.5)
    assert [str(each.message).split(": ", 1)[1] for each in told] == [f"population 'cells': srm0: {WARNED}"]
    assert times.size == 500


@pytest.mark.parametrize("other", [{"eta_sum": True}, {"t_ref": 1.0}, {"lambda_0": 1.0}, {"I_e": 298.0}])
def test_it_does_not_warn_elsewhere(other):
    times, _ = spikes(neuro.srm0(**DRIVEN | {"I_e": 305.0} | other), 0.1, 50.0, v_0=30.5)
    assert times.size < 500


def test_one_without_noise_sleeps_and_one_with_noise_does_not():
    s, i_0 = np.zeros((5, 1)), np.zeros(1)
    s[0] = -70.0
    for rate, sleeps in ((0.0, True), (1e-9, False)):
        model = neuro.srm0(lambda_0=rate)
        c = np.zeros(model.width)
        model.arithmetic.constants(list(model.parameters().values()), 0.1, c)
        assert model.arithmetic.quiet(s, c, i_0, 0, 1) is sleeps
