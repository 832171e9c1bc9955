"""Every example runs."""

import runpy
import sys
from pathlib import Path

import pytest
from matplotlib import pyplot

import neuro

ROOT = Path(__file__).parents[1]
NEEDS_PACKAGE = {"drone_ppo": "stable_baselines3", "joules_to_learn": "stable_baselines3"} | {
    "masquelier_thorpe_2007": "sklearn"
}
NMNIST = ROOT.parent / "shared" / "data" / "nmnist" / "nmnist_train1000_bin.zip"
LARVA = ROOT.parent / "shared" / "data" / "connectome" / "larva_winding2023.zip"
NEEDS_DATA = {"diehl_cook_2015": NMNIST, "larva": LARVA, "masquelier_thorpe_2007": NMNIST}
ARGUMENTS = {
    "brunel_2000": ["--scale", "0.1", "--ms", "100"],
    "conditioning": ["--seconds", "30"],
    "diehl_cook_2015": [str(NMNIST), "--neurons", "10", "--epochs", "1", "--folds", "1", "--recordings", "2"],
    "drone_on_chips": ["200"],
    "drone_ppo": ["256"],
    "grid_world": ["--side", "2", "--episodes", "3"],
    "hedonists": ["--trials", "60"],
    "joules_to_learn": ["20"],
    "larva": [str(LARVA), "--seeds", "2", "--ms", "100"],
    "linear_track": ["--runs", "2"],
    "loop_without_host": ["8"],
    "masquelier_thorpe_2007": [str(NMNIST), "--each", "5"],
    "potjans_diesmann_2014": ["--scale", "0.02", "--ms", "50"],
    "vogels_abbott_2005": ["--neurons", "1000", "--ms", "100"],
    "song_2000": ["--seconds", "2"],
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    yield tmp_path
    pyplot.close("all")


SCRIPTS = [path for path in sorted((ROOT / "examples").glob("*.py")) if path.stem != "first_hour"]
"""All but that of `test_first_hour.py`."""


SLOW = (
    *("diehl_cook_2015", "drone_on_chips", "firing_patterns", "joules_to_learn", "masquelier_thorpe_2007", "neurons"),
    *("loop_without_host", "recognisers", "vogels_abbott_2005"),
)
"""Their kernels take seconds to compile, and other tests run what they show."""


@pytest.mark.parametrize(
    "path",
    [pytest.param(path, marks=pytest.mark.slow) if path.stem in SLOW else path for path in SCRIPTS],
    ids=lambda path: path.stem,
)
def test_example(path, folder, capsys, monkeypatch):
    if path.stem in NEEDS_PACKAGE:
        pytest.importorskip(NEEDS_PACKAGE[path.stem], reason=f"the example needs {NEEDS_PACKAGE[path.stem]}")
    if path.stem in NEEDS_DATA and not NEEDS_DATA[path.stem].exists():
        pytest.skip(f"the example needs {NEEDS_DATA[path.stem]}")
    monkeypatch.setattr(sys, "argv", [str(path), *ARGUMENTS.get(path.stem, ())])
    runpy.run_path(str(path), run_name="__main__")
    assert capsys.readouterr().out.strip()


@pytest.mark.parametrize("path", sorted((ROOT / "examples").glob("*.yaml")), ids=lambda path: path.stem)
def test_example_network(path, folder):
    net = neuro.load(path)
    neuro.compile(net, backend="reference")
    net.save("copy.yaml")
    assert neuro.load("copy.yaml") == net
