"""`pp_psc_delta` beside NEST's: the same potential, and in the mean the same spikes."""

import numpy as np
import pytest

import neuro

PARAMETERS = {"tau_m": 8.0, "C_m": 100.0, "dead_time": 2.0, "I_e": 20.0}
TIMES, WEIGHT = [3.0, 5.5, 5.6, 9.0], 4.0


def ours(n, ms, **parameters):
    net = neuro.Network("point", resolution=0.1)
    net.population("in", 1, neuro.spike_generator(spike_times=[TIMES]))
    net.population("cells", n, neuro.pp_psc_delta(**PARAMETERS, **parameters))
    net.connect("in", "cells", neuro.all_to_all(), weight=WEIGHT, delay=1.0)
    net.probe("v", "cells", record="V_m", every=0.1)
    sim = neuro.compile(net, seed=3)
    sim.run(ms)
    return sim


def theirs(nest, n, ms, **parameters):
    nest.resolution, nest.rng_seed = 0.1, 3
    lists = {name: [value] for name, value in parameters.items() if name in ("tau_sfa", "q_sfa")}
    cells = nest.Create("pp_psc_delta", n, params=PARAMETERS | parameters | lists)
    source = nest.Create("spike_generator", params={"spike_times": TIMES})
    nest.Connect(source, cells, syn_spec={"weight": WEIGHT, "delay": 1.0})
    meter = nest.Create("multimeter", params={"record_from": ["V_m"], "interval": 0.1})
    recorder = nest.Create("spike_recorder")
    nest.Connect(meter, cells[0])
    nest.Connect(cells, recorder)
    nest.Simulate(ms)
    return meter.get("events", "V_m"), recorder.n_events


def test_the_potential_is_that_of_nest(own_nest):
    rates = {"c_1": 0.0, "c_2": 0.0, "c_3": 0.0}
    v, spikes = theirs(own_nest, 1, 30.0, **rates)
    sim = ours(1, 30.0, **rates)
    assert spikes == len(sim.spikes("cells")[0]) == 0
    np.testing.assert_allclose(sim.trace("v")[1][: len(v), 0], v, rtol=1e-12)


@pytest.mark.parametrize(
    "rates",
    [
        {"c_1": 30.0, "c_2": 40.0, "c_3": 0.0, "with_reset": False},
        {"c_1": 0.0, "c_2": 20.0, "c_3": 0.8, "with_reset": True},
        {"c_1": -50.0, "c_2": 10.0, "c_3": 0.0, "with_reset": False},
        {"c_1": 300.0, "c_2": 400.0, "c_3": 0.0, "with_reset": False, "tau_sfa": 12.0, "q_sfa": 0.8},
    ],
)
def test_rates_are_those_of_nest(own_nest, rates):
    n, ms = 400, 200.0
    _, spikes = theirs(own_nest, n, ms, **rates)
    found = len(ours(n, ms, **rates).spikes("cells")[0])
    # Counts of a process with a dead time vary less than those of a Poisson process.
    assert found == pytest.approx(spikes, abs=4.0 * np.sqrt(found + spikes) + 4.0)


def test_the_threshold_adapts_as_in_nest(own_nest):
    """Spikes that are sure, so that both have the same: the threshold after each, and its decay."""
    rates = {"c_1": 1e6, "c_2": 0.0, "c_3": 0.0, "with_reset": False, "tau_sfa": 5.0, "q_sfa": 6.0}
    v, spikes = theirs(own_nest, 1, 30.0, **rates)
    sim = ours(1, 30.0, **rates)
    assert len(sim.spikes("cells")[0]) == spikes > 3
    np.testing.assert_allclose(sim.trace("v")[1][: len(v), 0], v, rtol=1e-12)
