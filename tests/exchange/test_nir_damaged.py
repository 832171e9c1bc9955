"""Damaged and hostile NIR files: one clear message, no traceback, no wait."""

from __future__ import annotations

from contextlib import suppress
from itertools import pairwise

import h5py
import numpy as np
import pytest

import neuro

nir = pytest.importorskip("nir", reason="nir is not installed")


def one(n: int = 3) -> np.ndarray:
    return np.ones(n)


def lif(n: int = 3, **words):
    return nir.LIF(**{"tau": one(n) * 0.01, "r": one(n), "v_leak": 0 * one(n), "v_threshold": one(n)} | words)


def graph(*nodes, edges=None, n: int = 3):
    """Nodes between an Input and an Output, in a row where no edges are given."""
    named = {"input": nir.Input({"input": np.array([n])})} | {f"n{k}": node for k, node in enumerate(nodes)}
    named["output"] = nir.Output({"output": np.array([n])})
    names = list(named)
    return nir.NIRGraph(named, edges or list(pairwise(names)), type_check=False)


def written(tmp_path, change=lambda file: None):
    path = tmp_path / "net.nir"
    nir.write(path, graph(nir.Linear(np.eye(3)), lif()))
    with h5py.File(path, "r+") as file:
        change(file["node"])
    return path


def put(name, value):
    def change(node):
        del node[name]
        node[name] = value

    return change


def remove(name):
    def change(node):
        del node[name]

    return change


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (put("nodes/n1/tau", -one()), "node 'n1': tau = -1: expected a time above 0"),
        (put("nodes/n1/tau", np.nan * one()), "node 'n1': tau: found a number that is not finite"),
        (put("nodes/n1/v_threshold", -one()), "v_reset is not below v_threshold"),
        (put("nodes/n0/weight", np.ones((3, 4))), r"net.nir: node 'n0' .* receives the shape \[3\]"),
        (put("nodes/n1/type", "Unheard"), "cannot be read as NIR"),
        (remove("nodes/n1/tau"), "cannot be read as NIR"),
        (remove("nodes/input"), "input"),
        (put("edges", np.array([[b"input", b"nobody"]], dtype="S6")), "nobody"),
        (put("nodes/input/shape", np.array([-3])), r"shape \[-3\]: expected whole sizes of at least 1, of 268,435"),
        (put("nodes/n1/tau", one(7)), "cannot be read as NIR: node 'n1': All parameters must have the same shape"),
        (put("nodes/n1/tau", one() * 1j), "node 'n1': tau: found complex128: expected real numbers"),
        (put("nodes/n1/r", np.zeros(3, [("a", "f4")])), "node 'n1': r: found .*: expected real numbers"),
        (put("nodes/n1/v_leak", np.array(["a", "b", "c"], dtype="S1")), r"v_leak: found \|S1: expected real numbers"),
        (put("nodes/input/shape", np.array([3.5])), r"shape \[3.5\]: expected whole sizes of at least 1"),
        (put("nodes/input/shape", np.array([np.nan])), r"cannot be read as NIR|shape \[nan\]: expected whole sizes"),
        (remove("nodes/n1/type"), "cannot be read as NIR: node 'n1': has no 'type'"),
        (put("type", "LIF"), "net.nir: holds LIF: expected a graph, NIRGraph"),
        (remove("edges"), "cannot be read as NIR"),
    ],
)
def test_a_damaged_file_is_told_in_one_message(change, message, tmp_path):
    path = written(tmp_path, change)
    with pytest.raises(neuro.ModelError, match=message):
        neuro.from_nir(path, dt=1.0, from_="norse")


def test_no_nir_file(tmp_path):
    (tmp_path / "a.nir").write_text("hello")
    with pytest.raises(neuro.ModelError, match="is no NIR file: expected HDF5"):
        neuro.from_nir(tmp_path / "a.nir", dt=1.0, from_="norse")
    with pytest.raises(neuro.ModelError, match=r"found int: expected a file, or a nir\.NIRGraph"):
        neuro.from_nir(3, dt=1.0, from_="norse")


