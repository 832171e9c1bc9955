"""Placing: limits to the neuron, memory and hops against counts by hand, refusals by their text."""

import json
import math
from dataclasses import fields
from itertools import combinations, pairwise

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import neuro
import neuro_models
from neuro.chips import chip, place, quantise, splitting as split
from neuro.chips.description import Chip, Mesh
from neuro.chips.fitting import cut, fits_one_chip, too_late
from neuro.chips.incoming import block_bits, synapse_bits
from neuro.chips.mesh import exchange, lay_out
from neuro.chips.quantising import refusals
from neuro.compiler import compile_network
from refused import refusals_of
from to_place import LOIHI, SPINNAKER, limited, network, sources


# limits, to the neuron
@pytest.mark.parametrize(("size", "cores"), [(1, 1), (1024, 1), (1025, 2), (2048, 2), (2049, 3)])
def test_neurons_of_a_core(size, cores):
    placed = place(network(("a", size)), LOIHI)
    assert len(placed.cores) == cores
    assert sum(core.neurons for core in placed.cores) == size
    assert placed.problems == ()


def test_memory_of_a_core():
    program = network(sources(10), ("a", 100), connect=[("in", "a", neuro.all_to_all())])
    # Blocks of 64 and 36 synapses of 8 + 7 bits: 970 and 550 bits, rounded up to 1024 and 576: 200 bytes a source.
    (core,) = place(program, limited(synapse_bytes_per_core=2000)).cores
    assert core.synapse_bytes == 2000
    assert core.load["synapse_bytes_per_core"] == 1.0
    first, second = place(program, limited(synapse_bytes_per_core=1999), order="declared").cores
    # 98 neurons would take 34 x 15 + 10 = 520 -> 576 bits in the second block, as much; 97: 505 -> 512 bits.
    assert (first.neurons, first.synapse_bytes) == (97, 1920)
    assert second.neurons == 3


def test_memory_shared_by_a_chip():
    program = network(sources(10), ("a", 300), connect=[("in", "a", neuro.all_to_all())])
    # 256 and 44 neurons: 10 rows of 3 + 256 and 3 + 44 words.
    need = [10 * (3 + 256) * 4, 10 * (3 + 44) * 4]
    placed = place(program, limited(SPINNAKER, synapse_bytes_per_chip=sum(need)), order="declared")
    assert [core.synapse_bytes for core in placed.cores] == need
    assert placed.chips_used == 1
    assert place(program, limited(SPINNAKER, synapse_bytes_per_chip=sum(need) - 1)).chips_used == 2
    smaller = place(program, limited(SPINNAKER, synapse_bytes_per_chip=need[0] - 1), order="declared")
    assert [core.neurons for core in smaller.cores] == [255, 45]


def test_output_axons_when_a_split_makes_more_of_them():
    """A ring, each neuron to the next three: 45 would do on one core, but the last ones reach the next core, too."""
    pre = np.repeat(np.arange(60), 3)
    program = network(("a", 60), connect=[("a", "a", neuro.pairs(pre, (pre + np.tile([1, 2, 3], 60)) % 60))])
    placed = place(program, limited(axons_out_per_core=45), order="declared")
    assert placed.problems == ()
    assert [(core.neurons, core.axons_out) for core in placed.cores] == [(43, 45), (17, 19)]


def test_generators_take_no_core():
    placed = place(network(sources(5000), ("a", 1), connect=[("in", "a", neuro.pairs([4], [0]))]), LOIHI)
    assert [core.parts for core in placed.cores] == [((1, 0, 1),)]
    assert (placed.core_of[0] == -1).all()
    nothing = place(network(sources(3)), LOIHI)
    assert (nothing.cores, nothing.chips_used, nothing.problems) == ((), 0, ())
    assert str(nothing).startswith("'test' on loihi: 0 cores on 0 tiles of 0 chips")


