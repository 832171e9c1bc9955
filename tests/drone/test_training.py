"""Training, its checkpoint and its file, and tests of what was learnt."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import neuro
from neuro_drone import train as training
from neuro_drone.controllers import make
from neuro_drone.evaluate import Start, grid, try_out
from neuro_drone.model import Model
from neuro_drone.paths import FIXED, FlightCourse
from neuro_drone.scenario import load
from neuro_drone.train import TrainingJob, side_by_side, train


def beside(model: Path) -> Path:
    """Where the checkpoint of a model lies."""
    return model.with_name(f"{model.name}.training")


SHORT = load("A60", **{"task": {"ball": {"lap": 1.5, "speed": 0.15}}})  # a lap of 500 steps
KILLED = """
import os, sys
from pathlib import Path
from neuro_drone import train
train.KEEP = 200
def report(p):
    if p.step >= 600:
        os.kill(os.getpid(), 9)
train.train("B60", steps=1000, seed=4, out=Path(sys.argv[1]), report=report)
"""


@pytest.fixture(scope="module")
def model():
    return train("B60", steps=1000, seed=4)


def test_killed_and_continued_equals_uninterrupted(tmp_path, model):
    out = tmp_path / "model.h5"
    died = subprocess.run([sys.executable, "-c", KILLED, str(out)], check=False)
    assert died.returncode == -9
    assert beside(out).exists()
    assert not out.exists()
    reports = []
    continued = train("B60", steps=1000, seed=4, out=out, report=reports.append)
    assert reports[0].step > 400  # not from the beginning
    assert (continued.learnt["cells_motors"] == model.learnt["cells_motors"]).all()
    assert all((continued.history[name] == model.history[name]).all() for name in model.history)
    assert not beside(out).exists()
    assert train("B60", steps=1000, seed=4, out=out, report=reports.append).steps == 1000  # done: not again
    assert reports[-1].step == 1000


def test_checkpoint_of_another_training(tmp_path, monkeypatch):
    monkeypatch.setattr(training, "KEEP", 50)
    out = tmp_path / "model.h5"

    def stop(progress):
        if progress.step >= 200:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train("B60", "lms", steps=400, out=out, report=stop)
    with pytest.raises(neuro.ModelError) as error:
        train("B60", "lms", steps=400, seed=1, out=out)
    assert str(error.value) == (
        f"{beside(out)}: an unfinished training with seed = 0: found 1 now\n"
        "  hint: give the same options to continue it, or delete the file"
    )


def test_progress(model):
    reports = []
    train("B60", "lms", steps=150, episode=60, report=reports.append)
    assert [(p.episode, p.step, p.steps) for p in reports] == [(0, 60, 150), (1, 120, 150), (2, 150, 150)]
    assert all(0 < p.error_px < 91 for p in reports)
    assert model.history["steps"].sum() == 1000


def test_seeds_differ_and_side_by_side_changes_nothing(model):
    jobs = [TrainingJob("B60", "snn", steps=300, seed=seed) for seed in (4, 5)]
    one, two = (job.run() for job in jobs)
    assert (one.learnt["cells_motors"] != two.learnt["cells_motors"]).any()
    reports = []
    both = side_by_side(jobs, processes=2, report=reports.append)
    assert (both[0].learnt["cells_motors"] == one.learnt["cells_motors"]).all()
    assert (both[1].learnt["cells_motors"] == two.learnt["cells_motors"]).all()
    assert {p.seed for p in reports} == {4, 5}


def test_file(tmp_path, model):
    model.save(tmp_path / "model.h5")
    back = Model.load(tmp_path / "model.h5")
    assert back.told() == model.told()
    assert back.steps == 1000
    assert (back.learnt["cells_motors"] == model.learnt["cells_motors"]).all()
    assert back.learner().network() == model.learner().network()


def test_file_holds_the_network_of_a_user(tmp_path):
    net = neuro.Network("own", resolution=1.0)
    cells = net.population("cells", 64, neuro.poisson_generator())
    motors = net.population("motors", 4, neuro.iaf_psc_exp())
    net.signal("mine", to=motors)
    net.connect(
        cells, motors, neuro.all_to_all(), neuro.stdp_dopa(Wmax=3000.0, signal="mine"), weight=1400.0, delay=1.0
    )
    net.save(tmp_path / "own.yaml")
    own = train("B60", steps=200, settings={"network": str(tmp_path / "own.yaml")}, out=tmp_path / "model.h5")
    (tmp_path / "own.yaml").unlink()
    back = Model.load(tmp_path / "model.h5").frozen()
    assert (back.learnt()["cells_motors"] == own.learnt["cells_motors"]).all()
    assert (own.learnt["cells_motors"] != 1400.0).any()


@pytest.mark.parametrize(
    ("write", "message"),
    [
        (lambda f: None, "{}: no such file: expected a neuro drone model 1"),
        (lambda f: f.write_text("no"), "{}: not a neuro drone model 1"),
    ],
)
def test_files_that_are_none(tmp_path, write, message):
    file = tmp_path / "model.h5"
    write(file)
    with pytest.raises(neuro.ModelError) as error:
        Model.load(file)
    assert str(error.value) == message.format(file)


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ({"steps": 0}, "steps = 0: expected a whole number >= 1"),
        ({"episode": True}, "episode = True: expected a whole number >= 1"),
        ({"seed": -1}, "seed = -1: expected a whole number >= 0 and < 2^63"),
        ({"seed": 2**63}, f"seed = {2**63}: expected a whole number >= 0 and < 2^63"),
        ({"seed": 1.5}, "seed = 1.5: expected a whole number >= 0 and < 2^63"),
    ],
)
def test_mistakes(words, message):
    with pytest.raises(neuro.ModelError) as error:
        train("B60", **words)
    assert str(error.value) == message


def test_out_that_cannot_be_written(tmp_path):
    with pytest.raises(neuro.ModelError) as error:
        train("B60", steps=100, out=tmp_path)
    assert str(error.value) == f"{tmp_path}: is a folder, expected the name of a file"


def test_oracle_flies_all_laps_and_nothing_none():
    tried = try_out(train(SHORT, "oracle"), starts=grid(SHORT, 2, 10.0))
    assert (tried.laps, tried.starts) == (4, 4)
    assert tried.error_px < 8
    assert try_out(train(SHORT, "nothing"), starts=grid(SHORT, 2, 10.0)).laps == 0


def test_a_trial_does_not_depend_on_the_others(model):
    short = replace(model, scenario=SHORT)
    starts = [Start((20.0, -10.0)), Start((0.0, 5.0))]
    both, again = try_out(short, starts=starts), try_out(short, starts=starts[:1])
    assert (both.each[0].track == again.each[0].track).all()


def test_figures(model):
    tried = try_out(train(SHORT, "nothing"), starts=[Start((10.0, 0.0))])
    one = tried.each[0]
    assert tried.error_px == pytest.approx(np.hypot(*one.track.T).mean())
    assert one.signed == pytest.approx(tuple(one.track.mean(0)))
    assert one.absolute == pytest.approx(tuple(np.abs(one.track).mean(0)))
    words = json.loads(json.dumps(tried.as_words()))
    assert words["starts"] == 1
    assert words["each"][0]["start"] == [10.0, 0.0]


def test_learning_on_is_another_figure(model):
    short, starts = replace(model, scenario=SHORT), [Start((20.0, 20.0))]
    on, off = try_out(short, starts=starts, learning=True), try_out(short, starts=starts)
    assert on.learning
    assert not off.learning
    assert on.error_px != off.error_px


def test_grid():
    starts = grid(SHORT)
    assert len(starts) == 25
    assert {start.error for start in starts} >= {(-35.0, -35.0), (0.0, 0.0), (35.0, 17.5)}
    assert {start.direction for start in grid(load("line"))} == {1, -1}
    assert grid(SHORT, 1, course=FlightCourse("fixed")) == (Start((0.0, 0.0)),)
    assert {start.path for start in grid(SHORT, course=FlightCourse("fixed"))} == {FIXED}
    assert len({start.path for start in starts} - {FIXED}) == 25
    assert starts == grid(SHORT)
    assert not {start.path for start in starts} & {start.path for start in grid(SHORT, course=FlightCourse(seed=1))}
    assert [start.error for start in starts] == [start.error for start in grid(SHORT, course=FlightCourse("fixed"))]
    with pytest.raises(neuro.ModelError) as error:
        FlightCourse("variable")
    assert str(error.value) == "unknown path 'variable'\n  hint: did you mean 'varied'?"
    for seed in (-1, 2**63, True, 1.0):
        with pytest.raises(neuro.ModelError) as error:
            FlightCourse(seed=seed)
        assert str(error.value) == f"seed of the paths = {seed!r}: expected a whole number >= 0 and < 2^63"
    with pytest.raises(neuro.ModelError) as error:
        FlightCourse("fixed", 3)
    assert str(error.value) == "seed of the paths = 3: the fixed path has none: expected path varied"
    with pytest.raises(neuro.ModelError) as error:
        grid(SHORT, 0)
    assert str(error.value) == "grid = 0: expected a whole number >= 1"
    with pytest.raises(neuro.ModelError) as error:
        grid(SHORT, 5, -1.0)
    assert str(error.value) == "spread = -1.0: expected numbers >= 0"


def test_the_curve_touches_no_training(model, monkeypatch):
    """With a test every 300 steps all that is learnt is the same."""
    monkeypatch.setattr(training, "EVERY", 300)
    tested = train("B60", steps=1000, seed=4)
    assert model.curve["steps"].tolist() == [1000]
    assert tested.curve["steps"].tolist() == [300, 600, 900]
    assert (tested.learnt["cells_motors"] == model.learnt["cells_motors"]).all()
    assert all((tested.history[name] == model.history[name]).all() for name in model.history)


def test_the_curve_is_of_frozen_weights_and_survives_a_kill(tmp_path, monkeypatch):
    monkeypatch.setattr(training, "EVERY", 300)
    monkeypatch.setattr(training, "KEEP", 200)
    whole, out = train("B60", "lms", steps=1500), tmp_path / "model.h5"

    def stop(progress):
        if progress.step >= 700:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train("B60", "lms", steps=1500, out=out, report=stop)
    parts = train("B60", "lms", steps=1500, out=out)
    assert all((whole.curve[name] == parts.curve[name]).all() for name in whole.curve)
    assert all((whole.curve[name] == a).all() for name, a in Model.load(out).curve.items())
    assert len(whole.curve["steps"]) == 5
    last = training.Curve(whole.scenario)
    last.follow(whole.learner(), 1500)
    assert last.arrays()["error_px"] == whole.curve["error_px"][-1:]
    untaught = training.Curve(whole.scenario)
    untaught.follow(make("lms", whole.scenario), 1000)
    assert whole.curve["error_px"][-1] < 35.0 < 50.0 < untaught.arrays()["error_px"][0]
