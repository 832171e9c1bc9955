"""Training, its checkpoint, its curve and its file, and tests of what was learnt, also on chips."""

import json
import os
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import neuro
import neuro_models
from drones import SHORT, stop_at
from neuro_drone import train as training
from neuro_drone.controllers import make
from neuro_drone.energy import compute_bills, show, words
from neuro_drone.env import DroneEnv
from neuro_drone.evaluate import Start, grid, try_out
from neuro_drone.model import Model
from neuro_drone.paths import FIXED, FlightCourse
from neuro_drone.scenario import load
from neuro_drone.train import TrainingJob, side_by_side, train
from refused import refused

CHIP = pytest.mark.filterwarnings("ignore::neuro.ApproximationWarning", "ignore::neuro.OverflowWarning")


def beside(model: Path) -> Path:
    """Where the checkpoint of a model lies."""
    return model.with_name(f"{model.name}.training")


def same(one, other):
    """Whether the same was learnt on the same way."""
    pairs = [(getattr(one, part), getattr(other, part)) for part in ("learnt", "history")]
    return all(a.keys() == b.keys() and all((a[name] == b[name]).all() for name in a) for a, b in pairs)


def networks(model):
    """That which goes on learning, and the frozen one."""
    return [model.loop(DroneEnv(model.scenario), learns=learns).network() for learns in (True, False)]


def test_interrupted_and_continued_equals_uninterrupted(tmp_path):
    """`tests/test_kills.py` kills it without a word."""
    out, reports = tmp_path / "model.h5", []
    words = {"steps": 1000, "seed": 4, "settings": {"block": 250}}
    whole = train("B60", **words)
    with pytest.raises(KeyboardInterrupt):
        train("B60", **words, out=out, report=stop_at(600))
    assert beside(out).exists()
    assert not out.exists()
    continued = train("B60", **words, out=out, report=reports.append)
    assert reports[0].step > 500  # not from the beginning
    assert same(continued, whole)
    assert not beside(out).exists()
    told = len(reports)
    assert train("B60", **words, out=out, report=reports.append).steps == 1000  # done: not again
    assert (reports[-1].step, len(reports)) == (1000, told)


def test_the_network_learns_as_by_neuro_run(snn):
    """Whoever runs the description gets the same bits, in whatever blocks."""
    file = neuro_models.path("drone")
    for model, block in ((snn, 10_000), (train("B60", steps=1000, seed=4, settings={"block": 300}), 300)):
        loop = neuro.closed_loop(neuro.load(file, params={"block": block}), seed=4)
        log = loop.run(steps=1000)
        assert (loop.pilot.weights["cells_motors"] == model.learnt["cells_motors"]).all()
        assert (model.history["returns"] == log.returns).all()


def test_a_network_keeps_its_world(tmp_path):
    """One that has none gets the usual one, of which no more is said in two places than step and episode."""
    own = neuro.load(neuro_models.path("drone"), params={"gain": 1.0})
    own.save(tmp_path / "own.yaml")
    settings = {"network": str(tmp_path / "own.yaml")}
    kept, told = make("snn", SHORT, 0, settings).world, own.world_section
    assert (kept.act.gain, kept.step, told.step, kept.episode) == (1.0, SHORT.step, 50.0, 100)
    assert refused(lambda: make("snn", SHORT, 0, settings | {"gain": 3.0})).startswith(
        f"{tmp_path}/own.yaml: unknown parameter 'gain'"
    )
    own.world_section = None
    usual = make("snn", load("line"), 0, {"network": own, "eta": 0.2}).world
    assert (usual.act.gain.tolist(), usual.observe["cells"].of, usual.reward["dopamine"].scale) == ([8, 4], "rows", 0.2)
    assert make("snn-eta0", load("line")).world.reward["dopamine"].scale == 0.0


def test_a_checkpoint_is_of_one_training_and_progress_is_told(tmp_path, monkeypatch):
    monkeypatch.setattr("neuro_drone.model.BLOCK", 50)
    out = tmp_path / "model.h5"
    with pytest.raises(KeyboardInterrupt):
        train("B60", "lms", steps=400, out=out, report=stop_at(200))
    assert refused(lambda: train("B60", "lms", steps=400, seed=1, out=out)) == (
        f"{beside(out)}: an unfinished training with seed = 0: found 1 now\n"
        "  hint: give the same options to continue it, or delete the file"
    )
    monkeypatch.undo()
    reports = []
    train("B60", "lms", steps=150, episode=60, report=reports.append)
    assert [(p.episodes, p.step, p.steps) for p in reports] == [(1, 60, 150), (2, 120, 150), (2, 150, 150)]
    assert all(0 < p.reward < 1 for p in reports)


