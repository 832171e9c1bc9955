"""Views: neurons of a population by an index, wherever neurons are named."""

import copy
import pickle

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st

import neuro
from neuro.compiler import compile_network
from neuro.extend import Rule
from neuro.model.network import Network
from neuro.model.parts import Population
from neuro.testing.case import differences, observe
from refused import refused
from strategies import views

SETTINGS = settings(max_examples=60, deadline=None, derandomize=True)
FLOATS = ("reference", "event")


def row(n: int = 10, name: str = "exc") -> Population:
    return Network().population(name, n, neuro.iaf_psc_exp())


def sheet(*shape: int | str) -> Population:
    return Network().population("grid", shape, neuro.iaf_psc_exp())


# what a handle gives


def test_handles_as_arrays():
    exc, grid = row(), sheet(2, 3)
    assert np.asarray(exc[2:5]).tolist() == exc[range(2, 5)].ids.tolist() == [2, 3, 4]
    assert np.asarray(exc).tolist() == exc.ids.tolist() == list(range(10))
    assert np.asarray(grid[1], dtype=float).tolist() == [3.0, 4.0, 5.0]
    assert grid.ids.tolist() == grid[range(6)].ids.tolist()


def test_neurons_are_no_numbers(messages):
    net = Network()
    exc = net.population("exc", 3, neuro.iaf_psc_exp())
    messages.calls(globals() | {"net": net, "exc": exc, "sim": neuro.compile(net, "reference")})


def test_populations_are_keys():
    exc, inh = row(), row(name="inh")
    colours = {exc: "blue", inh: "red"}
    assert (colours[exc], colours[inh]) == ("blue", "red")
    assert hash(row()) == hash(exc)
    assert row() == exc


def test_numbers_are_in_a_simulation():
    exc = row()
    with pytest.raises(AttributeError) as error:
        exc.V_m  # noqa: B018
    expected = "population 'exc' is a description: its V_m is in a simulation: "
    assert str(error.value) == expected + "sim.get(exc, 'V_m') reads it"
    with pytest.raises(AttributeError) as error:
        exc.V_m = 3.0
    assert str(error.value) == expected + "sim.set(exc, V_m=...) sets it"
    with pytest.raises(AttributeError, match="object has no attribute 'colour'"):
        exc.colour  # noqa: B018
    with pytest.raises(AttributeError):
        exc.name = "inh"
    assert not hasattr(exc, "_repr_png_")
    assert pickle.loads(pickle.dumps(exc)) == copy.deepcopy(exc) == exc


def test_several_names():
    net = Network()
    exc = net.population("exc", 3, neuro.iaf_psc_exp(I_e=5.0))
    sim = neuro.compile(net, "reference")
    found = sim.get(exc[:2], ["V_m", "I_e"])
    assert {word: values.tolist() for word, values in found.items()} == {"V_m": [-70.0, -70.0], "I_e": [5.0, 5.0]}


# what an index chooses


@given(st.data())
@SETTINGS
def test_an_index_is_that_of_numpy(data):
    shape = tuple(data.draw(st.lists(st.integers(1, 5), min_size=1, max_size=3)))
    part = sheet(*shape)
    table = np.arange(len(part)).reshape(shape)

    def item(n):
        bound = st.none() | st.integers(-n, n)
        return st.integers(-n, n - 1) | st.builds(slice, bound, bound, st.sampled_from([None, 1, 2, 3, -1, -2]))

    index = data.draw(st.tuples(*(item(n) for n in shape[: data.draw(st.integers(1, len(shape)))])))
    expected = table[index]
    if expected.size == 0:
        assert "chooses no neuron: expected at least one" in refused(part.__getitem__, index)
        return
    found = part[index]
    assert found.ids.tolist() == expected.reshape(-1).tolist()
    assert found.shape == (expected.shape or (1,))
    assert len(found) == expected.size
    assert [one.ids.tolist() for one in found] == [[neuron] for neuron in found.ids]
    assert eval(repr(found), {"grid": part}) == found


@given(st.data())
@SETTINGS
def test_a_view_of_a_view_is_one_of_the_population(data):
    part = row(data.draw(st.integers(1, 12)))
    first = data.draw(views(part))
    inner = data.draw(views(row(len(first))))
    index = inner.index
    found = first[index[0] if isinstance(index, tuple) else index]
    assert found.ids.tolist() == first.ids[inner.ids].tolist()
    assert found.population is part


