"""Costs of networks, and primate reaching, are as by the package `neurobench`; `make test-oracles` has it."""

import numpy as np
import pytest

pytest.importorskip("neurobench", reason="neurobench is not installed: make test-oracles")
torch = pytest.importorskip("torch", reason="the extra torch is not installed")

from neurobench.benchmarks import Benchmark  # noqa: E402
from neurobench.metrics.static import ConnectionSparsity, Footprint, ParameterCount  # noqa: E402
from neurobench.metrics.workload import R2, ActivationSparsity, SynapticOperations  # noqa: E402
from neurobench.models import TorchModel  # noqa: E402
from torch import nn  # noqa: E402

from neuro_bench import Examples, Spikes  # noqa: E402
from neuro_bench.artificial import CNN, Network, QuantisedCNN  # noqa: E402
from neuro_bench.primate_reaching import PrimateReaching  # noqa: E402

SHORT = {**CNN.settings, "maps": 4, "epochs": 1, "rate": 0.01, "decay": 0.0, "dropout": 0.0, "shift": 0}


def examples(n=24, binary=False):
    frames = np.maximum(np.random.default_rng(2).normal(size=(n, 2, 8, 12)), 0.0).astype(np.float32)
    frames = (frames > 0.5).astype(np.float32) if binary else frames
    return Examples(frames, np.arange(n) % 3, tuple("abc"), Spikes.of_dense(np.zeros((n, 3, 2, 4, 4)), 1.0))


def linear():
    return nn.Sequential(nn.Flatten(), nn.Linear(192, 16), nn.ReLU(), nn.Linear(16, 3)).eval()


def pruned():
    module = linear()
    with torch.no_grad():
        module[1].weight[:, ::3] = 0.0
    return module


NETWORKS = {
    "cnn": lambda: CNN().fit(examples(), SHORT, 0).module,
    "normalised": lambda: CNN().fit(examples(), {**SHORT, "norm": True, "members": 2}, 0).module,
    "int8": lambda: QuantisedCNN().fit(examples(), SHORT, 0).module,
    "linear": linear,
    "pruned": pruned,
    "strided": lambda: nn.Sequential(nn.Conv2d(2, 5, 3, stride=2), nn.ReLU(), nn.Flatten(), nn.Linear(75, 3)).eval(),
}


@pytest.mark.parametrize("name", NETWORKS)
@pytest.mark.filterwarnings("ignore")
def test_costs_are_those_of_neurobench(name, capsys):
    shown, module = examples(), NETWORKS[name]()
    ours = Network(module, "float32").costs(shown)
    data = torch.utils.data.TensorDataset(torch.from_numpy(shown.frames), torch.from_numpy(shown.labels))
    loader = torch.utils.data.DataLoader(data, batch_size=len(shown))
    metrics = [[Footprint, ConnectionSparsity, ParameterCount], [ActivationSparsity, SynapticOperations]]
    theirs = Benchmark(TorchModel(module), loader, [], [], metrics).run(quiet=True)
    ops = theirs["SynapticOperations"]
    assert (ours.parameters, ours.footprint_bytes) == (theirs["ParameterCount"], theirs["Footprint"])
    assert ours.connection_sparsity == pytest.approx(theirs["ConnectionSparsity"], abs=1e-3)
    assert ours.activation_sparsity == pytest.approx(theirs["ActivationSparsity"])
    assert ours.effective_macs == pytest.approx(ops["Effective_MACs"], rel=1e-6)
    assert ours.dense == pytest.approx(ops["Dense"], rel=1e-6)


@pytest.mark.parametrize("split", PrimateReaching.splits)
def test_spikes_velocities_parts_and_r2_are_those_of_neurobench(split, tmp_path, write_reaching):
    from neurobench.datasets.primate_reaching import PrimateReaching as Theirs

    name, target = "indy_20160622_01.mat", np.repeat(np.arange(8.0), [700, 2100, 300, 400, 500, 2001, 1999, 800])
    write_reaching(tmp_path / name, steps=len(target), target_pos=np.stack((target, target)))
    words = {"num_steps": 1, "train_ratio": 0.5, "bin_width": 0.004, "remove_segments_inactive": split == "active"}
    theirs, task = Theirs(str(tmp_path), name, download=False, **words), PrimateReaching(tmp_path, split)
    fold = task.folds()[0]
    parts = (fold.train, theirs.ind_train), (fold.validation, theirs.ind_val), (fold.test, theirs.ind_test)
    for ours, steps in parts:
        assert np.array_equal(ours.spikes, theirs.samples[:, steps].numpy().T)
        assert ours.targets == pytest.approx(theirs.labels[:, steps].numpy().T, abs=1e-4)  # they round positions first
    metric = R2()
    metric.reset()
    said = fold.test.targets + np.random.default_rng(0).normal(0.0, 0.3, fold.test.targets.shape).astype(np.float32)
    wanted = torch.from_numpy(fold.test.targets)
    assert task.score(said, fold.test) == pytest.approx(metric(None, torch.from_numpy(said), (None, wanted)), abs=1e-5)
