"""Agents in environments of their own: what they learn, what they keep, what they refuse, and the chips."""

import signal
import time
from types import SimpleNamespace

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces

import neuro_agent
from neuro.apps import End, Environments, actions_of, dimensions_of, flat
from neuro.coding import PERIOD, Places
from neuro.coding.values import ErrorScale, Novelty, RewardScale
from neuro.kernels import compile_report
from neuro_agent import deployed, files, training
from neuro_agent.network import GAIN, REST, TAU
from refused import refusals_of, refused


class Corridor(gymnasium.Env):
    """Seven places in a row; the goal is at the right end, and `fault` says what goes wrong in the third step."""

    observation_space = spaces.Dict({"place": spaces.Discrete(7), "near": spaces.Box(0.0, 1.0, (1,))})
    action_space = spaces.Discrete(2)
    fault = ""

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.at, self.k = int(self.np_random.integers(3)), 0
        return self._seen(), {}

    def _seen(self):
        return {"place": np.int64(self.at), "near": np.array([self.at / 6], dtype=np.float32)}

    def step(self, action):
        self.k += 1
        self.at = min(max(self.at + (1 if action else -1), 0), 6)
        if self.k == 3 and self.fault:
            return self.wrong()
        return self._seen(), 1.0 if self.at == 6 else -0.05, self.at == 6, self.k >= 30, {}

    def wrong(self):
        if self.fault == "raises":
            raise ValueError("no power")
        seen = self._seen()
        answers = {
            "four values": (seen, 0.0, False, {}),
            "space": (np.zeros(3), 0.0, False, False, {}),
            "two flags": (seen, 0.0, np.array([True, False]), False, {}),
            "no flag": (seen, 0.0, False, "no", {}),
        }
        others = {"between": {"place": 1.5}, "outside": {"place": 7}, "NaN": {"near": np.array([np.nan])}}
        rewards = {"reward NaN": float("nan"), "text": "much", "large": 10**400}
        return answers.get(
            self.fault, (seen | others.get(self.fault, {}), rewards.get(self.fault, 0.0), False, False, {})
        )


def agent(seed=1, **settings):
    few = {"critics": 20, "explore": 100, "active": 6} | settings
    return neuro_agent.ActorCritic(Corridor.observation_space, Corridor.action_space, seed=seed, **few)


@pytest.fixture(scope="module")
def learnt():
    one = agent()
    one.train(Corridor(), steps=2500)
    return one


def test_what_is_learnt_decides_alike_from_a_file_on_chips_and_has_a_bill(learnt, tmp_path):
    assert learnt.test(Corridor(), episodes=20).mean > 0.6
    assert agent().test(Corridor(), episodes=20).mean < 0.2
    bill = learnt.energy("loihi", steps=20)
    assert 0.0 < bill.low_j < bill.total_j < bill.high_j
    assert len(deployed.HOST) == 2
    places = learnt.places
    # Along a dimension a grid takes 5 operations with states and 8 without, and a comparison in each tick.
    along = sum(5 if places.dimensions[d].states else 8 for d in places._member.ravel())
    by_hand = along + places.active * (deployed.TICKS - 1) + sum(learnt.actions.sizes)
    assert bill.by_cost()["host"] == pytest.approx(20 * by_hand * 8.6e-9)
    learnt.save(tmp_path / "agent.h5")
    again = neuro_agent.ActorCritic.load(tmp_path / "agent.h5")
    for name, weight in learnt.weights.items():
        np.testing.assert_array_equal(weight, again.weights[name])
    one, other = (each.test(Corridor(), episodes=5, seed=4).returns for each in (learnt, again))
    np.testing.assert_array_equal(one, other)
    assert [again.act({"place": 5, "near": np.array([5 / 6], np.float32)}) for _ in range(5)].count(1) >= 4


