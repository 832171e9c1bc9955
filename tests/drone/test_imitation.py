"""Behavioural cloning and DAgger: who flies, what is fitted, and trainings that go on."""

import sys

import numpy as np
import pytest

from drones import stop_at
from neuro_drone.controllers import make
from neuro_drone.controllers.simple import shares
from neuro_drone.evaluate import grid, try_out
from neuro_drone.model import Model
from neuro_drone.scenario import load
from neuro_drone.train import train
from refused import refused

BALL = load("B60")
HIDDEN = {"hidden": 8, "updates": 20, "batch": 8}


def scenes(steps, seed=0):
    """Fields with events, and errors that are linear in their shares but for the oracle's bounds."""
    rng = np.random.default_rng(seed)
    way = rng.normal(0.0, 0.1, (2, 64))
    for counts in rng.poisson(0.5, (steps, 8, 8)):
        yield counts, {"supervised_error": way @ shares(counts, "shares")}


def flown(controller, steps=400):
    """Shares, the oracle's actions, and the actions that were flown."""
    oracle, inputs, wanted, actions = make("oracle", BALL), [], [], []
    controller.begin()
    for counts, info in scenes(steps):
        actions.append(controller.act(counts, info))
        wanted.append(oracle.act(counts, info))
        inputs.append(shares(counts, "shares"))
        controller.learn(info)
    return np.array(inputs), np.array(wanted), np.array(actions)


def missing(inputs, wanted, weights):
    """The largest sum of shares times what the fit misses, which is 0 of least squares."""
    return np.abs(np.einsum("ki,ka->ia", inputs, wanted - np.einsum("ki,ai->ka", inputs, weights))).max()


def test_a_clone_never_flies_and_is_the_least_squares_fit_of_what_the_oracle_did():
    clone = make("clone", BALL, 1, {"round": 100})
    inputs, wanted, actions = flown(clone)
    assert (actions == wanted).all()
    assert missing(inputs, wanted, clone.learnt()["0.weight"]) < 0.003
    assert missing(inputs, wanted, 0.9 * clone.learnt()["0.weight"]) > 0.03
    acts = [clone.frozen().act(counts, {}) for counts, _ in scenes(400)]
    assert np.array(acts) == pytest.approx(wanted, abs=0.02)


def test_dagger_flies_more_from_round_to_round_and_is_told_what_the_oracle_would_do():
    dagger = make("dagger", BALL, 1, {"round": 100, "expert": 0.5})
    inputs, wanted, actions = flown(dagger)
    by_oracle = (actions == wanted).all(axis=1).reshape(4, 100).mean(axis=1)
    assert by_oracle[0] == 1.0
    assert by_oracle[1:] == pytest.approx([0.5, 0.25, 0.125], abs=0.12)
    assert missing(inputs, wanted, dagger.learnt()["0.weight"]) < 0.003
    first, own = make("clone", BALL), np.flatnonzero((actions != wanted).any(axis=1))
    flown(first, 100)
    second, fields = own[own < 200], [counts for counts, _ in scenes(400)]
    assert actions[second].tolist() == [first.frozen().act(fields[k], {}).tolist() for k in second]
    alone = make("dagger", BALL, 1, {"round": 100, "expert": 0.0})
    _, wanted, actions = flown(alone)
    assert (actions[:100] == wanted[:100]).all()
    assert (actions[100:] != wanted[100:]).any(axis=1).all()


@pytest.mark.parametrize("scenario", ["B60", "B60-height"])
def test_imitation_flies_laps_after_few_steps(scenario):
    tried = try_out(train(scenario, "dagger", steps=1000, seed=1), starts=grid(load(scenario), 1))
    assert tried.laps == 1
    assert tried.error_px < 4.0


@pytest.mark.parametrize("hidden", [{}, HIDDEN], ids=["linear", "hidden"])
def test_a_training_goes_on_after_a_kill_to_the_same_bits(hidden, tmp_path, monkeypatch):
    if hidden:
        pytest.importorskip("torch", reason="the extra 'torch' is not installed")
    file, reports, words = tmp_path / "model.h5", [], {"steps": 300, "settings": {"round": 40, **hidden}, "episode": 20}
    monkeypatch.setattr("neuro_drone.model.BLOCK", 70)
    whole = train(BALL, "dagger", **words)
    with pytest.raises(KeyboardInterrupt):
        train(BALL, "dagger", **words, out=file, report=stop_at(190))
    parts = train(BALL, "dagger", **words, out=file, report=reports.append)
    assert reports[0].step > 70
    for name, array in whole.learnt.items():
        assert (array == parts.learnt[name]).all()
        assert (Model.load(file).learnt[name] == array).all()
    assert whole.learnt["0.weight"].any()


def test_hidden_layers_learn_and_fly_without_torch(monkeypatch):
    pytest.importorskip("torch", reason="the extra 'torch' is not installed")
    clone = make("clone", BALL, 1, {"hidden": 32, "updates": 600, "rate": 3e-3})
    _, wanted, _ = flown(clone)
    learnt, fresh = clone.learnt(), make("clone", BALL, 1, {"hidden": 32}).learnt()
    monkeypatch.setitem(sys.modules, "torch", None)

    def missed(arrays):
        again = make("clone", BALL, 1, {"hidden": 32})
        again.restore(arrays)
        acts = np.array([again.frozen().act(counts, {}) for counts, _ in scenes(400)])
        return np.mean((acts - wanted) ** 2)

    assert missed(learnt) < 0.2 * missed(fresh)
    said = refused(lambda: train(BALL, "clone", steps=10, settings={"hidden": 32}))
    assert said.startswith("controller 'clone': hidden = 32 needs torch")
