"""DQN, DDPG and PPO as controllers: they learn from the reward, come back from files, and fly in NumPy."""

import sys
import warnings

import numpy as np
import pytest
from hypothesis import given, strategies as st

from drones import SHORT, stop_at
from neuro_drone.controllers import make
from neuro_drone.controllers.deep import Dense, observed
from neuro_drone.env import ACTIONS, DroneEnv
from neuro_drone.evaluate import grid, try_out
from neuro_drone.model import Model
from neuro_drone.scenario import load
from neuro_drone.train import train

BALL = load("B60")
REPLAYING = {"warm": 50, "batch": 8, "hidden": 16, "buffer": 1000}
SMALL = {"dqn": REPLAYING, "ddpg": REPLAYING, "ppo": {"rollout": 32, "batch": 8, "hidden": 16, "epochs": 3}}
every = pytest.mark.parametrize("name", SMALL)
needs = pytest.mark.usefixtures("package")


@pytest.fixture
def package():
    with warnings.catch_warnings():  # of what the package's own imports warn of
        warnings.simplefilter("ignore")
        return pytest.importorskip("stable_baselines3", reason="the extra 'rl' is not installed")


def seen(n=50):
    return np.random.default_rng(0).poisson(0.3, (n, 8, 8))


def frozen(model):
    return model.loop(DroneEnv(model.scenario)).pilot.controller


def actions(controller):
    return np.array([controller.act(counts, {}) for counts in seen()])


@needs
@every
@pytest.mark.parametrize("scenario", [SHORT, load("line")], ids=["ball", "line"])
def test_training_changes_the_networks_and_a_file_keeps_them(name, scenario, tmp_path, monkeypatch):
    """A trained model flies without the package, and goes on learning with it."""
    file, told = tmp_path / "model.h5", []
    model = train(scenario, name, steps=100, settings=SMALL[name], out=file, report=told.append)
    fresh = make(name, scenario, 0, SMALL[name])
    assert told[-1].step == 100
    assert any((a != fresh.learnt()[n]).any() for n, a in model.learnt.items())
    again, flown = Model.load(file), actions(frozen(model))
    assert np.array_equal(actions(frozen(again)), flown)
    assert np.abs(flown).max() <= 1.0
    if scenario is not SHORT:
        return
    starts = grid(scenario, 1)
    assert try_out(again, starts=starts).as_words() == try_out(model, starts=starts).as_words()
    before, rng = {n: a.copy() for n, a in model.learnt.items()}, np.random.default_rng(1)
    learner = model.loop(DroneEnv(scenario), learns=True).pilot.controller
    for counts in seen(80):
        learner.act(counts, {})
        learner.learn({"counts": counts, "reward": rng.random(), "lost": False})
    assert all((before[n] == a).all() for n, a in model.learnt.items())  # what was learnt is a copy
    assert any((before[n] != a).any() for n, a in learner.learnt().items())
    monkeypatch.setitem(sys.modules, "stable_baselines3", None)
    assert (actions(frozen(model)) == flown).all()


@every
def test_numpy_flies_as_the_package_does(name, package):
    learner = train_some(name, 120)
    frozen = learner.frozen()
    for counts in seen():
        chosen, _ = learner.algorithm.predict(observed(counts, "binary"), deterministic=True)
        expected = ACTIONS[int(chosen)] if name == "dqn" else chosen
        assert frozen.act(counts, {}) == pytest.approx(np.array(expected), abs=1e-5)


def train_some(name, steps, seed=0):
    learner, env = make(name, BALL, seed, SMALL[name]), DroneEnv("B60")
    _, info = env.reset(seed=seed)
    learner.begin()
    for _ in range(steps):
        _, _, lost, end, info = env.step(learner.act(info["counts"], info))
        learner.learn(info)
        if lost or end:
            _, info = env.reset()
            learner.begin()
    return learner


@needs
@every
def test_seeds_generators_and_the_reward_alone(name):
    one, same, other = (train_some(name, 80, seed).learnt() for seed in (1, 1, 2))
    assert all((one[n] == same[n]).all() for n in one)
    assert any((one[n] != other[n]).any() for n in one)
    import torch

    def drawn():
        return [*np.random.random(3), *torch.rand(3).tolist()]  # noqa: NPY002

    def seed():
        np.random.seed(5)  # noqa: NPY002
        torch.manual_seed(5)

    seed()
    expected, threads = drawn(), torch.get_num_threads()
    seed()
    train_some(name, 80)
    assert (drawn(), torch.get_num_threads()) == (expected, threads)

    def taught(reward, error):
        learner, rng = make(name, BALL, 0, SMALL[name]), np.random.default_rng(0)
        for counts in seen(120):
            learner.act(counts, {})
            info = {"counts": counts, "reward": reward * rng.random(), "lost": False}
            learner.learn(info | {"supervised_error": np.full(2, error), "error": (error, error)})
        return learner.learnt()

    one, same, other = taught(1.0, 0.1), taught(1.0, -0.9), taught(0.1, 0.1)
    assert all((one[n] == same[n]).all() for n in one)
    assert any((one[n] != other[n]).any() for n in one)


