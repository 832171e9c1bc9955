"""The commands: what they write and print, and what they tell of mistakes."""

import contextlib
import io
import json
import re
import runpy
import sys
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from gymnasium import spaces

import neuro_agent
from neuro import ModelError
from neuro.results import read as results_of
from neuro_agent import compare, environments, training
from refused import mistakes_of

WALK = """\
import gymnasium
import numpy as np
from gymnasium import spaces


class Walk(gymnasium.Env):
    observation_space = spaces.Discrete(4)
    action_space = spaces.Discrete(2)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.at, self.steps = 1, 0
        return self.at, {}

    def step(self, action):
        self.at, self.steps = min(3, max(0, self.at + 2 * int(action) - 1)), self.steps + 1
        return self.at, float(self.at == 3), self.at == 3, self.steps == 20, {}


gymnasium.register("Walk-v0", Walk, reward_threshold=0.9)
"""


@pytest.fixture
def walk(neuro, tmp_path, registries):
    """A world of the user's own, in a file of the folder."""
    (tmp_path / "my_walk.py").write_text(WALK)
    yield
    import gymnasium

    gymnasium.registry.pop("Walk-v0", None)


def test_a_world_of_the_users_own_is_trained_tested_and_watched(neuro, walk):
    small = ("--set", "critics=10", "--set", "explore=50")
    code, out, err = neuro("train", "my_walk:Walk-v0", "--out", "walk.h5", "--seed", 1, "--steps", 20000, *small)
    assert (code, err) == (0, "")
    assert out.startswith("walk.h5: ")
    assert out.endswith(", solved\n")
    assert [path.name for path in Path().glob("*.h5*")] == ["walk.h5"]
    agent = neuro_agent.ActorCritic.load("walk.h5")
    assert (agent.seed, agent.settings.critics, agent.log.solved) == (1, 10, True)
    assert environments.remembered(Path("walk.h5")) == "my_walk:Walk-v0"
    code, out, _ = neuro("test", "walk.h5", "my_walk:Walk-v0", "--episodes", 5)
    assert (code, out) == (0, "my_walk:Walk-v0: 5 episodes, mean return 1, 95 % 1 to 1; it counts as solved at 0.9\n")
    told = json.loads(neuro("test", "walk.h5", "my_walk:Walk", "--episodes", 3, "--seed", 7, "--json")[1])
    assert (told["environment"], told["seed"], told["mean"], told["bar"]) == ("my_walk:Walk", 7, 1.0, None)
    assert told["returns"] == [1.0] * 3
    code, out, _ = neuro("watch", "walk.h5", "my_walk:Walk-v0", "--out", "page.html", "--learning")
    assert code == 0
    assert out.startswith("page.html: ")
    assert out.endswith(" steps, return 1, terminated; no frames, the environment renders no rgb_array\n")
    assert "learning continues" in Path("page.html").read_text()


@pytest.mark.parametrize("name", ["Acrobot-v1", "MountainCar-v0"])
def test_its_description_learns_the_same_by_run(neuro, answer, name):
    words = ("--steps", 2000, "--seed", 101)
    assert neuro("train", name, "--out", "agent.h5", "--save", "net.yaml", "--set", "critics=30", *words).status == 0
    assert answer("run", "net.yaml", "--out", "run.h5", *words).status == 0
    results = results_of("run.h5")
    for projection, weights in neuro_agent.ActorCritic.load("agent.h5").weights.items():
        assert np.any(weights)
        assert np.array_equal(results.weights(projection)[2].ravel(), weights.ravel())


PICTURED = """
class Pictured(gymnasium.Wrapper):
    metadata = property(lambda self: {"render_modes": ["rgb_array"]})
    def __init__(self, render_mode=None):
        super().__init__(Walk())
        self.mode = render_mode
    render_mode = property(lambda self: self.mode)
    def render(self):
        return np.zeros((4, 4, 3), np.uint8)
class Blank(Walk):
    metadata = {"render_modes": ["rgb_array"]}
"""


