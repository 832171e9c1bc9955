import shutil
from functools import partial

import numpy as np
import pytest

from flickering import drawn
from neuro.events import Events, recordings, save
from neuro_recognise import fit
from neuro_recognise.methods.frame_networks import Remus
from neuro_recognise.recogniser import learn
from neuro_recognise.shown import Features


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
def learning(folder):
    return recordings(folder, part="Train")


@pytest.fixture(scope="session")
def unseen(folder, learning):
    return recordings(folder, part="Test", classes=learning.classes)


@pytest.fixture(autouse=True)
def _own_cache(monkeypatch, tmp_path):
    monkeypatch.setattr("platformdirs.user_cache_path", lambda name: tmp_path / "cache")


@pytest.fixture(scope="session")
def of_hats(learning, tmp_path_factory):
    """The file of a recogniser by HATS that learnt the bars."""
    file = tmp_path_factory.mktemp("hats") / "m.h5"
    fit(learning, "hats", out=file, cache=file.parent / "cache")
    return file


@pytest.fixture
def model(of_hats, tmp_path):
    """A copy of that file, `m.h5` in the folder of the test."""
    return shutil.copy(of_hats, tmp_path / "m.h5")


@pytest.fixture
def neuro(answer, monkeypatch, tmp_path):
    """Run `neuro recognise ...`; return exit status, stdout and stderr."""
    monkeypatch.chdir(tmp_path)

    return partial(answer, "recognise")


def shapes():
    """Spikes of 24 noisy recordings of three shapes on a small sheet, three frames each; two more are empty."""
    rng = np.random.default_rng(2)
    shapes, labels, evidence = [rng.permutation(4 * 64)[:30] for _ in range(3)], np.arange(26) % 3, []
    for k in range(26):
        codes, ids, lengths = [], [], []
        for _ in range(3 if k < 24 else 0):
            seen = np.unique(np.concatenate([rng.permutation(shapes[labels[k]])[:26], rng.permutation(256)[:8]]))
            ticks = np.where(np.isin(seen, shapes[labels[k]]), rng.integers(0, 8, len(seen)), 6)
            order = np.lexsort((seen, ticks))
            codes.append(ticks[order])
            ids.append(seen[order])
            lengths.append(len(seen))
        codes, ids = (np.concatenate([np.zeros(0, int), *part]) for part in (codes, ids))
        ends = 10_000 * np.arange(1, len(lengths) + 1)
        one = {"codes": codes.astype(np.uint16), "ids": ids.astype(np.uint32)}
        one |= {"pixels": np.full(len(lengths), 20), "events": np.array([100 * len(lengths) + 7])}
        evidence.append(one | {"lengths": np.array(lengths, np.int64), "ends": ends})
    return Features(evidence, labels, tuple(f"{k}.bin" for k in range(26)), ("a", "b", "c"))


@pytest.fixture(scope="session")
def letters():
    """What `shapes` draws."""
    return shapes()


@pytest.fixture(scope="session")
def small():
    """ReMuS with the preset `adapted` and settings that suit `letters`."""
    changed = {"epochs": 3, "size": [16, 16], "window": 10.0, "field": 7, "theta": 16.0}
    return Remus().preset("adapted").changed(changed)


@pytest.fixture(scope="session")
def train():
    """Teach a method what recordings show."""

    def taught(shown, method, **more):
        return learn(method, shown, "letters", **more)

    return taught


@pytest.fixture(scope="session")
def shapes_folder(tmp_path_factory):
    """Recordings of crosses and rings, in classes of these names."""
    path = tmp_path_factory.mktemp("shapes")
    for name in ("cross", "ring"):
        (path / name).mkdir()
        for k in range(8):
            save(drawn(name, k), path / name / f"{k}.npz")
    return path
