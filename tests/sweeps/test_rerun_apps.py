"""What apps make says where it comes from, and models of theirs are made again to the bit."""

import html
import json
import re
from pathlib import Path

import h5py
import numpy as np
import pytest

from bar_recordings import write_bars
from neuro.core.hdf5 import seal
from neuro.core.provenance import ATTRIBUTE

pytestmark = pytest.mark.slow


@pytest.fixture
def neuro(answer, monkeypatch, tmp_path):
    """Run `neuro ...` in an empty folder; its exit status and what it prints."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("platformdirs.user_cache_path", lambda name: tmp_path / "cache")

    def run(*words):
        status, out, err = answer(*words)
        assert status in (0, 1), err
        return status, out

    return run


@pytest.fixture
def bars(tmp_path):
    """Recordings of bars beside the place where commands are run."""
    return write_bars(tmp_path / "bars")


def record(file):
    """What a page, a model or a file of JSON says of where it comes from."""
    path = Path(file)
    if path.suffix == ".h5":
        with h5py.File(path) as opened:
            return json.loads(opened.attrs[ATTRIBUTE])
    text = path.read_text()
    if path.suffix == ".json":
        return json.loads(text)["provenance"]
    (found,) = re.findall(rf'^<meta name="{ATTRIBUTE}" content="([^"]*)">$', text, re.M)
    return json.loads(html.unescape(found))


def edit(model, name):
    """Change one number of a model by the least that it can."""
    with h5py.File(model, "r+") as file:
        values = file[name][()]
        values.flat[0] = np.nextafter(values.flat[0], np.inf)
        file[name][()] = values
    seal(Path(model))


def test_the_demonstrations_model_is_made_again(neuro, bars, tmp_path):
    assert neuro("remus", "demo", "--data", "bars", "--out", "demo")[0] == 0
    told = record("demo/model.h5")
    assert told["command"] == "neuro remus demo --data bars --out demo"
    assert f"{tmp_path}/bars" in told["inputs"]
    assert neuro("rerun", "demo/model.h5") == (0, "demo/model.h5: the same bits\n")
    arrays = []
    with h5py.File("demo/model.h5") as file:
        file.visititems(lambda name, part: arrays.append(name) if getattr(part, "dtype", "") == np.float64 else None)
    edit("demo/model.h5", next(name for name in arrays if "learnt" in name))
    (bars / "Train" / "lying" / "note.txt").write_text("of mine")
    code, out = neuro("rerun", "demo/model.h5")
    assert (code, out.startswith("demo/model.h5: not the same: ")) == (1, True)
    assert f"input {tmp_path}/bars: was edited" in out


@pytest.mark.parametrize("seeds", [1, 2])
def test_a_drones_model_is_made_again(neuro, seeds):
    assert neuro("drone", "train", "--steps", 400, "--out", "fly.h5", "--repeats", seeds)[0] == 0
    file = "fly.h5" if seeds == 1 else "fly-1.h5"
    assert (record(file)["seed"], neuro("rerun", file)) == (seeds - 1, (0, f"{file}: the same bits\n"))


def test_an_own_world_is_an_input_of_each_seed_that_is_trained_beside_others(neuro, tmp_path):
    """It is read by the process that asks, not by those that train."""
    world, own = Path(__file__).parents[2] / "apps" / "neuro_drone" / "scenarios", tmp_path / "own.yaml"
    own.write_text(sorted(world.glob("*.yaml"))[0].read_text())
    neuro("drone", "train", "--scenario", "own.yaml", "--steps", 100, "--repeats", 2, "--out", "fly.h5")
    assert [str(own) in record(f"fly-{seed}.h5")["inputs"] for seed in (0, 1)] == [True, True]


def test_pages_and_figures_of_apps_say_where_they_come_from(neuro, bars, tmp_path):
    one = "bars/Test/lying/23.bin"
    neuro("recognise", "train", "hats", "--data", "bars", "--out", "hats.h5")
    neuro("recognise", "watch", "hats.h5", one, "--out", "seen.html")
    assert {f"{tmp_path}/hats.h5", f"{tmp_path}/bars"} <= record("seen.html")["inputs"].keys()
    neuro("recognise", "compare", "--data", "bars", "--folds", 2, "--method", "hats", "--out", "all")
    for file in ("all/hats-0-0.json", "all/hats-0-1.json"):
        told = record(file)
        assert told["command"] == "neuro recognise compare --data bars --folds 2 --method hats --out all"
        assert (told["seed"], told["backend"]) == (0, "event")
        assert f"{tmp_path}/bars" in told["inputs"]
    assert f"{tmp_path}/bars" in record("all/compare.html")["inputs"]
    neuro("events", "view", one, "--out", "view.html")
    assert f"{tmp_path}/bars" in record("view.html")["inputs"]
    neuro("drone", "compare", "--row", "static", "--repeats", 1, "--starts", 1, "--out", "flown")
    assert record("flown/static-0.json")["seed"] == 0
    neuro("drone", "watch", "flown/static-0.h5", "--out", "lap.html")
    assert f"{tmp_path}/flown/static-0.h5" in record("lap.html")["inputs"]


def test_a_page_names_only_what_it_is_of(neuro, tmp_path):
    """However much the same process has read before."""
    (tmp_path / "net.yaml").write_text(
        "neuro: 1\nname: one\npopulations:\n  noise: {model: {poisson_generator: {rate: 900.0}}, shape: 5}\n"
        "probes: {seen: {of: noise}}\n"
    )
    neuro("run", "net.yaml", "--for", 20, "--out", "a.h5")
    neuro("compare", "net.yaml", "--backends", "event,reference", "--for", 20, "--html", "c.html", "--out", "c.json")
    neuro("report", "a.h5", "--out", "a.html")
    assert [*record("a.html")["inputs"]] == [f"{tmp_path}/a.h5"]
    assert [*record("c.html")["inputs"]] == [*record("c.json")["inputs"]] == [f"{tmp_path}/net.yaml"]
    assert record("c.json")["backend"] == "event, reference"