def test_a_wrapper_is_watched_and_so_is_what_takes_no_mode(neuro, walk):
    with Path("my_walk.py").open("a") as file:
        file.write(PICTURED)
    few = ("--set", "critics=5", "--set", "explore=30")
    assert neuro("train", "my_walk:Pictured", "--out", "walk.h5", "--steps", 60, *few).status == 0
    refused = neuro("watch", "walk.h5", "--out", "page.html")
    assert refused.status == 2
    assert "was trained in 'my_walk:Pictured', which runs the module my_walk" in refused.err
    assert " frames" in neuro("watch", "walk.h5", "my_walk:Pictured", "--out", "page.html").out
    told = neuro("watch", "walk.h5", "my_walk:Blank", "--out", "page.html").out
    assert told.endswith("no frames, the environment's render_mode is None: expected 'rgb_array'\n")


def test_an_interruption_is_told(neuro, walk, monkeypatch):
    with Path("my_walk.py").open("a") as file:
        file.write(
            "class Left(Walk):\n    def step(self, action):\n        raise KeyboardInterrupt\n"
            "class Late(Walk):\n    moves = 0\n    def step(self, action):\n        Late.moves += 1\n"
            "        if Late.moves == 200:\n            raise KeyboardInterrupt\n        return super().step(action)\n"
        )
    few = ("--set", "critics=5", "--set", "explore=30")
    answer = neuro("train", "my_walk:Left", "--steps", 100, "--out", "walk.h5")
    assert answer == (130, "", "Interrupted before the first checkpoint (10,000 steps). Nothing was kept.\n")
    monkeypatch.setattr(training, "BLOCK", 50)
    answer = neuro("train", "my_walk:Late", "--steps", 300, "--out", "late.h5", *few)
    assert answer == (130, "", "Interrupted. Run the same command again to resume from the last checkpoint.\n")
    Path("late.h5.training").unlink()
    assert not list(Path().glob("*.h5*"))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*Overriding environment")  # of my_walk.py, which this process runs twice
def test_agents_and_pages_are_made_again_to_the_bit(neuro, answer, walk):
    words = ("--steps", 300, "--set", "critics=5", "--set", "explore=30")
    assert neuro("train", "my_walk:Walk", "--out", "walk.h5", *words).status == 0
    assert neuro("watch", "walk.h5", "my_walk:Walk", "--out", "page.html").status == 0
    assert "it was made with my_walk.py\n  hint: if you trust this file, add --with" in answer("rerun", "walk.h5").err
    for name in ("walk.h5", "page.html"):
        assert answer("rerun", name, "--with", "my_walk.py").out == f"{name}: the same bits\n"


def test_one_episode_or_several_side_by_side(neuro, walk):
    neuro("train", "my_walk:Walk", "--out", "walk.h5", "--steps", 30, "--set", "critics=5")
    assert neuro("test", "walk.h5", "my_walk:Walk", "--episodes", 1).out.startswith("my_walk:Walk: 1 episode, return ")
    assert json.loads(neuro("test", "walk.h5", "my_walk:Walk", "--episodes", 1, "--json").out)["interval"] is None
    words = ("--envs", 3, "--episodes", 6, "--until", 2, "--set", "critics=5", "--set", "explore=30")
    code, out, _ = neuro("train", "my_walk:Walk", "--out", "walk.h5", *words)
    assert code == 0
    assert " episodes, " in out
    assert out.endswith(", not solved\n")
    assert len(neuro_agent.ActorCritic.load("walk.h5").log) >= 6


def test_controls(neuro, walk):
    words = ("--steps", 200, "--episodes", 2, "--set", "critics=5", "--set", "explore=30")
    code, out, _ = neuro("controls", "my_walk:Walk", *words)
    assert code == 0
    rows = [line.split() for line in out.splitlines() if line.strip()]
    assert [row[0] for row in rows[3:]] == ["agent", "shuffled", "frozen", "random", "scrambled"]


