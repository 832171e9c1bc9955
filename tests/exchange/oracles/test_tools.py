"""Networks of other tools fire here as there: `make test-oracles` installs the tools."""

from __future__ import annotations

import contextlib
import io
import logging
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import neuro
from neuro_exchange.nir import measured
from neuro_exchange.nir.judging import judge

TOOLS = ("nir", "norse", "snntorch", "sinabs", "spikingjelly")
nir, norse, snntorch, sinabs, spikingjelly = (
    pytest.importorskip(name, reason=f"{name} is not installed: make test-oracles") for name in TOOLS
)
torch = pytest.importorskip("torch", reason="torch is not installed")
random_nir = pytest.importorskip("random_nir")

pytestmark = pytest.mark.filterwarnings("ignore")
SHARED = Path(__file__).resolve().parents[4] / "shared"
NETWORKS = SHARED / "reference" / "nir"
BRAILLE = ("braille_noDelay_bias_zero", "braille_noDelay_noBias_subtract")


@pytest.fixture(autouse=True)
def quiet():
    logging.disable(logging.CRITICAL)
    yield
    logging.disable(logging.NOTSET)


def silently(call: Any, *arguments: Any, **words: Any) -> Any:
    with contextlib.redirect_stdout(io.StringIO()):
        return call(*arguments, **words)


def of_norse(graph: Any, counts: np.ndarray, dt: float = 1e-3) -> np.ndarray:
    """The spikes of Norse's own importer."""
    import norse.torch

    module, state, out = norse.torch.from_nir(graph, ignore_warnings=True, dt=dt), None, []
    with torch.no_grad():
        for step in counts:
            spikes, state = module(torch.from_numpy(step), state)
            out.append(spikes.numpy().copy())
    return np.array(out).astype(int)


def of_snntorch(graph: Any, counts: np.ndarray) -> np.ndarray:
    """The spikes of snnTorch's own importer."""
    from snntorch.import_nir import import_from_nir

    module, state, out = silently(import_from_nir, graph), None, []
    with torch.no_grad():
        for step in counts:
            spikes, state = module(torch.from_numpy(step), *(() if state is None else (state,)))
            out.append((spikes[0] if isinstance(spikes, tuple) else spikes).numpy().copy())
    return np.array(out).astype(int)


@pytest.mark.parametrize(
    ("tool", "run", "dt", "share"), [("norse", of_norse, 1.0, 0.95), ("snntorch", of_snntorch, 0.1, 0.75)]
)
def test_random_graphs(tool, run, dt, share, tmp_path):
    ran = exact = 0
    for seed in range(200):
        graph = random_nir.random_graph(nir, seed, tool)
        counts = random_nir.input_of(graph, seed, 150)
        nir.write(tmp_path / "net.nir", graph)
        try:
            expected = run(nir.read(tmp_path / "net.nir"), counts)
        except Exception:  # the tool's own importer does not run it
            continue
        ran += 1
        net = neuro.from_nir(tmp_path / "net.nir", dt=dt, from_=tool)
        if net.verdicts.exact:
            exact += 1
            assert np.array_equal(random_nir.spikes_here(net, counts), expected), f"seed {seed}"
    print(f"{tool}: {ran} of 200 run there, {exact} of them exact here")
    assert ran >= 50
    assert exact >= share * ran


def test_what_snntorch_makes_of_recurrent_weights_is_what_is_measured(tmp_path):
    ran = 0
    for seed in range(200):
        graph = random_nir.random_graph(nir, seed, "snntorch")
        found = judge(graph, 0.1, "snntorch")
        differing = {each.node for each in found.table() if each.verdict == "approximate"}
        if not differing:
            continue
        nir.write(tmp_path / "net.nir", graph)
        shape = graph.nodes["input"].input_type["input"]
        counts = (np.random.default_rng(seed).random((measured.STEPS, *shape)) < 0.3).astype(np.float32)
        try:
            expected = of_snntorch(nir.read(tmp_path / "net.nir"), counts)
        except Exception:  # the importer does not run it
            continue
        ran += 1
        layers = [measured.Layer(found, name, differing) for name in sorted(found.cells, key=found.depths.get)]
        spikes = measured.run_there(layers, {"input": counts.reshape(len(counts), -1)})
        assert np.array_equal(spikes[layers[-1].name], expected.reshape(len(counts), -1)), f"seed {seed}"
    assert ran >= 15


