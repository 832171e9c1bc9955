from functools import partial
from importlib.metadata import EntryPoint

import numpy as np
import pytest

import neuro as snn
import neuro_models
from neuro.cli import commands
from neuro.events import Events, save

NAMES = ("upright", "lying", "oblique")
SIDE = 12


def bars(k, n=240):
    """A bar that moves over a small field: upright, lying and oblique in turn."""
    rng = np.random.default_rng(k)
    along, across = rng.integers(1, 11, n), 3 + np.arange(n) * 5 // n + rng.integers(0, 2, n)
    x, y = ((across, along), (along, across), (along, np.clip(along + across - 5, 0, 11)))[k % 3]
    return Events(np.arange(n) * 250, x, y, rng.integers(0, 2, n), (SIDE, SIDE))


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    """Recordings of bars in folders Train (24) and Test (9), 60 ms each."""
    folder = tmp_path_factory.mktemp("bars")
    for k in range(33):
        path = folder / ("Train" if k < 24 else "Test") / NAMES[k % 3] / f"{k}.npz"
        path.parent.mkdir(parents=True, exist_ok=True)
        save(bars(k), path)
    return folder


@pytest.fixture(scope="session")
def file(tmp_path_factory):
    """The dense network that ships, small."""
    small = {"height": SIDE, "width": SIDE, "hidden": 10, "classes": 3, "in_std": 0.2, "out_std": 0.4}
    path = tmp_path_factory.mktemp("net") / "net.yaml"
    snn.load(neuro_models.path("dense"), params=small).save(path)
    return path


@pytest.fixture
def neuro(answer, monkeypatch, tmp_path):
    """Run `neuro train ...`; return exit status, stdout and stderr."""
    monkeypatch.chdir(tmp_path)
    here = commands.apps() | {"train": EntryPoint("train", "neuro_train.cli:app", commands.GROUP)}
    monkeypatch.setattr(commands, "apps", lambda: here)

    return partial(answer, "train")


@pytest.fixture
def interrupted(neuro, monkeypatch):
    """Run `neuro train ...`, which is interrupted after so many epochs."""

    def run(epochs, *words):
        from neuro_train import trainer

        def stop(self):
            if self.done == epochs:
                raise KeyboardInterrupt
            whole(self)

        whole = trainer._Training.epoch
        with monkeypatch.context() as patch:
            patch.setattr(trainer._Training, "epoch", stop)
            status, _, err = neuro(*words)
        assert (status, err.splitlines()[-1]) == (130, "interrupted: run the same command again to resume")

    return run


@pytest.fixture
def dense(folder):
    """Words of `neuro train` for the dense network that ships, small."""
    small = {"height": SIDE, "width": SIDE, "hidden": 8, "classes": 3, "in_std": 0.2, "out_std": 0.4}

    def words(data=folder, **more):
        set_ = [word for name, value in (small | more).items() for word in ("--set", f"{name}={value}")]
        return [neuro_models.path("dense"), "--data", data, "--for", 60, "--batch", 6, *set_]

    return words