@pytest.mark.slow
@needs
@every
@pytest.mark.parametrize("kept", [{}, {"buffer": 90}])
def test_a_state_goes_on_as_if_nothing_was(name, kept, tmp_path, monkeypatch):
    settings = {**SMALL[name], **(kept if name != "ppo" else {}), "observation": "counts"}
    monkeypatch.setattr("neuro_drone.model.BLOCK", 60)
    whole = train("B60", name, steps=200, settings=settings, episode=25)
    file = tmp_path / "model.h5"
    with pytest.raises(KeyboardInterrupt):
        train("B60", name, steps=200, settings=settings, episode=25, out=file, report=stop_at(130))
    told = []
    parts = train("B60", name, steps=200, settings=settings, episode=25, out=file, report=told.append)
    assert told[0].step > 60
    assert all((whole.learnt[n] == a).all() for n, a in parts.learnt.items())


PAYS = {
    "dqn": ({"explore": 300, "rate": 0.01, "gamma": 0.0}, 800),
    "ddpg": ({"rate": 0.01, "gamma": 0.0}, 300),
    "ppo": ({"rollout": 64, "batch": 32, "epochs": 10, "rate": 0.01, "gamma": 0.0}, 1280),
}


@needs
@every
def test_it_learns_what_pays(name):
    """DQN: reward for one of the nine actions only; the others in proportion to the way to the right and up."""
    settings, steps = PAYS[name]
    learner = make(name, BALL, 0, {**SMALL[name], **settings})
    for k, counts in enumerate(seen(steps)):
        if k % 10 == 0:
            learner.begin()
        action = learner.act(counts, {})
        graded = 0.5 + 0.25 * (action[0] - action[1])
        reward = float((action == ACTIONS[6]).all()) if name == "dqn" else graded
        learner.learn({"counts": counts, "reward": reward, "lost": False})
    wanted = ACTIONS[6] if name == "dqn" else (1.0, -1.0)
    assert actions(learner.frozen()).mean(axis=0) == pytest.approx(wanted, abs=1e-9 if name == "dqn" else 0.1)


def ppo(settings=SMALL["ppo"], learner=None):
    """Episodes of 5 and 11 steps, the first of which is lost; gives what an update learnt from."""
    learner = learner or make("ppo", BALL, 0, settings)
    kept, update = [], learner.algorithm.train
    learner.algorithm.train = lambda: (kept.append(learner.buffer.returns.copy()), update())
    rng = np.random.default_rng(0)
    for k, counts in enumerate(seen(48)):
        if k % 16 in (0, 5):
            learner.begin()
        learner.act(counts, {})
        learner.learn({"counts": seen(49)[k + 1], "reward": float(rng.random()), "lost": k % 16 == 4})
    return learner, kept


@needs
def test_episodes_of_ppo_that_are_cut():
    """Against returns by their definition; with a trace of 1 they are all rewards to come, and the critic's guess."""
    settings = {**SMALL["ppo"], "rollout": 32, "batch": 32, "trace": 1.0, "gamma": 0.8}
    learner, guess = make("ppo", BALL, 0, settings), make("ppo", BALL, 0, settings).critic
    _, (found, *_) = ppo(learner=learner)
    rewards, after = np.random.default_rng(0).random(32), seen(49)[1:]
    expected, come = np.zeros(32), 0.0
    for k in reversed(range(32)):
        if k % 16 == 4:
            come = 0.0
        elif k % 16 == 15:
            come = float(guess(observed(after[k], "binary"))[0])
        expected[k] = come = rewards[k] + 0.8 * come
    assert found.ravel() == pytest.approx(expected, abs=1e-5)
    learner, _ = ppo()
    learner.act(seen()[0], {})
    learner.learn({"counts": seen()[1], "reward": 0.5, "lost": False})
    other = make("ppo", BALL, 0, SMALL["ppo"])
    other.restore(learner.state())
    for one in (learner, other):
        one.begin()
    assert learner.buffer.pos == other.buffer.pos == 17
    assert (learner.buffer.rewards == other.buffer.rewards).all()
    assert learner.buffer.rewards[16] != 0.5


@given(st.lists(st.integers(0, 2**40), min_size=64, max_size=64))
def test_what_is_seen_lies_between_0_and_1(counts):
    cells = np.array(counts).reshape(8, 8)
    binary, scaled = observed(cells, "binary"), observed(cells, "counts")
    assert binary.dtype == scaled.dtype == np.float32
    assert (binary == (cells.ravel() > 0)).all()
    assert scaled == pytest.approx(np.minimum(cells.ravel() / 15.0, 1.0))


def test_layers_are_not_copied_and_activated_but_the_last():
    arrays = {f"{k}.{what}": np.full((2, 2) if what == "weight" else 2, k, np.float32)
              for k in (10, 2, -1) for what in ("weight", "bias")}  # fmt: skip
    net = Dense(arrays, ("-1", "2", "10"))
    arrays["10.bias"][:] = -5.0
    assert net(np.zeros(2, np.float32)).tolist() == [35.0, 35.0]
    tanh = Dense(arrays, ("2", "-1"), "tanh")(np.ones(2, np.float32))
    assert tanh == pytest.approx(np.full(2, -2.0 * np.tanh(6.0) - 1.0))
