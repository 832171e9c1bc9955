"""Random small networks: the event backend equals the reference, spike for spike.

`NEURO_RANDOM_NETWORKS` sets how many networks are tried, `NEURO_QUIET_NETWORKS` how many with long silences.
"""

import os

import numpy as np
from hypothesis import HealthCheck, given, settings, strategies as st

import neuro
from alike import alike
from neuro.model.network import Network
from neuro.run.simulation import Simulation
from neuro.testing import observe
from neuro.testing.case import differences, run_on
from strategies import SILENCE, networks, quiet_networks

STEPS = 100
SETTINGS = settings(
    max_examples=int(os.environ.get("NEURO_RANDOM_NETWORKS", "20")),
    deadline=None,
    derandomize=True,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)


def steered(sim: Simulation, cuts: list[int]) -> dict[str, np.ndarray]:
    """Run in pieces with a signal after each half."""
    h, done = sim.program.resolution, 0
    for stop in sorted({*cuts, STEPS // 2, STEPS}):
        run_on(sim, (stop - done) * h)
        done = stop
        if done == STEPS // 2:
            for signal in sim.program.signals:
                sim.signal(signal.name, 0.03)
    return observe(sim)


@SETTINGS
@given(net=networks(), seed=st.integers(0, 5), cuts=st.lists(st.integers(1, STEPS - 1), max_size=3))
def test_event_equals_reference(net: Network, seed: int, cuts: list[int]):
    expected, found = (neuro.compile(net, backend, seed=seed) for backend in ("reference", "event"))
    assert differences(steered(expected, []), steered(found, cuts), exact=False) == []


@settings(SETTINGS, max_examples=int(os.environ.get("NEURO_QUIET_NETWORKS", "20")))
@given(net=quiet_networks(), seed=st.integers(0, 5), cuts=st.lists(st.integers(1, SILENCE), max_size=3))
def test_long_silences_change_nothing(net: Network, seed: int, cuts: list[int]):
    found = []
    for backend, stops in (("reference", []), ("event", cuts)):
        sim = neuro.compile(net, backend, seed=seed)
        done = 0
        for stop in sorted({*stops, SILENCE + 40}):
            run_on(sim, (stop - done) * net.resolution)
            done = stop
        found.append(observe(sim))
    assert differences(*found, exact=False) == []


def test_a_generator_of_many_rates_has_no_table_of_probabilities():
    net = Network("rates")
    net.population("noise", 70, neuro.poisson_generator(rate=np.linspace(1e3, 5e3, 70)))
    net.population("cells", 70, neuro.iaf_psc_exp())
    net.connect("noise", "cells", neuro.one_to_one(), weight=50.0, delay=1.0)
    net.probe("v", "cells", "V_m", every=1.0)
    alike(net, 5.0)
