from functools import partial
from importlib.metadata import EntryPoint

import numpy as np
import pytest
from scipy.io import wavfile

from neuro.cli import commands

TONES = {"low": 300.0, "middle": 900.0, "high": 2400.0}


@pytest.fixture(scope="session")
def sounds(tmp_path_factory):
    """Tones of three heights by three speakers, 12 of each."""
    folder, rng = tmp_path_factory.mktemp("sounds"), np.random.default_rng(0)
    for name, frequency in TONES.items():
        for k in range(12):
            t = np.arange(2400) / 8000.0
            sound = np.sin(2 * np.pi * frequency * rng.uniform(0.95, 1.05) * t) + rng.normal(0, 0.02, len(t))
            wavfile.write(folder / f"{name}_{'abc'[k % 3]}_{k}.wav", 8000, (8000 * sound).astype(np.int16))
    return folder


@pytest.fixture
def bench(answer, monkeypatch, tmp_path):
    """Run `neuro bench ...`; return exit status, stdout and stderr."""
    monkeypatch.chdir(tmp_path)
    here = {"bench": EntryPoint("bench", "neuro_bench.cli:app", commands.GROUP)}
    monkeypatch.setattr(commands, "apps", lambda: here)
    return partial(answer, "bench")
