"""Ports: what they refuse, and what they fill. That they do what plain calls do is in `neuro.testing.probes`."""

import gc
import weakref

import numpy as np
import pytest

import neuro
from refused import refused

BACKENDS = ["reference", "event"]


def net():
    net = neuro.Network("loop", resolution=1.0)
    net.population("noise", 6, neuro.poisson_generator(rate=100.0))
    cells = net.population("cells", (2, 2), neuro.iaf_psc_exp(), initial={"V_m": -60.0})
    net.signal("reward", to=cells)
    rule = neuro.stdp_dopa(signal="reward", Wmax=900.0)
    net.connect("noise", "cells", neuro.all_to_all(), rule, weight=500.0, name="learnt")
    return net


@pytest.fixture(params=BACKENDS)
def sim(request):
    return neuro.compile(net(), backend=request.param, seed=1)


def test_what_is_refused_when_set_leaves_everything_as_it_was(messages):
    sim = neuro.compile(net(), "reference", seed=1)
    before = sim.get("noise", "rate"), sim.get("cells", "V_th"), sim.get("learnt", "n")
    messages.calls(globals() | {"sim": sim})
    after = sim.get("noise", "rate"), sim.get("cells", "V_th"), sim.get("learnt", "n")
    assert all(map(np.array_equal, before, after))


def test_what_does_not_fit(messages):
    sim = neuro.compile(net(), "reference", seed=1)
    sim.run(5.0)
    messages.calls(globals() | {"sim": sim})


def test_spikes_that_do_not_fit_are_not_lost(sim):
    port = sim.port("cells", "spikes")
    sim.run(200.0)
    _, ids = sim.spikes("cells")
    assert ids.size > 3
    with pytest.raises(
        neuro.ModelError, match=f"expected an array of int64 of at least {ids.size}, the spikes since 0 ms"
    ):
        port.get(np.zeros(3, np.int64))
    assert np.array_equal(port.get(), ids)
    assert port.get().size == 0


def test_spikes_that_were_forgotten_are_refused_and_counts_are_not(sim):
    spikes, counts = sim.port("cells", "spikes"), sim.port("cells", "counts")
    sim.run(200.0)
    fired = sim.spikes("cells")[1].size
    sim.forget(before=100.0)
    assert "spikes up to 100 ms were forgotten" in refused(spikes.get)
    assert counts.get().sum() == fired


def test_arrays_are_filled_and_given_back(sim):
    potential, counts = sim.port("cells", "V_m"), sim.port("cells", "counts")
    sim.run(50.0)
    states, fired = np.zeros(4), np.zeros(4, np.int64)
    assert potential.get(states) is states
    assert counts.get(fired) is fired
    assert np.array_equal(states, sim.get("cells", "V_m"))
    assert np.array_equal(fired, np.bincount(sim.spikes("cells")[1], minlength=4))
    assert fired.sum() > 0
    assert counts.get().sum() == 0


def test_what_is_set_is_not_the_callers_array(sim):
    rates = np.full(6, 30.0)
    sim.port("noise", "rate").set(rates)
    rates[:] = 7.0
    sim.reset()
    assert np.array_equal(sim.get("noise", "rate"), np.full(6, 30.0))


def test_arrays_of_any_kind_are_taken(sim):
    rate = sim.port("noise", "rate")
    for values in (np.arange(6), np.arange(12.0)[::2], list(range(6)), np.arange(6, dtype=np.float32), "20 Hz", 3):
        rate.set(values)
        taken = sim.get("noise", "rate")
        sim.set("noise", rate=values)
        assert np.array_equal(taken, sim.get("noise", "rate"))
    potential = sim.port("cells", "V_m")
    potential.set(np.array([[-60.0, -61.0], [-62.0, -63.0]]))
    assert np.array_equal(potential.get(), [-60.0, -61.0, -62.0, -63.0])


def test_counts_of_a_generator_that_is_not_recorded(sim):
    counts = sim.port("noise", "counts")
    sim.run(100.0)
    assert counts.get().sum() == sim.counts().populations["noise"].spikes > 0


def test_counts_of_a_generator_whose_spikes_are_tallied():
    """It drives neurons one to one so fast that the loop keeps no list of its spikes."""
    net = neuro.Network("tallied", resolution=1.0)
    noise = net.population("noise", 10, neuro.poisson_generator(rate=800.0))
    cells = net.population("cells", 10, neuro.iaf_psc_exp())
    net.connect(noise, cells, neuro.one_to_one(), weight=1.0)
    sim = neuro.compile(net, seed=1)
    sim.run(100.0)
    before, port = sim.counts().spikes, sim.port("noise", "counts")
    sim.run(100.0)
    assert port.get().sum() == sim.counts().spikes - before > 0


def test_a_simulation_with_ports_is_dropped_at_once():
    gc.collect()
    gc.disable()
    try:
        sim = neuro.compile(net(), backend="reference", seed=1)
        port, gone = sim.port("noise", "rate"), weakref.ref(sim._engine)
        del sim
        assert gone() is not None
        del port
        assert gone() is None
    finally:
        gc.enable()


def test_how_a_port_is_shown(sim):
    assert repr(sim.port("noise", "rate")) == "Port(rate of 'noise')"
    assert repr(sim.port("reward")) == "Port(signal 'reward')"
