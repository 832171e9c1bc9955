"""neuro train: potentials of an output that never fires follow targets, the same on every backend."""

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("torch", reason="PyTorch is not installed")

import neuro as snn
from neuro_torch import Events
from neuro_train import trainer
from neuro_train.data import BatchData, r_squared, read
from neuro_train.plan import TrainingPlan
from neuro_train.tested import by_module, on_backend
from refused import mistakes_of

pytestmark = pytest.mark.filterwarnings("ignore:backend '(loihi|spinnaker)'")
STEPS, CHANNELS, ASKED = 60, 8, 20


@pytest.fixture(scope="module")
def net():
    net, cell = snn.Network("decoder", resolution=4.0), {"t_ref": 0.0, "E_L": 0.0, "V_reset": 0.0}
    net.population("channels", CHANNELS, snn.spike_generator())
    net.population("hidden", 24, snn.iaf_psc_delta(tau_m=20.0, V_th=1.0, **cell))
    net.population("out", 2, snn.iaf_psc_delta(tau_m=30.0, V_th=100.0, **cell))
    for name, source, target, std in (("up", "channels", "hidden", 0.5), ("read", "hidden", "out", 0.1)):
        net.connect(source, target, snn.all_to_all(), weight=snn.normal(mean=0.0, std=std), delay=4.0, name=name)
    return net


def made(recordings, seed):
    """Spikes of channels that prefer directions, and the direction: a circle at the speed of the recording."""
    rng = np.random.default_rng(seed)
    angle = rng.uniform(0.0, 6.0, recordings)[:, None] + rng.uniform(0.1, 0.2, recordings)[:, None] * np.arange(STEPS)
    own = 2.0 * np.pi * np.arange(CHANNELS) / CHANNELS
    spikes = rng.random((recordings, STEPS, CHANNELS)) < 0.4 * np.maximum(0.0, np.cos(angle[..., None] - own))
    targets = np.stack((np.cos(angle - 0.6), np.sin(angle - 0.6)), axis=2)
    targets[:, :ASKED] = np.nan
    return {"spikes": spikes, "targets": targets}


@pytest.fixture
def files(net, tmp_path):
    net.save(tmp_path / "decoder.yaml")
    for name, recordings in (("learn", 40), ("unseen", 10)):
        np.savez(tmp_path / f"{name}.npz", **made(recordings, recordings))
    return tmp_path


def test_potentials_follow_targets_on_every_backend(net, files):
    words = {"epochs": 30, "batch": 4, "rate": 0.02, "slope": 2.0}
    plan = TrainingPlan(input="channels", output="out", loss="mse", duration=STEPS * 4.0, **words)
    shown, unseen = (read(files / name, net, plan) for name in ("learn.npz", "unseen.npz"))
    trained = trainer.learn(net, shown, plan)
    first = by_module(trained.module, unseen, plan)
    assert first.r_squared > 0.7
    assert trained.curves["right"][-1] == pytest.approx(1.0 - trained.curves["loss"][-1] / shown.variance)
    for backend, most in (("event", 1e-4), ("reference", 1e-4), ("loihi", 0.3)):
        tried = on_backend(trained.net, backend, unseen, plan)
        assert np.abs(tried.V_m - first.V_m).max() < most
        assert (tried.bill is not None) == (backend == "loihi")
        host = [(item.of, item.count) for item in tried.bill.items if item.what == "host"] if tried.bill else []
        assert host == [("cpu", 0.0)] * (backend == "loihi"), "spikes come as such, and potentials are read"
        assert not tried.spikes.any()


def test_the_command_learns_and_tests_targets(neuro, files, interrupted):
    words = ("--data", files / "learn.npz", "--loss", "mse", "--input", "channels", "--epochs", 4, "--batch", 8)
    command = (files / "decoder.yaml", *words, "--test", files / "unseen.npz", "--backends", "event,loihi")
    interrupted(2, *command)
    status, out, err = neuro(*command)
    assert (status, err) == (0, "")
    assert "R2 " in out
    assert all(word in out for word in ("largest difference", "event", "loihi", "10 recordings", "uJ"))
    assert "unseen recordings" in Path("trained.html").read_text()
    assert list(snn.load("trained.yaml").probes) == ["out_V_m"]


