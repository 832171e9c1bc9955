"""Random search of a linear policy: it learns from the reward alone, without torch, and comes back from files."""

import subprocess
import sys

import numpy as np
import pytest

import neuro
from neuro_drone import train as training
from neuro_drone.controllers import make
from neuro_drone.evaluate import grid, try_out
from neuro_drone.model import Model
from neuro_drone.scenario import load
from neuro_drone.train import train

SMALL = {"directions": 2, "best": 1}
EAST = np.zeros((8, 8), int)
EAST[3:5, 6] = 5


def taught(reward, settings, episodes, error=0.1):
    """A search whose episodes have one step; `reward` of the action decides."""
    learner = make("random-search", load("B60"), 0, settings)
    for _ in range(episodes):
        learner.begin()
        action = learner.act(EAST, {})
        learner.learn({"counts": EAST, "reward": reward(action), "supervised_error": np.full(2, error), "lost": False})
    return learner


def test_one_update_by_hand():
    """Against the update's equation, with the directions and rewards written out."""
    settings = {"directions": 3, "best": 2, "noise": 0.5, "rate": 0.3}
    learner = make("random-search", load("B60"), 7, settings)
    directions = np.random.default_rng((7, 4)).standard_normal((3, 2, 3))
    seen = np.array(((16 * 6 + 7.5 - 63) / 64, (16 * 3.5 + 7.5 - 63) / 64, 1.0))
    returns = np.array([[0.1, 0.2], [0.9, 0.3], [0.4, 0.8]])
    for k, (way, sign) in enumerate([(d, s) for d in directions for s in (1, -1)]):
        learner.begin()
        assert learner.act(EAST, {}) == pytest.approx(np.clip(sign * 0.5 * way @ seen, -1.0, 1.0))
        learner.learn({"reward": returns.ravel()[k]})
    assert not learner.learnt()["weights"].any()
    learner.begin()
    kept = returns[[1, 2]]  # by the larger of both rewards
    step = 0.3 / (2 * kept.std()) * (0.6 * directions[1] - 0.4 * directions[2])
    assert learner.learnt()["weights"] == pytest.approx(step)


def test_it_learns_what_pays():
    best = np.array((0.6, -0.3))
    settings = {"noise": 0.1, "rate": 0.05}
    policy = taught(lambda action: -float(np.sum((action - best) ** 2)), settings, 480).frozen()
    assert policy.act(EAST, {}) == pytest.approx(best, abs=0.1)


def test_only_the_reward_is_learnt_from():
    def pays(action):
        return float(action[0])

    one, same = (taught(pays, SMALL, 40, error).learnt()["weights"] for error in (0.1, -0.9))
    other = taught(lambda action: -float(action[0]), SMALL, 40).learnt()["weights"]
    assert (one == same).all()
    assert (one != other).any()


def test_equal_rewards_change_nothing():
    assert not taught(lambda _: 1.0, SMALL, 40).learnt()["weights"].any()


def test_nothing_seen_nothing_done():
    policy = taught(lambda action: float(action[0]), SMALL, 40).frozen()
    assert policy.act(EAST, {}).any()
    assert not policy.act(np.zeros((8, 8), int), {}).any()


@pytest.mark.parametrize("scenario", ["B60", "B60-height", "line"])
def test_a_training_goes_on_after_a_kill_to_the_same_bits(scenario, tmp_path, monkeypatch):
    file, told = tmp_path / "model.h5", []
    whole = train(scenario, "random-search", steps=300, settings=SMALL, episode=20)
    monkeypatch.setattr(training, "KEEP", 70)

    def stop(progress):
        if progress.step >= 190:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        train(scenario, "random-search", steps=300, settings=SMALL, episode=20, out=file, report=stop)
    parts = train(scenario, "random-search", steps=300, settings=SMALL, episode=20, out=file, report=told.append)
    assert told[0].step > 70
    assert whole.learnt["weights"].any()
    assert (whole.learnt["weights"] == parts.learnt["weights"]).all()
    again, starts = Model.load(file), grid(whole.scenario)[:1]
    assert try_out(again, starts=starts).as_words() == try_out(whole, starts=starts).as_words()


def test_it_learns_to_follow():
    model = train("B60", "random-search", steps=12_000, seed=1)
    tried = try_out(model, starts=grid(model.scenario, 2))
    assert tried.laps == 4
    assert tried.error_px < 15.0


def test_where_the_drone_climbs_it_has_a_third_action():
    world = load("B60-height")
    learner = make("random-search", world)
    assert learner.learnt()["weights"].shape == (3, 4)
    learner.begin()
    seen = (*make("centroid", world, 0, {"gain": 1.0}).act(EAST, {}), 1.0)
    ways = np.random.default_rng((0, 4)).standard_normal((8, 3, 4))
    assert max(np.abs(seen[:3])) < 1.0  # so that the centroid's action tells what it found
    assert learner.act(EAST, {}) == pytest.approx(np.clip(ways[0] @ seen, -1.0, 1.0))
    assert learner.frozen().act(np.zeros((8, 8), int), {}).tolist() == [0.0, 0.0, 0.0]


def test_it_needs_no_torch():
    code = "from neuro_drone.train import train; import sys; train('B60', 'random-search', steps=50); "
    code += "sys.exit('torch' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_more_directions_than_there_are():
    with pytest.raises(neuro.ModelError) as told:
        make("random-search", load("B60"), 0, {"best": 9})
    assert str(told.value) == "controller 'random-search': best = 9: expected at most directions = 8"
