"""The controllers without deep learning: what each does with counts and errors, what it learns, on which backend."""

import warnings
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from hypothesis.extra.numpy import arrays

import neuro
from drones import stop_at
from neuro_drone.controllers import CONTROLLERS, Learner, make
from neuro_drone.controllers.simple import DOWN, RIGHT, pattern, shares
from neuro_drone.evaluate import Start, grid, try_out
from neuro_drone.model import Model
from neuro_drone.report import weight_maps
from neuro_drone.scenario import load
from neuro_drone.train import train, untrained
from refused import refused

BALL, LINE, HEIGHT = load("B60"), load("line"), load("B60-height")
COUNTS = arrays(np.int64, (8, 8), elements=st.integers(0, 40))
FEW = settings(max_examples=30)


def seen(row, column, n=10):
    counts = np.zeros((8, 8), np.int64)
    counts[row, column] = n
    return counts


def told(*errors):
    return {"supervised_error": np.array(errors)}


@pytest.mark.parametrize("name", ["nothing", "oracle", "centroid", "lms"])
@pytest.mark.parametrize("scenario", [BALL, LINE], ids=["ball", "line"])
def test_all_act_within_bounds(name, scenario):
    controller = make(name, scenario, 1)
    controller.begin()
    rng = np.random.default_rng(0)
    for _ in range(5):
        action = controller.act(rng.integers(0, 30, (8, 8)), told(0.9, -0.9))
        assert action.shape == (2,)
        assert np.abs(action).max() <= 1.0
        controller.learn(told(0.9, -0.9))


def test_hand_made_controllers():
    oracle = make("oracle", BALL, 0, {"gain": [2.0, 4.0]})
    assert oracle.act(seen(0, 0), told(0.1, -0.1)).tolist() == pytest.approx([0.2, -0.4])
    assert oracle.act(seen(0, 0), told(0.9, -0.9)).tolist() == [1.0, -1.0]
    error = told(0.1, 0.1)
    assert make("oracle", BALL).act(seen(0, 0), error).tolist() == pytest.approx([0.8, 0.8])
    assert make("oracle", LINE).act(seen(0, 0), error).tolist() == pytest.approx([0.8, 0.4])
    assert make("oracle", LINE, 0, {"gain": 1.0}).act(seen(0, 0), error).tolist() == pytest.approx([0.1, 0.1])
    lms, upright = make("lms", LINE), np.ones((8, 8), np.int64)
    upright[:, 3] += np.arange(8) * 5  # more events in near rows
    lms.act(upright, {})
    assert lms._shares.reshape(8, 8).sum(1) == pytest.approx(np.full(8, 0.125))
    action = make("centroid", BALL, 0, {"gain": 1.0}).act(seen(0, 5), {})
    assert action.tolist() == pytest.approx([(5 * 16 + 7.5 - 63) / 64, (7.5 - 63) / 64])
    upright, leaning = np.zeros((8, 8), np.int64), np.zeros((8, 8), np.int64)
    upright[:, 6] = 5
    np.fill_diagonal(leaning[:, ::-1], 5)  # from bottom left to top right: leans 45 degrees to the right
    centroid = make("centroid", LINE, 0, {"gain": 1.0})
    assert centroid.act(upright, {}).tolist() == pytest.approx([(6 * 16 + 7.5 - 63) / 64, 0.0])
    assert centroid.act(leaning, {}).tolist() == pytest.approx([1 / 64, 0.5])
    none, error = np.zeros((8, 8), int), told(0.1, -0.1, 0.2)
    assert make("nothing", HEIGHT).act(none, {}).tolist() == [0.0, 0.0, 0.0]
    assert make("oracle", HEIGHT).act(none, error) == pytest.approx((0.4, -0.4, 0.8))
    centroid = make("centroid", HEIGHT, 0, {"gain": 1.0})
    assert centroid.act(none, {}).tolist() == [0.0, 0.0, 0.0]
    inner, outer = np.zeros((8, 8), int), np.zeros((8, 8), int)
    inner[3:5, 3:5] = 1
    outer[2, 3:5] = outer[5, 3:5] = outer[3:5, 2] = outer[3:5, 5] = 1
    assert centroid.act(inner, {})[2] < -0.3
    assert centroid.act(outer, {})[2] > 0.1
    learning = {
        "lms",
        "random-search",
        "clone",
        "dagger",
        "snn",
        "snn-static-init",
        "snn-eta0",
        "snn-flipped",
        "snn-loihi",
        "dqn",
        "ddpg",
        "ppo",
    }
    assert {name for name in CONTROLLERS if CONTROLLERS[name].learns} == learning
    assert all(isinstance(make(name, BALL), Learner) for name in ("lms", "random-search", "clone", "dagger"))
    assert not isinstance(make("oracle", BALL), Learner)