@pytest.mark.parametrize(
    ("net", "message", "way_out"),
    [
        (graph(lif(), lif(), edges=[("input", "n0"), ("n0", "n1"), ("n1", "n0"), ("n1", "output")]), "loop", "delay"),
        (
            graph(nir.Linear(np.eye(3)), nir.Linear(np.eye(3)), edges=[("n0", "n1"), ("n1", "n0"), ("input", "n0")]),
            "has no neuron in it",
            "",
        ),
        (graph(nir.Delay(one() * 0.00035), lif()), "is no multiple of the step", "dt that divides it"),
        (graph(lif(tau=one() * 1e-4)), "below a step", "smaller dt"),
        (graph(nir.LI(one() * 0.01, one(), 0 * one()), lif()), "its potential is sent on", "let it fire"),
    ],
)
def test_what_cannot_be_is_refused_with_the_way_out(net, message, way_out):
    with pytest.raises(neuro.ModelError, match=message) as told:
        neuro.from_nir(net, dt=1.0, from_="norse")
    assert way_out in told.value.hint


def sub():
    return graph(lif())


@pytest.mark.parametrize(
    ("net", "message"),
    [
        (graph(nir.Affine(np.eye(3), one(4)), lif()), r"node 'n0': bias has the shape \[4\]: expected \[3\]"),
        (graph(nir.Affine(np.eye(3), one() * np.nan), lif()), "node 'n0': bias: found a number that is not finite"),
        (graph(nir.Delay(one() * np.nan), lif()), "node 'n0': delay: found a number that is not finite"),
        (graph(nir.Flatten(None, 0.5, -1), lif()), r"node 'n0': start_dim = 0\.5: expected a whole number"),
        (graph(lif(), edges=[("input", "n0"), ("n0", "input"), ("n0", "output")]), "an Input receives nothing"),
        (graph(lif(), edges=[("input", "n0"), ("n0", "x")]), "an edge names 'x', which is no node"),
        (
            graph(sub(), edges=[("input", "n0"), ("n0", "output"), ("n0.n0", "output")]),
            "an edge names 'n0.n0', which is no node",
        ),
        (graph(edges=[("input", "input")]), "has no neuron in it|an Input receives nothing"),
        (graph(nir.Linear(np.eye(3)), lif(), edges=[("n0", "n1"), ("n1", "output")]), "node 'n0' .*: receives nothing"),
    ],
)
def test_a_graph_that_is_none_is_refused(net, message):
    with pytest.raises(neuro.ModelError, match=message):
        neuro.from_nir(net, dt=1.0, from_="nir")


@pytest.mark.parametrize("word", ["stride", "padding", "dilation", "groups"])
@pytest.mark.parametrize("value", [1.5, np.inf, -1, [1, 1, 1], []])
def test_what_is_no_whole_number_of_a_convolution_is_refused(word, value):
    conv = nir.Conv2d((4, 4), np.ones((1, 1, 2, 2)), 1, 0, 1, 1, np.zeros(1))
    setattr(conv, word, np.array(value, dtype=float))
    named = {"input": nir.Input({"input": np.array([1, 4, 4])}), "conv": conv}
    with pytest.raises(neuro.ModelError, match=f"node 'conv': {word} = .*: expected|groups = -1"):
        neuro.from_nir(nir.NIRGraph(named, [("input", "conv")], type_check=False), dt=1.0, from_="nir")


def test_a_node_of_a_subgraph_and_one_beside_it_are_two():
    named = {"input": nir.Input({"input": np.array([3])}), "s": sub(), "s.n0": lif()}
    net = nir.NIRGraph(named, [("input", "s"), ("s", "s.n0")], type_check=False)
    with pytest.raises(neuro.ModelError, match=r"node 's\.n0': is there twice"):
        neuro.from_nir(net, dt=1.0, from_="nir")


