"""Steps a second of the emulated Loihi, counting included, and how long a network takes to get onto the chip."""

import pytest
from chip_networks import feedforward, recurrent, sources

import neuro
from neuro.chips import chip, place, quantise
from neuro.compiler import compile_network

AIMS = {"ff": "at least 60,000", "rec": "at least 9,000"}
STEPS = {"ff": 10_000, "rec": 2_000}


@pytest.mark.parametrize("name", AIMS)
def test_steps(benchmark, figure, name):
    sim = neuro.compile(feedforward() if name == "ff" else recurrent(), backend="loihi")
    rounds = 5
    if name == "ff":
        sim.inject("sources", *sources(1000, rounds * STEPS[name] + 100))
    sim.run(100.0)
    benchmark.pedantic(sim.run, args=(float(STEPS[name]),), rounds=rounds)
    figure(f"loihi, {name}", STEPS[name] / benchmark.stats.stats.min, "steps/s", AIMS[name])


def drawn() -> neuro.Network:
    """A million synapses of float neurons with weights of their own."""
    net = neuro.Network("million", resolution=1.0)
    cells = net.population("cells", 10_000, neuro.iaf_psc_exp(I_e=300.0))
    weights = neuro.uniform(low=10.0, high=90.0)
    net.connect(cells, cells, neuro.fixed_indegree(100), weight=weights, delay=1.0)
    return net


def prepared(net: neuro.Network) -> None:
    """Compile, quantise and place."""
    program = compile_network(net, 0)
    target = chip("loihi")
    assert not any(problem.refused for problem in quantise(program, target).problems)
    assert not place(program, target).problems


def test_a_million_synapses_get_onto_the_chip(benchmark, figure):
    prepared(drawn())  # the placement's kernels are loaded
    benchmark.pedantic(prepared, args=(drawn(),), rounds=5)
    figure("compile, quantise, place a million", benchmark.stats.stats.min, "s", "below 2")
