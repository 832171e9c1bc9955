"""Weights that are set during a run: spikes under way keep the old weights, on every path of delivery."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import neuro
from neuro.model.network import Network
from neuro.run.simulation import Simulation
from neuro.testing import observe
from neuro.testing.case import differences, run_on

N = 1100
"""Size of a population, of which two threads have a part each."""

RULES: dict[str, tuple[Any, Any]] = {
    "one to one": (neuro.one_to_one(), None),
    "dense": (neuro.all_to_all(), None),
    "sparse": (neuro.fixed_indegree(n=7), None),
    "plastic": (neuro.fixed_indegree(n=7), neuro.stdp(Wmax=400.0)),
    "plastic, dopamine": (neuro.fixed_indegree(n=7), neuro.stdp_dopa(Wmax=400.0, dopamine="dopa")),
}
SOURCES = {
    "counts": neuro.poisson_generator(rate=1500.0),
    "lists": neuro.poisson_generator(rate=150.0),
    "relay": neuro.parrot_neuron(),
    "neurons": neuro.iaf_psc_exp(I_e=neuro.uniform(low=380.0, high=420.0)),
}
DELAYS = {"one delay": 1.3, "drawn delays": neuro.uniform(low=0.4, high=2.9)}


def network(source: str, rule: str, delay: str, n: int = N) -> Network:
    """Wires from one kind of source onto cells that also receive noise, currents and each other's spikes."""
    net = Network("carried")
    connect, synapse = RULES[rule]
    few = 40 if rule == "dense" else n
    net.population("source", few, SOURCES[source])
    net.population("cells", n, neuro.iaf_psc_exp(I_e=neuro.uniform(low=300.0, high=420.0)))
    net.population("dopa", 3, neuro.poisson_generator(rate=300.0))
    net.population("noise", n, neuro.poisson_generator(rate=2000.0))
    if source == "relay":
        net.population("input", few, neuro.poisson_generator(rate=150.0))
        net.connect("input", "source", neuro.one_to_one(), delay=0.4)
    net.connect("noise", "cells", neuro.fixed_indegree(n=2), weight=90.0, delay=0.4)
    rule_words = () if synapse is None else (synapse,)
    weight = neuro.normal(mean=60.0, std=30.0, low=1.0) if source == "neurons" or synapse is not None else 40.0
    net.connect("source", "cells", connect, *rule_words, weight=weight, delay=DELAYS[delay], name="wires")
    net.connect("cells", "cells", neuro.fixed_indegree(n=5), weight=-20.0, delay=0.7, name="others")
    return net


def steered(sim: Simulation, state: Path | None = None) -> dict[str, np.ndarray]:
    """Set weights three times while spikes are under way; with a file, save between the sets and restore later."""
    run_on(sim, 4.1)
    w = sim.get("wires", "weight")
    sim.set("wires", weight=np.linspace(1.4, 0.6, w.size) * w)
    sim.run(0.1)
    sim.set("wires", weight=0.5 * w)
    sim.set("others", weight=-35.0)
    sim.set("wires", weight=1.5 * w)
    if state is not None:
        sim.save(state)
        sim.set("wires", weight=0.0)
        sim.run(1.0)
        sim.restore(state)
    sim.run(1.1)
    sim.set("wires", weight=0.0)
    sim.run(0.5)
    if state is not None:
        sim.save(state)
        sim.reset()
        sim.run(2.0)
        sim.restore(state)
    sim.set("wires", weight=w)
    run_on(sim, 3.0)
    return observe(sim)


CASES = [
    (source, rule, delay)
    for source in SOURCES
    for rule in RULES
    for delay in DELAYS
    if not ((rule == "dense" or "plastic" in rule) and source == "counts")
]


@pytest.mark.parametrize(("source", "rule", "delay"), CASES)
def test_event_equals_reference(source: str, rule: str, delay: str):
    net = network(source, rule, delay, n=60)
    expected, actual = (steered(neuro.compile(net, backend, seed=3)) for backend in ("reference", "event"))
    assert differences(expected, actual, exact=False) == []


@pytest.mark.parametrize(("source", "rule", "delay"), CASES)
def test_threads_and_saved_states_change_no_bit(source: str, rule: str, delay: str, tmp_path: Path):
    net = network(source, rule, delay)
    expected = steered(neuro.compile(net, "event", seed=3, threads=1))
    for threads in (1, 2):
        actual = steered(neuro.compile(net, "event", seed=3, threads=threads), tmp_path / f"state{threads}.h5")
        assert differences(expected, actual, exact=True) == []
