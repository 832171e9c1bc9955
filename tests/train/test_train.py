"""neuro train: learns, tells what chips make of it, goes on after a kill, and says what is wrong before long work."""

import json
import signal
import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("torch", reason="PyTorch is not installed")

import neuro as snn
from neuro import ModelError
from neuro.events import recordings
from neuro_train import trainer
from neuro_train.data import moved, show
from neuro_train.plan import TrainingPlan
from neuro_train.tested import by_module, on_backend

pytestmark = [
    pytest.mark.filterwarnings("ignore:backend 'spinnaker'"),  # no released binary has iaf_psc_delta
    pytest.mark.filterwarnings("ignore:backend 'loihi'"),  # what rounding loses
]
QUICK = ("--duration", 60, "--epochs", 8, "--batch", 6)
PLAN = {"input": "pixels", "output": "out", "duration": 60.0, "epochs": 8, "batch": 6}


@pytest.fixture
def told(folder, file):
    """A network, recordings to learn from and a plan with some words."""

    def of(**words):
        net, plan = snn.load(file), TrainingPlan(**(PLAN | words))
        return net, show(net, recordings(folder, part="Train"), plan, lambda *told: None), plan

    return of


def test_it_learns_and_every_backend_decides_alike(told, folder):
    net, shown, plan = told(epochs=20, bits=8)
    trained = trainer.learn(net, shown, plan)
    unseen = show(net, recordings(folder, part="Test"), plan, lambda *told: None)
    by_torch = by_module(trained.module, unseen, plan)
    assert by_torch.own.accuracy >= 8 / 9
    assert trained.curves["loss"][-1] < 0.5 * trained.curves["loss"][0]
    for backend, spikes in (("event", 9), ("reference", 9), ("loihi", 8), ("spinnaker", 8)):
        tried = on_backend(trained.net, backend, unseen, plan)
        assert tried.agrees(by_torch) == 1.0
        assert tried.same_spikes(by_torch) >= spikes
        assert (tried.bill is not None) == (backend in ("loihi", "spinnaker"))


def test_the_command_writes_a_network_and_a_page_and_tells_of_chips(neuro, folder, file):
    status, out, err = neuro(
        file, "--data", folder, *QUICK, "--test", folder, "--augment", "shift=1", "--cost", "loihi=0.1"
    )
    assert (status, err) == (0, "")
    assert out.splitlines()[-2:] == ["trained.yaml: written", "trained.html: written"]
    for word in ("torch", "event", "loihi", "spinnaker", "9 recordings", "uJ"):
        assert word in out
    net, before = snn.load("trained.yaml"), snn.load(file)
    assert net.populations == before.populations
    assert not np.array_equal(net.projections["in_hidden"].weight, before.projections["in_hidden"].weight)
    with open("trained.html", encoding="utf-8") as opened:
        page = opened.read()
    for word in (
        "loss by epoch",
        "right, % by epoch",
        "uJ by epoch",
        "loihi=0.1<",
        str(file),
        "one scan over all steps",
    ):
        assert word in page
    import os

    assert sorted(os.listdir()) == ["trained.h5", "trained.html", "trained.yaml"]


def slower(file):
    """The same network with an output of another time constant."""
    net = snn.load(file)
    net.populations["out"] = replace(net.populations["out"], model=replace(net.populations["out"].model, tau_m=30.0))
    net.save("slower.yaml")
    return "slower.yaml"


KILLED = """
import os, signal, sys
from importlib.metadata import EntryPoint
from neuro.cli import commands, main
from neuro_train import trainer
commands.apps = lambda: {"train": EntryPoint("train", "neuro_train.cli:app", commands.GROUP)}
trainer.KEEP_S = 0.0
whole = trainer._Training.epoch
def epoch(self):
    if self.done == 6:
        os.kill(os.getpid(), signal.SIGKILL)
    whole(self)
trainer._Training.epoch = epoch
main()
"""


@pytest.mark.slow
def test_after_a_kill_it_goes_on_to_the_same_bits(neuro, folder, file, tmp_path):
    words = (file, "--data", folder, *QUICK, "--augment", "shift=1", "--bits", 6, "--prune", 0.4, "--seed", 3)
    assert neuro(*words, "--out", "whole.yaml")[0] == 0
    done = subprocess.run(
        [sys.executable, "-c", KILLED, "train", *map(str, words), "--out", "killed.yaml"], check=False, cwd=tmp_path
    )
    assert done.returncode == -signal.SIGKILL
    assert (tmp_path / "killed.yaml.training").exists()
    assert not (tmp_path / "killed.yaml").exists()
    assert neuro(*words, "--out", "killed.yaml")[0] == 0
    assert snn.load("killed.yaml") == snn.load("whole.yaml")
    assert not (tmp_path / "killed.yaml.training").exists()


