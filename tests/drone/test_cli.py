"""The commands: what they write and print; tests/drone/test_mistakes.py has what they tell of mistakes."""

import json
import re
import subprocess
import sys
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from neuro_drone.evaluate import grid
from neuro_drone.live import fly_live
from neuro_drone.model import Model
from neuro_drone.report import describe_training
from neuro_drone.scenario import load
from neuro_drone.train import pilot, train, untrained
from players import tracks_of
from refused import refused

ORACLE = ("--controller", "oracle", "--scenario", "short.yaml")


def told(drone, *words):
    """What a command prints as JSON."""
    code, out, _ = drone(*words, "--json")
    assert code == 0
    return json.loads(out)


def test_train_and_test(drone, tmp_path):
    code, out, err = drone("train", "--scenario", "short.yaml", "--steps", 2000, "--set", "eta=2e-3")
    assert code == 0
    assert err.splitlines()[-1].startswith("seed 0: 2,000 of 2,000 steps, ")
    assert len(err.splitlines()) == 10
    frozen = re.search(
        r"px with frozen weights in short flights from far starts; mean reward 0\.\d+ in the last tenth of", out
    )
    assert frozen, out
    assert out.startswith("model.h5: snn in short, 2,000 steps, seed 0: ")
    assert "px frozen, from far starts, reward 0." in err
    four = told(drone, "test", "model.h5", "--starts", 2)
    assert (four["starts"], four["controller"], four["scenario"], four["steps"]) == (4, "snn", "short", 2000)
    assert [one["start"] for one in four["per_start"]] == [[-35, -35], [35, -35], [-35, 35], [35, 35]]
    assert four["error_px"] == pytest.approx(sum(one["error_px"] for one in four["per_start"]) / 4)
    assert four["laps"] == sum(one["lap"] for one in four["per_start"])
    assert not four["learning"]
    one = ("test", "model.h5", "--starts", 1)
    assert told(drone, *one, "--learning")["learning"]
    assert told(drone, *one, "--set", "camera.tilt=50")["error_px"] != four["error_px"]
    code, out, err = drone(*one, "--out", "pictures")
    assert (code, err) == (0, "")
    assert out.split()[:3] == ["pictures/density.png", "pictures/training.png", "pictures/weights.png"]
    assert "snn in short, 2,000 steps, seed 0; weights frozen, no dopamine" in out
    for name in ("density", "training", "weights"):
        image = imread(tmp_path / "pictures" / f"{name}.png")
        assert min(image.shape[:2]) > 400
        assert 0.003 < (image[..., :3].min(axis=2) < 0.9).mean() < 0.9


def test_a_training_says_that_its_last_test_lost_the_target():
    def told_of(lost, **changes):
        model = untrained(load("B60", **changes), "snn", 0, None, {})
        curve = {"steps": np.array([2000]), "error_px": np.array([9.0]), "lost": np.array([lost])}
        history = {"returns": np.ones(10), "lengths": np.ones(10, dtype=np.int64)}
        return describe_training(replace(model, steps=2000, curve=curve, history=history))

    assert "lost" not in told_of(0)
    assert "far starts; the target was lost in 2 of the last 2 of them; mean reward" in told_of(2)
    body = told_of(1, **{"camera.mount": "body"})
    assert "lost in 1 of the last 2 of them, as the camera rolls and pitches with the drone" in body


def test_tests_and_flights_of_controllers_by_name(drone, tmp_path):
    def tried(*words):
        found = told(drone, "test", *ORACLE, "--starts", 2, *words)
        return found["path"], found["test_seed"], [one["path"] for one in found["per_start"]]

    first, second, again = (tried("--seed", seed)[2] for seed in (0, 1, 1))
    assert second == again
    assert all(one not in first for one in second)
    kind, seed, fixed = tried("--path", "fixed")
    assert (kind, seed) == ("fixed", 0)
    assert {(path["scale"], path["turn"], path["speed"], path["begin"]) for path in fixed} == {(1.0, 0.0, 1.0, 0.0)}
    out = drone("test", *ORACLE, "--starts", 1, "--seed", 7)[1]
    assert "oracle in short; weights frozen, no dopamine; varied paths, seed 7" in " ".join(out.split())

    def watched(*words):
        out = drone("watch", *ORACLE, *words, "--out", "lap.html")[1]
        return out, re.search("<p>(.*?)</p>", (tmp_path / "lap.html").read_text("utf-8"))[1]

    assert " · the fixed path · " in watched("--path", "fixed")[1]
    first, second = watched("--error", "20,-10"), watched("--error", "20,-10", "--seed", 1)
    assert re.search(r" · a path scaled by \d\.\d\d, turned by -?\d+ degrees, \d\.\d\d times as fast · ", first[1])
    assert first != second
    error = told(drone, "test", *ORACLE, "--starts", 1)["error_px"]
    assert f"mean error {error:.2f} px, a lap that counts" in watched("--error", "0,0")[0]
    short = [word for set in ("task.ball.lap=0.6", "task.ball.speed=0.06") for word in ("--set", set)]
    assert drone("watch", "--controller", "oracle", "--scenario", "B60-height", *short, "--error", "5,-5,8")[0] == 0
    talls = tracks_of((tmp_path / "lap.html").read_text("utf-8"))["camera"]["talls"]
    assert (talls[0], told(drone, "test", *ORACLE, "--starts", 1)["laps"]) == (pytest.approx(48.0), 1)
    assert told(drone, "test", "--controller", "nothing", "--scenario", "short.yaml", "--starts", 1)["laps"] == 0
    slow = ("--set", "gain=[0.5, 0.5]", "--set", "drone.v_max=0.5")
    assert told(drone, "test", *ORACLE, "--starts", 1, *slow)["error_px"] > 5
    for command, names in (
        ("scenarios", ("A30", "B60", "C60", "line", "B60-texture")),
        ("controllers", ("nothing", "oracle", "snn-flipped", "dqn", "coding")),
    ):
        code, out, _ = drone(command)
        assert code == 0
        assert all(f" {name} " in out for name in names)


