"""Numbers of Poisson generators: the same on every backend, however they are found, and of the right distribution."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from numpy.typing import NDArray
from scipy import stats

import neuro
from beside import evaluated
from neuro.core import keyed_random
from neuro.core.keyed_random import LARGEST_MEAN, poisson_table, uniform
from neuro.kernels.draws import GUIDE_BITS, UNSURE, guide_to, poisson_by_table, words_of
from neuro.kernels.jit import kernel
from neuro.model import distributions
from neuro_event.building.layout import LINE, PAGE, aligned_zeros, zeros
from neuro_event.loop import tables as t

MEANS = [0.06, 0.3, 1.3, 2.0, 8.0, 47.0, 499.0]
means = st.floats(0.001, LARGEST_MEAN) | st.sampled_from(MEANS)


@kernel
def find(base, first, guide, cumulative, words, counts):
    """What a block of neighbouring neurons draws."""
    words_of(base, first, words)
    poisson_by_table(words, guide, cumulative, counts)


def drawn(key: int, step: int, first: int, n: int, mean: float) -> NDArray[np.uint16]:
    """The numbers of a kernel."""
    table = poisson_table(mean)
    words, counts = np.zeros(n, dtype=np.uint64), np.zeros(n, dtype=np.uint16)
    word = np.array([(key + step * keyed_random.STEP_STRIDE) % 2**64], dtype=np.uint64)
    find(keyed_random.mix(word)[0], first, guide_to(table), np.append(table, np.inf), words, counts)
    return counts


@given(
    key=st.integers(0, 2**64 - 1),
    step=st.integers(1, 2**40),
    first=st.integers(0, 10**6),
    n=st.integers(1, 600),
    mean=means,
)
def test_a_table_finds_what_is_defined(key: int, step: int, first: int, n: int, mean: float):
    u = uniform(key, step, np.arange(first, first + n))
    assert np.array_equal(drawn(key, step, first, n, mean), np.searchsorted(poisson_table(mean), u, side="right"))


@pytest.mark.parametrize("mean", MEANS)
def test_a_guide_is_sure_of_all_words_of_a_cell_or_of_none(mean: float):
    table, guide = poisson_table(mean), guide_to(poisson_table(mean))
    cells = 1 << GUIDE_BITS
    unit = 2**53 // cells
    least = np.searchsorted(table, np.arange(cells) / cells, side="right")
    most = np.searchsorted(table, (np.arange(1, cells + 1) * unit - 1) * 2.0**-53, side="right")
    assert np.array_equal(guide % UNSURE, least)
    assert np.all((guide >= UNSURE) | (least == most))
    assert np.mean(guide >= UNSURE) < 0.06


@pytest.mark.parametrize("mean", MEANS)
def test_numbers_are_poisson(mean: float):
    found = np.concatenate([drawn(77, step, 0, 512, mean) for step in range(1, 161)])
    least, most = (int(stats.poisson.ppf(share, mean)) for share in (1e-4, 1 - 1e-4))
    edges = stats.poisson.cdf(np.arange(least, most), mean)
    expected = found.size * np.diff(edges, prepend=0.0, append=1.0)
    seen = np.bincount(np.clip(found, least, most) - least, minlength=expected.size)
    assert stats.chi2.sf(np.sum((seen - expected) ** 2 / expected), seen.size - 1) > 1e-3
    assert abs(found.mean() - mean) < 4.0 * np.sqrt(mean / found.size)


def relayed(mean: float, n: int, window: tuple[float, float], **options: Any) -> neuro.Simulation:
    """A generator whose spikes are wanted as one-to-one input only, and relays that tell of each."""
    net = neuro.Network("relayed", resolution=0.1)
    start, stop = window
    net.population("noise", n, neuro.poisson_generator(rate=mean * 1e4, start=start, stop=stop))
    net.population("relay", n, neuro.parrot_neuron())
    net.connect("noise", "relay", neuro.one_to_one(), delay=0.7)
    return neuro.compile(net, **options)


def told(sim: neuro.Simulation) -> tuple[Any, ...]:
    """What is known of a simulation's spikes."""
    counts = sim.counts().populations
    return (*sim.spikes("relay"), counts["noise"].spikes, counts["relay"].spikes)


@settings(deadline=None, max_examples=25)
@given(
    mean=st.floats(0.06, 3.0) | st.sampled_from([9.0, 120.0]),
    n=st.sampled_from([1, 63, 64, 65, 511, 512, 513, 600, 1100]),
    window=st.sampled_from([(0.0, float("inf")), (0.5, 1.2), (0.9, float("inf"))]),
    seed=st.integers(0, 99),
    pieces=st.lists(st.integers(1, 9), min_size=1, max_size=4),
)
def test_counted_spikes_are_those_of_the_reference(
    mean: float, n: int, window: tuple[float, float], seed: int, pieces: list[int]
):
    runs = []
    for options in ({"backend": "reference"}, {"backend": "event"}, {"backend": "event", "threads": 2}):
        sim = relayed(mean, n, window, seed=seed, **options)
        for k, steps in enumerate(pieces):
            sim.run(0.1 * steps)
            sim.set("noise", rate=[2e3, 0.0, mean * 1e4][k % 3])
        runs.append(told(sim))
    for found in runs[1:]:
        assert all(np.array_equal(a, b) for a, b in zip(found, runs[0], strict=True))


