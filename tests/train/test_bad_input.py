"""neuro train with what cannot be, or is no longer what it was: one error, before long work, and nothing is mixed."""

import shutil
import signal
import subprocess
import sys
import zipfile

import h5py
import numpy as np
import pytest

import neuro as snn
import neuro_models
from neuro.events import Events, save

torch = pytest.importorskip("torch", reason="PyTorch is not installed")
from neuro_train import trainer  # noqa: E402

QUICK = ("--duration", 60, "--epochs", 8, "--batch", 6)
DELTA = snn.iaf_psc_delta(tau_m=20.0, t_ref=0.0, E_L=0.0, V_reset=0.0, V_th=1.0)


def network(cell=DELTA, synapse=None, connected=True):
    """Pixels, and a neuron for each of three classes."""
    net = snn.Network("poor", resolution=5.0)
    net.population("pixels", (2, 12, 12), snn.spike_generator(spike_times=[]))
    net.population("out", 3, cell)
    if connected:
        learnt = {} if synapse is None else {"synapse": synapse}
        net.connect("pixels", "out", snn.all_to_all(), weight=0.1, delay=5.0, name="up", **learnt)
    return net


@pytest.mark.parametrize(
    ("net", "messages"),
    [
        (network(connected=False), ["network 'poor': no projection carries spikes: expected one, whose weights learn"]),
        (
            network(synapse=snn.stdp()),
            [
                "network 'poor' cannot be trained by gradients (1 problem)\nnet.yaml:9:3: projection 'up': stdp: only "
                "static synapses are here",
                "use static",
            ],
        ),
        (
            network(snn.hh_psc_alpha(t_ref=5.0)),
            [
                "population 'out': hh_psc_alpha: its spikes have no gradient: a surrogate is told in units of V_th - ",
                "hint: use iaf_psc_delta or iaf_psc_exp",
            ],
        ),
        (network(snn.srm0(t_ref=5.0)), ["population 'out': srm0: its spikes have no gradient: it fires at random"]),
    ],
    ids=["nothing learns", "a rule", "no V_reset", "at random"],
)
def test_networks_that_cannot_learn(neuro, folder, tmp_path, net, messages):
    net.save("net.yaml")
    status, out, err = neuro("net.yaml", "--data", folder, *QUICK)
    assert (status, out) == (2, "")
    for message in messages:
        assert message in err
    assert not (tmp_path / "trained.yaml").exists()


def test_recordings_to_test_on_of_another_sensor(neuro, folder, file, tmp_path):
    for k, name in enumerate(("upright", "lying", "oblique")):
        path = tmp_path / "wide" / "Test" / name / "0.npz"
        path.parent.mkdir(parents=True)
        save(Events(np.arange(5) * 1000, [k] * 5, range(5), [0, 1, 0, 1, 0], (16, 14)), path)
    status, out, err = neuro(file, "--data", folder, *QUICK, "--test", tmp_path / "wide")
    assert (status, out) == (2, "")
    told = "wide: --input pixels: shape [2, 12, 12]: recordings of 16x14 px have 14 rows and 16 columns"
    assert f"{told}: expected the shape [2, 14, 16]\n  hint: test on recordings of the sensor of --data" in err
    assert not (tmp_path / "trained.yaml").exists()


def test_recordings_to_test_on_of_a_class_that_is_not_learnt(neuro, folder, file, tmp_path):
    shutil.copytree(folder / "Test", tmp_path / "more" / "Test")
    (tmp_path / "more" / "Test" / "lying").rename(tmp_path / "more" / "Test" / "leaning")
    status, out, err = neuro(file, "--data", folder, *QUICK, "--test", tmp_path / "more")
    assert (status, out) == (2, "")
    assert "leaning" in err


def test_a_batch_beyond_memory(neuro, folder, file, monkeypatch, tmp_path):
    monkeypatch.setattr("neuro_torch.memory.free_memory", lambda: 12000)
    status, out, err = neuro(file, "--data", folder, *QUICK)
    assert (status, out) == (2, "")
    assert "error: a batch of 6 recordings of 12 steps needs about" in err
    assert "expected at most what is free, 1.2e-05 GB\n  hint: a batch of 1 takes half of that" in err
    assert list(tmp_path.iterdir()) == []


