"""The networks of the NIR paper: published traces, accuracy on N-MNIST, decisions on chips."""

from __future__ import annotations

import warnings
import zipfile
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import neuro
from golden_traces import LIF, lif_graph, run_lif, stored

nir = pytest.importorskip("nir", reason="nir is not installed")
SHARED = Path(__file__).resolve().parents[3] / "shared"
NETWORKS = SHARED / "reference" / "nir"
RECORDINGS = SHARED / "data" / "nmnist" / "nmnist_train1000_bin.zip"
needs_networks = pytest.mark.skipif(not NETWORKS.exists(), reason="the networks of the NIR paper are not there")


@pytest.mark.parametrize("platform", LIF)
def test_a_neuron_fires_at_the_published_steps(platform, tmp_path):
    golden = stored("nir_lif")
    found = run_lif(lif_graph(tmp_path / "lif.nir", golden), golden["input"], platform)
    assert np.array_equal(found, golden[platform])


def recordings(every: int) -> tuple[list[tuple[np.ndarray, np.ndarray]], np.ndarray]:
    """Some recordings of N-MNIST as steps of 1 ms and ids of (polarity, row, column), and their digits."""
    found, digits = [], []
    with zipfile.ZipFile(RECORDINGS) as files:
        names = sorted(name for name in files.namelist() if name.endswith(".bin"))
        for name in names[::every]:
            b = np.frombuffer(files.read(name), np.uint8).reshape(-1, 5).astype(np.int64)
            step = (((b[:, 2] & 127) << 16) | (b[:, 3] << 8) | b[:, 4]) // 1000
            ids = ((b[:, 2] >> 7) * 34 + b[:, 1]) * 34 + b[:, 0]
            order = np.lexsort((ids, step))[: np.count_nonzero(step < 300)]
            found.append((step[order], ids[order]))
            digits.append(int(name.split("/")[-2]))
    return found, np.array(digits)


def decisions(backend: str, every: int) -> tuple[np.ndarray, np.ndarray]:
    net = neuro.from_nir(NETWORKS / "cnn_sinabs.nir", dt=1.0, from_="sinabs")
    assert net.verdicts.exact
    found, digits = recordings(every)
    decided = []
    with warnings.catch_warnings():  # what chips approximate, and voltages that are clipped below V_min
        warnings.simplefilter("ignore")
        sim = neuro.compile(net, backend=backend)
        for steps, ids in found:
            sim.reset()
            sim.inject("input", steps + 1.0, ids)
            sim.run(306.0)
            decided.append(np.bincount(sim.spikes("12")[1], minlength=10).argmax())
    return np.array(decided), digits


@needs_networks
def test_digits_are_recognised_as_published():
    decided, digits = decisions("event", 50)
    assert np.mean(decided == digits) >= 0.95


@needs_networks
@pytest.mark.slow
def test_all_digits_are_recognised_as_published():
    decided, digits = decisions("event", 1)
    assert np.mean(decided == digits) >= 0.975


@needs_networks
@pytest.mark.slow
@pytest.mark.parametrize("backend", ["loihi", "spinnaker"])
def test_chips_decide_alike(backend):
    assert np.mean(decisions(backend, 2)[0] == decisions("event", 2)[0]) >= 0.98


def test_convolutions_and_pools_are_shared_kernels(tmp_path):
    """A graph of the shape of the paper's network for N-MNIST."""
    rng = np.random.default_rng(0)

    def conv(maps, depth, side, size, stride):
        weight = rng.normal(size=(maps, depth, side, side)).astype(np.float32)
        return nir.Conv2d((size, size), weight, (stride, stride), (1, 1), (1, 1), 1, np.zeros(maps, np.float32))

    def fires(*shape):
        return nir.IF(np.ones(shape, np.float32), np.ones(shape, np.float32), np.zeros(shape, np.float32))

    def dense(out, into):
        return nir.Affine(rng.normal(size=(out, into)).astype(np.float32), np.zeros(out, np.float32))

    def pool():
        return nir.SumPool2d(*(np.array([n, n]) for n in (2, 2, 0)))

    layers = [conv(16, 2, 5, 34, 2), fires(16, 16, 16), conv(16, 16, 3, 16, 1), fires(16, 16, 16), pool()]
    layers += [conv(8, 16, 3, 8, 1), fires(8, 8, 8), pool(), nir.Flatten({"input": np.array([8, 4, 4])}, start_dim=0)]
    layers += [dense(256, 128), fires(256), dense(10, 256), fires(10)]
    names = ["input", *map(str, range(len(layers))), "output"]
    ends = nir.Input({"input": np.array([2, 34, 34])}), nir.Output({"output": np.array([10])})
    nodes = dict(zip(names, [ends[0], *layers, ends[1]], strict=True))
    nir.write(tmp_path / "cnn.nir", nir.NIRGraph(nodes, list(pairwise(names))))
    net = neuro.from_nir(tmp_path / "cnn.nir", dt=1.0, from_="sinabs")
    rules = {part.target: part.rule.name for part in net.projections.values()}
    assert rules == {"1": "grid", "3": "grid", "6": "grid", "10": "all_to_all", "12": "all_to_all"}