@pytest.mark.parametrize(
    "settings",
    [{"encoder": "tiles"}, {"encoder": "population", "spikes": "poisson"}],
    ids=str,
)
def test_every_encoder_learns_the_way(settings):
    one = agent(**settings)
    one.train(Corridor(), steps=4000)
    assert one.test(Corridor(), episodes=20).mean > 0.6


@pytest.mark.filterwarnings("ignore::neuro.ApproximationWarning")  # of weights, and of iaf_psc_delta on SpiNNaker
@pytest.mark.parametrize("backend", ["loihi", "spinnaker"])
def test_chips_decide_by_their_spikes(learnt, backend):
    assert learnt.test(Corridor(), episodes=10, backend=backend).mean > 0.6


def test_what_a_twin_has_learnt_is_nothing_to_a_spiking_agent(learnt, tmp_path, messages):
    spaces_of, few = (Corridor.observation_space, Corridor.action_space), {"critics": 5, "explore": 20}
    twin, file = neuro_agent.LinearTwin(*spaces_of, **few), tmp_path / "twin.h5"
    twin.save(file)
    assert neuro_agent.LinearTwin.load(file).kind == "linear twin"
    learnt.save(tmp_path / "agent.h5")
    loop = training.loop_of(twin, Environments(Corridor()))
    loop.checkpoint(tmp_path / "new.h5", files.plain_of(twin)).keep()
    messages(refusals_of(messages.cases, globals() | locals(), tmp_path=tmp_path))


@pytest.mark.parametrize(
    ("twin", "settings"),
    [
        (True, {"encoder": "population"}),
        (False, {"spikes": "poisson"}),
        (False, {"novelty": 1.0, "errors": "normalised"}),
    ],
)
def test_a_training_that_was_stopped_goes_on_to_the_same_bits(tmp_path, monkeypatch, twin, settings):
    monkeypatch.setattr(training, "BLOCK", 250)
    kind = neuro_agent.LinearTwin if twin else neuro_agent.ActorCritic

    def made():
        return kind(Corridor.observation_space, Corridor.action_space, seed=2, critics=10, explore=50, **settings)

    whole, file = made(), tmp_path / "agent.h5"
    whole.train(Corridor(), steps=1000)
    env, first = Corridor(), made()
    seen = env.step

    def step(action):
        step.count += 1
        if step.count == 640:
            raise KeyboardInterrupt
        return seen(action)

    step.count, env.step = 0, step
    with pytest.raises(KeyboardInterrupt):
        first.train(env, steps=1000, out=file)
    assert not file.exists()
    second = made()
    second.train(Corridor(), steps=1000, out=file)
    assert file.exists()
    assert not (tmp_path / "agent.h5.training").exists()
    for name, weight in whole.weights.items():
        np.testing.assert_array_equal(weight, second.weights[name])
    np.testing.assert_array_equal(whole.log.returns, second.log.returns)


def test_what_was_stopped_goes_on_in_the_same_environment_only(tmp_path, monkeypatch):
    monkeypatch.setattr(training, "BLOCK", 50)

    class Stopped(gymnasium.Wrapper):
        steps = 0

        def step(self, action):
            self.steps += 1
            if self.steps > 180:
                raise KeyboardInterrupt
            return super().step(action)

    def lake(slippery):
        return gymnasium.make("FrozenLake-v1", is_slippery=slippery)

    def made():
        one = neuro_agent.ActorCritic(lake(True).observation_space, lake(True).action_space, critics=5, explore=20)
        one.explored = True
        return one

    file = tmp_path / "lake.h5"
    with pytest.raises(KeyboardInterrupt):
        made().train(Stopped(lake(True)), steps=300, out=file)
    told = "unfinished training with options.is_slippery = True: found False now"
    assert told in refused(made().train, lake(False), steps=300, out=file)
    assert len(made().train(lake(True), steps=300, out=file))
    assert file.exists()


