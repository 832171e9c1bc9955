"""An agent beside others on the same control steps and seeds, each tested frozen in the same new episodes."""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib.util import find_spec
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces

from neuro import ModelError
from neuro.apps import Environments, Test, episode_seed, install, side_by_side, unknown
from neuro_agent import environments
from neuro_agent.agent import ActorCritic
from neuro_agent.deep import NAMES as DEEP, BaselineError, from_zero, starts, trained
from neuro_agent.training import MOST, TESTS
from neuro_agent.twin import LinearTwin

NAMES = {
    "agent": "spiking agent",
    "twin": "its linear twin, without spikes",
    **DEEP,
    "random": "random actions",
}

Act = Callable[[Any], Any]


@dataclass(frozen=True, slots=True)
class Trial:
    """A training and its test.

    Attributes:
        name: who, see `NAMES`.
        environment: its name.
        steps: control steps of the training.
        seed: of the training.
        episodes: of the test.
        settings: of the agent and its twin.
    """

    name: str
    environment: str
    steps: int
    seed: int
    episodes: int
    settings: Mapping[str, Any]

    def run(self, report: Callable[[str], None]) -> dict[str, Any]:
        """Train and test; the figures as plain data."""
        env = environments.make(self.environment)
        began = time.perf_counter()
        try:
            steps, test = _TRAINED[self.name](self, env)
        except BaselineError as error:  # the trainings of the others are not lost
            report(f"{self.name}, seed {self.seed}: {error}")
            return {"name": self.name, "seed": self.seed, "failed": str(error)}
        told = {
            "name": self.name,
            "seed": self.seed,
            "steps": steps,
            "seconds": round(time.perf_counter() - began, 2),
            "returns": test.returns.tolist(),
        }
        report(f"{self.name}, seed {self.seed}: mean return {test.mean:g}")
        return told


@dataclass(frozen=True, slots=True)
class Plan:
    """What is to be compared.

    Attributes:
        environment, steps, episodes, settings: as of `Trial`.
        seeds: of the trainings.
        only: names of those that are wanted; all that can be if none are given.

    Raises:
        ModelError: a name is unknown, one that is asked for cannot be, or a seed is there twice.
    """

    environment: str
    steps: int
    seeds: tuple[int, ...]
    episodes: int = 100
    settings: Mapping[str, Any] = field(default_factory=dict)
    only: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in self.only:
            if name not in NAMES:
                raise unknown("contestant", name, NAMES)
            if name in self.left_out:
                raise ModelError(f"'{name}' cannot be compared: {self.left_out[name]}")
        if len(set(self.seeds)) < len(self.seeds):
            raise ModelError(f"seeds {self.seeds}: found one twice: expected each once")
        env = environments.make(self.environment)
        ActorCritic(env.observation_space, env.action_space, **self.settings)

    @property
    def left_out(self) -> dict[str, str]:
        """Who cannot take part, and why."""
        env = environments.make(self.environment)
        found: dict[str, str] = {}
        if find_spec("stable_baselines3") is None:
            reason = f"stable-baselines3 is not installed: {install('rl')}"
            return {"ppo": reason, "dqn": reason}
        if not isinstance(env.action_space, spaces.Discrete):
            found["dqn"] = "it takes Discrete actions only"
        if reason := _refused_observations(env.observation_space) or _refused_actions(env.action_space):
            found |= dict.fromkeys(("ppo", "dqn"), reason)
        return found

    @property
    def trials(self) -> list[Trial]:
        """All trainings and tests."""
        left = self.left_out
        names = [name for name in NAMES if name in self.only or not (self.only or name in left)]
        each = (self.episodes, self.settings)
        return [Trial(name, self.environment, self.steps, seed, *each) for name in names for seed in self.seeds]


