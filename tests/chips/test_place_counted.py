"""Cores filled without a look at each synapse, where memory and axons allow it, and with one."""

from dataclasses import fields

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import neuro
from neuro.chips import chip, place, quantise, splitting as split
from neuro.chips.quantising import refusals
from neuro.compiler import compile_network

LOIHI = chip("loihi")


def each(program, target, **words):
    """Look at each synapse."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(split, "_within", lambda found, limits: False)
        return place(program, target, **words)


def test_by_hand():
    """2,100 cores of one neuron each: 17 chips on a square of 5 x 5, whose tiles are filled row by row."""
    net = neuro.Network("wide", resolution=1.0)
    net.population("in", 2100, neuro.spike_generator())
    net.population("out", 2100, neuro.iaf_psc_delta())
    net.connect("in", "out", neuro.one_to_one(), weight=1.0, delay=1.0, name="first")
    net.connect("out", "out", neuro.pairs([0, 0, 0], [0, 1, 2099]), weight=1.0, delay=1.0, name="second")
    placed = place(compile_network(net, 0), LOIHI, order="declared", neurons_per_core=1)
    number, within = np.divmod(np.arange(2100), 128)
    tile = within // 4
    column, row = number % 5 * 8 + tile % 8, number // 5 * 4 + tile // 8
    assert [(core.column, core.row) for core in placed.cores] == list(zip(column, row, strict=True))
    assert (placed.chips_used, len(placed.cores)) == (17, 2100)
    first, second = placed.ways
    assert first.east_west.tolist() == column.tolist()
    assert first.north_south.tolist() == row.tolist()
    assert first.chip.tolist() == (number % 5 + number // 5).tolist()
    assert first.local.sum() == 4  # the four cores of the tile at which the host's spikes enter
    assert (second.cores[0], second.local[0], second.cores[1:].sum()) == (3, 2, 0)
    assert (second.east_west[0], second.north_south[0], second.chip[0]) == (column[-1], row[-1], 1 + 3)
    assert [core.axons_in for core in placed.cores[:2]] == [2, 2]
    assert [core.axons_out for core in placed.cores[:2]] == [3, 0]
    assert {core.synapse_bytes for core in placed.cores[2:-1]} == {8}  # a block of one synapse
    assert [placed.cores[i].synapse_bytes for i in (0, 1, -1)] == [16, 16, 16]


def same(one, other):
    assert one.as_dict() == other.as_dict()
    for a, b in zip(one.ways, other.ways, strict=True):
        for name in (field.name for field in fields(a)):
            np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


@settings(deadline=None, max_examples=12)
@given(
    sizes=st.tuples(st.integers(1, 40), st.integers(1, 60), st.integers(1, 60)),
    degree=st.integers(1, 30),
    per_core=st.integers(1, 20),
    seed=st.integers(0, 5),
)
def test_filled_alike(sizes, degree, per_core, seed):
    n_in, n_a, n_b = sizes
    net = neuro.Network("random", resolution=1.0)
    net.population("in", n_in, neuro.spike_generator())
    net.population("a", n_a, neuro.iaf_psc_exp())
    net.population("b", n_b, neuro.iaf_psc_exp())
    delays = neuro.uniform_int(low=1, high=9) if hasattr(neuro, "uniform_int") else 3.0
    net.connect("in", "a", neuro.all_to_all(), weight=1.0, delay=1.0, name="dense")
    net.connect("in", "b", neuro.fixed_indegree(degree), weight=1.0, delay=delays, name="twice")
    net.connect("a", "b", neuro.fixed_total_number(degree * n_b), neuro.stdp(), weight=1.0, delay=2.0, name="learns")
    net.connect("b", "a", neuro.fixed_indegree(degree), weight=1.0, delay=1.0, name="back")
    net.connect("a", "b", neuro.fixed_total_number(degree), weight=1.0, delay=1.0, name="again")
    program = compile_network(net, seed)
    for target in (LOIHI, chip("spinnaker")):
        for order in ("declared", "connected"):
            words = {"order": order, "neurons_per_core": per_core}
            same(place(program, target, **words), each(program, target, **words))


def test_grids_are_filled_alike():
    net = neuro.Network("grid", resolution=1.0)
    net.population("image", (2, 8, 8), neuro.spike_generator())
    net.population("maps", (3, 6, 6), neuro.iaf_psc_delta())
    net.connect("image", "maps", neuro.grid((3, 3), 1, 0), weight=1.0, delay=1.0)
    program = compile_network(net, 0)
    words = {"order": "declared", "neurons_per_core": 7}
    same(place(program, LOIHI, **words), each(program, LOIHI, **words))


def test_what_does_not_fit_is_told_alike():
    net = neuro.Network("full", resolution=1.0)
    net.population("in", 5000, neuro.spike_generator())
    net.population("out", 3, neuro.iaf_psc_delta())
    net.connect("in", "out", neuro.all_to_all(), weight=1.0, delay=1.0)
    program = compile_network(net, 0)
    assert each(program, LOIHI, order="declared").problems == place(program, LOIHI, order="declared").problems != ()


def test_refusals_are_those_of_quantising():
    net = neuro.Network("odd", resolution=1.0)
    net.population("in", 3, neuro.spike_generator())
    net.population("one", 4, neuro.izhikevich())
    net.population("two", 4, neuro.iaf_psc_exp(tau_m=float("inf"), tau_syn_ex=2.0, tau_syn_in=3.0))
    net.connect("in", "two", neuro.all_to_all(), neuro.stdp(), weight=1.0, delay=90.0)
    net.connect("in", "two", neuro.fixed_indegree(2), weight=-1.0, delay=150.0, name="late")
    for name in ("loihi", "spinnaker"):
        bare = refusals(compile_network(net, 0), chip(name))
        full = [problem for problem in quantise(compile_network(net, 0), chip(name)).problems if problem.refused]
        assert list(bare) == full != []
        program = compile_network(net, 0)
        quantise(program, chip(name))
        assert refusals(program, chip(name)) == bare