def test_another_training_does_not_go_on_with_it(neuro, folder, file, monkeypatch):
    def stop(self):
        if self.done == 3:
            raise KeyboardInterrupt
        whole(self)

    whole = trainer._Training.epoch
    monkeypatch.setattr(trainer, "KEEP_S", 0.0)
    with monkeypatch.context() as patch:
        patch.setattr(trainer._Training, "epoch", stop)
        status, _, err = neuro(file, "--data", folder, *QUICK)
    assert (status, err) == (130, "interrupted: the same command goes on where it was\n")
    status, _, err = neuro(file, "--data", folder, *QUICK, "--rate", 0.02)
    assert status == 2
    assert "trained.yaml.training: an unfinished training with rate = 0.01: found 0.02 now" in err
    status, _, err = neuro(slower(file), "--data", folder, *QUICK)
    assert status == 2
    assert "trained.yaml.training: an unfinished training with network = " in err
    assert neuro(file, "--data", folder, *QUICK)[0] == 0


def test_a_loss_that_is_no_number_stops_and_keeps_what_was_good(neuro, folder, file, monkeypatch, tmp_path):
    calls = []

    def bad(*told):
        calls.append(None)
        return loss(*told) * (float("nan") if len(calls) == 11 else 1.0)

    loss = trainer._loss
    monkeypatch.setattr(trainer, "_loss", bad)
    status, _, err = neuro(file, "--data", folder, *QUICK)
    assert status == 2
    told = "epoch 3, batch 3 of 4: the loss is nan: expected a number; what was learnt until the end of epoch 2 is kept"
    assert f"{told} in trained.yaml.training\n" in err
    assert "hint: a smaller --rate, or a smaller --cost, under another --out" in err
    monkeypatch.setattr(trainer, "_loss", loss)
    assert (tmp_path / "trained.yaml.training").exists()
    assert neuro(file, "--data", folder, *QUICK)[0] == 0
    assert neuro(file, "--data", folder, *QUICK, "--out", "other.yaml")[0] == 0
    assert snn.load("trained.yaml") == snn.load("other.yaml")


def test_joules_that_cost_something_are_fewer(told):
    taken = {}
    for price in (0.0, 500.0):
        net, shown, plan = told(cost={"loihi": price}, epochs=15)
        taken[price] = trainer.learn(net, shown, plan).curves["joules"][-1]
    assert 0.0 < taken[500.0] < 0.95 * taken[0.0]


@pytest.mark.parametrize("loss", ["potential", "first_spike"])
def test_other_losses_learn_too(told, loss):
    net, shown, plan = told(loss=loss, epochs=20)
    trained = trainer.learn(net, shown, plan)
    assert trained.curves["loss"][-1] < 0.8 * trained.curves["loss"][0]
    if loss == "first_spike":
        assert trained.curves["right"][-1] >= 0.8


def test_folds_are_trained_once(neuro, folder, file, tmp_path, monkeypatch):
    words = (file, "--data", folder, *QUICK, "--folds", 2, "--backends", "event")
    status, out, err = neuro(*words)
    assert (status, err) == (0, "")
    told = json.loads((tmp_path / "trained-1.json").read_text())
    assert told["n"] == 12
    assert told["same_spikes"]["event"] == 12
    assert "of 24 right (95 % interval" in out
    monkeypatch.setattr(trainer._Training, "epoch", lambda self: pytest.fail("it is there already"))
    assert neuro(*words)[1] == out
    with pytest.raises(pytest.fail.Exception):
        neuro(slower(file), *words[1:])


def test_no_epochs_test_only(neuro, folder, file):
    status, out, _ = neuro(
        file, "--data", folder, "--duration", 60, "--epochs", 0, "--test", folder, "--backends", "event"
    )
    assert status == 0
    assert "9 of 9" in out
    before, after = (snn.compile(snn.load(each)).weights("in_hidden")[2] for each in (file, "trained.yaml"))
    np.testing.assert_array_equal(after, before.astype(np.float32))


def test_a_shift_moves_every_event_alike_and_loses_those_that_leave():
    from neuro_torch import Events

    rng = np.random.default_rng(2)
    dense = rng.random((5, 7, 2 * 6 * 4)) < 0.2
    events = Events(5, 7, {"pixels": np.nonzero(dense)})
    found = (
        moved(events, "pixels", (2, 6, 4), 2, 0.0, np.random.default_rng(8)).dense("pixels", 48).reshape(5, 7, 2, 6, 4)
    )
    down, right = np.random.default_rng(8).integers(-2, 3, (2, 5))
    for b in range(5):
        expected = np.zeros((7, 2, 6, 4))
        for t, p, y, x in zip(*np.nonzero(dense[b].reshape(7, 2, 6, 4)), strict=True):
            if 0 <= y + down[b] < 6 and 0 <= x + right[b] < 4:
                expected[t, p, y + down[b], x + right[b]] = 1.0
        np.testing.assert_array_equal(found[b], expected)
    assert len({*down, *right}) > 2


