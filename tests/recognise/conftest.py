import sys

import numpy as np
import pytest

from neuro.cli import main
from neuro.events import Events, recordings, save


def bars(k, n=900):
    """A bar that moves over a small field: upright, lying and oblique in turn."""
    rng = np.random.default_rng(k)
    along, across = rng.integers(8, 27, n), 12 + np.arange(n) * 6 // n + rng.integers(0, 2, n)
    x, y = ((across, along), (along, across), (along, np.clip(along + across - 16, 0, 33)))[k % 3]
    return Events(np.arange(n) * 100 + 7000, x, y, rng.integers(0, 2, n), (34, 34))


NAMES = ("upright", "lying", "oblique")


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    """Recordings of bars in folders Train (24) and Test (9, one of them empty)."""
    folder = tmp_path_factory.mktemp("bars")
    for k in range(33):
        path = folder / ("Train" if k < 24 else "Test") / NAMES[k % 3] / f"{k}.bin"
        path.parent.mkdir(parents=True, exist_ok=True)
        save(bars(k) if k < 32 else bars(k)[:0], path)
    return folder


@pytest.fixture(scope="session")
def train(folder):
    return recordings(folder, part="Train")


@pytest.fixture(scope="session")
def test(folder, train):
    return recordings(folder, part="Test", classes=train.classes)


@pytest.fixture(autouse=True)
def _own_cache(monkeypatch, tmp_path):
    monkeypatch.setattr("platformdirs.user_cache_path", lambda name: tmp_path / "cache")


@pytest.fixture
def neuro(monkeypatch, tmp_path, capsys):
    """Run `neuro recognise ...`; return exit status, stdout and stderr."""
    monkeypatch.chdir(tmp_path)

    def run(*words):
        monkeypatch.setattr(sys, "argv", ["neuro", "recognise", *map(str, words)])
        with pytest.raises(SystemExit) as end:
            main()
        out = capsys.readouterr()
        return end.value.code or 0, out.out, out.err

    return run