def test_compare(neuro, walk):
    words = ("compare", "my_walk:Walk", "--steps", 200, "--seeds", "1,2", "--episodes", 3)
    words = (*words, "--method", "agent", "--method", "random", "--set", "critics=5", "--set", "explore=30")
    code, out, _ = neuro(*words, "--out", "table.json")
    assert code == 0
    told = json.loads(Path("table.json").read_text())
    assert out.splitlines()[0] == told["winner"]
    assert "mean return" in told["winner"]
    assert [(one["name"], one["seed"], one["steps"]) for one in told["each"]] == [
        ("agent", 1, 200), ("agent", 2, 200), ("random", 1, 0), ("random", 2, 0)
    ]  # fmt: skip
    assert neuro(*words, "--out", "table.json")[0] == 0
    Path("table.json").write_text(Path("table.json").read_text().replace("wins", "loses"))
    assert neuro(*words, "--out", "table.json")[2].startswith("error: table.json: exists and ")


FAULTS = """
class Raises(Walk):
    def step(self, action):
        raise OSError("no camera")
class Fails(Raises):
    pass

class Endless(Walk):
    def step(self, action):
        return 1, 1.0, False, False, {}
class Bare(gymnasium.Env):
    action_space = spaces.Discrete(2)
"""


def test_compare_ends_where_episodes_do_not_and_tells_what_an_environment_raises(neuro, walk, monkeypatch):
    monkeypatch.setattr(compare, "MOST", 30)
    with Path("my_walk.py").open("a") as file:
        file.write(FAULTS)
    words = ("--steps", 10, "--seeds", 1, "--episodes", 2, "--method", "random", "--out", "table.json")
    assert neuro("compare", "my_walk:Endless", *words).status == 0
    assert json.loads(Path("table.json").read_text())["each"][0]["returns"] == [30.0, 30.0]


@pytest.mark.slow
def test_what_an_environment_raises_in_a_training_of_stable_baselines(walk):
    if find_spec("stable_baselines3") is None:
        pytest.skip("stable-baselines3 is not installed: pip install stable-baselines3")
    with Path("my_walk.py").open("a") as file:
        file.write(FAULTS)
    with pytest.raises(ModelError, match=r"^PPO of stable-baselines3, defaults: OSError: no camera$"):
        compare.run(compare.Plan("my_walk:Raises", 10, (1,), 2, {}, ("ppo",)))


@pytest.mark.slow
@pytest.mark.parametrize("observations", ["Discrete", "Dict"])
def test_compare_with_stable_baselines(walk, monkeypatch, observations):
    if find_spec("stable_baselines3") is None:
        pytest.skip("stable-baselines3 is not installed: pip install stable-baselines3")
    if observations == "Dict":
        with Path("my_walk.py").open("a") as file:
            file.write(
                "class Named(gymnasium.ObservationWrapper):\n"
                "    def __init__(self):\n        super().__init__(Walk())\n"
                "        self.observation_space = spaces.Dict({'at': spaces.Box(0, 3, (1,))})\n"
                "    def observation(self, seen):\n        return {'at': np.array([seen], np.float32)}\n"
            )
    name = "my_walk:Named" if observations == "Dict" else "my_walk:Walk"
    plan = compare.Plan(name, 300, (1,), 2, {"critics": 5, "explore": 30}, ("agent", "ppo", "dqn"))
    told = []
    found = compare.run(plan, told.append)
    assert [(one["name"], one["steps"], len(one["returns"])) for one in found.each] == [
        ("agent", 300, 2), ("ppo", 256, 2), ("dqn", 300, 2)
    ]  # fmt: skip
    assert len(told) == 3


def test_joules_of_a_deep_training(neuro, walk):
    if find_spec("stable_baselines3") is None:
        pytest.skip("stable-baselines3 is not installed: pip install stable-baselines3")
    with Path("my_walk.py").open("a") as file:
        file.write(STARTS)
    assert "--until = .nan: expected a finite number" in neuro("energy", "my_walk:Starts", "--until", "nan")[2]
    words = ("energy", "my_walk:Starts", "--steps", 128, "--chips", "cpu,gpu")
    told = json.loads(neuro(*words, "--json")[1])
    critic = 1 * 64 + 64 * 64 + 64 * 1
    both = critic + 1 * 64 + 64 * 64 + 64 * 3
    batches, parameters = 10 * 128 // 64, both + 4 * 64 + 1 + 3
    taught = 10 * 128 * both
    macs = {
        "layers, forward": taught + 128 * both + critic,  # the value behind the rollout
        "layers, backward": 2 * taught,
        "optimiser": 5 * batches * parameters,
    }
    cpu, gpu = told["bills"]
    assert {item["of"]: item["count"] for item in cpu["items"]} == macs
    assert (told["steps"], told["episodes"], told["solved"]) == (128, 12, None)
    assert gpu["total_high_j"] == pytest.approx(sum(macs.values()) * 172.5e-9)
    out = neuro(*words, "--until", 0, "--steps", 2048, "--sources").out
    assert "\nppo: 100 episodes, 1,000 steps, mean return of the last 100: " in out
    assert out.endswith(", solved\n")
    assert "Degnan" in out


