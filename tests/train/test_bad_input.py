"""neuro train with what cannot be, or is no longer what it was: one error, before long work, and nothing is mixed."""

import shutil
import signal
import subprocess
import sys
import zipfile
from dataclasses import replace

import h5py
import pytest

import neuro as snn
from neuro.events import Events, save
from refused import mistakes_of

torch = pytest.importorskip("torch", reason="PyTorch is not installed")

QUICK = ("--for", 60, "--epochs", 8, "--batch", 6)
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


def test_networks_that_cannot_learn(neuro, folder, tmp_path, messages):
    said = {}
    for name, net in {
        "nothing learns": network(connected=False), "a rule": network(synapse=snn.stdp()),
        "no V_reset": network(snn.hh_psc_alpha(t_ref=5.0)), "at random": network(snn.srm0(t_ref=5.0)),
    }.items():  # fmt: skip
        net.save("net.yaml")
        (said[name],) = mistakes_of(neuro, [f"net.yaml --data {folder} --for 60 --epochs 8 --batch 6"]).values()
    messages(said)
    assert not (tmp_path / "trained.yaml").exists()


def test_options_that_cannot_be(neuro, folder, file, tmp_path, messages):
    messages(mistakes_of(neuro, messages.cases, folder=folder, file=file))
    assert list(tmp_path.iterdir()) == []


def test_recordings_that_do_not_fit(neuro, folder, file, tmp_path):
    """Of another sensor, of a class that is not learnt, of no class, in a damaged archive."""
    for k, name in enumerate(("upright", "lying", "oblique")):
        path = tmp_path / "wide" / "Test" / name / "0.npz"
        path.parent.mkdir(parents=True)
        save(Events(range(0, 5000, 1000), [k] * 5, range(5), [0, 1, 0, 1, 0], (16, 14)), path)
    shutil.copytree(folder / "Test", tmp_path / "more" / "Test")
    (tmp_path / "more" / "Test" / "lying").rename(tmp_path / "more" / "Test" / "leaning")
    with zipfile.ZipFile(tmp_path / "Train.zip", "w") as packed:
        for path in sorted((folder / "Train").rglob("*.npz")):
            packed.write(path, path.relative_to(folder))
    (tmp_path / "Train.zip").write_bytes((tmp_path / "Train.zip").read_bytes()[:-1000])
    one = next((folder / "Train" / "lying").iterdir())
    told = "wide: --input pixels: shape [2, 12, 12]: recordings of 16x14 px have 14 rows and 16 columns"
    for words, message in (
        (("--data", folder, "--test", tmp_path / "wide"),
         f"{told}: expected the shape [2, 14, 16]\n  hint: test on recordings of the sensor of --data"),
        (("--data", folder, "--test", tmp_path / "more"), "leaning"),
        (("--data", one), f"{one.name}: its class is not known: expected recordings in folders of classes"),
        (("--data", tmp_path / "Train.zip"), "Train.zip"),
    ):  # fmt: skip
        status, out, err = neuro(file, *QUICK, *words)
        assert (status, out) == (2, "")
        assert err.startswith("error: ")
        assert message in err
        assert not (tmp_path / "trained.yaml").exists()
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler


def test_an_interrupt_loses_no_whole_epoch_and_files_of_something_else_stay(neuro, interrupted, folder, file, tmp_path):
    interrupted(5, file, "--data", folder, *QUICK)
    with h5py.File("trained.yaml.training") as kept:
        assert kept["progress"][0] == 5.0
    assert neuro(file, "--data", folder, *QUICK)[0] == 0
    assert neuro(file, "--data", folder, *QUICK, "--out", "other.yaml")[0] == 0
    assert snn.load("trained.yaml") == snn.load("other.yaml")
    (tmp_path / "trained.yaml").write_text("my notes")
    (tmp_path / "folder.yaml").mkdir()
    for out, message in (
        ("trained.yaml", "exists and is not a network that was saved: expected a new name"),
        ("folder.yaml", "is a folder, expected the name of a file"),
    ):
        status, _, err = neuro(file, "--data", folder, *QUICK, "--out", out)
        assert (status, f"{out}: {message}" in err) == (2, True)


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
        ("data", "data._check_sensor", "interrupted: run the same command again to resume\n"),
        ("tested", "tested._bill", "interrupted: run the same command again to resume\n"),
    ],
    ids=["before", "reading", "testing"],
)
def test_an_interrupt_wherever_it_comes(folder, file, tmp_path, where, function, told):
    words = [file, "--data", folder, *QUICK, "--epochs", 1, "--test", folder, "--backends", "event"]
    command = [sys.executable, "-c", INTERRUPTED.format(where=where, function=function), "train", *map(str, words)]
    done = subprocess.run(command, check=False, cwd=tmp_path, capture_output=True, text=True)
    lines = [line for line in done.stderr.splitlines(keepends=True) if "kernels" not in line and "left" not in line]
    assert (done.returncode, "".join(lines), (tmp_path / "trained.yaml").exists()) == (130, told, where == "tested")


