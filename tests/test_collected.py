"""Populations that are stepped without their input, which is added where it arrived: no bit differs."""

from typing import Any

import numpy as np
import pytest

import neuro
from neuro.kernels.instructions import bits_of, lowest, marked, take
from neuro.kernels.jit import kernel
from neuro_event.loop import tables as t
from neuro_event.loop.operations import NEURONS

COLLECTING = [model for model in NEURONS if model.collects]


def test_some_models_collect():
    assert [model.__name__ for model in COLLECTING] == ["iaf_psc_exp"]


@pytest.mark.parametrize("model", COLLECTING)
def test_a_step_adds_its_input_last_and_a_spike_leaves_it_alone(model: Any):
    rng, n = np.random.default_rng(1), 200
    rows = [[state.name for state in model.states].index(name) for name in model.collects]
    assert rows == list(range(rows[0], rows[0] + model.receptors))
    parameters = np.array([model.defaults()[name] for name in model.quantities()])
    c = np.zeros(model.width)
    model.arithmetic.constants(parameters, 0.1, c)
    state = rng.normal(0.0, 50.0, (len(model.states), n))
    state[-1] = rng.integers(0, 3, n)
    x = np.where(rng.random((model.receptors, n)) < 0.5, rng.normal(0.0, 30.0, (model.receptors, n)), -0.0)
    fired, later, none = np.zeros(n, dtype=np.uint8), np.zeros(n, dtype=np.uint8), np.full_like(x, -0.0)
    whole, bare = state.copy(), state.copy()
    model.arithmetic.step(whole, c, x, np.zeros(n), 0, n, fired)
    model.arithmetic.step(bare, c, none, np.zeros(n), 0, n, later)
    bare[rows] += x
    assert np.array_equal(fired, later)
    assert whole.tobytes() == bare.tobytes()
    model.arithmetic.fire(whole, c, 3)
    assert np.array_equal(whole[rows], bare[rows])


def network(model: Any = neuro.iaf_psc_exp, **given: Any) -> neuro.Network:
    """Busy neurons and ones that sleep, of sizes that fill no group of blocks; weights of one value and of many."""
    net = neuro.Network("collected", resolution=0.1)
    cell = model(tau_syn_ex=0.7, tau_syn_in=1.5, t_ref=0.5, **given)
    net.population("exc", 700, cell, initial={"V_m": neuro.uniform(low=-70.0, high=-54.0)})
    net.population("inh", 300, cell, initial={"V_m": neuro.uniform(low=-70.0, high=-54.0)})
    drawn = neuro.normal(mean=150.0, std=80.0)
    net.connect("exc", "exc", neuro.fixed_indegree(n=5), weight=drawn, delay=0.1)
    net.connect("exc", "inh", neuro.fixed_indegree(n=5), weight=1500.0, delay=0.3)
    net.connect("inh", "exc", neuro.fixed_indegree(n=4), weight=-90.0, delay=0.1)
    return net


def ran(net: neuro.Network, backend: str = "event", **options: Any) -> list[Any]:
    """All that is known after some runs, with weights that are set in between."""
    sim = neuro.compile(net, backend, seed=3, **options)
    sim.run(6.0)
    sim.set("exc", I_e=neuro.normal(mean=420.0, std=150.0))
    sim.run(9.0)
    sim.set("exc_inh", weight=1800.0)
    sim.run(15.0)
    found = [*sim.spikes("exc"), *sim.spikes("inh")]
    found += [sim.get("exc", name) for name in ("V_m", "I_syn_ex", "I_syn_in")]
    counts = sim.counts().populations
    return [*found, np.array([[counts[p].spikes, counts[p].neuron_updates_active] for p in ("exc", "inh")])]


def collects(sim: neuro.Simulation) -> list[bool]:
    """Of which populations the loop does so."""
    engine: Any = sim._engine
    return [bool(row[t.COLLECTS] >= 0) for row in engine._arrays.net["pops"]]


@pytest.mark.parametrize("threads", [1, 2])
def test_all_is_as_on_the_reference(threads: int):
    assert collects(neuro.compile(network())) == [True, True]
    expected, found = ran(network(), "reference"), ran(network(), threads=threads)
    assert expected[0].size > 500
    assert expected[2].size > 100
    for a, b in zip(expected[:4], found[:4], strict=True):
        assert np.array_equal(a, b)
    for a, b in zip(expected[4:7], found[4:7], strict=True):  # what slept takes one step of many
        np.testing.assert_allclose(a, b, rtol=1e-9)
    assert np.array_equal(expected[-1], found[-1])


def test_weights_that_are_set_end_it_and_nothing_under_way_is_lost():
    sim = neuro.compile(network(), seed=3)
    sim.run(5.0)
    sim.set("exc_inh", weight=500.0)
    assert collects(sim) == [True, False]


def test_many_ways_of_input_are_not_collected():
    net = network()
    net.population("noise", 700, neuro.poisson_generator(rate=100.0))
    net.connect("noise", "exc", neuro.one_to_one(), weight=10.0, delay=0.1)
    assert collects(neuro.compile(net)) == [False, True, False]


@kernel
def _taken(states, inputs, marks, found):
    first = 0
    word = marked(marks, 0)
    found[0], found[1] = np.int64(bits_of(word)), np.int64(lowest(word))
    found[2] = np.int64(take(states, inputs, first + 8))


def test_lanes():
    states, inputs, marks = np.arange(24.0), np.full(24, -0.0), np.zeros(64, dtype=np.uint8)
    inputs[[3, 8, 9, 15, 17]] = 1.0, 0.0, -2.5, 4.0, 7.0
    marks[[5, 6, 63]] = 1, 255, 128
    found = np.zeros(3, dtype=np.int64)
    _taken(states, inputs, marks, found)
    assert found.tolist() == [3, 5, 0b10000011]
    assert states.tolist() == [*range(8), 8.0, 6.5, 10.0, 11.0, 12.0, 13.0, 14.0, 19.0, *range(16, 24)]
    assert inputs.tolist() == [0, 0, 0, 1.0, *[0] * 13, 7.0, *[0] * 6]
    assert np.signbit(inputs[8:16]).all()