def test_axes_of_a_view_are_those_of_its_index():
    part = sheet(3, 4, 5)
    assert part[1:, 2, ::2].shape == (2, 3)
    assert repr(part[1:, 2, ::2][0]) == "grid[1, 2, ::2]"
    assert repr(part[..., -1][1:, ::-1]) == "grid[1:, ::-1, 4]"
    assert repr(part[0, 1, 2][0]) == "grid[0, 1, 2]"
    assert repr(part[1][[0, 7]]) == "grid[[20, 27]]"


def test_views_are_told_shortly():
    part = row(100)
    assert [repr(part[index]) for index in (slice(None, 7), -1, [3, 5], slice(None), slice(90, 5, -7))] == [
        *("exc[:7]", "exc[99]", "exc[[3, 5]]", "exc[:]", "exc[90::-7]"),
    ]
    assert repr(part[np.arange(40, 60)[::-1]]) == "exc[[59, 58, 57, 56, 55, ..., 40]]"


def test_views_of_the_same_neurons_are_equal():
    part = row()
    assert part[:3] == part[[0, 1, 2]] == part[0:3:1] == part[np.arange(10) < 3] == part[:5][:3]
    assert part[:3] != part[2::-1]
    assert part[:3] != row(10, "inh")[:3]
    assert part[:3] != [0, 1, 2]


def test_a_shape_that_follows_is_resolved_when_compiled(messages):
    net = Network(resolution=1.0)
    net.population("sheet", (6, 6), neuro.poisson_generator(rate=100.0))
    maps = net.population("maps", (2, "auto", "auto"), neuro.iaf_psc_exp())
    out = net.population("out", 2, neuro.iaf_psc_exp())
    net.connect("sheet", "maps", neuro.grid(kernel=(3, 3)), weight=100.0)
    net.connect(maps[1, -1, :2], out, neuro.one_to_one(), name="last")
    assert maps[1, -1] == maps[1, -1] != maps[1, 3]
    sim = neuro.compile(net)
    assert sim.weights("last")[0].tolist() == [28, 29]
    assert sim.get(maps[0, 3], "V_m").shape == (4,)
    messages.calls({"maps": maps, "sim": sim})


def test_an_index_that_chooses_nothing_is_refused(messages):
    messages.calls(globals())


# connections


def ends(net: Network, name: str = "wires", seed: int = 3) -> list[tuple[int, int]]:
    """The pairs of a projection."""
    program = compile_network(net, seed)
    index = [part.name for part in program.projections].index(name)
    return list(zip(*(ids.tolist() for ids in program.connections(index)), strict=True))


def rules():
    n = st.integers(1, 3)
    return st.one_of(
        st.just(neuro.all_to_all()),
        st.builds(neuro.pairwise_bernoulli, p=st.floats(0.0, 1.0)),
        st.builds(neuro.fixed_indegree, n=n),
        st.builds(neuro.fixed_outdegree, n=n),
    )


@given(data=st.data(), rule=rules())
@SETTINGS
def test_a_rule_sees_views_as_populations_of_their_own(data, rule):
    """What is drawn between views is what is drawn between populations of their sizes, weight by weight."""
    weight, delay = neuro.normal(mean=1.0, std=1.0), neuro.uniform(low=0.1, high=3.0)
    whole, small = Network(), Network()
    pre, post = (whole.population(name, 9, neuro.iaf_psc_exp()) for name in ("a", "b"))
    source, target = data.draw(views(pre)), data.draw(views(post))
    whole.connect(source, target, rule, weight=weight, delay=delay, name="wires")
    for name, view in (("a", source), ("b", target)):
        small.population(name, len(view), neuro.iaf_psc_exp())
    small.connect("a", "b", rule, weight=weight, delay=delay, name="wires")
    expected = [(int(source.ids[i]), int(target.ids[j])) for i, j in ends(small)]
    assert ends(whole) == sorted(expected)
    program, other = (compile_network(net, 3).projections[0] for net in (whole, small))
    assert np.array_equal(program.weight, other.weight)
    assert np.array_equal(program.delay, other.delay)


