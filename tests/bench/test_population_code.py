"""The spikes of a value follow from the value alone, and a series goes on."""

import numpy as np
import pytest

from neuro_bench import METHODS
from neuro_bench.mackey_glass import MackeyGlass, solution
from neuro_bench.series import LEAST, SHOWN, _Cells, _gain, ridge

SMALL = {"cells": 200, "functions": 8, "delays": 6, "ridge": 1e-6, "steep": 2.0, "members": 2}


def test_neurons_and_their_values():
    cells, values = _Cells(100, 2, 0), np.stack((np.random.default_rng(0).uniform(-1.0, 1.0, 20), np.full(20, 0.2)))
    left = np.stack([cells.remaining_shares(each) for each in values.T], axis=1)
    current = LEAST[-1] + _gain(100) * (values[:, :, None] - cells.at[:, None, :])
    assert np.array_equal(left, (current[..., None] >= LEAST).sum(axis=-1) / SHOWN)
    assert len(np.unique(left[0])) >= SHOWN
    cells, late = _Cells(100, 1, 1), (LEAST - LEAST[-1]) / _gain(100)
    values = np.linspace(late.max() - 1.0, 1.0, 300)
    made = np.stack([cells.remaining_shares(np.array([each]))[0] for each in values]) @ cells.decoders(20, 4.5)[0]
    rng = np.random.default_rng((1, 0, 6))
    centre, slope = rng.uniform(-1.0, 1.0, 20), 4.5 * rng.uniform(0.5, 1.4, 20)
    blurred = np.tanh((values[:, None] - late[:, None, None] - centre) * slope).mean(axis=0)
    off = np.std(made - blurred, axis=0) / slope  # of the value; 100 neurons that fire or not have 2 / 100 / sqrt(12)
    assert off.max() < 0.1 * 2.0 / 100 / 12**0.5


def test_series_go_on():
    series, method = 1.0 + 0.3 * np.sin(np.arange(200.0) / 5.0), METHODS["population-code"]()
    model = method.fit(series[:160], {**method.settings, **SMALL}, 0)
    assert np.abs(model.predict(20) - series[160:180]).max() < 0.1
    costs = model.costs(10)
    assert costs.effective_macs == 2 * 200
    assert costs.effective_acs > 0.0
    assert costs.parameters == 2 * 6 * 200
    # Each spike, and the current of each member in 16 steps, is added to the sums of 6 predictions.
    spikes = (costs.host["macs"] - 3 * 2 - 1) / 6 - 2 * SHOWN
    assert spikes == pytest.approx(round(10 * spikes) / 10)
    assert 0.0 < spikes <= 2 * 200 * SHOWN
    assert costs.host["joules"] < costs.joules["SpiNNaker, as fast as it can"] < 0.1
    assert len(costs.joules) == len(costs.joules_of_spikes) == 1
    assert "a spike sets the voltage register to 0" in costs.refused["Loihi"]
    series, method = solution(17, 600), METHODS["population-code"]()
    model = method.fit(series[:500], {**method.settings, "cells": 300, "members": 1}, 0)
    score = MackeyGlass(None, "tau17").score
    assert score(model.predict(100), series[500:]) < 2.0
    assert score(np.full(100, series[:500].mean()), series[500:]) > 20.0
    series, words = solution(17, 600), {"members": 1, "ridge": 1e-7}
    spiking, exact = (METHODS[name]() for name in ("population-code", "tanh-ridge"))
    coded = spiking.fit(series[:500], {**spiking.settings, **words, "cells": 1000}, 0).predict(10)
    model = exact.fit(series[:500], {**exact.settings, **words}, 0)
    assert np.abs(model.predict(10) - coded).max() < 0.02
    assert MackeyGlass().score(model.predict(100), series[500:]) < 2.0
    assert model.costs(1).parameters == 20 * 45
    series, method = 1.0 + 0.3 * np.sin(np.arange(120.0) / 5.0), METHODS["echo-state"]()
    one, two = (method.fit(series, {**method.settings, "units": 30, "members": n}, 0) for n in (1, 2))
    parts = [model.predict(5) for model in two._models]
    assert np.allclose(two.predict(5), np.mean(parts, axis=0))
    assert np.array_equal(one.predict(5), parts[0])
    assert two.costs(5).parameters == 2 * one.costs(5).parameters


@pytest.mark.parametrize("functions", [10, 60])
def test_a_readout_says_the_mean_of_a_series(functions):
    rng = np.random.default_rng(2)
    features, seen = rng.normal(size=(40, functions)), 5.0 + rng.normal(size=40)
    weights, offset = ridge(features, seen, 1, 1.0)
    assert (features[:-1] @ weights[0] + offset).mean() == pytest.approx(seen[1:].mean())