def test_random_moves_vectors_and_second_trainings():
    env, one = Drifting(False), neuro_agent.ActorCritic(Drifting.observation_space, Drifting.action_space, critics=5)
    one.train(env, steps=1)
    assert not one.explored
    one.train(env, steps=500)
    assert one.explored
    assert one.places.spread[0] > 1.0
    none = neuro_agent.ActorCritic(Drifting.observation_space, Drifting.action_space, critics=5, explore=0)
    none.train(env, steps=10)
    assert (none.places.middle[0], none.places.spread[0]) == (0.0, 1.0)
    envs, one = gymnasium.vector.SyncVectorEnv([Corridor] * 4), agent(seed=3)
    log = one.train(envs, steps=4000)
    assert one.test(Corridor(), episodes=20).mean > 0.6
    assert len(log) > 100
    one, seeds, env = agent(), [], Corridor()
    reset = env.reset

    def noted(**words):
        seeds.append(words["seed"])
        return reset(**words)

    env.reset = noted
    one.train(env, steps=300)
    one.train(env, steps=300)
    assert len(seeds) == len(set(seeds)) > 20
    found = agent().controls(Corridor(), steps=400, episodes=5, names=("frozen", "random"))
    assert all(test.mean < 0.5 for test in found.values())


def test_what_an_environment_must_not_give(messages):
    said = {}
    faults = ("raises", "four values", "space", "outside", "between", "two flags", "no flag")
    for fault in (*faults, "NaN", "reward NaN", "text", "large"):
        env, one = Corridor(), agent(explore=0)
        one.train(env, steps=50)
        env.fault = fault
        said[fault] = refused(one.train, env, steps=50)
        assert all(np.isfinite(weight).all() for weight in one.weights.values())
        assert len(one.train(Corridor(), steps=50))
    messages(said)


class Drifting(gymnasium.Env):
    """A number that drifts; with `kept` all observations are one array, in which it writes on."""

    observation_space = spaces.Box(-np.inf, np.inf, (1,), np.float64)
    action_space = spaces.Discrete(2)

    def __init__(self, kept):
        self.kept, self.at = kept, np.zeros(1)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.at[:], self.k = 0.0, 0
        return self._seen(), {}

    def _seen(self):
        return self.at if self.kept else self.at.copy()

    def step(self, action):
        self.k += 1
        self.at += self.np_random.normal()
        return self._seen(), 1.0, False, self.k == 20, {}


def test_an_environment_may_write_on_in_its_observation():
    def trained(kept):
        env = Drifting(kept)
        one = neuro_agent.ActorCritic(env.observation_space, env.action_space, critics=5, explore=50)
        one.train(env, steps=100)
        return one

    own, copied = trained(True), trained(False)
    np.testing.assert_array_equal(own.places.spread, copied.places.spread)
    np.testing.assert_array_equal(own.last_vectors, copied.last_vectors)
    np.testing.assert_array_equal(own.weights["policy0"], copied.weights["policy0"])


def test_the_order_of_a_dict_does_not_matter(tmp_path):
    ordered = spaces.Dict([("near", spaces.Box(0.0, 1.0, (1,))), ("at", spaces.Discrete(7))])
    one = neuro_agent.ActorCritic(ordered, spaces.Discrete(2), critics=5)
    one.save(tmp_path / "a.h5")
    names = [dimension.name for dimension in one.places.dimensions]
    loaded = neuro_agent.ActorCritic.load(tmp_path / "a.h5")
    assert [dimension.name for dimension in loaded.places.dimensions] == names
    other, seen = spaces.Dict(dict(ordered.spaces.items())), {"near": np.array([0.5], np.float32), "at": 3}
    assert other == ordered
    np.testing.assert_array_equal(flat(other, seen), flat(ordered, seen))


@pytest.mark.parametrize("kind", [neuro_agent.ActorCritic, neuro_agent.LinearTwin])
def test_an_action_is_that_of_the_weights_of_now(kind):
    one = kind(spaces.Discrete(2), spaces.Discrete(2), critics=5)
    for best in (0, 1):
        weights = np.zeros((2, 2))
        weights[:, best] = 20.0
        one.learn_from(one.weights | {"policy0": weights})
        assert [one.act(0) for _ in range(10)] == [best] * 10


