"""Fixtures of the drone."""

from functools import partial

import pytest

from neuro_drone.train import train


@pytest.fixture
def drone(answer, monkeypatch, tmp_path):
    """Run `neuro drone ...` in a folder with a scenario of 500 steps; exit status, stdout and stderr."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("os.sched_getaffinity", lambda pid: {0})  # several jobs one after the other, in this process
    (tmp_path / "short.yaml").write_text("step: 20\ntask: {ball: {lap: 1.5, speed: 0.15}}\n")
    return partial(answer, "drone")


@pytest.fixture(scope="session")
def snn():
    """The network after 1000 steps in B60."""
    return train("B60", steps=1000, seed=4)


@pytest.fixture(scope="session")
def pybullet():
    return pytest.importorskip("pybullet", reason="pybullet has wheels for Python 3.11 only")
