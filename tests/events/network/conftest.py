import numpy as np
import pytest

from neuro.compiler import cameras
from neuro.events import Events


@pytest.fixture
def walk():
    rng, n = np.random.default_rng(3), 4000
    t = np.sort(rng.integers(7_000_000, 7_060_000, n))
    return Events(t, rng.integers(0, 12, n), rng.integers(0, 9, n), rng.integers(0, 2, n), (12, 9))


@pytest.fixture
def short(monkeypatch):
    """Stretches so short that runs are cut in many places."""
    monkeypatch.setattr(cameras, "MOST", 97)