def test_a_chip_without_mesh_or_limits():
    assert len(place(network(("a", 10000)), chip("loihi2")).cores) == 2
    bare = place(network(("a", 10000)), Chip("bare", "Bare", ""))
    assert [core.neurons for core in bare.cores] == [10000]
    assert bare.cores[0].load == {}


# memory
@pytest.mark.parametrize(
    ("synapses", "bits", "expected"), [(0, 15, 0), (1, 8, 64), (64, 9, 640), (65, 9, 704), (54, 1, 64), (55, 1, 128)]
)
def test_blocks(synapses, bits, expected):
    assert block_bits(synapses, bits) == expected
    assert block_bits(np.array([synapses]), bits).tolist() == [expected]


@pytest.mark.parametrize(
    ("model", "words", "bits"),
    [
        (neuro.iaf_psc_delta(), {}, 8),
        (neuro.iaf_psc_delta(), {"delay": 2.0}, 9),
        (neuro.iaf_psc_exp(), {"delay": 1.0}, 9),
        (neuro.iaf_psc_exp(), {"delay": np.array([1.0, 1.0, 1.0, 62.0])}, 14),
        (neuro.iaf_psc_exp(), {"synapse": neuro.stdp()}, 18),
        (neuro.parrot_neuron(), {}, 8),
        (neuro.loihi_lif(), {"synapse": neuro.loihi_static(num_weight_bits=4), "weight": 16.0}, 4),
    ],
)
def test_bits_of_a_synapse(model, words, bits):
    rule = neuro.pairs([0, 0, 1, 1], [0, 1, 0, 1])
    assert synapse_bits(network(sources(2), ("a", 2, model), connect=[("in", "a", rule, words)]), 0) == bits


def test_the_host_learns_for_a_grid():
    program = compile_network(neuro.load(neuro_models.path("remus")), 0)
    assert synapse_bits(program, 0) == 8


# refusals
def told(placed):
    assert all(problem.refused for problem in placed.problems)
    return "\n".join(f"{p.what}: {p.why}\n{p.way_out}" for p in placed.problems)


def test_too_much_memory_for_one_neuron(messages):
    program = network(sources(20), ("a", 3), connect=[("in", "a", neuro.all_to_all())])
    placed = place(program, limited(synapse_bytes_per_core=100))
    messages({"a": told(placed), "whole": str(placed)})
    assert placed.problems[0].origin == program.populations[1].origin is not None
    assert [core.neurons for core in placed.cores] == [1, 1, 1]
    assert place(program, limited(synapse_bytes_per_core=160)).problems == ()


def test_too_many_axons_of_one_neuron(messages):
    answers = []
    for size in (4096, 4097):
        net = network(sources(size), ("a", 1), connect=[("in", "a", neuro.all_to_all())])
        answers.append(told(place(net, LOIHI)))
    program = network(("a", 2), ("b", 5), connect=[("a", "b", neuro.pairs([1] * 5, range(5)))])
    for most in (5, 4):
        answers.append(told(place(program, limited(neurons_per_core=1, axons_out_per_core=most))))
    assert answers[::2] == ["", ""]
    messages({"input": answers[1], "output": answers[3]})


def test_too_large_for_the_largest_machine(messages):
    machine = limited(mesh=Mesh(1, 1, 4), cores_per_chip=4, neurons_per_core=10, chips=2)
    assert place(network(("a", 20), ("b", 60)), machine).problems == ()
    program = network(("a", 20), ("b", 61))
    placed = place(program, machine)
    assert placed.problems[0].origin == program.populations[1].origin
    messages({"b": told(placed), "crowd": told(place(network(*((name, 30) for name in "abcd")), machine))})


def delayed(model, delay):
    words = {"weight": 2.0, "delay": float(delay)}
    if model.chip:
        words["synapse"] = neuro.loihi_static()
    return network(sources(2), ("a", 2, model), connect=[("in", "a", neuro.all_to_all(), words)])


