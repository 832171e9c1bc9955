"""The page of an episode: what it holds, and what a browser makes of it."""

import base64
import io
import re
from functools import partial
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces
from PIL import Image

import neuro_agent
from neuro_agent import watch as watching
from neuro_agent.watch import page, played, watch
from players import tracks_of
from refused import refusals_of


class Corridor(gymnasium.Env):
    """Five numbers of an action move along a corridor to its end."""

    metadata = {"render_modes": ["rgb_array"]}
    observation_space = spaces.Dict({"at": spaces.Box(0.0, 1.0, (1,)), "open": spaces.Discrete(2)})
    action_space = spaces.Box(-1.0, 1.0, (1,))
    render_mode = "rgb_array"

    def __init__(self, picture=lambda self: np.full((40, 60, 3), 200, np.uint8)):
        self.picture = picture

    def reset(self, *, seed=None, options=None):
        super().reset(seed=seed)
        self.x, self.steps = 0.0, 0
        return self._seen(), {}

    def step(self, action):
        self.x, self.steps = min(1.0, max(0.0, self.x + 0.2 * float(action[0]))), self.steps + 1
        return self._seen(), float(self.x == 1.0) - 0.1, self.x == 1.0, self.steps == 400, {}

    def _seen(self):
        return {"at": np.array([self.x], np.float32), "open": self.steps % 2}

    def render(self):
        return self.picture(self)


@pytest.fixture(scope="module")
def agent():
    env = Corridor()
    one = neuro_agent.ActorCritic(env.observation_space, env.action_space, seed=2, critics=20, explore=100)
    one.train(env, steps=300)
    return one


@pytest.fixture(scope="module")
def episode(agent):
    return played(agent, Corridor(), seed=5)


def test_an_episode_is_the_first_of_a_test_and_leaves_the_agent(agent, lake, episode):
    tested = agent.test(Corridor(), 1, seed=5)
    assert (episode.moves, sum(episode.rewards)) == (tested.lengths[0], pytest.approx(tested.returns[0]))
    env = gymnasium.make("FrozenLake-v1", is_slippery=False)
    found, tested = played(lake, env, seed=4), lake.test(env, 1, seed=4)
    assert (found.moves, sum(found.rewards), found.observations[0]) == (tested.lengths[0], tested.returns[0], 0)
    assert found.end in ("terminated", "cut off by the environment")
    assert list(episode.weights) == [0]
    before, learnt = agent.weights, played(agent, Corridor(), seed=5, learning=True)
    assert not np.array_equal(learnt.weights[0], list(learnt.weights.values())[-1])
    assert all(np.array_equal(each, before[name]) for name, each in agent.weights.items())
    gamma, n = agent.settings.discount, episode.moves
    assert np.isnan(episode.errors[0])
    for k in range(1, n + 1):
        after = 0.0 if k == n and episode.end == "terminated" else gamma * episode.values[k]
        assert episode.errors[k] == pytest.approx(episode.rewards[k] + after - episode.values[k - 1])


