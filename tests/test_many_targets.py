"""Targets in ranges (`deliver_in_ranges`): the same input as in one range, and as the reference, with any threads."""

import numpy as np
import pytest

import neuro
from alike import alike, same
from neuro.model.network import Network
from neuro.testing.case import run_on
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
    reference, one = alike(network(sources, reached, weight), 5.0)
    assert reference.counts().populations["cells"].spikes > 1_000
    two = neuro.compile(network(sources, reached, weight), seed=1, threads=2)
    run_on(two, 5.0)
    same(one, two)