@dataclass(frozen=True, slots=True)
class Found:
    """What came of a comparison.

    Attributes:
        plan: what was compared.
        each: figures of each trial.
        failed: why others have no figures, by name.
    """

    plan: Plan
    each: tuple[Mapping[str, Any], ...]
    failed: Mapping[str, str] = field(default_factory=dict)

    @property
    def left_out(self) -> dict[str, str]:
        """Names of those that did not take part or failed, and why."""
        return {**self.plan.left_out, **self.failed}

    @property
    def names(self) -> list[str]:
        """Who took part, the best first."""
        there = dict.fromkeys(one["name"] for one in self.each)
        return sorted(there, key=lambda name: -self.mean(name))

    def means(self, name: str) -> list[float]:
        """The mean return of each seed."""
        return [float(np.mean(one["returns"])) for one in self.each if one["name"] == name]

    def mean(self, name: str) -> float:
        """The mean over the seeds."""
        return float(np.mean(self.means(name)))

    @property
    def winner(self) -> str:
        """Who wins, in a line."""
        first, *others = self.names
        if not others:
            return f"{first}: mean return {self.mean(first):.5g}; nobody else took part"
        second = others[0]
        here, there = self.means(first), self.means(second)
        if self.mean(first) == self.mean(second):
            level = [name for name in self.names if self.mean(name) == self.mean(first)]
            return f"nobody wins: {', '.join(level)} have the mean return {self.mean(first):.5g}"
        better = sum(a > b for a, b in zip(here, there, strict=True))
        return (
            f"{first} wins: mean return {self.mean(first):.5g}, then {second} {self.mean(second):.5g}; "
            f"it is better with {better} of {len(here)} seeds"
        )


def _refused_observations(space: gymnasium.Space[Any]) -> str:
    """Return why stable-baselines3 does not take observations of a space; "" if it does."""
    parts = list(space.spaces.values()) if isinstance(space, spaces.Dict) else [space]
    if any(isinstance(part, (spaces.Dict, spaces.Tuple)) for part in parts):
        return "it takes no Tuple of observations, and no Dict in a Dict"
    if any(starts(part).any() for part in parts):
        return "it takes no observations with a start other than 0"
    if any(isinstance(part, (spaces.MultiDiscrete, spaces.MultiBinary)) and len(part.shape) != 1 for part in parts):
        return "it takes no MultiDiscrete or MultiBinary observations of several dimensions"
    return ""


def _refused_actions(space: gymnasium.Space[Any]) -> str:
    """Return why stable-baselines3 does not take actions of a space; "" if it does."""
    if isinstance(space, (spaces.MultiDiscrete, spaces.MultiBinary)) and len(space.shape) != 1:
        return "it takes no MultiDiscrete or MultiBinary actions of several dimensions"
    return ""


def run(plan: Plan, report: Callable[[str], None] | None = None) -> Found:
    """Train and test all, on all cores.

    Args:
        plan: what to compare.
        report: is told of each trial that is done.

    Raises:
        ModelError: of the first trial of the agent, its twin or random actions that raises one; of a baseline where
            nothing else was compared.
    """
    each = side_by_side(Trial.run, plan.trials, report=report)
    failed = {one["name"]: one["failed"] for one in each if "failed" in one}
    if failed and len(failed) == len({one["name"] for one in each}):
        raise ModelError(next(iter(failed.values())))
    return Found(plan, tuple(one for one in each if one["name"] not in failed), failed)


def _agent(trial: Trial, env: gymnasium.Env[Any, Any]) -> tuple[int, Test]:
    kind = ActorCritic if trial.name == "agent" else LinearTwin
    agent = kind(env.observation_space, env.action_space, seed=trial.seed, **trial.settings)
    agent.train(env, steps=trial.steps)
    return trial.steps, agent.test(env, trial.episodes)


def _random(trial: Trial, env: gymnasium.Env[Any, Any]) -> tuple[int, Test]:
    env.action_space.seed(trial.seed)
    return 0, _tested(trial, env, lambda seen: env.action_space.sample())


def _baseline(trial: Trial, env: gymnasium.Env[Any, Any]) -> tuple[int, Test]:
    env, discrete = from_zero(env), isinstance(env.action_space, spaces.Discrete)
    model = trained(trial.name, env, steps=trial.steps, seed=trial.seed)[0]

    def act(seen: Any) -> Any:
        action = model.predict(seen, deterministic=True)[0]
        return action.item() if discrete else action

    return int(model.num_timesteps), _tested(trial, env, act)


def _tested(trial: Trial, env: gymnasium.Env[Any, Any], act: Act) -> Test:
    """The episodes that `ActorCritic.test` has."""
    returns, lengths = np.zeros(trial.episodes), np.zeros(trial.episodes, dtype=np.int64)
    one = Environments(env)
    with one.watched():
        for k in range(trial.episodes):
            one.reset([episode_seed(0, TESTS + k)])
            while not one.over[0] and lengths[k] < MOST:
                returns[k] += one.step([act(one.found)], [0])[1][0]
                lengths[k] += 1
    return Test(returns, lengths)


_TRAINED = {"agent": _agent, "twin": _agent, "ppo": _baseline, "dqn": _baseline, "random": _random}