@pytest.mark.parametrize("name", ["bias", "every_step"])
def test_a_node_may_have_the_name_of_what_sends_biases(name):
    cell = lif(1) if name == "bias" else nir.CubaLIF(*(one(1) * 0.01,) * 2, one(1), 0 * one(1), one(1))
    named = {"input": nir.Input({"input": np.array([1])}), name: cell, "w": nir.Affine(one(1)[:, None], one(1) * 2)}
    spikes = []
    for said in (name, "other"):
        nodes = {said if each == name else each: node for each, node in named.items()} | {"last": cell}
        net = neuro.from_nir(nir.NIRGraph(nodes, list(pairwise(nodes))), dt=1.0, from_="nir")
        sim = neuro.compile(net)
        sim.run(50.0)
        spikes.append(sim.spikes("last")[0].tolist())
    assert spikes[0] == spikes[1] != []


def test_long_names_are_cut_and_stay_apart(tmp_path):
    named = {"input": nir.Input({"input": np.array([3])}), "n" * 5000: lif(), "n" * 5001: lif()}
    net = neuro.from_nir(nir.NIRGraph(named, list(pairwise(named))), dt=1.0, from_="nir")
    net.save(tmp_path / "net.yaml")
    assert list(neuro.load(tmp_path / "net.yaml").populations) == ["input", "n" * 200, "n" * 200 + "_2"]


@pytest.mark.parametrize("said", [5, np.array([1, 2]), "Norse"])
def test_a_convention_that_is_none(said):
    net = graph(lif())
    net.metadata = {"neuro_convention": said}
    with pytest.raises(neuro.ModelError, match="unknown convention"):
        neuro.from_nir(net, dt=1.0)


def test_a_population_without_input_is_not_written():
    net = neuro.Network("net", resolution=1.0)
    net.population("current", 1, neuro.dc_generator(amplitude=100.0))
    net.population("cells", 3, neuro.iaf_psc_delta(t_ref=0.0))
    net.connect("current", "cells", neuro.all_to_all())
    with pytest.raises(neuro.ModelError, match=r"'cells' .* receives no spikes: a graph has no such node"):
        neuro.to_nir(net)
    with pytest.raises(neuro.ModelError, match="to_nir: found None: expected a Network"):
        neuro.to_nir(None)
    with pytest.raises(neuro.ModelError, match="unknown node 'nobody'"):
        neuro.check_nir(graph(lif()), dt=1.0, from_="nir")["nobody"]


def test_every_bit_that_flips_is_survived(tmp_path):
    content = written(tmp_path).read_bytes()
    rng, path = np.random.default_rng(0), tmp_path / "flipped.nir"
    for k in range(150):
        damaged = bytearray(content[: rng.integers(len(content))] if k % 5 == 0 else content)
        for _ in range(4 if damaged else 0):
            damaged[rng.integers(len(damaged))] ^= 1 << rng.integers(8)
        path.write_bytes(damaged)
        with suppress(neuro.ModelError):
            neuro.from_nir(path, dt=1.0, from_="norse")


@pytest.mark.parametrize("what", ["heap", "index", "length"])
def test_texts_that_are_elsewhere_are_not_read(what, tmp_path):
    """HDF5 ended the process."""
    path = written(tmp_path)
    content = bytearray(path.read_bytes())
    with h5py.File(path) as file:
        at = file["node/nodes/n1/type"].id.get_offset() + {"length": 0, "heap": 4, "index": 12}[what]
    content[at : at + 2] = b"\xff\x7f"
    path.write_bytes(content)
    with pytest.raises(neuro.ModelError, match="is damaged: the texts of 'node/nodes/n1/type' are not in the file"):
        neuro.from_nir(path, dt=1.0, from_="norse")


def test_what_is_a_list_in_place_of_a_text_is_not_read(tmp_path):
    def change(node):
        del node["nodes/n1/type"]
        node["nodes/n1"].create_dataset("type", (), h5py.vlen_dtype(np.int64))

    with pytest.raises(neuro.ModelError, match="is damaged: the texts of 'node/nodes/n1/type' are not in the file"):
        neuro.from_nir(written(tmp_path, change), dt=1.0, from_="norse")


def test_deep_subgraphs_are_refused():
    inner = graph(lif())
    for _ in range(20):
        inner = graph(inner)
    with pytest.raises(neuro.ModelError, match="nested more than 16 deep"):
        neuro.from_nir(inner, dt=1.0, from_="norse")
