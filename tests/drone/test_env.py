"""The gymnasium environment."""

import copy
import json
import warnings
from dataclasses import replace

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from hypothesis import given, strategies as st

import neuro_drone  # noqa: F401  (registers the environment)
from neuro_drone.env import ACTIONS, DroneEnv
from neuro_drone.parts import Ball, Camera, Drone, Ground, Line
from neuro_drone.scenario import NAMES, Scenario, load

KINDS = [(o, a) for o in ("counts", "binary", "frame", "normalised") for a in ("continuous", "discrete")]


def episode(env, actions, **reset):
    seen, info = env.reset(**reset)
    rows = [(seen, 0.0, info)]
    for action in actions:
        seen, reward, terminated, truncated, info = env.step(action)
        rows.append((seen, reward, info))
        if terminated or truncated:
            break
    return rows


@pytest.mark.parametrize(("observation", "actions"), KINDS)
@pytest.mark.parametrize("scenario", ["B60", "line"])
def test_gymnasium_finds_nothing_wrong(scenario, observation, actions):
    options = {"scenario": scenario, "observation": observation, "actions": actions}
    env = gymnasium.make("neuro/Drone-v0", **options, render_mode="rgb_array")
    check_env(env.unwrapped)
    env.close()


@pytest.mark.parametrize(("observation", "actions"), KINDS)
def test_stable_baselines_finds_nothing_wrong(observation, actions):
    checker = pytest.importorskip("stable_baselines3.common.env_checker", reason="stable-baselines3 is not installed")
    with warnings.catch_warnings():
        if observation != "normalised":
            warnings.filterwarnings("ignore", message=".*unconventional shape.*")  # 8 x 8 is neither picture nor vector
        checker.check_env(
            DroneEnv("line" if actions == "discrete" else "B60", observation=observation, actions=actions)
        )


def test_made_by_its_name_it_runs_without_a_warning():
    env = gymnasium.make("neuro_drone:neuro/Drone-v0", scenario="A60", **{"camera.tilt": 45})
    assert env.unwrapped.scenario == load("A60", **{"camera.tilt": 45})
    env.reset(seed=1)
    env.action_space.seed(1)
    for _ in range(20):
        _, reward, terminated, truncated, _ = env.step(env.action_space.sample())
        assert 0.0 <= reward <= 1.0
        if terminated or truncated:
            env.reset()
    env.close()


@pytest.mark.parametrize("scenario", ["B60", "B60-shake", "B60-texture", "line"])
def test_the_same_seed_gives_the_same_episode(scenario):
    actions = np.random.default_rng(3).uniform(-0.2, 0.2, (25, 2))
    first, second, other = (episode(DroneEnv(scenario), actions, seed=seed) for seed in (5, 5, 6))
    used = DroneEnv(scenario)
    episode(used, actions[:7], seed=9)
    again = episode(used, actions, seed=5)
    for run in (second, again):
        assert len(run) == len(first)
        for (seen, reward, info), (seen2, reward2, info2) in zip(first, run, strict=True):
            assert np.array_equal(seen, seen2)
            assert (reward, info["events"], info["error"]) == (reward2, info2["events"], info2["error"])
    assert first[0][2]["error"] != other[0][2]["error"]


def test_the_seed_of_the_scenario_is_that_of_the_first_episode():
    env = DroneEnv("B60", seed=5)
    errors = [env.reset()[1]["error"] for _ in range(2)]
    assert errors[0] == DroneEnv("B60").reset(seed=5)[1]["error"]
    assert errors[1] != errors[0]
    assert DroneEnv("B60", seed=5).reset(seed=6)[1]["error"] != errors[0]