@given(COUNTS)
@FEW
def test_centroid_turns_with_the_picture(counts):
    centroid = make("centroid", BALL, 0, {"gain": 0.5})
    right, down = centroid.act(counts, {})
    assert centroid.act(counts.T, {}).tolist() == pytest.approx([down, right])
    assert centroid.act(0 * counts, {}).tolist() == [0.0, 0.0]


@pytest.mark.parametrize("shape", ["sign", "linear"])
def test_patterns_speak_for_their_sides(shape):
    ball, line = pattern(BALL, shape), pattern(LINE, shape)
    assert np.abs(ball).max() == np.abs(line).max() == 1.0
    assert (np.sign(ball) == np.sign(np.stack((RIGHT.ravel(), DOWN.ravel()), 1))).all()
    assert line.reshape(8, 8, 2)[0, 7, 1] > 0 > line.reshape(8, 8, 2)[0, 0, 1]  # above and right: leans to the right
    third = pattern(HEIGHT, shape)[:, 2].reshape(8, 8)
    assert third.max() == third[7, 7] == 1.0 > 0.0 > third[3, 3]


@given(COUNTS)
@FEW
def test_shares_say_how_events_are_spread(counts):
    of_all, of_rows = shares(counts, "shares"), shares(counts, "rows").reshape(8, 8)
    assert of_all.sum() == pytest.approx(float(counts.any()))
    assert of_rows.sum(1) == pytest.approx(counts.any(axis=1) / 8)
    assert of_all * counts.sum() == pytest.approx(counts.ravel())
    of_peaks = shares(counts, "peaks")
    assert of_peaks.sum() == pytest.approx(float((counts > 2 * counts.mean()).any()))
    assert ((of_peaks > 0) == (counts > 2 * counts.mean()).ravel()).all()
    assert shares(counts * np.arange(1, 9)[:, None], "rows").reshape(8, 8) == pytest.approx(of_rows)


def test_lms_learns_where_fields_are_and_goes_on_from_its_state():
    lms, rng = make("lms", BALL, 0, {"mu": 0.2, "gain": 1.0}), np.random.default_rng(1)
    for _ in range(3000):
        row, column = rng.integers(0, 8, 2)
        lms.act(seen(row, column), {})
        lms.learn(told(RIGHT[row, column], DOWN[row, column]))
    frozen, other = lms.frozen(), make("lms", BALL, 7, {"mu": 0.2, "gain": 1.0})
    assert frozen.act(seen(1, 6), {}).tolist() == pytest.approx([RIGHT[1, 6], DOWN[1, 6]], abs=0.01)
    before = frozen.learnt()["weights"]
    frozen.learn(told(1.0, 1.0))
    assert (frozen.learnt()["weights"] == before).all()
    other.restore(lms.state())
    assert (lms.act(seen(4, 3), {}) == other.act(seen(4, 3), {})).all()


# the network: eq. 129, dopamine, frozen networks, networks of users, chips

RNG = np.random.default_rng(5)
SCENE = [RNG.poisson(0.3, (8, 8)) * RNG.integers(1, 8, (8, 8)) for _ in range(40)]
CHIP = pytest.mark.filterwarnings("ignore::neuro.ApproximationWarning", "ignore::neuro.OverflowWarning")


class Scenes(gymnasium.Env):
    """Counts one after the other, whatever is done, with the same error all the time."""

    scenario, action_space = BALL, gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)
    observation_space = gymnasium.spaces.Box(0, 2**20, (8, 8), np.int64)

    def __init__(self, scene=SCENE, error=(0.4, -0.2)):
        self.scene, self.error = scene, np.array(error)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.k = 0
        return self.scene[0], {"supervised_error": self.error}

    def step(self, action):
        self.k += 1
        return self.scene[self.k % len(self.scene)], 0.0, False, False, {"supervised_error": self.error}


def controller(name="snn", **settings):
    return untrained(BALL, name, 3, None, settings)


def taught(name="snn", steps=60, **settings):
    loop = controller(name, **settings).loop(Scenes(), learns=True)
    loop.run(steps=steps)
    return loop


def learnt(loop):
    return replace(controller(), learnt=loop.pilot.arrays()["learnt"])


def acted(model, steps=1, scene=SCENE, **words):
    """The actions of frozen weights."""
    loop = model.loop(Scenes(scene), record=True, **words)
    loop.run(steps=steps)
    return np.concatenate(loop.actions)


