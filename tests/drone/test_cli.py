"""The commands: what they write and print, and what they tell of mistakes."""

import base64
import json
import re
import shlex
import subprocess
import sys
from functools import partial

import numpy as np
import pytest
from matplotlib.image import imread

from neuro.core.extras import install

SHORT = """\
step: 20
task: {ball: {lap: 1.5, speed: 0.15}}
"""


@pytest.fixture
def neuro(answer, monkeypatch, tmp_path):
    """Run `neuro drone ...` in a folder with a scenario of 500 steps; return exit status, stdout and stderr."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("os.sched_getaffinity", lambda pid: {0})  # several jobs one after the other, in this process
    (tmp_path / "short.yaml").write_text(SHORT)

    return partial(answer, "drone")


def test_train_and_test(neuro, tmp_path):
    code, out, err = neuro("train", "--scenario", "short.yaml", "--steps", 1000, "--set", "eta=2e-3")
    assert code == 0
    assert err.splitlines()[-1].startswith("seed 0: 1,000 of 1,000 steps, ")
    assert len(err.splitlines()) == 10
    assert out.startswith("model.h5: snn in short, 1,000 steps, seed 0: in the last tenth of ")
    code, out, _ = neuro("test", "model.h5", "--starts", 2, "--json")
    told = json.loads(out)
    assert code == 0
    assert (told["starts"], told["controller"], told["scenario"], told["steps"]) == (4, "snn", "short", 1000)
    assert [one["start"] for one in told["per_start"]] == [[-35, -35], [35, -35], [-35, 35], [35, 35]]
    assert told["error_px"] == pytest.approx(sum(one["error_px"] for one in told["per_start"]) / 4)
    assert told["laps"] == sum(one["lap"] for one in told["per_start"])
    assert not told["learning"]
    on = json.loads(neuro("test", "model.h5", "--starts", 1, "--json", "--learning")[1])
    assert on["learning"]
    words = ("test", "model.h5", "--starts", 1, "--out", "pictures")
    code, out, err = neuro(*words, "--json")
    assert (code, json.loads(out)["starts"]) == (0, 1)
    assert err.split() == ["pictures/density.png", "pictures/training.png", "pictures/weights.png"]
    code, out, _ = neuro("test", "model.h5", "--starts", 1)
    assert code == 0
    assert "snn in short, 1,000 steps, seed 0; weights frozen, no dopamine" in out
    for name in ("density", "training", "weights"):
        image = imread(tmp_path / "pictures" / f"{name}.png")
        assert min(image.shape[:2]) > 400
        assert 0.003 < (image[..., :3].min(axis=2) < 0.9).mean() < 0.9
    again = json.loads(neuro("test", "model.h5", "--starts", 1, "--json", "--set", "camera.tilt=50")[1])
    assert again["error_px"] != told["error_px"]


def test_the_seed_of_a_test_draws_its_paths(neuro):
    def tried(*words):
        told = json.loads(
            neuro("test", "--controller", "oracle", "--scenario", "short.yaml", "--starts", 2, "--json", *words)[1]
        )
        return told["path"], told["test_seed"], [one["path"] for one in told["per_start"]]

    paths = [tried("--seed", seed)[2] for seed in (0, 1, 1)]
    assert paths[1] == paths[2]
    assert all(one not in paths[0] for one in paths[1])
    assert tried()[2] == paths[0]
    kind, seed, fixed = tried("--path", "fixed")
    assert (kind, seed) == ("fixed", 0)
    assert {(path["scale"], path["turn"], path["speed"], path["begin"]) for path in fixed} == {(1.0, 0.0, 1.0, 0.0)}
    out = neuro("test", "--controller", "oracle", "--scenario", "short.yaml", "--starts", 1, "--seed", 7)[1]
    assert "oracle in short; weights frozen, no dopamine; varied paths, seed 7" in " ".join(out.split())


def test_compare_tests_again_on_other_paths_and_trains_no_more(neuro, tmp_path):
    words = ("compare", "--scenario", "short.yaml", "--steps", 200, "--seeds", 1, "--starts", 1, "--json")
    words = (*words, "--row", "random-search")
    first = json.loads(neuro(*words)[1])
    assert first["rows"][0]["learning_on"] is None  # what learns from the reward hears no error that could steer
    model = tmp_path / "compare-short" / "random-search-0.h5"
    written = model.stat().st_mtime_ns
    other = json.loads(neuro(*words, "--test-seed", 1)[1])
    assert (first["path"], first["test_seed"], other["path"], other["test_seed"]) == ("varied", 0, "varied", 1)
    assert first["rows"][0]["error_px"] != other["rows"][0]["error_px"]
    assert model.stat().st_mtime_ns == written


def test_watch_flies_the_first_lap_of_a_test_or_the_fixed_path(neuro, tmp_path):
    def told(*words):
        words = ("--controller", "oracle", "--scenario", "short.yaml", *words)
        page = neuro("watch", *words, "--out", "lap.html")[1], (tmp_path / "lap.html").read_text("utf-8")
        return page[0], re.search("<p>(.*?)</p>", page[1])[1]

    assert " · the fixed path · " in told("--path", "fixed")[1]
    first, second = told("--start", "20,-10"), told("--start", "20,-10", "--seed", 1)
    assert re.search(r" · a path scaled by \d\.\d\d, turned by -?\d+ degrees, \d\.\d\d times as fast · ", first[1])
    assert first != second
    test = ("test", "--controller", "oracle", "--scenario", "short.yaml", "--starts", 1, "--json")
    error = json.loads(neuro(*test)[1])["error_px"]
    assert f"mean error {error:.2f} px, a lap that counts" in told("--start", "0,0")[0]


def test_watch_begins_on_three_axes(neuro, tmp_path):
    short = [word for set in ("task.ball.lap=0.6", "task.ball.speed=0.06") for word in ("--set", set)]
    words = ("watch", "--controller", "oracle", "--scenario", "B60-height", *short, "--start", "5,-5,8")
    assert neuro(*words)[0] == 0
    data = json.loads(re.search('id="data">(.*?)</script>', (tmp_path / "lap.html").read_text("utf-8"))[1])
    talls = np.frombuffer(base64.b64decode(data["talls"]), "<f4")
    assert talls[0] == pytest.approx(48.0)


def test_seeds_have_files_of_their_own(neuro, tmp_path):
    words = ("train", "--scenario", "short.yaml", "--controller", "lms", "--steps", 200, "--seed", 3)
    assert neuro(*words, "--out", "one.h5")[0] == 0
    code, out, _ = neuro(*words, "--seeds", 2, "--out", "both.h5")
    assert code == 0
    assert [line.partition(":")[0] for line in out.splitlines()] == ["both-3.h5", "both-4.h5"]
    from neuro_drone.model import Model

    one, both, other = (Model.load(tmp_path / f"{name}.h5") for name in ("one", "both-3", "both-4"))
    assert (one.learnt["weights"] == both.learnt["weights"]).all()
    assert (one.learnt["weights"] != other.learnt["weights"]).any()


def test_controllers_that_do_not_learn_are_tested_by_name(neuro):
    code, out, _ = neuro("test", "--controller", "oracle", "--scenario", "short.yaml", "--starts", 1, "--json")
    assert code == 0
    assert json.loads(out)["laps"] == 1
    code, out, _ = neuro("test", "--controller", "nothing", "--scenario", "short.yaml", "--starts", 2, "--json")
    assert json.loads(out)["laps"] == 0
    slow = ("--set", "gain=[0.5, 0.5]", "--set", "drone.v_max=0.5")
    lazy = neuro("test", "--controller", "oracle", "--scenario", "short.yaml", "--starts", 1, "--json", *slow)
    assert json.loads(lazy[1])["error_px"] > 5


def test_compare_is_kept_and_told(neuro, tmp_path):
    words = ("compare", "--scenario", "short.yaml", "--steps", 200, "--seeds", 2, "--starts", 1, "--row", "oracle")
    words = (*words, "--row", "lms", "--also", "lms gain=4 steps=300", "--out", "kept")
    code, out, err = neuro(*words, "--json")
    assert code == 0
    oracle, lms, other = json.loads(out)["rows"]
    assert (oracle["seeds"], oracle["sd"], oracle["learning_on"], oracle["laps"]) == ([0], None, None, 1)
    assert (lms["seeds"], lms["steps"], lms["starts"], other["steps"]) == ([0, 1], 200, 2, 300)
    first, second = (one["error_px"] for one in lms["each"])
    assert lms["error_px"] == pytest.approx((first + second) / 2)
    assert lms["sd"] == pytest.approx(abs(first - second) / 2**0.5)
    assert lms["learning_on"] > 0
    assert sorted(err.splitlines())[0].startswith("lms gain=4 steps=300 seed 0: ")
    results = {file: file.stat().st_mtime_ns for file in (tmp_path / "kept").glob("*.json")}
    assert len(results) == 5
    code, out, _ = neuro(*words)
    assert code == 0
    assert "short, varied paths, seed 0: weights frozen, no dopamine; mean ± sd over seeds" in out
    assert {file: file.stat().st_mtime_ns for file in (tmp_path / "kept").glob("*.json")} == results
    table = (tmp_path / "kept" / "table.md").read_text().splitlines()
    assert re.fullmatch("<!-- neuro drone compare --><!-- digest [0-9a-f]{32} -->", table[0])
    assert table[1].startswith("| controller | steps | seeds | error, px | laps |")
    assert len(table) == 8
    assert table[7] == "short, varied paths, seed 0: weights frozen, no dopamine; mean ± sd over seeds"


def test_lists(neuro):
    code, out, _ = neuro("scenarios")
    assert code == 0
    assert all(f" {name} " in out for name in ("A30", "B60", "C60", "line", "B60-texture"))
    code, out, _ = neuro("controllers")
    assert code == 0
    assert all(f" {name} " in out for name in ("nothing", "oracle", "snn-flipped", "dqn", "coding"))


MISTAKES = {
    "train --scenario B61": "unknown scenario 'B61'\n  hint: did you mean 'B60'?",
    "train --controller sn": "unknown controller 'sn'\n  hint: did you mean 'snn'?",
    "train --set camera.tlt=3": "unknown word of camera 'tlt'\n  hint: did you mean 'tilt'?",
    "train --set camera.tilt=x": "camera.tilt = 'x': expected a number >= 1 and <= 90 degrees",
    "train --set gian=3": "unknown setting of controller 'snn' 'gian'\n  hint: did you mean 'gain'?",
    "train --set seed=3": "--set seed: it would change nothing\n  hint: training has --seed; tests have fixed seeds",
    "train --seed 9223372036854775808": "seed = 9223372036854775808: expected a whole number >= 0 and < 2^63",
    "train --set eta=x": "controller 'snn': eta = 'x': expected a number",
    "train --set camera": "Invalid value for '--set': 'camera': expected NAME=VALUE\n"
    "  hint: see 'neuro drone train --help'",
    "train --steps 0": "Invalid value for '--steps': '0': expected a whole number >= 1\n"
    "  hint: see 'neuro drone train --help'",
    "train --scenario bad.yaml": "bad.yaml:2:10: unknown word of camera 'tlt'\n  hint: did you mean 'tilt'?",
    "train --out no/model.h5": "no/model.h5: cannot be written: No such file or directory",
    "test no.h5": "no.h5: no such file: expected a neuro drone model 1",
    "test bad.yaml": "bad.yaml: not a neuro drone model 1",
    "test": "Invalid value for 'MODEL': expected a model or --controller NAME\n  hint: see 'neuro drone test --help'",
    "test --controller lms": "controller 'lms' has to learn first: expected a model, or one of nothing, oracle, "
    "centroid, static, static-linear\n  hint: neuro drone train --controller lms",
    "test oracle.h5 --set gain=3": "--set gain: the settings of a trained controller stay: expected a word of the "
    "scenario\n  hint: 'neuro drone train --set' has settings of the controller",
    "test model.h5 --learning --backend loihi": "Invalid value for '--backend': a network goes on learning on what it "
    "learnt on\n  hint: see 'neuro drone test --help'",
    "test --controller oracle --path vary": "unknown path 'vary'\n  hint: did you mean 'varied'?",
    "compare --path fix": "unknown path 'fix'\n  hint: did you mean 'fixed'?",
    "compare --row": "Option '--row' requires an argument",
    "compare --row 'snn steps=x'": "row 'snn steps=x': steps = 'x': expected a whole number >= 1",
    "compare --row sn": "unknown controller 'sn'\n  hint: did you mean 'snn'?",
    "compare --row oracle --out bad.yaml": "bad.yaml: is no folder: expected the name of a folder, or a new name",
    "energy oracle.h5": "controller 'oracle' has no network: expected a spiking one, dqn, ddpg or ppo",
    "watch oracle.h5 --out no/lap.html": "no/lap.html: cannot be written: No such file or directory",
    "watch oracle.h5 --out lap.gif": "lap.gif: a lap is written as a page for a browser: expected a name that ends in "
    ".html",
    "test --controller oracle --seed -1": "Invalid value for '--seed': '-1': expected a whole number >= 0\n"
    "  hint: see 'neuro drone test --help'",
    "test --controller oracle --seed 3 --path fixed": "seed of the paths = 3: the fixed path has none: expected path "
    "varied",
    "compare --path fixed --test-seed 1": "seed of the paths = 1: the fixed path has none: expected path varied",
    "watch oracle.h5 --path fixd": "unknown path 'fixd'\n  hint: did you mean 'fixed'?",
    "watch oracle.h5 --start 900,0": "option start = 900: expected a number >= -180 and <= 180",
    "watch oracle.h5 --start 20": "option start = (20.0,): expected two numbers, the error on both axes",
    "watch oracle.h5 --start 20,-10,5": "option start = (20.0, -10.0, 5.0): expected two numbers, the error on both "
    "axes",
    "watch oracle.h5 --start 20;5": "Invalid value for '--start': '20;5': expected numbers with commas between them, "
    "say 20,-10\n  hint: see 'neuro drone watch --help'",
}


@pytest.mark.parametrize("words", MISTAKES)
def test_mistakes(neuro, tmp_path, words):
    (tmp_path / "bad.yaml").write_text("task: ball\ncamera: {tlt: 60}\n")
    if "oracle.h5" in words:
        assert neuro("train", "--controller", "oracle", "--scenario", "short.yaml", "--out", "oracle.h5")[0] == 0
    code, out, err = neuro(*shlex.split(words))
    assert (code, out, err) == (2, "", f"error: {MISTAKES[words]}\n")


def test_a_missing_extra_is_told_before_any_work(neuro, monkeypatch):
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    code, out, err = neuro("compare", "--scenario", "short.yaml", "--also", "dqn")
    assert (code, out) == (2, "")
    assert err == f"error: controller 'dqn': stable-baselines3 is not installed\n  hint: {install('rl')}\n"


def test_help_is_light():
    heavy = "('numba', 'h5py', 'matplotlib', 'scipy', 'torch', 'rich.progress')"
    code = f"import sys, neuro_drone.cli; sys.exit(any(m in sys.modules for m in {heavy}))"
    subprocess.run([sys.executable, "-c", code], check=True)
