"""Damaged and hostile NIR files: one clear message, no traceback, no wait."""

from __future__ import annotations

import re
from contextlib import suppress
from functools import partial
from itertools import pairwise

import h5py
import numpy as np
import pytest

import neuro
from refused import error_of, refused

EYE = np.eye(3)


read, norse = (partial(neuro.from_nir, dt=1.0, from_=tool) for tool in ("nir", "norse"))

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
    """A change of a file: a value in another's place, or none."""

    def change(node):
        del node[name]
        if value is not None:
            node[name] = value

    return change


def lists_of_texts(node):
    del node["nodes/n1/type"]
    node["nodes/n1"].create_dataset("type", (), h5py.vlen_dtype(np.int64))


def test_a_damaged_file_is_told_in_one_message(tmp_path, monkeypatch, messages):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.nir").write_text("hello")

    def damaged(change):
        return norse(written(tmp_path, change).name)

    def of_convention(convention):
        net = graph(lif())
        net.metadata = {"neuro_convention": convention}
        return neuro.from_nir(net, dt=1.0)

    scope = globals() | locals()
    foreign = re.compile(r"(cannot be read as NIR).*|(?<=found )\[?\(.*?\)\]?(?=: expected real)", re.DOTALL)
    messages.of(lambda case: foreign.sub(r"\1", refused(eval, case, scope)))  # the rest is that of other packages


AROUND = [("input", "n0"), ("n0", "n1"), ("n1", "n0")]
LINEAR = nir.Linear(EYE)


def deep():
    inner = graph(lif())
    for _ in range(20):
        inner = graph(inner)
    return inner


def twice():
    """A node whose name is that of one within a graph."""
    named = {"input": nir.Input({"input": np.array([3])}), "s": graph(lif()), "s.n0": lif()}
    return nir.NIRGraph(named, [("input", "s"), ("s", "s.n0")], type_check=False)


def convolved(word, value):
    """A convolution of which a word is odd."""
    conv = nir.Conv2d((4, 4), np.ones((1, 1, 2, 2)), 1, 0, 1, 1, np.zeros(1))
    setattr(conv, word, np.array(value, dtype=float))
    named = {"input": nir.Input({"input": np.array([1, 4, 4])}), "conv": conv}
    return nir.NIRGraph(named, [("input", "conv")], type_check=False)


def test_a_graph_that_is_none_is_refused(messages):
    messages.calls(globals())


@pytest.mark.parametrize("name", ["bias", "every_step"])
def test_a_node_may_have_the_name_of_what_sends_biases(name):
    cell = lif(1) if name == "bias" else nir.CubaLIF(*(one(1) * 0.01,) * 2, one(1), 0 * one(1), one(1))
    named = {"input": nir.Input({"input": np.array([1])}), name: cell, "w": nir.Affine(one(1)[:, None], one(1) * 2)}
    spikes = []
    for other in (name, "other"):
        nodes = {other if each == name else each: node for each, node in named.items()} | {"last": cell}
        sim = neuro.compile(read(nir.NIRGraph(nodes, list(pairwise(nodes)))), backend="reference")
        sim.run(50.0)
        spikes.append(sim.spikes("last")[0].tolist())
    assert spikes[0] == spikes[1] != []


def test_long_names_are_cut_and_stay_apart(tmp_path):
    named = {"input": nir.Input({"input": np.array([3])}), "n" * 5000: lif(), "n" * 5001: lif()}
    read(nir.NIRGraph(named, list(pairwise(named)))).save(tmp_path / "net.yaml")
    assert list(neuro.load(tmp_path / "net.yaml").populations) == ["input", "n" * 200, "n" * 200 + "_2"]


def test_a_population_without_input_is_not_written(messages):
    net = neuro.Network("net", resolution=1.0)
    net.population("current", 1, neuro.dc_generator(amplitude=100.0))
    net.population("cells", 3, neuro.iaf_psc_delta(t_ref=0.0))
    net.connect("current", "cells", neuro.all_to_all())
    table = neuro.check_nir(graph(lif()), dt=1.0, from_="nir")
    messages({"net": refused(neuro.to_nir, net), "none": refused(neuro.to_nir, None)})
    messages({"node": refused(lambda: table["nobody"])})


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


def test_texts_that_are_elsewhere_are_not_read(tmp_path):
    """HDF5 ended the process."""
    path = written(tmp_path)
    whole = path.read_bytes()
    for first in (0, 4, 12):  # the length, the heap and the index of a text
        content = bytearray(whole)
        with h5py.File(path) as file:
            at = file["node/nodes/n1/type"].id.get_offset() + first
        content[at : at + 2] = b"\xff\x7f"
        path.write_bytes(content)
        error = error_of(neuro.from_nir, path, dt=1.0, from_="norse")
        assert "is damaged: the texts of 'node/nodes/n1/type' are not in the file" in str(error)
        path.write_bytes(whole)