def braille_of_snntorch(graph: Any, counts: np.ndarray) -> np.ndarray:
    """The spikes of snnTorch's neurons; its importer fails on these files."""
    import snntorch as snn

    nodes, out = graph.nodes, []

    def cell(node: Any, rec: Any = None) -> Any:
        alpha, beta = (float((1 - 1e-4 / tau).ravel()[0]) for tau in (node.tau_syn, node.tau_mem))
        words = {"threshold": 1.0, "reset_mechanism": "zero", "reset_delay": False}
        if rec is None:
            return snn.Synaptic(alpha=alpha, beta=beta, **words)
        made = snn.RSynaptic(alpha=alpha, beta=beta, **words, all_to_all=True, linear_features=len(rec.weight))
        made.recurrent.weight.data = torch.Tensor(rec.weight)
        made.recurrent.bias.data = torch.Tensor(getattr(rec, "bias", np.zeros(len(rec.weight))))
        return made

    hidden, last = cell(nodes["lif1.lif"], nodes["lif1.w_rec"]), cell(nodes["lif2"])
    weights = [torch.Tensor(nodes[name].weight) for name in ("fc1", "fc2")]
    biases = [torch.Tensor(getattr(nodes[name], "bias", np.zeros(1))) for name in ("fc1", "fc2")]
    states = [torch.zeros(len(weights[0]))] * 3
    others = [torch.zeros(len(weights[1]))] * 2
    with torch.no_grad():
        for step in counts:
            states = hidden(weights[0] @ torch.from_numpy(step) + biases[0], *states)
            spikes, *others = last(weights[1] @ states[0] + biases[1], *others)
            out.append(spikes.numpy().copy())
    return np.array(out).astype(int)


@pytest.mark.skipif(not NETWORKS.exists(), reason="the networks of the NIR paper are not there")
@pytest.mark.parametrize("name", BRAILLE)
@pytest.mark.parametrize("tool", ["norse", "snntorch"])
def test_braille(name, tool):
    path = NETWORKS / f"{name}.nir"
    net = neuro.from_nir(path, dt=0.1, from_=tool)
    for seed in range(20):
        counts = (np.random.default_rng(seed).random((256, 12)) < 0.1 + 0.01 * seed).astype(np.float32)
        graph = nir.read(path)
        expected = of_norse(graph, counts, 1e-4) if tool == "norse" else braille_of_snntorch(graph, counts)
        assert expected.sum() > 10
        assert np.array_equal(random_nir.spikes_here(net, counts), expected)


@pytest.mark.skipif(not NETWORKS.exists(), reason="the networks of the NIR paper are not there")
def test_the_convolutional_network_beside_sinabs(nmnist):
    import sinabs.nir

    path = NETWORKS / "cnn_sinabs.nir"
    net = neuro.from_nir(path, dt=1.0, from_="sinabs")
    equal = 0
    for frames in nmnist[::10][:100]:
        module = sinabs.nir.from_nir(nir.read(path), batch_size=1)
        with torch.no_grad():
            there = module(torch.from_numpy(frames))
        there = (there[0] if isinstance(there, tuple) else there).sum(0).numpy()
        here = random_nir.spikes_here(net, frames).sum(0)
        equal += np.array_equal(here, there)
        assert here.argmax() == there.argmax()
    assert equal >= 95


@pytest.fixture(scope="module")
def nmnist():
    import zipfile

    frames = []
    with zipfile.ZipFile(SHARED / "data" / "nmnist" / "nmnist_train1000_bin.zip") as files:
        for name in sorted(name for name in files.namelist() if name.endswith(".bin")):
            b = np.frombuffer(files.read(name), np.uint8).reshape(-1, 5).astype(np.int64)
            step = (((b[:, 2] & 127) << 16) | (b[:, 3] << 8) | b[:, 4]) // 1000
            counts, early = np.zeros((300, 2, 34, 34), np.float32), step < 300
            np.add.at(counts, (step[early], b[early, 2] >> 7, b[early, 1], b[early, 0]), 1)
            frames.append(counts)
    return frames


