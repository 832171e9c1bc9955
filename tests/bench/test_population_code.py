"""The spikes of a value follow from the value alone, and a series goes on."""

import numpy as np

from neuro_bench import METHODS
from neuro_bench.population_code import _Cells

SMALL = {"cells": 400, "functions": 8, "delays": 6, "ridge": 1e-6, "members": 2}


def test_who_fires_depends_on_the_value_alone():
    cells = _Cells(100, 2, 0)
    values = np.array([[-1.0, 0.3, 2.0, 0.3, -2.9, 0.3], [0.5] * 6])
    counts = cells.counts(values)
    assert np.array_equal(counts[0, 1], counts[0, 3])
    assert np.array_equal(counts[0, 1], counts[0, 5])
    assert (counts[1] == counts[1, 0]).all()
    assert set(np.unique(counts)) == {0.0, 1.0}
    ordered = cells.counts(np.tile(np.linspace(-2.9, 2.9, 40), (2, 1)))
    up = np.diff(ordered, axis=1)
    assert ((up >= 0).all(axis=1) | (up <= 0).all(axis=1)).all()  # from some value on, up or down


def test_neurons_say_functions_of_the_value():
    cells = _Cells(400, 1, 1)
    values = np.linspace(-2.8, 2.8, 57)
    made = cells.counts(values[None, :])[0] @ cells.decoders(5, 1.0)[0]
    rng = np.random.default_rng((1, 0, 6))
    centre, slope = rng.uniform(-3.0, 3.0, 5), rng.uniform(0.5, 1.4, 5)
    wanted = np.tanh((values[:, None] - centre) * slope)
    off = made - wanted
    assert np.abs(off - off.mean(axis=0)).max() < 1.4 * 6.0 / 400  # a neuron's change of the steepest function


def test_a_series_goes_on():
    series = 1.0 + 0.3 * np.sin(np.arange(200.0) / 5.0)
    method = METHODS["population-code"]()
    model = method.fit(series[:160], {**method.settings, **SMALL}, 0)
    assert np.abs(model.predict(20) - series[160:180]).max() < 0.1
    costs = model.costs(10)
    assert costs.effective_macs == 2 * 2 * 400
    assert costs.effective_acs > 0.0
    assert costs.parameters == 2 * 2 * 6 * 400
    assert 0.0 < next(iter(costs.joules.values())) < 1e-3


def test_members_of_a_reservoir_are_averaged():
    series = 1.0 + 0.3 * np.sin(np.arange(120.0) / 5.0)
    method = METHODS["echo-state"]()
    one, two = (method.fit(series, {**method.settings, "units": 30, "members": n}, 0) for n in (1, 2))
    parts = [model.predict(5) for model in two._models]
    assert np.allclose(two.predict(5), np.mean(parts, axis=0))
    assert np.array_equal(one.predict(5), parts[0])
    assert two.costs(5).parameters == 2 * one.costs(5).parameters