STARTS = """
class Starts(gymnasium.Env):
    observation_space = spaces.Box(0, 1, (1,))

    def __init__(self):
        self.action_space = spaces.Discrete(3, start=-1)

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.moves = 0
        return np.zeros(1, np.float32), {}

    def step(self, action):
        assert self.action_space.contains(action), action
        self.moves += 1
        return np.zeros(1, np.float32), float(np.ravel(action)[0] == -1), self.moves == 10, False, {}


class Several(Starts):
    def __init__(self):
        self.action_space = spaces.MultiDiscrete([3, 2], start=[-1, 5])"""


@pytest.mark.parametrize("name", ["Starts", "Several"])
def test_actions_that_do_not_start_at_zero_are_those_of_the_space(walk, name):
    if find_spec("stable_baselines3") is None:
        pytest.skip("stable-baselines3 is not installed: pip install stable-baselines3")
    with Path("my_walk.py").open("a") as file:
        file.write(STARTS)
    found = compare.run(compare.Plan(f"my_walk:{name}", 256, (1,), 2, {}, ("ppo",)))
    assert (found.failed, found.mean("ppo")) == ({}, 10.0)


def test_spaces_that_stable_baselines_does_not_take_are_named(messages):
    lacks = {}
    for space in (
        spaces.Discrete(3, start=1), spaces.Dict({"a": spaces.MultiDiscrete([2, 3], start=[0, 1])}),
        spaces.MultiDiscrete([[2, 3], [4, 5]]), spaces.MultiBinary((2, 3)), spaces.Tuple([spaces.Discrete(2)]),
        spaces.MultiBinary(3), spaces.MultiDiscrete([2, 3]), spaces.Box(0, 1, (2, 2)),
    ):  # fmt: skip
        lacks[" ".join(str(space).split())] = compare._refused_observations(space)
    messages(lacks)


def test_a_baseline_that_fails_loses_no_other_training(walk, monkeypatch):
    def fails(trial, env):
        raise compare.BaselineError("PPO of stable-baselines3, defaults: no such space")

    monkeypatch.setitem(compare._TRAINERS, "ppo", fails)
    monkeypatch.setattr(compare, "side_by_side", lambda run, jobs, report: [run(job, report) for job in jobs])
    monkeypatch.setattr(compare, "find_spec", lambda name: True)
    found = compare.run(compare.Plan("my_walk:Walk", 10, (1,), 2, {}, ("random", "ppo")), lambda text: None)
    assert (found.names, found.left_out["ppo"]) == (["random"], "PPO of stable-baselines3, defaults: no such space")


def test_who_takes_part_and_wins(monkeypatch):
    def found(**returns):
        plan = compare.Plan("FrozenLake-v1", 10, (1, 2))
        each = [{"name": n, "seed": k, "returns": [r]} for n, pair in returns.items() for k, r in enumerate(pair)]
        return compare.Comparison(plan, tuple(each)).winner

    told = "agent wins: mean return 15, then ppo 12; better with 1 of 2 seeds"
    assert found(random=(1, 2), ppo=(12, 12), agent=(20, 10)) == told
    assert found(ppo=(3, 3), agent=(2, 4), random=(0, 0)) == "tie: ppo, agent have the mean return 3"
    assert found(agent=(1, 2)) == "agent: mean return 1.5; no other method took part"
    assert compare.Plan("Pendulum-v1", 10, (1,)).left_out["dqn"]
    monkeypatch.setattr(compare, "find_spec", lambda name: None)
    plan = compare.Plan("CartPole-v1", 10, (1,))
    assert list(plan.left_out) == ["ppo", "dqn"]
    assert plan.left_out["ppo"].startswith("stable-baselines3 is not installed: pip install ")
    assert [trial.name for trial in plan.trials] == ["agent", "twin", "random"]