def test_the_scale_of_late_rewards_does_not_depend_on_an_interruption():
    class Late(Corridor):
        pays = False

        def step(self, action):
            seen, reward, ended, cut, info = super().step(action)
            return seen, reward * self.pays, ended, cut, info

    envs, agents = [Late(), Late()], [agent(explore=1), agent(explore=1)]
    whole, again = (training.loop_of(one, Environments(env)) for one, env in zip(agents, envs, strict=True))
    whole.run(steps=200)
    again.go_on(whole.arrays())
    scales = [loop.pilot.taught["error"].scale for loop in (whole, again)]
    assert not scales[0].known
    for env, loop in zip(envs, (whole, again), strict=True):
        env.pays = True
        loop.run(steps=400)
    assert scales[1].known
    assert vars(scales[1]) == vars(scales[0])
    for name, weights in whole.pilot.weights.items():
        np.testing.assert_array_equal(again.pilot.weights[name], weights)


@pytest.mark.parametrize("value", [-0.5, 0.0, 0.5])
def test_the_critic_counts_what_its_input_is_worth(value):
    """The measured constants of its neurons: spikes at rest, spikes of 1 mV, and how much their counts vary."""
    one = neuro_agent.ActorCritic(spaces.Box(0.0, 1.0, (2,)), spaces.Discrete(2), seed=1, critic_rate=0.0)
    x = np.exp(-np.arange(PERIOD) / TAU) / (1.0 - np.exp(-PERIOD / TAU))
    each = value / (one.places.active * x.mean())
    one.learn_from({name: np.full_like(w, each if name == "value" else 0.0) for name, w in one.weights.items()})
    env = SimpleNamespace(n=1, observations=one.observations, actions=one.actions.space, rewards=np.zeros(1))
    pilot = one.pilot(env, seed=1)
    pilot.put(one.arrays())
    pilot.begin(1, 0)
    values = np.zeros(300)
    for k in range(values.size):
        pilot.act(np.array([[0.3, 0.6]]), ({},))
        values[k] = (pilot.counts["critic"].mean() - REST) / GAIN
    # A spike of a place is felt a step later, and the first steps of a network have had none.
    assert (values[5:].mean(), values[5:].std()) == (pytest.approx(value, abs=0.06), pytest.approx(0.014, abs=0.005))


class Rewarded(Corridor):
    """Pays so many times as much."""

    pays = 1.0

    def step(self, action):
        seen, reward, ended, cut, info = super().step(action)
        return seen, self.pays * reward, ended, cut, info


@pytest.mark.parametrize("kind", [neuro_agent.ActorCritic, neuro_agent.LinearTwin])
def test_rewards_that_grow_do_not_leave_the_scale_of_the_critic(kind):
    env = Rewarded()
    one = kind(env.observation_space, env.action_space, seed=1)
    one.train(env, steps=1000)
    before = one.rewards.factor
    env.pays = 1000.0
    one.train(env, steps=1000)
    assert one.rewards.factor * 1000.0 <= 1.25
    assert one.rewards.factor < before
    assert all(np.abs(weights).max() < 10.0 for weights in one.weights.values())


def test_scales_of_errors_rewards_and_novelty():
    one, novelty = agent(), Novelty(0.2)
    novelty.join(one.places.cells, one.places.size)
    first, second, *_, last = (novelty.of(np.array([[3.0, 0.5]]))[0] for _ in range(100))
    assert (first, second, last) == pytest.approx((0.2, 0.2 / np.sqrt(2.0), 0.02))
    assert novelty.of(np.array([[6.0, 1.0]]))[0] == pytest.approx(0.2)
    scale, drawn = ErrorScale(0.05), np.random.default_rng(1).normal(0.0, 7.0, (3000, 2))
    assert np.array([scale.of(errors) for errors in drawn])[500:].std() == pytest.approx(0.05, rel=0.05)
    np.testing.assert_array_equal(ErrorScale(None).of(drawn[0]), drawn[0])
    scales = [RewardScale(0.9, scale) for scale in (1.0, 0.25)]
    for scale in scales:
        scale.learn([2.0, 2.0, 2.0])
    assert [scale.factor for scale in scales] == pytest.approx([0.05, 0.0125])
    assert [scale.first for scale in scales] == pytest.approx([1.0, 0.25])


