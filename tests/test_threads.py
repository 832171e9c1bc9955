"""Threads of the event backend: the same results in whichever way slices are run."""

import os
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import neuro
from neuro.compiler import compile_network
from neuro.program.program import Program
from neuro_event.building import layout, thread_partition
from neuro_event.host import threads
from neuro_event.loop import steps


def network() -> neuro.Network:
    """Noise, neurons that learn, and delays of one to twenty steps."""
    net = neuro.Network("shared", resolution=0.1)
    cell = neuro.iaf_psc_exp(tau_syn_ex=0.5, tau_syn_in=0.5)
    net.population("noise", 700, neuro.poisson_generator(rate=9000.0))
    net.population("exc", 700, cell, initial={"V_m": neuro.uniform(low=-70.0, high=-56.0)})
    net.population("inh", 300, cell)
    net.connect("noise", "exc", neuro.one_to_one(), weight=95.0, delay=0.7)
    net.connect("exc", "exc", neuro.fixed_indegree(n=20), neuro.stdp(Wmax=60.0), weight=20.0, delay=1.5)
    net.connect("exc", "inh", neuro.fixed_indegree(n=40), weight=60.0, delay=0.3)
    delay = neuro.uniform(low=0.1, high=2.0)
    net.connect("inh", "exc", neuro.fixed_indegree(n=30), weight=-50.0, delay=delay)
    return net


def ran(pieces: list[float], **options: Any) -> list[Any]:
    """Everything that is known after some runs."""
    sim = neuro.compile(network(), seed=4, **options)
    for ms in pieces:
        sim.run(ms)
    counts = sim.counts().populations
    found = [*sim.spikes("exc"), *sim.spikes("inh"), sim.get("exc_exc", "weight"), sim.get("exc", "V_m")]
    return [*found, np.array([counts[name].spikes for name in counts])]


WAYS = {
    "in turn": {"STRETCH": 0.0, "SHARE": 1e9, "ENOUGH": 0.0, "MOST": 1e-9, "HELD": 0.0},
    "together": {"GAIN": 1e-9, "AGAIN": np.inf, "HELD": 0.0},
    "in one": {"ENOUGH": np.inf},
}


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("n", [2, 3])
def test_no_way_changes_a_bit(n: int, way: str, monkeypatch: pytest.MonkeyPatch):
    for name, value in WAYS[way].items():
        monkeypatch.setattr(threads, name, value)
    alone = ran([40.0])
    assert alone[0].size > 500
    for pieces in ([40.0], [0.1, 7.3, 0.2, 32.4]):
        assert all(np.array_equal(a, b) for a, b in zip(ran(pieces, threads=n), alone, strict=True))


@pytest.fixture
def all_threads(monkeypatch: pytest.MonkeyPatch) -> None:
    """Slices are run on all threads, whatever that takes."""
    for name, value in WAYS["together"].items():
        monkeypatch.setattr(threads, name, value)


@pytest.mark.parametrize("cores", [1, 2], ids=["in turn on one core", "on two cores"])
def test_threads_that_need_only_spikes_of_each_other(cores: int, all_threads: None):
    """Three run ahead of each other, and one that waits in vain lets the others have its core."""
    net = neuro.Network("free", resolution=0.1)
    net.population("noise", 1500, neuro.poisson_generator(rate=9000.0))
    net.population("cells", 1500, neuro.iaf_psc_exp())
    net.connect("noise", "cells", neuro.one_to_one(), weight=95.0, delay=0.2)
    late = neuro.uniform(low=0.2, high=2.0)
    net.connect("cells", "cells", neuro.fixed_indegree(n=40), weight=neuro.normal(mean=-9.0, std=3.0), delay=late)

    def found(n: int) -> list[Any]:
        sim = neuro.compile(net, seed=4, threads=n)
        for ms in (0.1, 39.7, 20.2):
            sim.run(ms)
        return [*sim.spikes("cells"), sim.get("cells", "V_m")]

    alone, every = found(1), os.sched_getaffinity(0)
    assert alone[0].size > 1500
    try:
        os.sched_setaffinity(0, set(sorted(every)[:cores]))
        assert all(np.array_equal(a, b) for a, b in zip(found(3), alone, strict=True))
    finally:
        os.sched_setaffinity(0, every)