def test_seeds_differ_and_side_by_side_changes_nothing(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda pid: {0, 1})
    jobs = [TrainingJob("B60", "lms", steps=200, seed=seed) for seed in (4, 5)]
    one, two = (job.run() for job in jobs)
    assert not same(one, two)
    reports = []
    both = side_by_side(jobs, processes=2, report=reports.append)
    assert same(both[0], one)
    assert same(both[1], two)
    assert {p.seed for p in reports} == {4, 5}


def test_a_file_that_comes_back(tmp_path, snn):
    snn.save(tmp_path / "model.h5")
    back = Model.load(tmp_path / "model.h5")
    assert (back.training_arguments(), back.steps) == (snn.training_arguments(), 1000)
    assert same(back, snn)
    assert networks(back) == networks(snn)
    net = neuro.Network("own", resolution=1.0)
    cells = net.population("cells", 64, neuro.poisson_generator())
    motors = net.population("motors", 4, neuro.iaf_psc_exp())
    net.signal("mine", to=motors)
    rule = neuro.stdp_dopa(Wmax=3000.0, signal="mine")
    net.connect(cells, motors, neuro.all_to_all(), rule, weight=1400.0, delay=1.0)
    net.save(tmp_path / "own.yaml")
    own = train("B60", steps=200, settings={"network": str(tmp_path / "own.yaml")}, out=tmp_path / "model.h5")
    (tmp_path / "own.yaml").unlink()
    assert networks(own) == networks(Model.load(tmp_path / "model.h5"))
    assert (own.learnt["cells_motors"] != 1400.0).any()


def test_tests_of_what_was_learnt(snn):
    tried, none = (try_out(train(SHORT, name), starts=grid(SHORT, 2, 10.0)) for name in ("oracle", "nothing"))
    assert (tried.laps, tried.starts, none.laps) == (4, 4, 0)
    assert tried.error_px < 8
    one = none.each[0]
    assert one.error_px == pytest.approx(np.hypot(*one.track.T).mean())
    assert one.signed == pytest.approx(tuple(one.track.mean(0)))
    assert one.absolute == pytest.approx(tuple(np.abs(one.track).mean(0)))
    words = json.loads(json.dumps(none.as_words()))
    assert (words["starts"], words["each"][0]["start"]) == (4, [-10.0, -10.0])
    short, starts = replace(snn, scenario=SHORT), [Start((20.0, -10.0)), Start((0.0, 5.0))]
    both, again = (try_out(short, starts=some) for some in (starts, starts[:1]))
    on = try_out(short, starts=starts[:1], learning=True)
    assert (both.each[0].track == again.each[0].track).all()
    assert (on.learning, both.learning) == (True, False)
    assert on.error_px != again.error_px
    starts = grid(SHORT)
    assert len(starts) == 25
    assert {start.error for start in starts} >= {(-35.0, -35.0), (0.0, 0.0), (35.0, 17.5)}
    assert {start.direction for start in grid(load("line"))} == {1, -1}
    assert grid(SHORT, 1, course=FlightCourse("fixed")) == (Start((0.0, 0.0)),)
    assert {start.path for start in grid(SHORT, course=FlightCourse("fixed"))} == {FIXED}
    assert (len({start.path for start in starts} - {FIXED}), starts) == (25, grid(SHORT))
    assert not {start.path for start in starts} & {start.path for start in grid(SHORT, course=FlightCourse(seed=1))}
    assert [start.error for start in starts] == [start.error for start in grid(SHORT, course=FlightCourse("fixed"))]


def test_the_curve_touches_no_training_and_survives_a_kill(snn, monkeypatch, tmp_path):
    """With a test every 300 steps all that is learnt is the same."""
    monkeypatch.setattr(training, "TEST_EVERY", 300)
    tested = train("B60", steps=1000, seed=4)
    assert (snn.curve["steps"].tolist(), tested.curve["steps"].tolist()) == ([], [300, 600, 900])
    assert same(tested, snn)
    monkeypatch.setattr("neuro_drone.model.BLOCK", 200)
    whole, out = train("B60", "lms", steps=1500), tmp_path / "model.h5"
    with pytest.raises(KeyboardInterrupt):
        train("B60", "lms", steps=1500, out=out, report=stop_at(700))
    parts = train("B60", "lms", steps=1500, out=out)
    for found in (parts, Model.load(out)):
        assert all((whole.curve[name] == a).all() for name, a in found.curve.items())
    assert len(whole.curve["steps"]) == 5
    untaught = train("B60", "snn-eta0", steps=1000).curve["error_px"]
    assert whole.curve["error_px"][-1] < 35.0 < 45.0 < untaught[0]


@CHIP
def test_a_trained_network_flies_on_chips_as_well():
    world = load("B60", **{"task.ball.lap": 1.5})  # a lap of 400 steps
    model, starts = train(load("B60"), "snn", steps=2000, seed=1), grid(world, 2)[::3]
    event, *chips = (
        try_out(model, scenario=world, starts=starts, backend=name) for name in ("event", "loihi", "spinnaker")
    )
    for chip in chips:
        assert event.laps == chip.laps == 2
        assert chip.error_px == pytest.approx(event.error_px, rel=0.15)