@pytest.mark.parametrize("interrupts", [signal.default_int_handler, signal.SIG_IGN], ids=["alone", "in the background"])
def test_an_environment_that_hangs_is_given_up(interrupts):
    class Hanging(Corridor):
        def step(self, action):
            if self.k == 5:
                hangs.append(time.monotonic())
                time.sleep(20.0)
            return super().step(action)

    before, hangs = signal.signal(signal.SIGINT, interrupts), []
    try:
        assert "a call has not returned for 0.4 s" in refused(agent().train, Hanging(), steps=50, patience=0.4)
    finally:
        signal.signal(signal.SIGINT, before)
    assert time.monotonic() - hangs[0] < 10.0
    assert signal.getsignal(signal.SIGURG) == signal.SIG_DFL


def test_compiling_kernels_is_not_a_hang(monkeypatch):
    class Compiling(Corridor):
        def step(self, action):
            if self.k == 5:
                began = compile_report.begin()
                time.sleep(0.8)
                compile_report.end(began, 0)
            return super().step(action)

    monkeypatch.setenv(compile_report.REPORTED, "1")
    monkeypatch.setattr(compile_report, "_seconds", 0.0)
    agent().train(Compiling(), steps=20, patience=0.4)


def test_what_cannot_be(learnt, tmp_path, monkeypatch, messages):
    monkeypatch.chdir(tmp_path)

    def returning(answer):
        env = Corridor()
        env.reset = lambda **words: answer
        return env

    def vector(mode):
        env = gymnasium.vector.SyncVectorEnv([Corridor])
        env.metadata = {**env.metadata, "autoreset_mode": mode}
        return env

    assert Environments(vector("NextStep")).n == 1  # of metadata that went through JSON
    two, number, box = spaces.Discrete(2), np.zeros((3, 2)), spaces.Box(-1.0, 1.0, (2,))
    number[2, 1] = np.inf
    names = globals() | locals() | {"Agent": neuro_agent.ActorCritic}
    messages(refusals_of(messages.cases, names, tmp_path=tmp_path))


@pytest.mark.parametrize(
    "space",
    [spaces.Discrete(5, start=2), spaces.MultiDiscrete([3, 4]), spaces.MultiBinary([2, 2]), spaces.Box(-1, 2, (2, 2)),
     spaces.Tuple([spaces.Discrete(3), spaces.Dict({"b": spaces.Box(0, 1, (2,)), "a": spaces.MultiBinary(2)})])],
    ids=str,
)  # fmt: skip
def test_every_space_comes_back_from_a_file(space, tmp_path):
    actions = space if not isinstance(space, spaces.Tuple) else spaces.MultiDiscrete([2, 3], start=[1, 0])
    one = neuro_agent.ActorCritic(space, actions, critics=5)
    one.save(tmp_path / "a.h5")
    again = neuro_agent.ActorCritic.load(tmp_path / "a.h5")
    assert (again.observations, again.actions.space) == (space, actions)
    space.seed(1)
    for _ in range(5):
        vector = flat(space, space.sample())[0]
        assert len(one.places.cells(vector)) == one.places.active
        assert actions.contains(one.actions.of(one.frozen(seed=1).decide(vector[None]))[0])


def test_whole_numbers_of_a_box_are_one_hot():
    whole = spaces.Box(0, 3, (2,), np.uint8)
    assert neuro_agent.ActorCritic(whole, Corridor.action_space, encoder="one_hot").places.size == 8