def modules() -> dict[str, Any]:
    """A module of each tool by name, what resets it, and the axis of time that it takes at once."""
    import norse.torch as of_norse
    import sinabs.layers as of_sinabs
    import snntorch as snn
    from spikingjelly.activation_based import layer, neuron

    torch.manual_seed(0)
    linear = torch.nn.Linear
    leaky = {}
    for mechanism in ("subtract", "zero"):
        words = {"init_hidden": True, "reset_mechanism": mechanism}
        cells = [snn.Leaky(beta=0.9, threshold=0.4, **words), snn.Leaky(beta=0.8, threshold=0.5, **words)]
        leaky[f"snntorch {mechanism}"] = torch.nn.Sequential(linear(10, 12), cells[0], linear(12, 6), cells[1])
    box = of_norse.LIFBoxCell(of_norse.LIFBoxParameters(tau_mem_inv=torch.tensor(100.0), v_th=torch.tensor(0.05)))
    iaf = of_norse.IAFCell(of_norse.IAFParameters(v_th=torch.tensor(0.5)))
    squeezed = of_sinabs.IAFSqueeze(batch_size=1, spike_threshold=torch.tensor(0.5), min_v_mem=-0.5)
    return {
        **leaky,
        "norse": of_norse.SequentialState(linear(10, 12), box, linear(12, 6), iaf),
        "sinabs": torch.nn.Sequential(linear(10, 12), squeezed),
        "spikingjelly": torch.nn.Sequential(
            layer.Linear(10, 12),
            neuron.LIFNode(tau=5.0, decay_input=False, v_threshold=0.5),
            layer.Linear(12, 6),
            neuron.IFNode(v_threshold=0.7),
        ),
    }


@pytest.mark.parametrize("name", ["snntorch subtract", "snntorch zero", "norse", "sinabs", "spikingjelly"])
def test_modules_of_torch(name):
    counts = (np.random.default_rng(0).random((150, 10)) < 0.3).astype(np.float32)
    module = modules()[name]
    net = neuro.from_torch(module, torch.rand(1, 10), of=name.partition(" ")[0])
    for part in module.modules():
        for reset in ("reset_mem", "reset_states", "reset"):
            if hasattr(part, reset) and not isinstance(getattr(part, reset), torch.Tensor):
                getattr(part, reset)()
    state, out = None, []
    with torch.no_grad():
        if name == "sinabs":
            out = module(torch.from_numpy(counts)).numpy()
        else:
            for step in counts:
                given = (state,) if name == "norse" else ()
                spikes = module(torch.from_numpy(step)[None], *given)
                spikes, state = spikes if name == "norse" else (spikes, None)
                out.append(spikes.numpy()[0].copy())
    assert net.verdicts.exact
    assert np.array_equal(random_nir.spikes_here(net, counts, next(iter(net.probes))), np.array(out).astype(int))


@pytest.mark.parametrize(("tool", "run"), [("norse", of_norse), ("snntorch", of_snntorch)])
def test_what_is_written_for_a_tool_fires_there_as_here(tool, run, tmp_path):
    ran = 0
    for seed in range(60):
        graph = random_nir.random_graph(nir, seed, "snntorch" if tool == "snntorch" else "norse")
        counts = random_nir.input_of(graph, seed, 100)
        net = neuro.from_nir(graph, dt=0.1 if tool == "snntorch" else 1.0, from_=tool)
        try:
            written = neuro.to_nir(net, for_=tool)
        except neuro.ModelError:
            continue
        if '"exact": true' not in written.metadata["neuro_verdicts"]:
            continue
        nir.write(tmp_path / "net.nir", written)
        try:
            expected = run(nir.read(tmp_path / "net.nir"), counts)
        except Exception:  # the tool's own importer does not run it
            continue
        ran += 1
        assert np.array_equal(random_nir.spikes_here(net, counts), expected), f"seed {seed}"
    assert ran >= 10
