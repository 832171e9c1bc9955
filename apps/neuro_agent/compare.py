"""Comparison of an agent with other methods: same control steps and seeds, each tested frozen in the same episodes."""

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
    """The training of a method with a seed, and the test.

    Attributes:
        name: name of the method, see `NAMES`.
        environment: name of the environment.
        steps: control steps of the training.
        seed: seed of the training.
        episodes: episodes of the test.
        settings: settings of the agent and its twin.
    """

    name: str
    environment: str
    steps: int
    seed: int
    episodes: int
    settings: Mapping[str, Any]

    def run(self, report: Callable[[str], None]) -> dict[str, Any]:
        """Train and test; return the results as plain data."""
        env = environments.make(self.environment)
        start_time = time.perf_counter()
        try:
            steps, test = _TRAINERS[self.name](self, env)
        except BaselineError as error:  # results of the other trials are kept
            report(f"{self.name}, seed {self.seed}: {error}")
            return {"name": self.name, "seed": self.seed, "failed": str(error)}
        results = {
            "name": self.name,
            "seed": self.seed,
            "steps": steps,
            "seconds": round(time.perf_counter() - start_time, 2),
            "returns": test.returns.tolist(),
        }
        report(f"{self.name}, seed {self.seed}: mean return {test.mean:g}")
        return results