def stopped_after(epochs, monkeypatch):
    """A patch by which a training is interrupted."""

    def stop(self):
        if self.done == epochs:
            raise KeyboardInterrupt
        whole(self)

    whole = trainer._Training.epoch
    monkeypatch.setattr(trainer._Training, "epoch", stop)


def test_an_interrupt_loses_no_whole_epoch(neuro, folder, file, monkeypatch):
    with monkeypatch.context() as patch:
        stopped_after(5, patch)
        assert neuro(file, "--data", folder, *QUICK)[::2] == (
            130,
            "interrupted: the same command goes on where it was\n",
        )
    with h5py.File("trained.yaml.training") as kept:
        assert kept["progress"][0] == 5.0
    assert neuro(file, "--data", folder, *QUICK)[0] == 0
    assert neuro(file, "--data", folder, *QUICK, "--out", "other.yaml")[0] == 0
    assert snn.load("trained.yaml") == snn.load("other.yaml")


INTERRUPTED = """
import os, signal
from importlib.metadata import EntryPoint
from neuro.cli import commands, main
from neuro_train import {where}
commands.apps = lambda: {{"train": EntryPoint("train", "neuro_train.cli:app", commands.GROUP)}}
whole = {function}
def interrupted(*told):
    os.kill(os.getpid(), signal.SIGINT)
    return whole(*told)
{function} = interrupted
main()
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("where", "function", "told"),
    [
        ("cli", "cli._check_before", ""),
        ("data", "data._check_sensor", "interrupted: the same command goes on where it was\n"),
        ("tested", "tested._bill", "interrupted: the same command goes on where it was\n"),
    ],
    ids=["before", "reading", "testing"],
)
def test_an_interrupt_wherever_it_comes(folder, file, tmp_path, where, function, told):
    words = [file, "--data", folder, *QUICK, "--epochs", 1, "--test", folder, "--backends", "event"]
    script = INTERRUPTED.format(where=where, function=function)
    command = [sys.executable, "-c", script, "train", *map(str, words)]
    done = subprocess.run(command, check=False, cwd=tmp_path, capture_output=True, text=True)
    lines = [line for line in done.stderr.splitlines(keepends=True) if "kernels" not in line and "left" not in line]
    assert (done.returncode, "".join(lines)) == (130, told)
    assert (tmp_path / "trained.yaml").exists() == (where == "tested")


@pytest.fixture
def own(folder, tmp_path):
    """A copy of the recordings that may be edited."""
    return shutil.copytree(folder, tmp_path / "own")


@pytest.mark.parametrize("edited", ["other events", "one less", "another class"])
def test_recordings_that_are_edited_between_two_runs_are_not_mixed(neuro, own, file, monkeypatch, edited):
    with monkeypatch.context() as patch:
        stopped_after(3, patch)
        assert neuro(file, "--data", own, *QUICK)[0] == 130
    one = own / "Train" / "lying" / "1.npz"
    whole = one.read_bytes()
    if edited == "other events":
        one.write_bytes((own / "Train" / "lying" / "4.npz").read_bytes())
    elif edited == "one less":
        one.unlink()
    else:
        one.rename(own / "Train" / "upright" / "1.npz")
    status, out, err = neuro(file, "--data", own, *QUICK)
    assert (status, out) == (2, "")
    assert "trained.yaml.training: an unfinished training with data = " in err
    way = "recordings are others, or were edited: give those that it began with to continue it, or delete the file"
    assert f"hint: {way}" in err
    (own / "Train" / "upright" / "1.npz").unlink(missing_ok=True)
    one.write_bytes(whole)
    own.rename(own.with_name("moved"))  # where they lie does not matter
    assert neuro(file, "--data", own.with_name("moved"), *QUICK)[0] == 0


def test_folds_of_recordings_that_are_edited_are_learnt_anew(neuro, own, file):
    words = (file, "--data", own, *QUICK, "--folds", 2, "--backends", "event")
    before = neuro(*words)[1]
    for k in range(1, 22, 6):
        (own / "Train" / "lying" / f"{k}.npz").write_bytes((own / "Train" / "upright" / f"{k + 2}.npz").read_bytes())
    status, out, _ = neuro(*words)
    assert status == 0
    assert [line for line in out.splitlines() if "right" in line] != [
        line for line in before.splitlines() if "right" in line
    ]


def search_words(own, more=()):
    small = {"height": 12, "width": 12, "hidden": 8, "classes": 3, "in_std": 0.2, "out_std": 0.4, **dict(more)}
    set_ = [word for name, value in small.items() for word in ("--set", f"{name}={value}")]
    budget = ("--search", "hidden=4:8", "--budget", 2)
    return [neuro_models.path("dense"), "--data", own, *QUICK, "--epochs", 1, *set_, *budget]


@pytest.mark.filterwarnings("ignore:backend 'loihi'")
def test_a_search_does_not_go_on_with_other_recordings_or_another_network(neuro, own):
    pytest.importorskip("optuna", reason="Optuna is not installed")
    assert neuro(*search_words(own))[0] == 0
    status, _, err = neuro(*search_words(own, {"tau": 10.0}))
    assert status == 2
    assert "trained: the folder of another tuning: set is " in err
    (own / "Train" / "lying" / "1.npz").write_bytes((own / "Train" / "lying" / "4.npz").read_bytes())
    status, _, err = neuro(*search_words(own))
    assert status == 2
    assert "trained: the folder of another tuning: set is " in err
    assert '"recordings": ' in err
    assert "hint: expected the same tuning, or the name of a new folder" in err


@pytest.mark.filterwarnings("ignore:backend 'loihi'")
def test_a_search_goes_on_in_the_process_that_was_interrupted(neuro, own, monkeypatch):
    pytest.importorskip("optuna", reason="Optuna is not installed")
    with monkeypatch.context() as patch:
        stopped_after(0, patch)
        assert neuro(*search_words(own))[0] == 130
    status, out, err = neuro(*search_words(own))
    assert status == 0, err
    assert "trained/front.csv: written" in out


def test_a_damaged_checkpoint_is_told(neuro, folder, file, monkeypatch, tmp_path):
    with monkeypatch.context() as patch:
        stopped_after(3, patch)
        assert neuro(file, "--data", folder, *QUICK)[0] == 130
    kept = tmp_path / "trained.yaml.training"
    whole = kept.read_bytes()
    with h5py.File(kept) as opened:
        at = whole.index(opened["weights"]["weights.in_hidden"][()].tobytes()) + 7
    kept.write_bytes(whole[:at] + bytes([whole[at] ^ 16]) + whole[at + 1 :])
    status, out, err = neuro(file, "--data", folder, *QUICK)
    assert (status, out) == (2, "")
    assert err.startswith("error: trained.yaml.training: damaged neuro training by gradients 1: it is not ")
    assert "hint: delete the file to begin anew" in err


def test_a_folder_that_is_named_as_the_network_is_told(neuro, folder, file, tmp_path):
    (tmp_path / "trained.yaml").mkdir()
    status, _, err = neuro(file, "--data", folder, *QUICK)
    assert status == 2
    assert "trained.yaml: is a folder, expected the name of a file" in err


def test_a_damaged_archive_is_told(neuro, folder, file, tmp_path):
    with zipfile.ZipFile(tmp_path / "Train.zip", "w") as packed:
        for path in sorted((folder / "Train").rglob("*.npz")):
            packed.write(path, path.relative_to(folder))
    whole = (tmp_path / "Train.zip").read_bytes()
    (tmp_path / "Train.zip").write_bytes(whole[: len(whole) // 2])
    status, out, err = neuro(file, "--data", tmp_path / "Train.zip", *QUICK)
    assert (status, out) == (2, "")
    assert err.startswith("error: ")
    assert "Train.zip" in err
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
