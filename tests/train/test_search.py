"""neuro train --search: networks that differ, accuracy against joules on a chip, the front on what is held out."""

import csv
import importlib.util
import signal
import subprocess
import sys

import pytest

pytest.importorskip("torch", reason="PyTorch is not installed")

import neuro as snn
import neuro_models
from neuro.events import recordings
from neuro_train import trainer
from neuro_train.plan import TrainingPlan
from neuro_train.search import divided, parted, space
from neuro_train.telling import FrontPlace, draw
from refused import refusals_of

pytestmark = [
    pytest.mark.filterwarnings("ignore:backend 'spinnaker'"),
    pytest.mark.filterwarnings("ignore:backend 'loihi'"),
]
STEP = {"resolution": 5.0}
PLAN = TrainingPlan(input="pixels", output="out", duration=60.0)


@pytest.fixture
def words(dense):
    """Arguments of a small search."""
    pytest.importorskip("optuna", reason="Optuna is not installed")
    return [*dense(), "--epochs", 4, "--budget", 4]


def table(path):
    with open(path, encoding="utf-8", newline="") as opened:
        return list(csv.DictReader(opened))


@pytest.mark.filterwarnings("ignore:population .out.. no neuron fired")  # small networks in four epochs
def test_every_point_is_a_network_that_runs_and_the_front_is_tested_on_what_is_held_out(neuro, words, folder, tmp_path):
    words += ["--search", "step=5:10,for=30:60,hidden,prune=0:0.5"]
    status, out, err = neuro(*words)
    assert status == 0, err
    assert out.splitlines()[-2:] == ["trained/front.csv: written", "trained/front.png: written"]
    rows = table("trained/front.csv")
    assert 2 <= len(rows) <= 4
    spent = [float(row["microjoules"]) for row in rows]
    assert spent == sorted(spent)
    front = [row for row in rows if row["held_out"]]
    assert "in real time" in " ".join(out.split())
    for row in front:
        ends = [[float(row[f"held_out_{clock}microjoules{end}"]) for end in ("_low", "", "_high")]
                for clock in ("", "real_time_")]  # fmt: skip
        assert ends == [sorted(each) for each in ends]
        assert ends[1][1] - ends[0][1] == pytest.approx(float(row["for"]) * 104.0, rel=0.01)
    accuracy = [float(row["accuracy"]) for row in front]
    assert accuracy == sorted(accuracy)
    assert all(any(float(best["accuracy"]) >= float(row["accuracy"]) for best in front) for row in rows)
    for row in rows:
        net = snn.load(f"trained/{row['network']}")
        assert (net.resolution, net.populations["hidden"].shape) == (float(row["step"]), (int(row["hidden"]),))
        snn.compile(net, backend="loihi").run(float(row["for"]))
        kept = len(snn.compile(net).weights("in_hidden")[2]) / (288 * int(row["hidden"]))
        assert kept == 1.0 if row["prune"] == "0" else kept < 0.6
        assert row["network"].startswith("front/" if row["held_out"] else "points/")


def test_what_is_trained_is_not_trained_again(neuro, words, monkeypatch):
    words += ["--search", "hidden=4:8,prune"]
    first = neuro(*words)
    assert first[0] == 0, first[2]
    before = table("trained/front.csv")
    with monkeypatch.context() as patch:
        patch.setattr(trainer._Training, "epoch", lambda self: pytest.fail("it is there already"))
        assert neuro(*words)[:2] == first[:2]
    assert table("trained/front.csv") == before
    status, _, err = neuro(*words[:-2], "--search", "hidden=4:9")
    assert status == 2
    assert "trained" in err


KILLED = """
import os, signal, sys
from importlib.metadata import EntryPoint
from neuro.cli import commands, main
from neuro_train import trainer
commands.apps = lambda: {"train": EntryPoint("train", "neuro_train.cli:app", commands.GROUP)}
trainer.KEEP_S = 0.0
whole, epochs = trainer._Training.epoch, []
def epoch(self):
    epochs.append(None)
    if len(epochs) == 7:
        os.kill(os.getpid(), signal.SIGKILL)
    whole(self)
trainer._Training.epoch = epoch
main()
"""