def test_a_warp_keeps_the_middle_and_stays_small():
    from neuro_torch import Events

    rng = np.random.default_rng(5)
    y, x = np.mgrid[3:18, 3:18].reshape(2, -1)
    batch = np.repeat(np.arange(40), y.size)
    events = Events(40, 1, {"pixels": (batch, 0 * batch, np.tile(y * 21 + x, 40))})
    found = moved(events, "pixels", (21, 21), 0, 0.2, rng).dense("pixels", 441).reshape(40, 21, 21)
    assert np.all(found[:, 10, 10] == 1.0)  # the middle does not move
    sizes = found.sum(axis=(1, 2))
    assert 0.6 * 225 < sizes.min() < 225 <= sizes.max() < 1.5 * 225
    assert len({image.tobytes() for image in found}) == 40


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["--input", "pixls"], "unknown population for --input 'pixls'"),
        (["--output", "ot"], "unknown population for --output 'ot'"),
        (["--input", "hidden"], "--input hidden: found iaf_psc_delta: expected a spike_generator"),
        (["--output", "hidden"], "--output hidden: 10 neurons for the 3 classes of"),
        (["--scale", 2], "recordings of 12x12 px by 2 have 6 rows and 6 columns: expected the shape [2, 6, 6]"),
        (["--augment", "shft=2"], "unknown augmentation 'shft'"),
        (["--augment", "shift=two"], "--augment shift=two: expected a whole number of px >= 0"),
        (["--cost", "loihi"], "--cost loihi: expected NAME=NUMBER"),
        (["--cost", "lohi=1"], "unknown target 'lohi'"),
        (["--loss", "counts"], "unknown loss 'counts'"),
        (["--surrogate", "sigmoid"], "unknown surrogate 'sigmoid'"),
        (["--epochs", -1], "epochs = -1: expected a whole number >= 0"),
        (["--prune", 1], "prune = 1.0: expected a share, 0 to less than 1"),
        (["--augment", "warp=a"], "--augment warp=a: expected a share, 0 to less than 1"),
        (["--augment", "mirror=1"], "mirror = 1.0: expected a share, 0 to less than 1"),
        (["--window", "middle"], "--window middle: expected 'centred', or column and row of its first pixel"),
        (["--window", "3"], "--window 3: expected 'centred'"),
        (["--window", "-1,0"], "--window -1,0: expected 'centred'"),
        (["--window", "9,9"], "events lie outside of the window of 12x12 px at 9,9: expected at most 5%"),
        (["--augment", "shift=-1"], "shift = -1: expected a whole number >= 0"),
        (["--bits", 9], "bits = 9: weights of loihi have 8: expected 1 to 8"),
        (["--learn", "in_hiden"], "unknown projection 'in_hiden'"),
        (["--device", "cuda:7"], "--device cuda:7: torch has no such device here: expected one of cpu"),
        (["--device", "meta"], "--device meta: torch has no such device here: expected one of cpu"),
        (["--without", "*"], "--without *: leaves none of the 24 recordings of"),
        (["--duration", 61], "duration = 61 ms"),
        (["--folds", 2, "--test", "Test"], "--folds and --test: expected one of them"),
        (["--folds", 2, "--backends", "event,lohi"], "unknown backend 'lohi'"),
        (["--prune", 0.999], "prune: projection 'hidden_out': none of its 30 synapses stays: expected some"),
    ],
    ids=lambda part: " ".join(map(str, part)) if isinstance(part, list) else "",
)
def test_mistakes(neuro, folder, file, words, message, tmp_path):
    status, out, err = neuro(file, "--data", folder, *QUICK, *words)
    assert (status, out) == (2, "")
    assert message in err
    assert list(tmp_path.iterdir()) == []


def test_recordings_can_be_left_out_by_name(neuro, folder, file):
    left_out = ("--without", "*/1*.npz", "--without", "*/2*.npz")  # 1, 2, 10 ... 23
    status, out, err = neuro(file, "--data", folder, *QUICK, "--epochs", 1, *left_out)
    assert (status, err) == (0, "")
    assert "% of 8 right" in out


def test_recordings_without_classes_are_told(neuro, folder, file):
    one = next((folder / "Train" / "lying").iterdir())
    status, _, err = neuro(file, "--data", one, *QUICK)
    assert status == 2
    assert f"{one.name}: its class is not known: expected recordings in folders of classes" in err


def test_a_file_that_is_not_ours_stays(neuro, folder, file, tmp_path):
    (tmp_path / "trained.yaml").write_text("my notes")
    status, _, err = neuro(file, "--data", folder, *QUICK)
    assert status == 2
    assert "trained.yaml: exists and is not a network that was saved: expected a new name" in err


def test_a_batch_beyond_memory_is_refused_before_any_is_taken(told, monkeypatch):
    monkeypatch.setattr("neuro_torch.memory.free_memory", lambda: 2000)
    net, shown, plan = told()
    with pytest.raises(ModelError, match="a batch of 6 recordings of 12 steps needs about"):
        trainer.learn(net, shown, plan)
