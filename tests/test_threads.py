"""Threads of the event backend: the same results in whichever way slices are run."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import neuro
from neuro.compiler import compile_network
from neuro.program.program import Program
from neuro_event import layout, loop, shares, threads


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


@pytest.mark.parametrize("tried", [(1, 1), (3, 2), (10**6, 1)], ids=["in turn", "in turn, longer", "together"])
@pytest.mark.parametrize("n", [2, 3])
def test_no_way_changes_a_bit(n: int, tried: tuple[int, int], monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(threads, "FEWEST", tried[0])
    monkeypatch.setattr(threads, "MOST", tried[0])
    monkeypatch.setattr(threads, "KEPT", tried[1])
    monkeypatch.setattr(threads, "LONGEST", tried[1])
    alone = ran([40.0])
    assert alone[0].size > 500
    for pieces in ([40.0], [0.1, 7.3, 0.2, 32.4]):
        assert all(np.array_equal(a, b) for a, b in zip(ran(pieces, threads=n), alone, strict=True))


def test_the_faster_way_is_kept_and_tried_again_ever_more_rarely():
    ways, shortest = threads.Threads(2), threads.KEPT * threads.MOST
    assert tried(ways, together=2e-6, alone=1e-6) == (False, shortest)
    assert tried(ways, together=2e-6, alone=1e-6) == (False, 2 * shortest)
    assert tried(ways, together=1e-6, alone=2e-6) == (True, shortest)
    for _ in range(20):
        kept = tried(ways, together=1e-6, alone=2e-6)
    assert kept == (True, threads.LONGEST)


def test_long_slices_are_tried_again_after_some_time():
    ways = threads.Threads(2)
    for _ in range(20):
        kept = tried(ways, together=2e-3, alone=1e-3)
    assert kept == (False, threads.LATEST / 1e-3)
    assert tried(ways, together=1.0, alone=2.0) == (True, threads.KEPT * threads.FEWEST)


def tried(ways: threads.Threads, together: float, alone: float) -> tuple[bool, int]:
    """Which way is kept after a trial, and for how many slices."""
    for way, seconds in ((True, together), (False, 9.0), (True, 9.0), (False, alone)):
        ways._weigh(way, seconds)
    return ways._together, ways._left


def test_a_thread_that_waits_in_vain_comes_back():
    sim = neuro.compile(network(), seed=4, threads=2)
    view, said = sim._engine._view, np.full((3, threads.LINE), 1, dtype=np.int64)
    assert loop.share(view, said, 1, 11, 1, 30, 0.1) == 0
    assert list(said[:, 0]) == [1, 1, 1]
    said[2, 0] = loop.HALT
    assert loop.share(view, said, 1, 11, 1, 30, 0.1) == 1


def parted(sizes: list[int], n: int, delay: float = 1.0) -> np.ndarray[Any, np.dtype[np.int64]]:
    """How many blocks each of n threads has of some populations."""
    net = neuro.Network("parted", resolution=0.1)
    for k, size in enumerate(sizes):
        net.population(f"p{k}", size, neuro.iaf_psc_exp())
    net.connect("p0", "p0", neuro.one_to_one(), weight=1.0, delay=delay)
    program = compile_network(net, 0)
    return np.diff(shares.thread_edges(program, layout.places(program), n), axis=1)


def test_threads_share_each_population_evenly():
    assert parted([4096, 2048], 2).tolist() == [[32, 32], [16, 16]]
    assert parted([8000, 2000], 2).tolist() == [[64, 61], [16, 16]]
    assert parted([6144], 3).tolist() == [[32, 32, 32]]


def test_what_cannot_be_shared_is_made_up_for():
    blocks = parted([500] * 6, 2)
    assert sorted(blocks.tolist()) == [[0, 8]] * 3 + [[8, 0]] * 3
    assert parted([1536, 1536], 2).sum(axis=0).tolist() == [24, 24]


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
    monkeypatch.setattr(shares, "SCATTERED", 219_000)
    edges = shares.thread_edges(program, where, 2)
    assert edges[:, 0].tolist() == [place.begin // 64 for place in where]
    assert edges[:, 2].tolist() == [-(-place.end // 64) for place in where]
    assert (np.diff(edges, axis=1) == 0).sum(axis=1).tolist() == [1] * 8
    whose = np.diff(edges, axis=1).argmax(axis=1).reshape(4, 2)
    assert (whose[:, 0] == whose[:, 1]).all()  # noise goes with who hears it
    assert sorted(whose[:, 0]) == [0, 0, 1, 1]
    monkeypatch.setattr(shares, "SCATTERED", 219_001)
    assert (np.diff(shares.thread_edges(program, where, 2), axis=1) > 0).all()


@settings(max_examples=100, deadline=None)
@given(sizes=st.lists(st.integers(1, 900), min_size=1, max_size=9), threads=st.integers(2, 4))
def test_populations_stay_whole_only_where_the_work_is_even(sizes: list[int], threads: int):
    owners = shares.whole_populations(circuit(sizes, []), threads)
    works = np.repeat(sizes, 2) * 1.0
    works[::2] += np.array(sizes) / 200  # a synapse from each generator
    if owners is not None:
        work = np.bincount(owners, works, threads)
        assert work.max() <= 1.02 * work.mean() + 1e-6
    elif threads == 2 and len(sizes) <= 2:
        assert max(sizes) > 0.51 * sum(sizes)


def test_a_division_is_found_where_the_largest_first_is_uneven():
    """Largest first, to whom has least, would give shares of 0.52 and 0.48."""
    owners = shares.whole_populations(circuit([349, 209, 126, 108, 103, 80, 24, 10], []), 2)
    assert owners is not None
    assert np.bincount(owners[::2], [349, 209, 126, 108, 103, 80, 24, 10]).max() <= 1.02 * 504.5


@pytest.mark.parametrize(("size", "delay", "found"), [(4000, 0.1, 1), (30_000, 0.1, 2), (4000, 1.5, 2)])
def test_a_network_is_cut_only_where_threads_meet_seldom_enough(
    size: int, delay: float, found: int, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(shares, "WORTH_MEETING", 12_000)
    net = neuro.Network("cut", resolution=0.1)
    net.population("cells", size, neuro.iaf_psc_exp())
    net.connect("cells", "cells", neuro.one_to_one(), weight=1.0, delay=delay)
    assert shares.parts(compile_network(net, 0), 2) == found
    assert shares.parts(compile_network(net, 0), 1) == 1


def test_a_state_saved_with_one_edge_for_all_populations_goes_on(monkeypatch: pytest.MonkeyPatch):
    """As in version 0.1.0, where threads owned stretches of all neurons."""

    def flat(program: Any, where: list[layout.Place], n: int) -> Any:
        words = layout.total(program) // layout.WORD
        return shares.edges_of(np.arange(n + 1) * words // n * 8, where)

    alone = ran([40.0])
    with monkeypatch.context() as patched:
        patched.setattr(shares, "thread_edges", flat)
        sim = neuro.compile(network(), seed=4, threads=2)
        sim.run(15.3)
        arrays = sim._engine.snapshot()
    words = layout.total(sim.program) // layout.WORD
    arrays["engine.edges"] = np.arange(3) * words // 2 * 8
    other = neuro.compile(network(), seed=4, threads=2)
    other._engine.restore(arrays)
    other.run(24.7)
    found = [*other.spikes("exc"), *other.spikes("inh"), other.get("exc_exc", "weight"), other.get("exc", "V_m")]
    assert all(np.array_equal(a, b) for a, b in zip(found, alone, strict=False))


def test_a_state_of_another_number_of_threads_is_refused():
    sim, other = neuro.compile(network(), seed=4, threads=3), neuro.compile(network(), seed=4, threads=2)
    sim.run(5.0)
    with pytest.raises(neuro.ModelError, match=r"^the state was saved with threads=3: expected the same to continue$"):
        other._engine.restore(sim._engine.snapshot())