@pytest.fixture
def own(folder, tmp_path):
    """A copy of the recordings that may be edited."""
    return shutil.copytree(folder, tmp_path / "own")


def test_a_training_goes_on_with_what_it_began_with_alone(neuro, interrupted, own, file, tmp_path):
    interrupted(3, file, "--data", own, *QUICK)

    def refused(message, *words, network=file):
        status, out, err = neuro(network, "--data", own, *QUICK, *words)
        assert (status, out) == (2, "")
        assert f"trained.yaml.training: {message}" in err
        return err

    refused("an unfinished training with rate = 0.01: found 0.02 now", "--rate", 0.02)
    net = snn.load(file)
    net.populations["out"] = replace(net.populations["out"], model=replace(net.populations["out"].model, tau_m=30.0))
    net.save("slower.yaml")
    refused("an unfinished training with network = ", network="slower.yaml")
    one, other = own / "Train" / "lying" / "1.npz", own / "Train" / "upright" / "1.npz"
    whole = one.read_bytes()
    for edit in (  # other events, another class, one less
        lambda: one.write_bytes((own / "Train" / "lying" / "4.npz").read_bytes()),
        lambda: one.rename(other),
        lambda: other.unlink(),
    ):
        edit()
        way = (
            "the recordings are not those of the checkpoint: give those with which the training began to continue it, "
            "or delete the file"
        )
        assert f"hint: {way}" in refused("an unfinished training with data = ")
    one.write_bytes(whole)
    kept = tmp_path / "trained.yaml.training"
    good = kept.read_bytes()
    with h5py.File(kept) as opened:
        at = good.index(opened["weights"]["weights.in_hidden"][()].tobytes()) + 7
    kept.write_bytes(good[:at] + bytes([good[at] ^ 16]) + good[at + 1 :])
    assert "hint: delete the file to start again" in refused("damaged neuro training by gradients 1: the content ")
    kept.write_bytes(good)
    own.rename(own.with_name("moved"))  # where they lie does not matter
    assert neuro(file, "--data", own.with_name("moved"), *QUICK)[0] == 0


def test_folds_of_recordings_that_are_edited_are_learnt_anew(neuro, own, file):
    words = (file, "--data", own, *QUICK, "--folds", 2, "--backends", "event")
    before = neuro(*words)[1]
    for k in range(1, 22, 6):
        (own / "Train" / "lying" / f"{k}.npz").write_bytes((own / "Train" / "upright" / f"{k + 2}.npz").read_bytes())
    status, out, _ = neuro(*words)
    assert status == 0
    one, other = ([line for line in text.splitlines() if "right" in line] for text in (before, out))
    assert one != other


@pytest.mark.filterwarnings("ignore:backend 'loihi'")
def test_a_search_goes_on_with_what_it_began_with_alone(neuro, interrupted, own, dense):
    pytest.importorskip("optuna", reason="Optuna is not installed")
    search = ("--epochs", 1, "--search", "hidden=4:8", "--budget", 2)
    interrupted(0, *dense(own), *search)
    status, out, err = neuro(*dense(own), *search)
    assert status == 0, err
    assert "trained/front.csv: written" in out
    status, _, err = neuro(*dense(own, tau=10.0), *search)
    assert (status, "trained: the folder of another tuning: set is " in err) == (2, True)
    (own / "Train" / "lying" / "1.npz").write_bytes((own / "Train" / "lying" / "4.npz").read_bytes())
    status, _, err = neuro(*dense(own), *search)
    assert (status, "trained: the folder of another tuning: set is " in err) == (2, True)
    assert '"recordings": ' in err
    assert "hint: expected the same tuning, or the name of a new folder" in err