def weights(loop):
    return loop.sim.get("cells_motors", "weight").reshape(64, 2, 2)


def moved_apart(w, way=1.0):
    """Whether each pair's weights went to both sides of the first, 1500 pA."""
    side = way * (w.mean(axis=0) - 1500.0)
    return side[0, 0] > 0 > side[0, 1] and side[1, 1] > 0 > side[1, 0]


def test_what_the_network_does():
    (action,) = acted(controller(gain=1.0))
    assert (action * 25 == np.round(action * 25)).all()  # 50 ms over 2 ms of rest
    assert moved_apart(weights(taught()))
    assert (weights(taught("snn-eta0")) == 1500).all()
    assert moved_apart(weights(taught("snn-flipped")), -1.0)
    assert (acted(controller("static"), scene=[seen(6, 7)]) > 0.2).all()
    linear = weights(controller("static-linear").loop(Scenes()))
    assert linear[:, 0, 0] - linear[:, 0, 1] == pytest.approx(3000 * RIGHT.ravel() / np.abs(RIGHT).max())
    assert linear[:, 1, 0] - linear[:, 1, 1] == pytest.approx(3000 * DOWN.ravel() / np.abs(DOWN).max())
    loop = taught()
    frozen = learnt(loop).loop(Scenes(), record=True)
    laps = []
    for _ in range(2):
        frozen.test(1, most=40)
        laps.append(frozen.sim.spikes("motors")[0])
    assert len(laps[0]) > 0
    assert (laps[0] == laps[1]).all()
    assert (weights(frozen) == weights(loop)).all()
    assert frozen.network().signals == {}


@CHIP
def test_it_learns_on_loihi_and_controls_fail_there_as_well():
    assert moved_apart(weights(taught("snn-loihi")))
    assert len(np.unique(weights(taught("snn-eta0", backend="loihi")))) == 1
    flipped = weights(taught("snn-flipped", backend="loihi", eta=-0.1))
    assert flipped[:, 0, 0].mean() < 1500 < flipped[:, 0, 1].mean()


@CHIP
@pytest.mark.parametrize("backend", ["loihi", "spinnaker", "reference"])
def test_frozen_runs_on_every_backend(backend):
    model = learnt(taught(start="linear"))
    here, there = (acted(model, 20, backend=one).mean(axis=0) for one in ("event", backend))
    assert there == pytest.approx(here, abs=0.05)


def test_a_network_of_a_user_and_parameters_of_ours(tmp_path):
    net = neuro.Network("own", resolution=0.5)
    cells = net.population("cells", 64, neuro.poisson_generator())
    motors = net.population("motors", 4, neuro.iaf_psc_exp(t_ref=5.0))
    net.connect(cells, motors, weight=900.0, delay=1.0, rule=neuro.all_to_all())
    net.save(tmp_path / "own.yaml")
    loop = controller(network=str(tmp_path / "own.yaml"), gain=1.0).loop(Scenes(), learns=True, record=True)
    loop.run(steps=3)  # it has no signal: nothing is taught
    assert (loop.actions[0] * 10 == np.round(loop.actions[0] * 10)).all()
    loop = controller(resolution=0.1, w_init=100.0).loop(Scenes(), learns=True)
    assert loop.sim.program.resolution == 0.1
    assert (weights(loop) == 100.0).all()


def test_what_would_not_learn_on_a_chip_is_told():
    def joined(**settings):
        return controller(**settings).loop(Scenes(), learns=True)

    said = refused(lambda: joined(backend="loihi", eta=0.003)).splitlines()
    assert said[0] == "backend 'loihi' cannot run this network (1 problem)"
    assert said[1].endswith("a change of 0.00408 mantissas cannot be represented: the smallest is 0.00781")
    with warnings.catch_warnings(record=True) as heard:
        warnings.simplefilter("always")
        joined(backend="loihi", eta=0.02)
    assert "a change is 0.027 of a weight step: below 0.125 much is truncated" in str(heard[-1].message)
    said = refused(lambda: joined(backend="spinnaker")).splitlines()
    assert said[1].endswith("the words of the eligibility have no sign")


def test_the_network_learns_the_third_axis():
    world = load(HEIGHT, **{"task.ball.lap": 1.5, "task.ball.speed": 0.06})  # 500 steps
    model, untaught = train(world, steps=2000, seed=1), train(world, "snn-eta0", steps=1)
    maps = weight_maps(model)
    assert list(maps) == ["right", "left", "backwards", "forward", "up", "down"]
    middle, ring = np.zeros((8, 8), bool), np.zeros((8, 8), bool)
    middle[3:5, 3:5] = ring[2:6, 2:6] = True
    speaks = maps["up"] - maps["down"]
    assert speaks[ring & ~middle].mean() > 200.0 > -200.0 > speaks[middle].mean()
    good, bad = (try_out(one, starts=[Start((0.0, 0.0, 12.0))]) for one in (model, untaught))
    assert (good.laps, bad.laps) == (1, 0)
    assert good.absolute[2] < 5.0