@given(data=st.data(), kind=st.sampled_from(["all", "into", "out", "chance"]), repeats=st.booleans())
@SETTINGS
def test_autapses_of_overlapping_views(data, kind, repeats):
    """Without autapses no neuron reaches itself, and all else is as the rule says."""
    net = Network()
    cells = net.population("cells", 9, neuro.iaf_psc_exp())
    source, target = data.draw(views(cells)), data.draw(views(cells))
    among_source, among_target = set(source.ids.tolist()), set(target.ids.tolist())
    n = {"multapses": repeats, "autapses": False}
    rule = {
        "all": neuro.all_to_all(autapses=False),
        "into": neuro.fixed_indegree(n=2, **n),
        "out": neuro.fixed_outdegree(n=2, **n),
        "chance": neuro.pairwise_bernoulli(p=1.0, autapses=False),
    }[kind]
    net.connect(source, target, rule, name="wires")
    each, among = (among_target, among_source) if kind == "into" else (among_source, among_target)
    least = min(len(among - {neuron}) for neuron in each)
    if kind in ("into", "out") and least < (1 if repeats else 2):
        assert f"expected at most {least}, the number of candidates" in refused(compile_network, net, 0)
        return
    found = ends(net)
    assert found == sorted(found)
    assert all(pre != post and pre in among_source and post in among_target for pre, post in found)
    if kind in ("all", "chance"):
        assert found == [(i, j) for i in sorted(among_source) for j in sorted(among_target) if i != j]
    else:
        one = 1 if kind == "into" else 0
        assert sorted(pair[one] for pair in found) == sorted(list(each) * 2)
        assert repeats or len(set(found)) == len(found)


@given(st.data())
@SETTINGS
def test_arrays_have_the_shapes_of_the_views(data):
    net = Network()
    cells, other = net.population("cells", 8, neuro.iaf_psc_exp()), net.population("other", 8, neuro.iaf_psc_exp())
    source, target = data.draw(views(cells)), data.draw(views(data.draw(st.sampled_from([cells, other]))))
    autapses = data.draw(st.booleans())
    weight = np.arange(1.0, 1.0 + len(source) * len(target)).reshape(len(source), len(target))
    net.connect(source, target, neuro.all_to_all(autapses=autapses), weight=weight, delay=0.1 * weight, name="wires")
    pre, post, found, late = neuro.compile(net, "reference").weights("wires", delays=True)
    table = np.zeros((8, 8))
    table[np.ix_(source.ids, target.ids)] = weight
    if target.population is cells and not autapses:
        np.fill_diagonal(table, 0.0)
    expected = np.zeros((8, 8))
    expected[pre, post] = found
    assert np.array_equal(expected, table)
    assert np.allclose(late, 0.1 * found)


@pytest.mark.parametrize("backend", FLOATS)
def test_views_equal_listed_pairs(backend):
    """A network of views runs as the same one with its pairs listed by hand."""
    found = []
    for by_hand in (False, True):
        net = Network("n")
        cells = net.population(
            "cells", (2, 6), neuro.iaf_psc_exp(I_e=400.0), initial={"V_m": neuro.uniform(low=-70, high=-56)}
        )
        weight = np.linspace(-100.0, 300.0, 12).reshape(4, 3)
        if by_hand:
            pre, post = np.repeat([1, 3, 5, 0], 3), np.tile([11, 9, 7], 4)
            net.connect(cells, cells, neuro.pairs(pre=pre, post=post), weight=weight.reshape(-1), name="wires")
            net.connect(cells, cells, neuro.pairs(pre=[0, 1], post=[1, 0]), neuro.stdp(), weight=0.5, name="learns")
        else:
            net.connect(cells[[1, 3, 5, 0]], cells[1, ::-2], neuro.all_to_all(), weight=weight, name="wires")
            some = cells[0, :2]
            net.connect(some, some, neuro.all_to_all(autapses=False), neuro.stdp(), weight=0.5, name="learns")
        sim = neuro.compile(net, backend, seed=2)
        sim.run(80.0)
        found.append(observe(sim))
    assert found[0]["spikes of cells: steps"].size > 20
    assert differences(*found, exact=True) == []


