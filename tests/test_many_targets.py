"""Targets in ranges (`deliver_in_ranges`): the same input as in one range, and as the reference, with any threads."""

import numpy as np
import pytest

import neuro
from neuro.model.network import Network
from neuro.testing import observe
from neuro.testing.case import differences, run_on
from neuro_event.loop.arrivals import QUEUE
from neuro_event.loop.deliver import RANGE

TARGETS = 2 * RANGE + 70
"""Three ranges, none of whole blocks."""


def network(sources: int, reached: int, weight: float) -> Network:
    """Bursts of many neurons at once, some of several spikes, onto many that fire."""
    random = np.random.default_rng(sources)
    times = [0.5 * np.sort(random.integers(1, 8, random.integers(0, 9))) for _ in range(sources)]
    net = Network("many", resolution=0.5)
    net.population("bursts", sources, neuro.spike_generator(spike_times=times))
    drive = neuro.uniform(low=0.0, high=300.0)
    net.population("cells", TARGETS, neuro.iaf_psc_delta(V_th=-68.0, I_e=drive))
    net.connect("bursts", "cells", neuro.fixed_outdegree(n=reached), weight=weight, delay=1.5)
    net.connect("cells", "cells", neuro.fixed_outdegree(n=3), weight=-0.1, delay=2.0)
    return net


@pytest.mark.parametrize(
    ("sources", "reached", "weight"),
    [(2 * QUEUE + 44, 1500, 0.07), (3000, 20, -0.07), (20, 1500, 0.07)],
    ids=["long rows", "short rows", "few spikes"],
)
def test_event_equals_reference(sources: int, reached: int, weight: float):
    found = {}
    for backend, threads in (("reference", 1), ("event", 1), ("event", 2)):
        sim = neuro.compile(network(sources, reached, weight), backend, seed=1, threads=threads)
        run_on(sim, 5.0)
        found[backend, threads] = observe(sim)
    assert found["reference", 1]["spikes of cells: steps"].size > 1_000
    assert differences(found["reference", 1], found["event", 1], exact=False) == []
    assert differences(found["event", 1], found["event", 2], exact=True) == []
