"""Delays that cannot be: what is drawn, or follows from distance, is cut to one step only where that is promised."""

import numpy as np
import pytest

import neuro
from neuro.compiler.resolve import compile_network
from neuro.model.distributions import Distribution
from neuro_event.building import joined_rows
from refused import without_place


def compiled(delay, resolution: float = 0.1, rule=None):
    net = neuro.Network("early", resolution=resolution)
    for name in ("a", "b"):
        net.population(name, [2, 3], neuro.iaf_psc_exp())
    net.connect("a", "b", rule or neuro.all_to_all(), delay=delay, name="x")
    return compile_network(net, 1).projections[0]


def test_tails_are_cut_to_one_step():
    bounded = neuro.normal(mean=-3, std=9, low=0.1, high=2)
    for delay in (neuro.normal(mean=0.1, std=0.2), bounded, neuro.uniform(low=0, high=1)):
        assert compiled(delay, rule=neuro.fixed_total_number(n=200)).delay.min() == 1


def test_delays_that_are_refused(messages):
    messages.calls(globals())


def test_a_distribution_of_ones_own(registries):
    @neuro.register
    class shifted(Distribution):
        """Below 0."""

        def sample(self, rng, n):
            return rng.random(n) - 2.0

    told = without_place(compiled, shifted())
    assert "delay of synapse 0 -> 0 = -1." in told
    assert "hint: 'sample' must give at least 0" in told


@pytest.mark.parametrize("joined", [True, False])
@pytest.mark.parametrize("at", range(2, 7))
def test_a_spike_that_has_arrived_when_weights_are_set_does_not_come_again(at, joined, monkeypatch):
    if not joined:
        monkeypatch.setattr(joined_rows, "choose", lambda program: frozenset())

    def run(backend):
        net = neuro.Network("set", resolution=1.0)
        net.population("in", 20, neuro.spike_generator(spike_times=[[1.0]] * 20))
        net.population("relay", 20, neuro.parrot_neuron())
        net.population("out", 50, neuro.iaf_psc_exp())
        net.connect("in", "relay", neuro.one_to_one(), delay=1.0)
        net.connect("relay", "out", neuro.all_to_all(), weight=20.0, delay=neuro.uniform(low=1.0, high=3.0), name="w")
        sim = neuro.compile(net, backend, seed=2)
        sim.run(float(at))
        sim.set("w", weight=10.0)
        sim.run(30.0)
        return sim.get("out", "V_m")

    assert np.allclose(run("event"), run("reference"), rtol=1e-12)