def test_a_whole_view_is_the_population():
    net = Network()
    cells = net.population("cells", (2, 3), neuro.iaf_psc_exp())
    net.connect(cells[:], cells[:, :], neuro.all_to_all(), name="wires")
    net.connect(cells[::-1], cells, neuro.one_to_one(), name="turned")
    net.probe("v", cells[...], "V_m")
    program = compile_network(net, 0)
    assert [part.layout for part in program.projections] == ["dense", "csr"]
    assert program.probes[0].ids is None


def test_a_rule_of_ones_own_is_told_whether_its_ends_are_the_same():
    seen = []

    class noted(Rule):
        def connect(self, source, target, same, rng):
            seen.append((source, target, same))
            return [0], [1]

    net = Network()
    cells = net.population("cells", (2, 4), neuro.iaf_psc_exp())
    for name, pre, post in (("a", cells[1], cells[1]), ("b", cells[0], cells[1]), ("c", cells, cells)):
        net.connect(pre, post, noted(), name=name)
    program = compile_network(net, 0)
    assert seen == [((4,), (4,), True), ((4,), (4,), False), ((2, 4), (2, 4), True)]
    assert [program.connections(index)[1].tolist() for index in range(3)] == [[5], [5], [1]]


def test_a_grid_connects_whole_populations(messages):
    net = Network()
    sheet = net.population("sheet", (4, 4), neuro.iaf_psc_exp())
    maps = net.population("maps", (2, 2, 2), neuro.iaf_psc_exp())
    net.connect(sheet, maps[:1], neuro.grid(kernel=(3, 3)), name="wires")
    messages.calls(globals() | {"net": net})


def test_the_learnt_network_of_views():
    net = Network()
    cells = net.population("cells", 6, neuro.iaf_psc_exp(I_e=500.0))
    net.connect(cells[:3], cells[3:], neuro.one_to_one(), weight=[1.0, 2.0, 3.0], name="wires")
    net.probe("v", cells[[4, 1]], "V_m")
    sim = neuro.compile(net)
    sim.run(10.0)
    learnt = sim.network()
    assert learnt.probes["v"].view == cells[[4, 1]]
    assert ends(learnt) == [(0, 3), (1, 4), (2, 5)]
    again = neuro.compile(learnt)
    again.run(10.0)
    assert np.array_equal(again.trace("v")[1], sim.trace("v")[1])


def test_parts_of_another_network_are_refused(messages):
    net, other = Network("here"), Network("there")
    cells = net.population("cells", 3, neuro.iaf_psc_exp())
    foreign = other.population("cells", 3, neuro.iaf_psc_exp())
    alone = other.population("alone", 3, neuro.iaf_psc_exp())
    messages.calls(globals() | {"net": net, "cells": cells, "foreign": foreign, "alone": alone})


@pytest.mark.parametrize("written", ["exc[2:5]", "exc[[2, 3, 4]]", {"exc": "2:5"}, {"exc": [2, 3, 4]}])
def test_views_as_text(written, tmp_path):
    """One grammar: what YAML and a command line take, calls take, too."""
    net = Network()
    net.population("exc", 10, neuro.iaf_psc_exp(I_e=500.0))
    net.connect(written, "exc", neuro.all_to_all(), weight=1.0)
    net.probe("z", written, "V_m", every=1.0)
    assert list(net.projections) == ["exc_exc"]
    sim = neuro.compile(net, "reference")
    sim.set(written, I_e=900.0)
    assert sim.get("exc", "I_e").tolist() == [500.0] * 2 + [900.0] * 3 + [500.0] * 5
    assert sim.get(written, "I_e").tolist() == [900.0] * 3
    sim.run(30.0, out=tmp_path / "out.h5")
    left = neuro.results.read(tmp_path / "out.h5")
    for run in (sim, left):
        assert set(run.spikes(written)[1].tolist()) == {2, 3, 4}
        assert run.trace("z")[1].shape[1] == 3
        assert set(run.weights("exc_exc", post=written)[1].tolist()) == {2, 3, 4}
        assert neuro.plots.raster(run, written).axes[0].get_title("left").startswith("exc: 3 neurons")


def test_mistakes_of_views_as_text(messages):
    net = Network()
    net.population("exc", 10, neuro.iaf_psc_exp())
    messages.calls(globals() | {"net": net, "sim": neuro.compile(net, "reference")})