def test_the_page_holds_it(agent, episode, monkeypatch):
    text = page(agent, episode, 5)
    data, n = tracks_of(text), episode.moves + 1
    policy, (places, critics, _), weights = data["policy"], data["raster"]["strips"], data["weights"]
    assert policy["labels"] == ["-1", "-0.667", "-0.333", "0", "0.333", "0.667", "1"]
    assert data["state"]["labels"] == ["['at'][0]", "['open']"]
    assert policy["values"].reshape(n, 7).sum(axis=1) == pytest.approx(1.0)
    spikes = np.bincount(critics["times"], critics["level"], minlength=n) * np.max(episode.critic) / 255
    assert spikes == pytest.approx([c.sum() for c in episode.critic], abs=0.5)
    assert np.array_equal(places["ids"][places["times"] == 1], agent.places.cells(episode.observations[1]))
    assert data["traces"]["lanes"][2]["lines"][0]["y"] == pytest.approx(np.cumsum(episode.rewards), abs=1e-5)
    pictured = weights["values"].reshape(7, weights["columns"]) * weights["largest"] / 127
    assert pictured == pytest.approx(agent.weights["policy0"].T, abs=weights["largest"] / 100)
    assert all(word in text for word in (f"{episode.moves} steps, return {sum(episode.rewards):g}", "weights frozen"))
    assert "http" not in text.replace("http-equiv", "")
    monkeypatch.setattr(watching, "COLUMNS", 40)
    weights = agent.weights["policy0"]
    found, each = watching._columns(weights), -(-len(weights) // 40)
    assert found.shape == (7, -(-len(weights) // each))
    assert np.abs(found).max(axis=1) == pytest.approx(np.abs(weights).max(axis=0))
    mute = Corridor()
    mute.render_mode = None
    assert played(agent, mute).blank == "the environment's render_mode is None: expected 'rgb_array'"
    mute.metadata = {}
    assert played(agent, mute).blank == "the environment renders no rgb_array"


def test_frames_are_small_pictures_at_most_so_many(agent, monkeypatch):
    monkeypatch.setattr(watching, "FRAMES", 8)
    monkeypatch.setattr(watching, "WIDTH", 30)
    monkeypatch.setattr(watching, "STEPS", 50)
    slow = neuro_agent.ActorCritic(agent.observations, agent.actions.space, seed=1, critics=20)
    never = Corridor()
    never.step = lambda action: (never._seen(), 0.0, False, False, {})
    found = played(slow, never)
    assert (found.moves, found.end, list(found.frames)) == (50, "cut off after 50 steps", [0, 8, 16, 24, 32, 40, 48])
    kind, content = found.frames[8].removeprefix("data:image/").split(";base64,")
    image = Image.open(io.BytesIO(base64.b64decode(content)))
    assert (image.format.lower(), image.size) == (kind, (30, 20))


def fails(self):
    raise gymnasium.error.DependencyNotInstalled('run `pip install "gymnasium[toy-text]"`')


def test_frames_that_cannot_be_rendered_are_told(agent, tmp_path, messages):
    pictures = {"needs": fails, "none": lambda self: None, "floats": lambda self: np.ones((4, 4, 3)),
                "raises": lambda self: 1 / 0}  # fmt: skip
    told = {name: str(watch(agent, Corridor(each), tmp_path / f"{name}.html", 5)) for name, each in pictures.items()}
    assert all("frame" not in tracks_of((tmp_path / f"{name}.html").read_text()) for name in pictures)
    messages({name: text.rpartition("; no frames, ")[2] for name, text in told.items()})


def test_only_pages_of_ours_are_replaced(agent, tmp_path, messages):
    file = tmp_path / "page.html"
    watch(agent, Corridor(), file)
    watch(agent, Corridor(), file)
    file.write_text(file.read_text().replace("Weights of the policy", "My weights"))
    vector = gymnasium.vector.SyncVectorEnv([Corridor, Corridor])
    messages(refusals_of(messages.cases, globals() | locals(), tmp_path=tmp_path))
    assert [path.name for path in tmp_path.iterdir()] == ["page.html"]


STEPS = Path(__file__).with_name("steps.html").read_text("utf-8")


@pytest.mark.parametrize("pictured", [True, False])
def test_a_browser_draws_it_moves_in_time_and_plays(agent, episode, tmp_path, chromium, pictured):
    chromium = partial(chromium, "--window-size=1280,1100")
    shown = episode if pictured else played(agent, Corridor(lambda self: None), seed=5)
    file, n = tmp_path / "episode.html", episode.moves
    file.write_text(page(agent, shown, 5).replace("</body>", STEPS), "utf-8")
    told = re.search("<title>(.*?)</title>", chromium("--dump-dom", f"file://{file}"))[1].split("|")
    assert told[:2] == [str(not pictured).lower(), f"step 2 of {n}"]
    assert told[2:4] == [f"{sum(episode.rewards[:3]):.3g}", f"step {n} of {n}"]
    assert told[4:8] == ["Pause", "0", "Play", f"step 1 of {n}"]
    names = ("policy", "raster", "traces", "weights", "state" if pictured else "large")
    assert told[8:] == [f"{name} drawn" for name in names]


def test_frames_of_gymnasium(lake, pygame):
    env = gymnasium.make("FrozenLake-v1", is_slippery=False, render_mode="rgb_array")
    found = played(lake, env)
    assert len(found.frames) == min(found.moves + 1, len(found.frames)) > 1
    assert found.blank == ""