class Timed(threads.Threads):
    """In place of a run: so many seconds go by for a slice on one thread, and on all; who is busy has half the core."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, slice_s: float) -> None:
        super().__init__(2)
        self.slice_s, self.gain, self.held = slice_s, 1.0, 1.0
        self.now, self.cpu, self.trials = 0.0, 0.0, 0
        clock = SimpleNamespace(perf_counter=lambda: self.now, thread_time=lambda: self.cpu)
        monkeypatch.setattr(threads, "time", clock)
        monkeypatch.setattr(threads, "steps", SimpleNamespace(run=self._alone, finish=self._finish))

    def _alone(self, view: int, first: int, last: int, *given: Any) -> int:
        if view:  # a simulation that runs meanwhile in this process
            return int(steps.run(view, first, last, *given))
        return self._go(last, (last - first) * self.slice_s)

    def _finish(self, view: int, *given: Any) -> None:
        if view:
            steps.finish(view, *given)

    def _share(self, view: int, first: int, last: int, *_: Any) -> int:
        self.trials += first < last
        return self._go(last, (last - first) * self.slice_s / self.gain + 1e-4)

    def _go(self, last: int, seconds: float) -> int:
        self.now, self.cpu = self.now + seconds / self.held, self.cpu + seconds
        return last

    def ratio(self, alone_s: float, pieces: int = 1) -> float:
        """How long what takes so many seconds on one thread takes, in units of that."""
        began, steps = self.now, round(alone_s / self.slice_s / pieces)
        for _ in range(pieces):
            self.run(0, 1, 1 + steps, 1, 1, 0.1, np.zeros(1, np.int64))
        return (self.now - began) * self.held / (steps * pieces * self.slice_s)


@pytest.mark.parametrize("slice_s", [5e-5, 7e-4])
@pytest.mark.parametrize("gain", [0.9, 0.7, 0.3])
def test_threads_that_lose_cost_little(gain: float, slice_s: float, monkeypatch: pytest.MonkeyPatch):
    ways = Timed(monkeypatch, slice_s)
    ways.gain = gain
    assert 1.0 < ways.ratio(0.5) < 1.04
    assert 1.0 < ways.ratio(20.0) < 1.03


@pytest.mark.parametrize("slice_s", [5e-5, 7e-4])
@pytest.mark.parametrize("pieces", [1, 100])
def test_threads_that_gain_are_kept_until_they_lose(slice_s: float, pieces: int, monkeypatch: pytest.MonkeyPatch):
    ways = Timed(monkeypatch, slice_s)
    ways.gain = 1.6
    assert ways.ratio(1.0) < 0.7
    assert ways.ratio(10.0, pieces) < 0.68
    ways.gain = 0.7
    assert ways.ratio(1.0, pieces) < 1.05
    ways.gain = 1.6
    ways.ratio(2.0, pieces)
    assert ways.ratio(10.0, pieces) < 0.68


def test_busy_cores_are_no_place_for_trials(monkeypatch: pytest.MonkeyPatch):
    ways = Timed(monkeypatch, 1e-3)
    ways.held = 0.5
    assert ways.ratio(100.0) == pytest.approx(1.0)
    assert ways.trials == 0
    ways.held, ways.gain = 1.0, 1.6
    assert ways.ratio(10.0) < 0.7
    trials, ways.held = ways.trials, 0.5
    ways.ratio(10.0)
    assert ways.trials <= trials + 1


def test_a_thread_that_waits_in_vain_comes_back():
    sim = neuro.compile(network(), seed=4, threads=2)
    view, said = sim._engine._view, np.full((3, threads.LINE), 1, dtype=np.int64)
    assert steps.share(view, said, 1, 11, 1, 30, 0.1) == 0
    assert list(said[:, 0]) == [1, 1, 1]
    said[2, 0] = steps.HALT
    assert steps.share(view, said, 1, 11, 1, 30, 0.1) == 1


def parted(sizes: list[int], n: int, delay: float = 1.0) -> np.ndarray[Any, np.dtype[np.int64]]:
    """How many blocks each of n threads has of some populations."""
    net = neuro.Network("parted", resolution=0.1)
    for k, size in enumerate(sizes):
        net.population(f"p{k}", size, neuro.iaf_psc_exp())
    net.connect("p0", "p0", neuro.one_to_one(), weight=1.0, delay=delay)
    program = compile_network(net, 0)
    return np.diff(thread_partition.thread_edges(program, layout.places(program), n), axis=1)


def test_threads_share_each_population_evenly():
    assert parted([4096, 2048], 2).tolist() == [[32, 32], [16, 16]]
    assert parted([8000, 2000], 2).tolist() == [[64, 61], [16, 16]]
    assert parted([6144], 3).tolist() == [[32, 32, 32]]


def circuit(sizes: list[int], between: list[tuple[int, int, int]]) -> Program:
    """Populations, each driven by a generator, and so many synapses with delays of their own between them."""
    net = neuro.Network("circuit", resolution=0.1)
    for k, size in enumerate(sizes):
        net.population(f"p{k}", size, neuro.iaf_psc_exp())
        net.population(f"noise{k}", size, neuro.poisson_generator(rate=100.0))
        net.connect(f"noise{k}", f"p{k}", neuro.one_to_one(), weight=1.0)
    for source, target, n in between:
        late = neuro.uniform(low=1.0, high=2.0)
        net.connect(f"p{source}", f"p{target}", neuro.fixed_total_number(n=n), weight=1.0, delay=late)
    return compile_network(net, 0)


def test_populations_stay_whole_where_synapses_lie_beyond_the_caches(monkeypatch: pytest.MonkeyPatch):
    program = circuit([1500, 1500, 3000, 3000], [(0, 1, 70_000), (1, 0, 50_000), (1, 2, 40_000), (2, 3, 59_000)])
    where = layout.places(program)
    monkeypatch.setattr(thread_partition, "SCATTERED", 219_000)
    edges = thread_partition.thread_edges(program, where, 2)
    assert edges[:, 0].tolist() == [place.begin // 64 for place in where]
    assert edges[:, 2].tolist() == [-(-place.end // 64) for place in where]
    assert (np.diff(edges, axis=1) == 0).sum(axis=1).tolist() == [1] * 8
    whose = np.diff(edges, axis=1).argmax(axis=1).reshape(4, 2)
    assert (whose[:, 0] == whose[:, 1]).all()  # noise goes with who hears it
    assert sorted(whose[:, 0]) == [0, 0, 1, 1]
    monkeypatch.setattr(thread_partition, "SCATTERED", 219_001)
    assert (np.diff(thread_partition.thread_edges(program, where, 2), axis=1) > 0).all()


@settings(max_examples=25, deadline=None)
@given(sizes=st.lists(st.integers(1, 900), min_size=1, max_size=9), threads=st.integers(2, 4))
def test_populations_stay_whole_only_where_the_work_is_even(sizes: list[int], threads: int):
    owners = thread_partition.whole_populations(circuit(sizes, []), threads)
    works = np.repeat(sizes, 2) * 1.0
    works[::2] += np.array(sizes) / 200  # a synapse from each generator
    if owners is not None:
        work = np.bincount(owners, works, threads)
        assert work.max() <= 1.02 * work.mean() + 1e-6
    elif threads == 2 and len(sizes) <= 2:
        assert max(sizes) > 0.51 * sum(sizes)


@pytest.mark.parametrize(("size", "delay", "found"), [(4000, 0.1, 1), (30_000, 0.1, 2), (4000, 1.5, 2)])
def test_a_network_is_cut_only_where_threads_meet_seldom_enough(
    size: int, delay: float, found: int, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(thread_partition, "WORTH_MEETING", 12_000)
    net = neuro.Network("cut", resolution=0.1)
    net.population("cells", size, neuro.iaf_psc_exp())
    net.connect("cells", "cells", neuro.one_to_one(), weight=1.0, delay=delay)
    assert thread_partition.parts(compile_network(net, 0), 2) == found
    assert thread_partition.parts(compile_network(net, 0), 1) == 1


def test_a_state_of_another_number_of_threads_is_refused():
    sim, other = neuro.compile(network(), seed=4, threads=3), neuro.compile(network(), seed=4, threads=2)
    sim.run(5.0)
    with pytest.raises(
        neuro.ModelError, match=r"^the state was saved with threads=3: expected the same number to continue$"
    ):
        other._engine.restore(sim._engine.snapshot())
