"""What the tests of agents share: small trainings, made once."""

import importlib.util
from functools import partial

import gymnasium
import pytest

import neuro_agent


@pytest.fixture(scope="session")
def pygame():
    """What the environments of gymnasium draw with, where it is."""
    if importlib.util.find_spec("pygame") is None:
        pytest.skip("pygame is not installed: pip install 'gymnasium[classic-control,toy-text]'")


@pytest.fixture(scope="session")
def lake():
    """An agent that has learnt a little on a frozen lake that is not slippery."""
    env = gymnasium.make("FrozenLake-v1", is_slippery=False, render_mode="rgb_array")
    agent = neuro_agent.ActorCritic(env.observation_space, env.action_space, seed=3, critics=10)
    agent.explored = True  # nothing has to be learnt of 16 states; random moves find the one reward after thousands
    agent.train(env, steps=300)
    return agent


@pytest.fixture
def neuro(answer, monkeypatch, tmp_path):
    """Run `neuro agent ...` in an empty folder; exit status, stdout and stderr."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("os.sched_getaffinity", lambda pid: {0})  # trials one after the other, in this process
    return partial(answer, "agent")