# random search

SMALL = {"directions": 2, "best": 1}
EAST = np.zeros((8, 8), int)
EAST[3:5, 6] = 5


def searched(reward, settings=SMALL, episodes=40, error=0.1):
    """A search whose episodes have one step; `reward` of the action decides."""
    learner = make("random-search", BALL, 0, settings)
    for _ in range(episodes):
        learner.begin()
        learner.learn({"counts": EAST, "reward": reward(learner.act(EAST, {})), "lost": False} | told(error, error))
    return learner


def test_one_update_of_random_search_by_hand():
    """Against the update's equation, with the directions and rewards written out."""
    learner = make("random-search", BALL, 7, {"directions": 3, "best": 2, "noise": 0.5, "rate": 0.3})
    directions = np.random.default_rng((7, 4)).standard_normal((3, 2, 3))
    found = np.array(((16 * 6 + 7.5 - 63) / 64, (16 * 3.5 + 7.5 - 63) / 64, 1.0))
    returns = np.array([[0.1, 0.2], [0.9, 0.3], [0.4, 0.8]])
    for k, (way, sign) in enumerate([(d, s) for d in directions for s in (1, -1)]):
        learner.begin()
        assert learner.act(EAST, {}) == pytest.approx(np.clip(sign * 0.5 * way @ found, -1.0, 1.0))
        learner.learn({"reward": returns.ravel()[k]})
    assert not learner.learnt()["weights"].any()
    learner.begin()
    kept = returns[[1, 2]]  # by the larger of both rewards
    step = 0.3 / (2 * kept.std()) * (0.6 * directions[1] - 0.4 * directions[2])
    assert learner.learnt()["weights"] == pytest.approx(step)
    learner = make("random-search", HEIGHT)
    assert learner.learnt()["weights"].shape == (3, 4)
    learner.begin()
    found = (*make("centroid", HEIGHT, 0, {"gain": 1.0}).act(EAST, {}), 1.0)
    ways = np.random.default_rng((0, 4)).standard_normal((8, 3, 4))
    assert max(np.abs(found[:3])) < 1.0  # so that the centroid's action tells what it found
    assert learner.act(EAST, {}) == pytest.approx(np.clip(ways[0] @ found, -1.0, 1.0))
    assert learner.frozen().act(np.zeros((8, 8), int), {}).tolist() == [0.0, 0.0, 0.0]


def test_random_search_learns_what_pays_from_the_reward_alone():
    best = np.array((0.6, -0.3))
    policy = searched(lambda a: -float(np.sum((a - best) ** 2)), {"noise": 0.1, "rate": 0.05}, 480).frozen()
    assert policy.act(EAST, {}) == pytest.approx(best, abs=0.1)
    assert not policy.act(np.zeros((8, 8), int), {}).any()
    one, same = (searched(lambda a: float(a[0]), error=error).learnt()["weights"] for error in (0.1, -0.9))
    other = searched(lambda a: -float(a[0])).learnt()["weights"]
    assert (one == same).all()
    assert (one != other).any()
    assert not searched(lambda _: 1.0).learnt()["weights"].any()
    model = train(BALL, "random-search", steps=8_000, seed=1)
    tried = try_out(model, starts=grid(model.scenario, 2))
    assert tried.laps == 4
    assert tried.error_px < 15.0


@pytest.mark.parametrize("scenario", ["B60", "B60-height", "line"])
def test_a_training_goes_on_after_a_kill_to_the_same_bits(scenario, tmp_path, monkeypatch):
    file, reports, words = tmp_path / "model.h5", [], {"steps": 300, "settings": SMALL, "episode": 20}
    monkeypatch.setattr("neuro_drone.model.BLOCK", 70)
    whole = train(scenario, "random-search", **words)
    with pytest.raises(KeyboardInterrupt):
        train(scenario, "random-search", **words, out=file, report=stop_at(190))
    parts = train(scenario, "random-search", **words, out=file, report=reports.append)
    assert reports[0].step > 70
    assert whole.learnt["weights"].any()
    assert (whole.learnt["weights"] == parts.learnt["weights"]).all()
    assert (Model.load(file).learnt["weights"] == whole.learnt["weights"]).all()