@dataclass(frozen=True, slots=True)
class Plan:
    """The trials of a comparison.

    Attributes:
        environment, steps, episodes, settings: as for `Trial`.
        seeds: seeds of the trainings.
        only: names of the methods to compare; if empty, all methods that the environment allows.

    Raises:
        ModelError: a name is unknown, a named method cannot take part, or a seed occurs twice.
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
            raise ModelError(f"seeds {self.seeds}: found a seed twice: expected each once")
        env = environments.make(self.environment)
        ActorCritic(env.observation_space, env.action_space, **self.settings)

    @property
    def left_out(self) -> dict[str, str]:
        """Methods that cannot take part, and the reasons."""
        env = environments.make(self.environment)
        reasons: dict[str, str] = {}
        if find_spec("stable_baselines3") is None:
            reason = f"stable-baselines3 is not installed: {install('rl')}"
            return {"ppo": reason, "dqn": reason}
        if not isinstance(env.action_space, spaces.Discrete):
            reasons["dqn"] = "it supports Discrete actions only"
        if reason := _refused_observations(env.observation_space) or _refused_actions(env.action_space):
            reasons |= dict.fromkeys(("ppo", "dqn"), reason)
        return reasons

    @property
    def trials(self) -> list[Trial]:
        """All trainings and tests."""
        excluded = self.left_out
        names = [name for name in NAMES if name in self.only or not (self.only or name in excluded)]
        common = (self.episodes, self.settings)
        return [Trial(name, self.environment, self.steps, seed, *common) for name in names for seed in self.seeds]


@dataclass(frozen=True, slots=True)
class Comparison:
    """Results of a comparison.

    Attributes:
        plan: the trials.
        each: results of each trial.
        failed: reasons of failed methods, by name.
    """

    plan: Plan
    each: tuple[Mapping[str, Any], ...]
    failed: Mapping[str, str] = field(default_factory=dict)

    @property
    def left_out(self) -> dict[str, str]:
        """Methods that did not take part or failed, and the reasons."""
        return {**self.plan.left_out, **self.failed}

    @property
    def names(self) -> list[str]:
        """Methods with results, the best first."""
        methods = dict.fromkeys(result["name"] for result in self.each)
        return sorted(methods, key=lambda name: -self.mean(name))

    def means(self, name: str) -> list[float]:
        """Return the mean return of each seed."""
        return [float(np.mean(result["returns"])) for result in self.each if result["name"] == name]

    def mean(self, name: str) -> float:
        """Return the mean over the seeds."""
        return float(np.mean(self.means(name)))

    @property
    def winner(self) -> str:
        """One line with the winner and the margin."""
        first, *other_names = self.names
        if not other_names:
            return f"{first}: mean return {self.mean(first):.5g}; no other method took part"
        second = other_names[0]
        first_means, second_means = self.means(first), self.means(second)
        if self.mean(first) == self.mean(second):
            tied = [name for name in self.names if self.mean(name) == self.mean(first)]
            return f"tie: {', '.join(tied)} have the mean return {self.mean(first):.5g}"
        better = sum(a > b for a, b in zip(first_means, second_means, strict=True))
        return (
            f"{first} wins: mean return {self.mean(first):.5g}, then {second} {self.mean(second):.5g}; "
            f"better with {better} of {len(first_means)} seeds"
        )


def _refused_observations(space: gymnasium.Space[Any]) -> str:
    """Return the reason why stable-baselines3 does not support the observations of a space; "" if it does."""
    parts = list(space.spaces.values()) if isinstance(space, spaces.Dict) else [space]
    if any(isinstance(part, (spaces.Dict, spaces.Tuple)) for part in parts):
        return "it supports no Tuple of observations, and no Dict in a Dict"
    if any(starts(part).any() for part in parts):
        return "it supports no observations with a start other than 0"
    if any(isinstance(part, (spaces.MultiDiscrete, spaces.MultiBinary)) and len(part.shape) != 1 for part in parts):
        return "it supports no MultiDiscrete or MultiBinary observations of several dimensions"
    return ""


def _refused_actions(space: gymnasium.Space[Any]) -> str:
    """Return the reason why stable-baselines3 does not support the actions of a space; "" if it does."""
    if isinstance(space, (spaces.MultiDiscrete, spaces.MultiBinary)) and len(space.shape) != 1:
        return "it supports no MultiDiscrete or MultiBinary actions of several dimensions"
    return ""


def run(plan: Plan, report: Callable[[str], None] | None = None) -> Comparison:
    """Train and test all methods, on all cores.

    Args:
        plan: the trials.
        report: receives a line for each finished trial.

    Raises:
        ModelError: the first error of the agent, its twin or random actions; an error of a baseline only if every
            method failed.
    """
    each = side_by_side(Trial.run, plan.trials, report=report)
    failed = {result["name"]: result["failed"] for result in each if "failed" in result}
    if failed and len(failed) == len({result["name"] for result in each}):
        raise ModelError(next(iter(failed.values())))
    return Comparison(plan, tuple(result for result in each if result["name"] not in failed), failed)


def _agent(trial: Trial, env: gymnasium.Env[Any, Any]) -> tuple[int, Test]:
    kind = ActorCritic if trial.name == "agent" else LinearTwin
    agent = kind(env.observation_space, env.action_space, seed=trial.seed, **trial.settings)
    agent.train(env, steps=trial.steps)
    return trial.steps, agent.test(env, trial.episodes)


def _random(trial: Trial, env: gymnasium.Env[Any, Any]) -> tuple[int, Test]:
    env.action_space.seed(trial.seed)
    return 0, _test(trial, env, lambda _: env.action_space.sample())


def _baseline(trial: Trial, env: gymnasium.Env[Any, Any]) -> tuple[int, Test]:
    env, discrete = from_zero(env), isinstance(env.action_space, spaces.Discrete)
    model = trained(trial.name, env, steps=trial.steps, seed=trial.seed)[0]

    def act(observation: Any) -> Any:
        action = model.predict(observation, deterministic=True)[0]
        return action.item() if discrete else action

    return int(model.num_timesteps), _test(trial, env, act)


def _test(trial: Trial, env: gymnasium.Env[Any, Any], act: Act) -> Test:
    """Test a method, given by its function from observation to action, in the episodes of `ActorCritic.test`."""
    returns, lengths = np.zeros(trial.episodes), np.zeros(trial.episodes, dtype=np.int64)
    worlds = Environments(env)
    with worlds.watched():
        for k in range(trial.episodes):
            worlds.reset([episode_seed(0, TESTS + k)])
            while not worlds.over[0] and lengths[k] < MOST:
                returns[k] += worlds.step([act(worlds.found)], [0])[1][0]
                lengths[k] += 1
    return Test(returns, lengths)


_TRAINERS = {"agent": _agent, "twin": _agent, "ppo": _baseline, "dqn": _baseline, "random": _random}
