"""Many spikes of one neuron in one step: they are counted, delivered and kept with 64 bits."""

import numpy as np
import pytest

import neuro
from neuro.results import read

BACKENDS = ["reference", "event"]


def multiplied(rounds: int, each: int) -> neuro.Network:
    """A spike that parrots multiply in each round."""
    net = neuro.Network("multiplied", resolution=1.0)
    net.population("p0", 1, neuro.spike_generator(spike_times=[[1.0]]))
    for k in range(1, rounds + 1):
        net.population(f"p{k}", 1, neuro.parrot_neuron())
        net.connect(f"p{k - 1}", f"p{k}", neuro.fixed_indegree(n=each), delay=1.0)
    net.population("last", 1, neuro.parrot_neuron())
    net.connect(f"p{rounds}", "last", neuro.one_to_one(), delay=1.0)
    net.population("cell", 1, neuro.iaf_psc_delta(V_th=1e9))
    net.connect(f"p{rounds}", "cell", neuro.one_to_one(), weight=1e-9, delay=1.0)
    return net


@pytest.mark.parametrize("backend", BACKENDS)
def test_more_than_31_bits_are_counted_delivered_and_kept(backend, tmp_path):
    sim = neuro.compile(multiplied(2, 50_000), backend)
    sim.run(4.0)
    number = 50_000**2
    assert [sim.counts().populations[name].spikes for name in ("p2", "last")] == [number, number]
    assert sim.get("cell", "V_m")[0] == pytest.approx(-70.0 + 2.5, abs=1e-12)
    assert [column.tolist() for column in sim.train("last")] == [[4], [0], [number]]
    state = tmp_path / "state.h5"
    sim.save(state)
    sim.run(2.0)
    other = neuro.compile(multiplied(2, 50_000), backend)
    other.restore(state)
    other.run(2.0)
    assert other.get("cell", "V_m")[0] == sim.get("cell", "V_m")[0]
    assert np.array_equal(other.train("p2")[2], [number])


@pytest.mark.parametrize("backend", BACKENDS)
def test_a_file_keeps_them(backend, tmp_path):
    sim = neuro.compile(multiplied(2, 50_000), backend)
    sim.run(4.0, out=tmp_path / "results.h5")
    assert read(tmp_path / "results.h5").populations["last"].multiplicity.tolist() == [50_000**2]


@pytest.mark.parametrize("backend", BACKENDS)
def test_one_by_one_they_need_memory_and_are_refused(backend):
    sim = neuro.compile(multiplied(3, 50_000), backend)
    sim.run(5.0)
    with pytest.raises(
        neuro.ModelError, match=r"spikes of 'last': 125,000,000,000,000 spikes one by one need \S+ byte"
    ):
        sim.spikes("last")


@pytest.mark.parametrize("backend", BACKENDS)
def test_more_than_63_bits_are_refused(backend):
    sim = neuro.compile(multiplied(5, 50_000), backend)
    with pytest.raises(
        neuro.ModelError,
        match=r"population 'p5': a neuron sent 2\^63 spikes or more, in a step or in all: expected fewer",
    ):
        sim.run(10.0)
