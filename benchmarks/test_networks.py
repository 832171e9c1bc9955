"""Speed of large networks, of learning, of a closed loop, of silent neurons, and of the emulated Loihi."""

import pytest
from networks import CHIP_NETWORKS, NETWORKS, learning, loop, silent, sources
from run import WARM_UP_MS, ClosedLoop, PlainLoop, seconds

import neuro
from neuro.chips import chip, place, quantise
from neuro.compiler import compile_network

AIMS = {"brunel": "at most 0.9", "cuba": "at most 0.05", "stdp": "at most 1/8 of NEST's"}
MS = {"brunel": 500.0, "cuba": 1000.0, "stdp": 500.0}
ONE_THREAD = {}


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("case", NETWORKS)
def test_network(benchmark, figure, case, threads):
    """Measure seconds per biological second on one core and on two."""
    sim = warm(NETWORKS[case](), seed=12345, threads=threads)
    benchmark.pedantic(sim.run, args=(MS[case],), rounds=3)
    rate = benchmark.stats.stats.min / MS[case] * 1e3
    benchmark.extra_info["sim_s_per_bio_s"] = rate
    if threads == 1:
        ONE_THREAD[case] = rate
        synapses = sum(p.size for p in sim.program.projections)
        figure(f"{case}", rate, "s/bio s", AIMS[case])
        used = sim.memory()["synapses"] / synapses
        figure(f"{case}: memory of synapses", used, "bytes a synapse", "at most 8" if case == "brunel" else "")
    else:
        figure(f"{case} on two threads", rate, "s/bio s")
        if case in ONE_THREAD:
            aim = "at least 1.5" if case == "brunel" else ""
            figure(f"{case}: two threads against one", ONE_THREAD[case] / rate, "times faster", aim)


def warm(net, seed=1, **words):
    sim = neuro.compile(net, seed=seed, **words)
    sim.run(WARM_UP_MS)
    return sim


LOOP_AIMS = {0.1: "at least 6,000", 1.0: "at least 20,000"}


@pytest.mark.parametrize("way", [ClosedLoop, PlainLoop])
@pytest.mark.parametrize("resolution", LOOP_AIMS)
def test_loop(benchmark, figure, resolution, way):
    """Measure steps per second of a closed loop with rates, dopamine, spikes and weights every 50 ms."""
    driven, steps = way(loop(resolution)), 2000
    driven.steps(20)
    benchmark.pedantic(driven.steps, args=(steps,), rounds=5)
    rate = steps / benchmark.stats.stats.min
    benchmark.extra_info["steps_per_s"] = rate
    aim = LOOP_AIMS[resolution] if way is ClosedLoop else ""
    figure(f"closed loop at {resolution:g} ms, {way.__name__}", rate, "steps/s", aim)


def test_learning(benchmark, figure):
    """Measure the time of STDP in ns per synaptic event, without the delivery of the spike.

    A synaptic event is a pre or post spike at a synapse.
    """
    plain, plastic = (warm(learning(plastic=plastic)) for plastic in (False, True))
    before = plastic.counts().learning_updates
    delivering = min(seconds(plain.run, 1000.0) for _ in range(5))
    benchmark.pedantic(plastic.run, args=(1000.0,), rounds=5)
    events = (plastic.counts().learning_updates - before) / 5
    cost = (benchmark.stats.stats.min - delivering) / events * 1e9
    benchmark.extra_info["ns_per_event"] = cost
    figure("learning by STDP", cost, "ns/event", "at most 40")


SILENT = {
    "beside": ("in the same population", "at most 1.2"),
    "elsewhere": ("in another population", "at most 1.2"),
    "between": ("between the busy ones", ""),
}


@pytest.mark.parametrize("where", SILENT)
def test_silent(benchmark, figure, where):
    """Measure the time of silent neurons, which need hardly any, because time grows with events."""
    alone, crowded = warm(silent("nowhere")), warm(silent(where))
    least = min(seconds(alone.run, 1000.0) for _ in range(5))
    benchmark.pedantic(crowded.run, args=(1000.0,), rounds=5)
    ratio = benchmark.stats.stats.min / least
    benchmark.extra_info["ratio"] = ratio
    figure(f"100 x silent neurons {SILENT[where][0]}", ratio, "times the time", SILENT[where][1])


CHIP_AIMS = {"ff": (10_000, "at least 60,000"), "rec": (2_000, "at least 9,000")}


@pytest.mark.parametrize("name", CHIP_AIMS)
def test_chip_steps(benchmark, figure, name):
    """Measure steps per second of the emulated Loihi, with its counts."""
    sim, (steps, aim), rounds = neuro.compile(CHIP_NETWORKS[name](), backend="loihi"), CHIP_AIMS[name], 5
    if name == "ff":
        sim.inject("sources", *sources(1000, rounds * steps + 100))
    sim.run(100.0)
    benchmark.pedantic(sim.run, args=(float(steps),), rounds=rounds)
    figure(f"loihi, {name}", steps / benchmark.stats.stats.min, "steps/s", aim)


def drawn() -> neuro.Network:
    """Return a network of float neurons with a million synapses of different weights."""
    net = neuro.Network("million", resolution=1.0)
    cells = net.population("cells", 10_000, neuro.iaf_psc_exp(I_e=300.0))
    weights = neuro.uniform(low=10.0, high=90.0)
    net.connect(cells, cells, neuro.fixed_indegree(100), weight=weights, delay=1.0)
    return net


def prepared(net: neuro.Network) -> None:
    """Compile, quantise and place a network."""
    program = compile_network(net, 0)
    target = chip("loihi")
    assert not any(problem.refused for problem in quantise(program, target).problems)
    assert not place(program, target).problems


def test_a_million_synapses_get_onto_the_chip(benchmark, figure):
    prepared(drawn())  # loads the kernels of the placement
    benchmark.pedantic(prepared, args=(drawn(),), rounds=5)
    figure("compile, quantise, place a million", benchmark.stats.stats.min, "s", "below 2")