def test_mistakes(neuro, walk, tmp_path, messages):
    with Path("my_walk.py").open("a") as file:
        file.write(FAULTS)
    (tmp_path / "my_fault.py").write_text("1 / 0")
    (tmp_path / "my_need.py").write_text("import not_there")
    messages(mistakes_of(neuro, messages.cases))
    assert not list(Path().glob("*.h5"))


def test_an_agent_for_another_environment(neuro, lake):
    lake.save("lake.h5")
    answer = neuro("test", "lake.h5")
    assert answer.err == "error: lake.h5: names no environment: expected ENV after the file\n"
    answer = neuro("test", "lake.h5", "CartPole-v1")
    assert answer.status == 2
    assert answer.err.endswith("expected Discrete(16), for which the agent was made\n")
    assert neuro("watch", "lake.h5", "Taxi-v4", "--out", "page.html").status == 2
    assert not Path("page.html").exists()


def test_what_an_environment_needs_is_named(neuro, monkeypatch):
    import gymnasium

    def make(*words, **named):
        raise gymnasium.error.DependencyNotInstalled('Box2D is missing, run `pip install "gymnasium[box2d]"`')

    monkeypatch.setattr(gymnasium, "make", make)
    answer = neuro("train", "LunarLander-v3", "--out", "a.h5")
    told = "environment 'LunarLander-v3': it needs gymnasium[box2d]: pip install 'gymnasium[box2d]'"
    assert answer.err == f"error: {told}\n"
    monkeypatch.setitem(sys.modules, "minigrid", None)
    for name in ("MiniGrid-Empty-5x5-v0", "minigrid:MiniGrid-Empty-5x5-v0"):
        told = neuro("train", name, "--steps", 10, "--out", "a.h5").err
        assert told.startswith(f"error: environment '{name}': minigrid is not installed\n  hint: pip install ")
        assert "[agent]" in told


@pytest.fixture
def folder(answer, tmp_path, monkeypatch):
    """A folder as the command writes it, with the current one in it; its modules are forgotten afterwards."""
    monkeypatch.chdir(tmp_path)
    written = answer("new", "mine", "--template", "agent")
    assert written.out == (
        "mine: made from agent\nfiles: test_world.py, train.py, world.py\n"
        "next:\n  cd mine\n  python train.py\n  python -m pytest     # needs pytest: pip install pytest\n"
        "  neuro agent watch agent.h5 world:Room --out episode.html\n"
    )
    monkeypatch.chdir("mine")
    monkeypatch.syspath_prepend(Path.cwd())
    yield answer
    for name in ("world", "train"):
        sys.modules.pop(name, None)


def test_list(answer):
    listed = answer("new", "--list").out
    assert re.search(r"agent +Agent: spiking neurons learn by reward in an environment of your own *\n", listed)


@pytest.fixture
def cut(monkeypatch):
    """Let trainings end sooner."""
    train = neuro_agent.ActorCritic.train

    def cut(most):
        monkeypatch.setattr(
            neuro_agent.ActorCritic, "train", lambda self, env, steps: train(self, env, steps=min(steps, most))
        )

    return cut


def test_the_script_runs_and_the_page_is_written(folder, cut):
    cut(500)
    printed = io.StringIO()
    with contextlib.redirect_stdout(printed):
        runpy.run_path("train.py", run_name="__main__")
    assert re.fullmatch(r"untrained: \d+ of 100 steps .*\ntrained: \d+ of 100 steps .*\n", printed.getvalue())
    told = folder("agent", "watch", "agent.h5", "world:Room", "--out", "episode.html")
    assert told.err == ""
    assert re.fullmatch(r"episode\.html: 100 steps, return \d+, cut off by the environment; 101 frames\n", told.out)


def test_its_tests_pass_as_written(folder, cut):
    cut(2500)
    tests = {name: f for name, f in runpy.run_path("test_world.py").items() if name.startswith("test_")}
    assert len(tests) == 2
    for test in tests.values():
        test()
