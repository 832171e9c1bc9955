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
        (put("nodes/input/shape", np.array([-3])), "cannot be read|expected sizes of at least 1|does not fit|Type"),
        (put("nodes/n1/tau", one(7)), "cannot be read|expected \\[3\\]"),
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


def test_deep_subgraphs_are_refused():
    inner = graph(lif())
    for _ in range(20):
        inner = graph(inner)
    with pytest.raises(neuro.ModelError, match="nested more than 16 deep"):
        neuro.from_nir(inner, dt=1.0, from_="norse")