@pytest.mark.parametrize("delay", [0.1, 0.4])
def test_weights_that_are_set_reach_no_count_that_was_emitted(delay: float):
    """Weights are set in every step, twice; what is under way keeps the old ones."""
    runs = []
    for backend in ("reference", "event"):
        net = neuro.Network("counted", resolution=0.1)
        net.population("noise", 70, neuro.poisson_generator(rate=5e3))
        for name in ("cells", "others"):
            net.population(name, 70, neuro.iaf_psc_delta(tau_m=math.inf, V_th=1e9))
            net.connect("noise", name, neuro.one_to_one(), weight=1.0, delay=delay, name=f"to_{name}")
        sim = neuro.compile(net, backend, seed=4)
        for k in range(8):
            sim.run(0.1)
            for weight in (-5.0, 2.0**k):
                sim.set_weights("to_cells", weight)
        sim.run(0.1)
        runs.append([sim.get(name, "V_m") for name in ("cells", "others")])
    assert all(np.array_equal(a, b) for a, b in zip(*runs, strict=True))


def test_tallies_never_run_over():
    n, steps, mean = 70, 1500, 400.0
    sim = relayed(mean, n, (0.0, float("inf")), seed=3)
    sim.run(0.1 * steps)
    u = keyed_random.uniform_table(keyed_random.key(3, "poisson", "noise"), np.arange(1, steps + 1), n)
    expected = np.searchsorted(poisson_table(mean), u, side="right")
    assert expected.sum(axis=0).max() > 1 << 19
    assert sim.counts().populations["noise"].spikes == expected.sum()
    assert np.array_equal(sim._engine.counts().events[0], np.count_nonzero(expected, axis=0))


def test_a_state_is_the_same_whenever_it_was_saved(tmp_path: Any):
    whole = relayed(1.7, 700, (0.0, float("inf")), seed=5)
    whole.run(6.0)
    halves = relayed(1.7, 700, (0.0, float("inf")), seed=5)
    halves.run(2.3)
    halves.save(tmp_path / "state.h5")
    again = relayed(1.7, 700, (0.0, float("inf")), seed=5)
    again.restore(tmp_path / "state.h5")
    again.run(3.7)
    assert all(np.array_equal(a, b) for a, b in zip(told(again), told(whole), strict=True))


def test_a_chip_draws_the_same_numbers():
    def run(backend: str) -> Any:
        net = neuro.Network("chip", resolution=1.0)
        net.population("noise", 130, neuro.poisson_generator(rate=1300.0))
        net.population("cells", 130, neuro.iaf_psc_exp())
        net.connect("noise", "cells", neuro.one_to_one(), weight=1.0, delay=1.0)
        sim = neuro.compile(net, backend, seed=8)
        sim.run(50.0)
        return sim.counts().populations["noise"].spikes

    assert run("spinnaker") == run("event") == run("reference")


def test_rows_that_are_read_together_begin_elsewhere_in_their_pages():
    state = next(each for each in t.NET_ARRAYS if each.name == "state")
    rows = zeros([state], {"states": 6, "row": 1024 + t.BLOCK})["state"]
    places = {row.ctypes.data % PAGE for row in rows}
    assert len(places) == 6
    assert not any(place % LINE for place in places)
    assert aligned_zeros(0, np.uint16).size == 0


@pytest.mark.parametrize(
    "distribution", [neuro.normal(std=5.0, low=-6.0, high=3.0), neuro.lognormal(low=0.5, high=2.0)]
)
@pytest.mark.parametrize("n", [20, 300])
def test_drawn_values_lie_between_their_bounds(distribution: Any, n: int):
    net = neuro.Network("drawn")
    net.population("cells", n, neuro.iaf_psc_exp())
    net.connect("cells", "cells", neuro.all_to_all(), weight=distribution)
    weights = neuro.compile(net, "reference", seed=1).get("cells_cells", "weight")
    assert distribution.low <= weights.min() < weights.max() <= distribution.high


@pytest.mark.parametrize("many", [100, 1 << 20])
@pytest.mark.parametrize("distribution", evaluated(__file__, "CUT", globals()))
def test_single_values_are_the_nearest_within_their_bounds(
    distribution: Any, many: int, monkeypatch: pytest.MonkeyPatch
):
    monkeypatch.setattr(distributions, "_MANY", many)
    single = replace(distribution, single=True)
    drawn, rounded = (np.concatenate([*map(np.array, d.pieces(np.random.default_rng(1), 70_000))])
                      for d in (distribution, single))  # fmt: skip
    assert np.array_equal(rounded.astype(np.float32), rounded)
    assert not np.signbit(rounded[rounded == 0.0]).any()
    inside = (drawn.astype(np.float32) >= distribution.low) & (drawn.astype(np.float32) <= distribution.high)
    assert np.array_equal(rounded[inside], drawn[inside].astype(np.float32))
    assert getattr(distribution, "low", -np.inf) <= rounded.min() < rounded.max() <= distribution.high
    assert inside.mean() > 0.999
