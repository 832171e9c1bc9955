from functools import partial
from importlib.metadata import EntryPoint

import h5py
import numpy as np
import pytest
from scipy.io import wavfile

from neuro.cli import commands

TONES = {"low": 300.0, "middle": 900.0, "high": 2400.0}
CHANNELS, UNITS = 24, 2
"""Of the electrodes that record from a monkey."""


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


def reaching_file(path, steps=5000, targets=20, seed=0, step=0.004, leave=(), **changes):
    """A session as O'Doherty et al. have it, MATLAB 7.3: cells are references, units by channels.

    The cursor moves at random; the rate of a unit is 15 Hz, and more or less by the cosine between the velocity and
    the direction that the unit prefers.
    """
    rng, t, velocity = np.random.default_rng(seed), 100.0 + step * np.arange(steps), np.zeros((2, steps))
    for k in range(1, steps):
        velocity[:, k] = 0.98 * velocity[:, k - 1] + rng.normal(0.0, 0.1, 2)
    target = np.repeat(rng.normal(0.0, 50.0, (2, targets)), -(-steps // targets), axis=1)[:, :steps]
    held = {"t": t[None], "cursor_pos": np.cumsum(velocity, axis=1), "target_pos": target, **changes}
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in held.items():
            if name not in leave:
                file[name] = values
        cells = file.create_dataset("spikes", (UNITS, CHANNELS), dtype=h5py.ref_dtype)
        for unit, channel in np.ndindex(UNITS, CHANNELS):
            angle = rng.uniform(0.0, 2.0 * np.pi)
            along = np.array([np.cos(angle), np.sin(angle)]) @ velocity
            fired = np.flatnonzero(rng.poisson(0.004 * np.maximum(0.0, 15.0 + 50.0 * along)))
            empty = (unit, channel) == (1, 3)
            times = np.zeros(2, np.uint64) if empty else (t[fired] - 0.01)[None]
            own = file.create_dataset(f"#refs#/{unit}_{channel}", data=times)
            own.attrs["MATLAB_empty"] = empty
            cells[unit, channel] = own.ref
    return path


@pytest.fixture(scope="session")
def write_reaching():
    """Write a session of a monkey that reaches."""
    return reaching_file


@pytest.fixture(scope="session")
def reaching(tmp_path_factory):
    """Two sessions of 20 s."""
    folder = tmp_path_factory.mktemp("reaching")
    for k, name in enumerate(("indy_1", "loco_2")):
        reaching_file(folder / f"{name}.mat", seed=k)
    return folder


@pytest.fixture
def bench(answer, monkeypatch, tmp_path):
    """Run `neuro bench ...`; return exit status, stdout and stderr."""
    monkeypatch.chdir(tmp_path)
    here = commands.apps() | {"bench": EntryPoint("bench", "neuro_bench.cli:app", commands.GROUP)}
    monkeypatch.setattr(commands, "apps", lambda: here)
    return partial(answer, "bench")
