"""States of chips that the version before wrote are read, and go on as they did there."""

import warnings
from pathlib import Path

import numpy as np
import pytest

import neuro

STATES = Path(__file__).parent / "states"
AFTER_100_MS = {
    "loihi": (175, -69.03647854611062, {"merged spikes of noise": 6}),
    "spinnaker": (187, -67.30023193359375, {"slot saturations of cells": 6}),
}
"""Spikes, V_m of the cells and native counts at 100 ms, as the version that wrote the states had them."""


@pytest.fixture
def net():
    net = neuro.Network("stored", resolution=1.0)
    net.population("noise", 3, neuro.poisson_generator(rate=200.0))
    net.population("relay", 3, neuro.parrot_neuron())
    net.population("cells", 3, neuro.iaf_psc_exp(tau_m=20.0))
    net.population("late", 2, neuro.iaf_psc_delta())
    net.connect("noise", "relay", neuro.one_to_one(), weight=1.0, delay=1.0)
    net.connect("relay", "cells", neuro.all_to_all(), weight=600.0, delay=2.0)
    net.connect("cells", "late", neuro.all_to_all(), weight=6.0, delay=3.0, name="cells_late")
    return net


@pytest.mark.parametrize("backend", AFTER_100_MS)
def test_a_state_of_before_goes_on(net, backend):
    with warnings.catch_warnings(action="ignore"):
        sim = neuro.compile(net, backend=backend, seed=3)
        sim.restore(STATES / f"{backend}.h5")
        sim.run(50.0)
    spikes, volt, native = AFTER_100_MS[backend]
    assert (sim.counts().spikes, sim.counts().native) == (spikes, native)
    assert np.array_equal(sim.get("cells", "V_m"), [volt] * 3)
