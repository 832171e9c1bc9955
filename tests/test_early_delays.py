"""Delays that cannot be: what is drawn, or follows from distance, is cut to one step only where that is promised."""

import numpy as np
import pytest

import neuro
from neuro import ModelError
from neuro.compiler.resolve import compile_network
from neuro.model.distributions import Distribution


def compiled(delay, resolution: float = 0.1, rule=None):
    net = neuro.Network("early", resolution=resolution)
    for name in ("a", "b"):
        net.population(name, [2, 3], neuro.iaf_psc_exp())
    net.connect("a", "b", rule or neuro.all_to_all(), delay=delay, name="x")
    return compile_network(net, 1).projections[0]


def told(delay, resolution: float = 0.1, rule=None) -> str:
    with pytest.raises(ModelError) as caught:
        compiled(delay, resolution, rule)
    return str(caught.value).partition(": ")[2]


def test_below_zero():
    assert told(neuro.uniform(low=-5, high=-2)) == (
        "projection 'x': delay: uniform.low = -5 ms: expected at least 0 ms\n  hint: low: 0.1 is one step"
    )
    assert told(neuro.uniform(low=-5, high=9)).startswith("projection 'x': delay: uniform.low = -5 ms")


def test_below_a_step():
    assert told(neuro.uniform(low=0, high=0.04)) == (
        "projection 'x': delay: uniform.high = 0.04 ms: expected at least one step, 0.1 ms\n"
        "  hint: a finer resolution has shorter steps"
    )


@pytest.mark.parametrize(
    ("delay", "middle"),
    [
        (neuro.normal(mean=-3, std=1), "-3"),
        (neuro.normal(mean=-3, std=9, high=-1), "-3"),
        (neuro.normal(mean=2, std=9, high=-1), "-1"),
        (neuro.normal(mean=0.02, std=1), "0.02"),
        (neuro.lognormal(mean=-6, std=0.1), "0.00248"),
    ],
)
def test_a_middle_below_a_step(delay, middle):
    assert told(delay) == (
        f"projection 'x': delay: the middle of the {delay.name} is {middle} ms: expected at least one step, 0.1 ms\n"
        f"  hint: only its tail is cut; raise {delay.name}.mean, or set {delay.name}.low"
    )


def test_tails_are_cut_to_one_step():
    bounded = neuro.normal(mean=-3, std=9, low=0.1, high=2)
    for delay in (neuro.normal(mean=0.1, std=0.2), bounded, neuro.uniform(low=0, high=1)):
        assert compiled(delay, rule=neuro.fixed_total_number(n=200)).delay.min() == 1


def test_of_distance_below_zero():
    assert told(neuro.of_distance(neuro.linear(c=-5, a=1))) == (
        "projection 'x': delay of synapse 0 -> 0 = -5 ms: expected at least 0 ms\n"
        "  hint: the function of distance is below 0 there: raise c"
    )
    falls = neuro.of_distance(neuro.linear(c=1.5, a=-1))
    assert told(falls).startswith("projection 'x': delay of synapse 0 -> 2 = -0.5 ms")
    assert told(falls, rule=neuro.pairs(pre=[0, 4, 3], post=[0, 4, 5])).startswith(
        "projection 'x': delay of synapse 3 -> 5 = -0.5 ms"
    )


def test_of_distance_below_a_step():
    assert told(neuro.of_distance(neuro.linear(a=2.0)), rule=neuro.one_to_one()) == (
        "projection 'x': delay: the largest of 6 is 0 ms: expected at least one step, 0.1 ms\n"
        "  hint: the function of distance is too small: raise c"
    )


def test_a_distribution_of_ones_own(registries):
    @neuro.register
    class shifted(Distribution):
        """Below 0."""

        def sample(self, rng, n):
            return rng.random(n) - 2.0

    assert "delay of synapse 0 -> 0 = -1." in told(shifted())
    assert "hint: 'sample' must give at least 0" in told(shifted())


@pytest.mark.parametrize("at", range(2, 7))
def test_a_spike_that_has_arrived_when_weights_are_set_does_not_come_again(at):
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
