"""What version 0.1.0 wrote is read: a network, states, results, models; and what it did after them is done again.

Its HDF5 files had no digest: these were given one, as they would be refused without.
"""

from pathlib import Path

import numpy as np
import pytest

import neuro
from neuro_drone.evaluate import Start, try_out
from neuro_drone.model import Model as DroneModel
from neuro_remus.stored import load as load_remus

STORED = Path(__file__).parent / "stored"


@pytest.mark.parametrize("backend", ["event", "reference"])
def test_a_state_goes_on(backend):
    net = neuro.Network("stored")
    net.population("noise", 6, neuro.poisson_generator(rate=np.linspace(100.0, 900.0, 6)))
    net.population("listed", 2, neuro.spike_generator(spike_times=[[1.0, 7.0, 60.0], [3.0]]))
    net.population("current", 1, neuro.dc_generator(amplitude=200.0, start=5.0, stop=80.0))
    net.population("relay", 6, neuro.parrot_neuron())
    net.population("exp", 6, neuro.iaf_psc_exp(tau_m=neuro.uniform(low=8.0, high=15.0)), initial={"V_m": -60.0})
    net.population("delta", 4, neuro.iaf_psc_delta(V_th=-62.0))
    net.signal("reward", to="delta")
    net.connect("noise", "relay", neuro.one_to_one(), delay=0.1)
    net.connect("listed", "exp", neuro.all_to_all(), weight=500.0, delay=0.7)
    net.connect("current", "exp", neuro.all_to_all(), weight=1.0, delay=0.3)
    delay = neuro.uniform(low=0.1, high=4.0)
    net.connect("relay", "delta", neuro.fixed_indegree(n=5), neuro.stdp(Wmax=6.0, lambda_=0.1), weight=2.0, delay=delay)
    rule = neuro.stdp_dopa(signal="reward", Wmax=9.0, A_plus=0.1, A_minus=0.08, tau_n=30.0)
    net.connect("exp", "delta", neuro.fixed_indegree(n=4), rule, weight=2.0, delay=delay)
    net.connect("exp", "exp", neuro.all_to_all(), weight=np.linspace(-30.0, 30.0, 36).reshape(6, 6), delay=1.5)
    net.probe("V", "delta", "V_m", every=1.0)
    assert neuro.load(STORED / "network.yaml") == net

    sim = neuro.compile(net, backend, seed=5)
    sim.restore(STORED / f"{backend}.h5")
    sim.run(50.0)
    with np.load(STORED / "after.npz") as after:
        for name in ("relay", "exp", "delta"):
            times, ids = sim.spikes(name)
            assert np.array_equal(times, after[f"{backend}.{name}.times"])
            assert np.array_equal(ids, after[f"{backend}.{name}.ids"])
        for name in ("relay_delta", "exp_delta"):
            assert np.array_equal(sim.get(name, "weight"), after[f"{backend}.{name}"])
        assert np.array_equal(sim.get("delta", "V_m"), after[f"{backend}.V"])


def test_a_drone_flies_as_it_did():
    [lap] = try_out(DroneModel.load(STORED / "drone.h5"), starts=[Start((10.0, 0.0))]).each
    assert lap.lap
    assert lap.error_px == pytest.approx(2.8184861357506796, rel=1e-12)


def test_a_recogniser():
    made = load_remus(STORED / "remus.h5")
    assert made.classes == ("a", "b", "c")
    weights = made.method.simulation(made.learnt).weights("c1_s2")
    assert np.array_equal(weights, made.learnt["c1_s2"])
    assert len(weights) == 3 * made.method.layer.per_class
    assert made.method.inputs.shape[0] == weights.shape[1]