@pytest.mark.slow
def test_after_a_kill_a_search_goes_on_to_the_same_front(neuro, words, tmp_path):
    words += ["--search", "hidden=2:4:8,prune"]
    assert neuro(*words, "--out", "whole.yaml")[0] == 0
    done = subprocess.run(
        [sys.executable, "-c", KILLED, "train", *map(str, words), "--out", "killed.yaml"], check=False, cwd=tmp_path
    )
    assert done.returncode == -signal.SIGKILL
    assert not (tmp_path / "killed" / "front.csv").exists()
    assert (neuro(*words, "--out", "killed.yaml")[0], table("killed/front.csv")) == (0, table("whole/front.csv"))


def test_folds_are_means_and_what_is_held_out_is_in_none(neuro, words, folder):
    status, _, err = neuro(*words, "--search", "hidden=4:8", "--folds", 2, "--budget", 2)
    assert status == 0, err
    assert {row["held_out"] for row in table("trained/front.csv")} <= {"8", ""}
    data = recordings(folder, part="Train")
    _, held_out = divided(data, 0, None, 2)
    judged = []
    for fold in range(2):
        learnt, tested = divided(data, 0, fold, 2)
        assert not {*learnt, *tested} & {*held_out}
        assert not {*learnt} & {*tested}
        judged += [*tested]
    assert sorted([*judged, *held_out]) == list(range(len(data)))


def test_what_varies_if_no_values_are_given():
    net, plan = snn.load(neuro_models.path("dense")), TrainingPlan(input="pixels", output="out", duration=310.0)
    found = space("step,for,hidden,prune", net, plan, {"hidden": 128, "resolution": 5.0})
    expected = {"step": [5.0, 10.0, 20.0], "for": [60.0, 140.0, 220.0, 300.0]}
    assert found == expected | {"hidden": [16, 32, 64, 128], "prune": [0.0, 0.25, 0.5, 0.75]}
    assert parted({"step": 5.0, "for": 50, "tau": 3.0}) == ({"resolution": 5.0, "tau": 3.0}, {"duration": 50})


def test_mistakes_in_what_varies(messages):
    net, given = snn.load(neuro_models.path("dense")), {"hidden": 8, "tau": 20.0}
    messages(refusals_of(messages.cases, globals() | locals()))


def test_without_optuna_one_error_says_how_to_get_it(neuro, dense, monkeypatch, tmp_path):
    found = importlib.util.find_spec
    monkeypatch.setattr("importlib.util.find_spec", lambda name, *a: None if name == "optuna" else found(name, *a))
    status, out, err = neuro(*dense(), "--search", "hidden")
    assert (status, out) == (2, "")
    assert all(word in err for word in ("neuro train --search needs Optuna, which is not installed", "[tune]"))
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("spent", "numbers"), [((1.8, 3.5), "2 2.4 2.8 3.2 3.6"), ((1.0, 500.0), "1 2 5 10 20 50 100 200 500")]
)
def test_joules_along_the_figure_are_numbers_as_people_write_them(spent, numbers, tmp_path):
    found = {"right": 9, "n": 10}
    places = [
        FrontPlace({"hidden": k}, 0.9, joules, tmp_path / "net.yaml", found | {"microjoules": joules})
        for k, joules in enumerate(spent)
    ]
    figure = draw(places, "loihi")
    figure.draw_without_rendering()
    axis = figure.axes[0]
    low, high = axis.get_xlim()
    labels = [tick for tick in axis.xaxis.get_major_ticks() if low <= tick.get_loc() <= high]
    assert " ".join(tick.label1.get_text() for tick in labels) == numbers
    assert not any(label.get_text() for label in axis.get_xticklabels(minor=True))