def test_constant_targets_have_no_r2(neuro, files):
    """In float32, 0.1 differs from its own mean, so the variance is not exactly 0."""
    for name in ("learn", "unseen"):
        content = made(40, 0)
        content["targets"] = np.where(np.isnan(content["targets"]), np.nan, 0.1)
        np.savez(files / f"{name}.npz", **content)
    words = ("--loss", "mse", "--input", "channels", "--epochs", 1, "--test", files / "unseen.npz")
    status, out, err = neuro(files / "decoder.yaml", "--data", files / "learn.npz", *words)
    assert (status, err) == (0, "")
    assert "no R2 (constant targets) on 40" in out
    assert np.isnan(r_squared(np.ones((2, 3, 2)), np.full((2, 3, 2), 0.1)))


def test_r2_and_recordings_that_ask_nothing(net, files):
    """Alone in a batch, too; and a neuron that nothing is asked of."""
    content = made(6, 0)
    content["targets"][2] = np.nan
    content["targets"][..., 1] = np.nan
    np.savez(files / "learn.npz", **content)
    plan = TrainingPlan(input="channels", output="out", loss="mse", duration=STEPS * 4.0, epochs=2, batch=1)
    shown = read(files / "learn.npz", net, plan)
    trained = trainer.learn(net, shown, plan)
    assert np.isfinite([trained.curves["loss"], trained.curves["right"]]).all()
    assert shown.variance == pytest.approx(shown.take(np.array([0, 1, 3, 4, 5])).variance)
    assert np.isfinite(r_squared(np.zeros(content["targets"].shape), content["targets"]))
    wanted = np.array([[[0.0, 1.0], [2.0, np.nan], [4.0, 3.0]]])
    assert (r_squared(np.nan_to_num(wanted), wanted), r_squared(np.array([2.0, 2.0]), wanted)) == (1.0, 0.0)


def test_what_cannot_be_learnt_is_refused(neuro, files, messages):
    def targets(value, shape=(40, STEPS, 2)):
        return {"targets": np.full(shape, value)}

    good, infinite, silent = (files / "learn.npz").read_bytes(), targets(0.0), np.zeros((40, STEPS, CHANNELS))
    infinite["targets"].flat[250] = np.inf
    (files / "cut.npz").write_bytes(good[: len(good) // 2])
    for name, changes in {
        "infinite": infinite, "large": targets(1e300), "all_NaN": targets(np.nan), "short": targets(0.0, (40, 50, 2)),
        "three": targets(0.0, (40, STEPS, 3)), "none": {"targets": None}, "silent": {"spikes": silent},
        "empty": {"spikes": silent[:0], **targets(0.0, (0, STEPS, 2))}, "twos": {"spikes": silent + 2},
    }.items():  # fmt: skip
        held = {word: value for word, value in (made(40, 0) | changes).items() if value is not None}
        np.savez(files / f"{name}.npz", **held)
    messages(mistakes_of(neuro, messages.cases, files=files))


def test_losses_and_what_is_wanted_belong_together(net):
    events = Events(3, STEPS, {"channels": ([0], [0], [0])})
    labels, targets = np.zeros(3, np.int64), np.zeros((3, STEPS, 2), np.float32)
    for loss, wanted, message in (
        ("mse", labels, "loss mse: found labels of classes: expected targets"),
        ("count", targets, "loss count: found targets: expected labels of classes"),
    ):
        plan = TrainingPlan(input="channels", output="out", loss=loss, duration=STEPS * 4.0, epochs=1)
        with pytest.raises(snn.ModelError, match=message):
            trainer.learn(net, BatchData(events, wanted, ("a", "b"), (CHANNELS,), ""), plan)