def test_observations_tell_the_same_events():
    actions = np.random.default_rng(3).uniform(-0.5, 0.5, (10, 2))
    counts, binary, frame, normalised = (
        episode(DroneEnv("B60", observation=o), actions, seed=2, options={"start": (0, 0)})
        for o in ("counts", "binary", "frame", "normalised")
    )
    for (seen, _, info), (some, _, _), (picture, _, _), (share, _, _) in zip(
        counts, binary, frame, normalised, strict=True
    ):
        events, wanted = info["events"], np.zeros((8, 8), np.int64)
        np.add.at(wanted, (events.y // 16, events.x // 16), 1)
        assert np.array_equal(seen, wanted)
        assert np.array_equal(info["counts"], wanted)
        assert np.array_equal(some, wanted > 0)
        assert share.dtype == np.float32
        np.testing.assert_allclose(share, wanted.ravel() / max(1, wanted.max()), rtol=1e-7)
        last = np.full((128, 128), 128, np.uint8)
        for x, y, p in zip(events.x, events.y, events.p, strict=True):
            last[y, x] = 255 * p
        assert np.array_equal(picture[:, :, 0], last)
    assert counts[-1][0].sum() > 0
    assert counts[0][0].sum() == 0


@pytest.mark.parametrize("observation", ["counts", "binary", "frame", "normalised"])
def test_what_was_given_is_the_users_own(observation):
    """Writing into an observation changes nothing else, and no later step changes what was given."""
    env = DroneEnv("B60", observation=observation)
    seen, info = env.reset(seed=1)
    for _ in range(3):
        seen, *_, info = env.step((0.3, 0.2))
    kept = copy.deepcopy((seen, info))
    for _ in range(5):
        env.step((0.3, 0.2))
    assert np.array_equal(seen, kept[0])
    assert np.array_equal(info["events"].x, kept[1]["events"].x)
    seen[:] = 0
    assert np.array_equal(info["counts"], kept[1]["counts"])
    assert info["counts"].any()


def test_actions():
    """A target on the right, or below, comes nearer by a positive action."""
    for scenario in ("B60", "line"):
        for axis in (0, 1):
            action, start = np.zeros(2), np.zeros(2)
            action[axis], start[axis] = 0.4, 20.0
            last = episode(DroneEnv(scenario), [action] * 8, options={"start": tuple(start)})[-1][2]
            assert abs(last["error"][axis]) < 19.0

    def last(actions, kind="continuous"):
        return episode(DroneEnv("B60", actions=kind), actions * 3, seed=1)[-1][2]["error"]

    assert all(last([number], "discrete") == last([np.array(pair)]) for number, pair in enumerate(ACTIONS))
    assert last([np.array([9.0, -9.0])]) == last([[1.0, -1.0]])
    motors = {"mirror": True, "since": 0.2}
    np.testing.assert_array_equal(_flown(0.2, [0.3, 0.1], motors=motors), _flown(0.2, [0.3, 0.1]))
    assert not np.allclose(_flown(0.4, [0.3, 0.1], motors=motors), _flown(0.4, [0.3, 0.1]))
    by_roll = {roll: _seen([0.3, 0.0], roll) - _seen([0.0, 0.0], roll) for roll in (0.0, 90.0, 180.0)}
    right, down = by_roll[0.0]
    assert abs(right) > 1.0 > abs(down)
    np.testing.assert_allclose(by_roll[180.0], [-right, -down], atol=0.2)
    np.testing.assert_allclose(np.abs(by_roll[90.0]), [abs(down), abs(right)], atol=0.2)


def test_rewards_ends_and_pictures():
    rows = episode(DroneEnv("B60"), [np.array([-1.0, 0.0])] * 60, options={"start": (30.0, 0.0)})
    rewards = [reward for _, reward, _ in rows[1:]]
    assert (rewards, rewards[-1]) == (sorted(rewards, reverse=True), 0.0)
    assert rows[-1][2]["lost"]
    assert not rows[-1][2]["lap"]
    for _, reward, info in rows[1:-1]:
        assert reward == pytest.approx(1.0 - info["error_px"] / np.hypot(64.5, 64.5)) == info["reward"]
        assert info["supervised_error"] == pytest.approx(np.array(info["error"]) / 64.0)
    env = DroneEnv("A60", **{"task.ball.speed": 1.2, "step": 10})
    _, info = env.reset(options={"start": (0.0, 0.0)})
    terminated = truncated = False
    while not (terminated or truncated):
        _, _, terminated, truncated, info = env.step(np.clip(8.0 * info["supervised_error"], -1.0, 1.0))
    assert (terminated, truncated, info["progress"]) == (False, True, 1.0)
    env = DroneEnv("B60", render_mode="rgb_array")
    env.reset(options={"start": (0.0, 0.0)})
    picture = env.render()
    assert picture.shape == (128, 128, 3)
    assert picture[63, 63, 0] < picture[5, 5, 0]
    assert DroneEnv("B60").render() is None
    discrete = DroneEnv("B60", actions="discrete")
    discrete.reset()
    assert discrete.step(np.int64(8))
    env = DroneEnv("B60", start=[12, -7])
    assert env.reset()[1]["error"] == pytest.approx((12.0, -7.0))
    assert env.reset(options={"start": (1.0, 2.0)})[1]["error"] == pytest.approx((1.0, 2.0))
    env = DroneEnv("line")
    for direction in (1, -1):
        env.reset(options={"start": (0.0, 0.0), "direction": direction})
        assert env.task.direction == direction


def _flown(seconds, command, **changes):
    """Where a drone is after a command, relative to where it began, (right, back) in m."""
    env = DroneEnv("B60", start=[0.0, 0.0], **changes)
    env.reset(seed=1)
    begin = env.body.pose.x, env.body.pose.y
    for _ in range(round(seconds * 20)):
        env.step(np.array(command))
    return np.array([-(env.body.pose.y - begin[1]), -(env.body.pose.x - begin[0])])


@pytest.mark.parametrize(("mirror", "angle", "gain"), [(True, 0.0, 1.0), (False, 90.0, 0.5), (True, -30.0, 0.7)])
def test_motors_mirror_turn_and_scale_a_command(mirror, angle, gain):
    command, c, s = np.array([0.3, 0.1]), gain * np.cos(np.radians(angle)), gain * np.sin(np.radians(angle))
    right = -command[0] if mirror else command[0]
    turned = [c * right + s * command[1], c * command[1] - s * right]
    motors = {"mirror": mirror, "angle": angle, "gain": gain}
    np.testing.assert_allclose(_flown(0.4, command, motors=motors), _flown(0.4, turned), atol=1e-12)
    assert not np.allclose(_flown(0.4, command, motors=motors), _flown(0.4, command))


def _seen(command, roll):
    """The error after some steps of a command, with a camera that looks straight down."""
    env = DroneEnv("B60", start=[0.0, 0.0], camera={"roll": roll, "tilt": 90.0})
    env.reset(seed=1)
    return np.array([env.step(np.array(command))[4]["error"] for _ in range(8)][-1])


def test_the_scenarios_that_come_along():
    variants = [f"B60-{what}" for what in ("bounce", "height", "rise", "shake", "spin", "texture", "wind")]
    assert (("A30", "A60", "B30", "B60", *variants, "C60", "line"), load("B60")) == (NAMES, Scenario())
    assert load("A30") == Scenario("A30", 20.0, Ball(lap=3.0, radius=0.27), Camera(tilt=30.0))
    assert (load("C60").task, load("line").task) == (Ball(lap=15.0, speed=0.375), Line(width=0.05))
    for name in NAMES:
        scenario = load(name)
        assert scenario.name == name
        if scenario.kind == "ball":
            assert scenario.task.lap / scenario.task.speed / (scenario.step / 1000.0) == pytest.approx(2000.0)


@pytest.mark.parametrize("name", NAMES)
def test_words_tell_the_whole_scenario(name):
    scenario = replace(load(name), start=(1.0, -2.5), seed=7)
    assert Scenario.from_words(json.loads(json.dumps(scenario.as_words()))) == scenario
    assert Scenario.from_words(load(name).as_words()) == load(name)


def test_files_and_changes(tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text("step: 20\ntask: {ball: {lap: 3}}\ncamera: {tilt: 45, mount: body}\nstart: [5, 6]\nseed: 3\n")
    wanted = Scenario("mine", 20.0, Ball(lap=3.0), Camera(tilt=45.0, mount="body"), start=(5.0, 6.0), seed=3)
    assert load(path) == load(str(path)) == wanted
    path.write_text("task: line\nname: other\n")
    assert load(path) == Scenario("other", task=Line())
    changed = load("B60", camera={"tilt": 45}, **{"drone.v_max": 1, "task.ball.lap": 3}, step=20, seed=4)
    wanted = Scenario("B60", 20.0, Ball(lap=3.0), Camera(tilt=45.0), drone=Drone(v_max=1.0), seed=4)
    assert changed == wanted
    assert load(wanted) is wanted
    assert load(wanted, seed=None).seed is None
    assert load("A60", task="line").task == load("A60", task={"line": {}}).task == Line()
    assert load("A60", task=Line(side=2.0), ground=Ground(texture=0.1)).task.side == 2.0
    assert load("B60", load={"mass": 0.5}).load.mass == 0.5  # it holds its height
    assert replace(load("B60"), task=load("B60-bounce").task).axes == 2


@given(st.floats(1.0, 90.0), st.floats(0.001, 20.0), st.integers(1, 10_000))
def test_values_go_through_files_and_words_unchanged(tilt, v_max, step_us):
    changed = load("B60", **{"camera.tilt": tilt, "drone.v_max": v_max, "step": 0.1 + step_us / 1000.0})
    assert (changed.camera.tilt, changed.drone.v_max, changed.step) == (tilt, v_max, 0.1 + step_us / 1000.0)
    assert Scenario.from_words(changed.as_words()) == changed