def test_seeds_have_files_of_their_own(drone, tmp_path):
    words = ("train", "--scenario", "short.yaml", "--controller", "lms", "--steps", 200, "--seed", 3)
    assert drone(*words, "--out", "one.h5")[0] == 0
    code, out, _ = drone(*words, "--repeats", 2, "--out", "both.h5")
    assert (code, [line.partition(":")[0] for line in out.splitlines()]) == (0, ["both-3.h5", "both-4.h5", "next"])
    one, both, other = (Model.load(tmp_path / f"{name}.h5").learnt["weights"] for name in ("one", "both-3", "both-4"))
    assert (one == both).all()
    assert (one != other).any()


def test_compare_is_kept_and_told(drone, tmp_path):
    words = ("compare", "--scenario", "short.yaml", "--steps", 200, "--repeats", 2, "--starts", 1, "--row", "oracle")
    words = (*words, "--row", "lms", "--also", "lms gain=4 steps=300", "--also", "random-search", "--out", "kept")
    code, out, err = drone(*words, "--json")
    assert code == 0
    found = json.loads(out)
    assert (found["path"], found["test_seed"]) == ("varied", 0)
    oracle, lms, other, search = found["rows"]
    assert (oracle["seeds"], oracle["sd"], oracle["learning_on"], oracle["laps"]) == ([0], None, None, 1)
    assert (lms["seeds"], lms["steps"], lms["starts"], other["steps"]) == ([0, 1], 200, 2, 300)
    first, second = (one["error_px"] for one in lms["each"])
    assert lms["error_px"] == pytest.approx((first + second) / 2)
    assert lms["sd"] == pytest.approx(abs(first - second) / 2**0.5)
    assert lms["learning_on"] > 0
    assert search["learning_on"] is None  # what learns from the reward hears no error that could steer
    assert sorted(err.splitlines())[0].startswith("lms gain=4 steps=300 seed 0: ")

    def written(kind):
        return {file.name: file.stat().st_mtime_ns for file in (tmp_path / "kept").glob(f"*.{kind}")}

    results, models = written("json"), written("h5")
    assert len(results) == len(models) == 7
    code, out, _ = drone(*words)
    assert code == 0
    about = "short, varied paths, seed 0: weights frozen, no dopamine; mean ± sd over seeds"
    assert about in out
    assert written("json") == results
    table = (tmp_path / "kept" / "table.md").read_text().splitlines()
    assert re.fullmatch("<!-- neuro drone compare --><!-- digest [0-9a-f]{32} -->", table[0])
    assert table[1].startswith("| controller | steps | seeds | error, px | laps |")
    assert (len(table), table[-1]) == (9, about)
    rows = told(drone, *words, "--test-seed", 1)["rows"]  # on other paths; nothing is trained again
    again = written("h5")
    assert all(again[name] == models[name] for name in models if "oracle" not in name)
    assert all(one["error_px"] != before["error_px"] for one, before in zip(rows, found["rows"], strict=True))


def test_what_is_not_needed_is_not_imported():
    """The package brings no numba, help and lists nothing heavy, and random search no torch."""
    code = """
import sys, neuro_drone
assert "numba" not in sys.modules and "pybullet" not in sys.modules
import neuro_drone.cli
assert not {"numba", "h5py", "matplotlib", "scipy", "torch", "rich.progress"} & sys.modules.keys()
from neuro_drone.train import train
train("B60", "random-search", steps=50)
assert "torch" not in sys.modules
"""
    subprocess.run([sys.executable, "-c", code], check=True)


LAP = ("--controller", "centroid", "--scenario", "short.yaml", "--speed", "2")


def test_a_lap_in_real_time_beside_the_same_offline(drone):
    code, out, _ = drone("live", *LAP, "--json", "--set", "task.ball.lap=0.5")
    assert code == 0
    found = json.loads(out)
    assert found["starts"] == 1
    assert found["flown"] == found["per_start"][0]["steps"] > 50
    assert found["error_px"] == pytest.approx(found["offline"]["error_px"], abs=20.0)
    if not found["missed"] and not found["events_lost"]:
        assert found["error_px"] == found["offline"]["error_px"]
    assert 0.0 < found["latency_ms"]["p50"] < found["latency_ms"]["p99"]
    code, _, err = drone("live", "--controller", "oracle", "--scenario", "short.yaml")
    assert code == 2
    assert "controller 'oracle' needs the true error, which no camera sends" in err
    model = pilot(None, "A60", "centroid", [])
    start = grid(model.scenario, 1)[0]
    assert "the world's process failed: ModelError: " in refused(fly_live, model, [type(start)((1000.0, 0.0))])


@pytest.mark.skipif(find_spec("websockets") is None, reason="websockets is not installed: pip install '.[live]'")
def test_a_lap_is_shown_on_a_page(drone):
    train("short.yaml", steps=1, out=Path("model.h5"))
    code, out, err = drone("live", "model.h5", "--speed", 10, "--json", "--page", "--no-browser")
    assert code == 0, err
    assert "page: http://127.0.0.1:" in err
    assert json.loads(out)["flown"] > 0
    code, _, err = drone("live", *LAP, "--page", "--no-browser")
    assert code == 2
    assert "controller 'centroid' is no spiking network" in err