def test_a_current_has_no_delay_register():
    current = ("dc", 3, neuro.dc_generator(amplitude=1.0))
    program = network(current, ("a", 2), connect=[("dc", "a", neuro.all_to_all(), {"delay": 100.0})])
    assert place(program, chip("loihi2")).problems == ()


@pytest.mark.parametrize("base", [LOIHI, SPINNAKER], ids=["loihi", "spinnaker"])
@pytest.mark.parametrize("model", [neuro.iaf_psc_exp(), neuro.iaf_psc_delta(), neuro.parrot_neuron()])
def test_a_delay_is_told_as_where_the_arithmetic_is_emulated_and_once(base, model):
    """Quantising tells it of these chips, with the registers that run; placing leaves it to that."""
    limit = base.limit("delay_max")
    for delay in range(limit - 1, limit + 3):
        program = delayed(model, delay)
        assert list(too_late(program, base)) == [p for p in quantise(program, base).problems if "a delay of" in p.what]
        assert place(program, base).problems == ()
    assert list(too_late(delayed(model, limit + 2), base)) != []


@settings(max_examples=30, deadline=None)
@given(sizes=st.lists(st.integers(1, 40), min_size=1, max_size=4), limit=st.integers(1, 12), chips=st.integers(1, 4))
def test_as_many_neurons_as_are_told_would_fit(sizes, limit, chips):
    """Of a network of one population no more; else one more may find room beside another population."""
    machine = limited(mesh=Mesh(1, 1, 3), cores_per_chip=3, neurons_per_core=limit, chips=chips)
    names = "abcd"[: len(sizes)]
    for problem in place(network(*zip(names, sizes, strict=True)), machine).problems:
        if problem.way_out.startswith("the network must be smaller"):
            continue
        which = names.index(problem.what[12])
        told = int(problem.way_out.split()[1])
        other = [*sizes[:which], told, *sizes[which + 1 :]]
        assert place(network(*zip(names, other, strict=True)), machine).problems == ()
        if len(sizes) == 1:
            assert place(network(("a", told + 1)), machine).problems != ()


@given(
    sizes=st.lists(st.integers(1, 40), min_size=1, max_size=4),
    neurons=st.integers(4, 12),
    axons=st.integers(1, 60),
    memory=st.integers(100, 4000),
    order=st.sampled_from(["connected", "declared"]),
)
def test_what_fits_one_chip_has_no_problem_wherever_it_lies(sizes, neurons, axons, memory, order):
    limits = {"axons_in_per_core": axons, "synapse_bytes_per_chip": memory, "chips": 1}
    machine = limited(mesh=Mesh(1, 1, 8), cores_per_chip=8, neurons_per_core=neurons, **limits)
    names = "abcd"[: len(sizes)]
    ring = [(names[k - 1], name, neuro.all_to_all()) for k, name in enumerate(names)]
    program = network(*zip(names, sizes, strict=True), connect=ring)
    if fits_one_chip(program, machine, cut(program, machine, order=order)):
        placed = place(program, machine, order=order)
        assert (placed.problems, placed.chips_used) == ((), 1)
    alone = network(("a", 1))
    assert fits_one_chip(alone, machine, cut(alone, machine, order=order))


def test_arguments(messages):
    messages(refusals_of(messages.cases, globals()))


def test_report(messages):
    to_all = [(source, target, neuro.all_to_all()) for source, target in (("in", "a"), ("a", "b"))]
    placed = place(network(sources(2), ("a", 3), ("b", 2), connect=to_all), LOIHI, neurons_per_core=3)
    messages({"report": str(placed)})
    plain = json.loads(json.dumps(placed.as_dict()))
    assert plain["cores"][1]["parts"] == [{"population": "b", "first": 0, "last": 2}]
    assert plain["hops_per_spike"]["a_b"] == {"cores": 1, "local": 1, "east_west": 0, "north_south": 0, "chip": 0}


LOIHI = chip("loihi")


def each(program, target, **words):
    """Look at each synapse."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(split, "_input_fits", lambda found, limits: False)
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
