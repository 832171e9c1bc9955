"""Where cores lie on the mesh: hops by hand, orders that keep what is connected close."""

import math
from itertools import combinations, pairwise

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import neuro
import neuro_models
from neuro.chips import place
from neuro.chips.description import Mesh
from neuro.chips.mesh import exchange, lay_out
from neuro.compiler import compile_network
from to_place import LOIHI, limited, network, sources

REMUS = neuro_models.path("remus")


# hops


# close together


def chain():
    """Twelve layers, declared in another order than they are connected in."""
    net = neuro.Network("chain", resolution=1.0)
    layers = [f"layer{i}" for i in range(12)]
    net.population("input", 600, neuro.spike_generator())
    for i in (7, 2, 10, 0, 5, 11, 3, 8, 1, 6, 9, 4):
        net.population(layers[i], 600, neuro.iaf_psc_exp())
    net.connect("input", layers[0], neuro.one_to_one(), weight=1.0, delay=1.0)
    for source, target in pairwise(layers):
        net.connect(source, target, neuro.fixed_indegree(60), weight=1.0, delay=1.0)
    return net


def balanced():
    """Brunel's network of `benchmarks/networks.py` with 5,000 neurons."""
    net = neuro.Network("balanced", resolution=0.1)
    cell = neuro.iaf_psc_delta()
    for name, size in (("exc", 4000), ("inh", 1000)):
        net.population(name, size, cell)
        net.population(f"noise_{name}", size, neuro.poisson_generator())
        net.connect(f"noise_{name}", name, neuro.one_to_one(), weight=1.0, delay=1.5)
    for target in ("exc", "inh"):
        for source, count in (("exc", 80), ("inh", 20)):
            net.connect(source, target, neuro.fixed_indegree(count), weight=1.0, delay=1.5)
    return net


def remus():
    return neuro.load(REMUS)


@pytest.mark.parametrize(("make", "at_most"), [(chain, 0.2), (balanced, 0.95), (remus, 0.7)])
def test_connected_parts_lie_close_together(make, at_most):
    program = compile_network(make(), 0)
    close, declared = (place(program, LOIHI, order=order) for order in ("connected", "declared"))
    assert 0 < close.total_hops < at_most * declared.total_hops
    assert len(close.cores) <= len(declared.cores)


def test_neurons_at_one_place_of_a_grid_share_a_core():
    program = compile_network(remus(), 0)
    core_of = place(program, LOIHI).core_of[1].reshape(20, 7, 7)
    assert (core_of == core_of[0]).mean() > 0.8
    declared = place(program, LOIHI, order="declared").core_of[1].reshape(20, 7, 7)
    assert (declared[0] == declared[0, 0, 0]).all()


def test_unused_tiles_that_are_closer_are_taken():
    """Four tiles, each of whose cores every source reaches: (0, 0), its two neighbours and one at two hops."""
    program = network(sources(8), ("a", 16), connect=[("in", "a", neuro.all_to_all())])
    assert place(program, LOIHI, neurons_per_core=1).total_hops == 8 * 4 * (0 + 1 + 1 + 2)
    assert place(program, LOIHI, neurons_per_core=1, order="declared").total_hops == 8 * 4 * (0 + 1 + 2 + 3)


@pytest.mark.parametrize("cores", [1, 4, 24, 25, 24 * 7])
def test_a_snake_takes_neighbours(cores):
    target = limited(mesh=Mesh(4, 6, 1), cores_per_chip=24)
    places = lay_out(target, np.zeros(cores, dtype=np.int64), snake=True)
    steps = np.abs(np.diff(places.column)) + np.abs(np.diff(places.row))
    assert (steps[np.diff(places.chip) == 0] == 1).all()
    over = np.abs(np.diff(places.chip_column)) + np.abs(np.diff(places.chip_row))
    assert (over == np.diff(places.chip)).all()
    side = math.ceil(math.sqrt(math.ceil(cores / 24)))
    assert max(places.chip_column.max(), places.chip_row.max()) < side


@settings(max_examples=50, deadline=None)
@given(st.integers(1, 9), st.randoms(use_true_random=False))
def test_exchange_leaves_no_pair_that_would_save_hops(n, draw):
    traffic = np.array([[draw.randint(0, 9) for _ in range(n)] for _ in range(n)], dtype=np.float64)
    traffic = np.triu(traffic, 1) + np.triu(traffic, 1).T
    pull = np.array([draw.randint(0, 9) for _ in range(n)], dtype=np.float64)
    column, row = (np.array([draw.randint(0, 4) for _ in range(n)]) for _ in range(2))

    def hops(at):
        x, y = column[at], row[at]
        way = np.abs(x[:, None] - x) + np.abs(y[:, None] - y)
        return (traffic * way).sum() / 2 + pull @ (x + y)

    at = exchange(traffic, pull, column, row)
    assert sorted(at) == list(range(n))
    assert hops(at) <= hops(np.arange(n))
    for i, j in combinations(range(n), 2):
        swapped = at.copy()
        swapped[[i, j]] = swapped[[j, i]]
        assert hops(swapped) >= hops(at)