@CHIP
@pytest.mark.slow
def test_training_on_loihi_goes_on_after_a_kill_and_learns(tmp_path):
    world, out = load("B60", **{"task": {"ball": {"lap": 3.0}}}), tmp_path / "model.h5"  # a lap of 800 steps
    words = {"steps": 1000, "seed": 2, "settings": {"block": 200}}
    whole = train(world, "snn-loihi", **words)
    with pytest.raises(KeyboardInterrupt):
        train(world, "snn-loihi", **words, out=out, report=stop_at(700))
    assert same(train(world, "snn-loihi", **words, out=out), whole)
    step = 3000 / 255  # pA of a weight on the chip
    assert np.unique(np.round(whole.learnt["cells_motors"] / step, 6) % 1).tolist() == [0]
    starts = grid(world, 1)
    assert try_out(whole, starts=starts, backend="loihi").laps == 1
    with warnings.catch_warnings(action="error"):
        whole.loop(DroneEnv(world))  # what the chip approximates in learning is not said again
    assert try_out(train(world, "snn-eta0", steps=1), starts=starts).laps == 0


LAP = load("A60", **{"task": {"ball": {"lap": 0.75, "speed": 0.15}}})  # a lap of 250 steps

MACS = 64 * 64 + 64 * 64 + 64 * 9


@pytest.fixture(scope="module")
def bills():
    return compute_bills(train(LAP, "static"), ("loihi", "spinnaker", "cpu"))


def test_bills(bills, capsys):
    told = json.loads(words(bills))
    each = told["per_step"]
    assert (told["steps"], each["network_steps"], told["step_us"]) == (250, 20, 20_000)
    assert each["synaptic_ops"] == pytest.approx(4 * each["input_spikes"])
    _, spinnaker, cpu = bills.spiking
    dynamic = each["synaptic_ops"] * 13.3e-9 + each["neuron_updates"] * 26e-9
    # The host's shares of 64 cells: a sum, a division, a product and a limit each. The motors pull by themselves.
    host = 64 * 4 * 8.6e-9
    assert all(bill.by_cost()["host"] == pytest.approx(host) for bill in bills.spiking)
    assert spinnaker.dynamic_j == pytest.approx(dynamic + host + spinnaker.by_cost()["packet"])
    assert cpu.total_j == pytest.approx(20 * 256 * 8.6e-9 + host)
    assert all(bill.of == "control step" for bill in bills.spiking)
    assert [(d.target, d.items[0].count, d.total_j) for d in bills.dense] == [
        ("cpu", MACS, pytest.approx(MACS * 8.6e-9)),
        ("gpu", MACS, pytest.approx(MACS * 0.3e-9)),
    ]
    loihi, spinnaker, cpu = json.loads(words(bills))["bills"]
    assert (loihi["in_time"], spinnaker["in_time"], cpu["in_time"]) == (True, True, None)
    assert spinnaker["time_us"] == pytest.approx(20_000)  # 1 ms of network in 1 ms
    assert loihi["share_of_step"] == pytest.approx(loihi["time_us"] / 20_000)
    fine = compute_bills(train(LAP, "static", settings={"resolution": 0.5}), ("spinnaker",))
    assert json.loads(words(fine))["bills"][0]["in_time"] is False
    show(bills)
    assert "Davies" not in capsys.readouterr().out
    show(bills, sources=True)
    out = capsys.readouterr().out
    assert all(word in out for word in ("energy per control step of 20 ms; static in", "dqn: 64-64-64-9"))
    assert all(word in out for word in ("Davies et al., IEEE Micro 38(1):82, 2018", "not in the bill: the camera"))
    assert bills.spiking[0].real_time.static_j == pytest.approx(20e-3 * 0.104)
    (row,) = [line for line in out.splitlines() if line.split()[:1] == ["loihi"]]
    assert " 2.082 mJ (582 uJ to 3.43 " in row
    assert row.split()[-1] == "yes"
    shapes = {0: (16, 64), 2: (16, 16), 4: (9, 16)}
    learnt = {f"q_net.q_net.{k}.weight": np.zeros(shape, np.float32) for k, shape in shapes.items()}
    learnt |= {f"q_net.q_net.{k}.bias": np.zeros(shape[0], np.float32) for k, shape in shapes.items()}
    model = Model("dqn", LAP, 0, 1, 100, {"hidden": 16}, learnt=learnt)
    bills = compute_bills(model, ("loihi", "gpu"))
    assert [(d.target, d.items[0].of, d.items[0].count) for d in bills.dense] == [
        ("gpu", "dqn: 64-16-16-9", 64 * 16 + 16 * 16 + 16 * 9)
    ]
    assert bills.spiking == ()