def test_each_grid_has_one_active_place_and_neighbours_share_some():
    places, rng = Places(dimensions_of(spaces.Box(0.0, 1.0, (2,))), 2, 6, 24), np.random.default_rng(1)
    for _ in range(50):
        x = rng.uniform(-0.2, 1.2, 2)
        near, far, here = places.cells(x + 0.01), places.cells((x + 0.5) % 1.0), places.cells(x)
        assert len(set(here)) == places.active == 24
        assert len(set(here) & set(near)) >= 18 > len(set(here) & set(far))


class Balance(gymnasium.Env):
    """A number that a force moves; the reward is by how much nearer it comes to 0."""

    observation_space = spaces.Box(-1.0, 1.0, (1,))
    action_space = spaces.Box(-1.0, 1.0, (1,))

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.at, self.k = float(self.np_random.uniform(-1.0, 1.0)), 0
        return np.array([self.at], np.float32), {}

    def step(self, action):
        before, self.at = abs(self.at), min(max(self.at - 0.2 * float(action[0]), -1.0), 1.0)
        self.k += 1
        return np.array([self.at], np.float32), before - abs(self.at), False, self.k == 20, {}


@pytest.mark.filterwarnings("error")
def test_actions_of_boxes():
    found = actions_of(spaces.Box(np.array([-1.0, 0.0]), np.array([1.0, 8.0]), dtype=np.float64), levels=2, circuits=4)
    assert found.sizes == (2,) * 8
    np.testing.assert_array_equal(found.of(np.array([[1, 1, 1, 0, 0, 0, 1, 0]])), [[0.5, 2.0]])
    found = actions_of(spaces.Box(-3, 3, (1,), np.int8), levels=2, circuits=4)
    winners = np.array([[0, 0, 0, 0], [1, 0, 0, 0], [1, 1, 0, 0], [1, 1, 1, 0], [1, 1, 1, 1]])
    np.testing.assert_array_equal(found.of(winners), [[-3], [-2], [0], [2], [3]])
    action = actions_of(spaces.Box(-1.0, 1.0, (2,), np.float16), levels=3).of(np.array([[0, 2]]))
    assert (action.dtype, action.tolist()) == (np.float16, [[-1.0, 1.0]])
    space = spaces.Box(-0.1, 0.1, (1,), np.float64)  # the mean of three 0.1 is more than 0.1
    found = actions_of(space, levels=2, circuits=3)
    assert all(space.contains(found.of(np.full((1, 3), winner))[0]) for winner in (0, 1))


@pytest.mark.parametrize("kind", [neuro_agent.ActorCritic, neuro_agent.LinearTwin])
def test_pairs_of_opponents_learn_to_steer_finely(kind):
    few = {"critics": 20, "explore": 100, "active": 4, "discount": 0.8, "reward_scale": 0.3, "actor_rate": 4.0}
    one = kind(Balance.observation_space, Balance.action_space, seed=1, levels=2, circuits=8, **few)
    one.train(Balance(), steps=2000)
    assert one.test(Balance(), episodes=20).mean > 0.35  # all of the way is 0.5
    left, right = (np.mean([one.act([at])[0] for _ in range(50)]) for at in (-0.9, 0.9))
    assert left < 0.0 < right


def test_it_learns_the_same_on_event_and_reference():
    env, learnt = gymnasium.make("CartPole-v1"), []
    for backend in ("event", "reference"):
        settings = {"critics": 3, "active": 6, "explore": 20, "backend": backend}
        agent = neuro_agent.ActorCritic(env.observation_space, env.action_space, seed=1, **settings)
        agent.train(env, steps=80)
        learnt.append(agent.weights)
    assert all(np.any(each) and np.array_equal(each, learnt[1][name]) for name, each in learnt[0].items())


def test_whole_numbers_may_be_written_as_floats(learnt):
    assert End(steps=1e3, episodes=np.float64(5)) == End(steps=1000, episodes=5)
    assert len(learnt.test(Corridor(), episodes=2.0).returns) == 2
