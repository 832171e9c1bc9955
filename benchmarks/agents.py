"""Spiking agents on tasks of Gymnasium: episodes until a task is solved, and returns of the frozen agents.

    python benchmarks/agents.py [TASK ...] [--seeds 101-110] [--twin] [--set name=value ...] [--json FILE]
    python benchmarks/agents.py [TASK ...] [--seeds 101-103] --controls
    python benchmarks/agents.py [TASK ...] [--seeds 101-103] --chips

A training stops when the mean return of the last 100 episodes (FrozenLake: 500) reaches the bar of the task, or at the
limit of control steps. A seed that did not reach the bar counts with its episodes at the limit. The agent is then
frozen and tested on 100 (FrozenLake: 1,000) new episodes. The benchmark uses one process and one core.

`--controls` tests agents that cannot learn, which must fail. Each has as many control steps as most agents need. Its
figure is (frozen mean return - mean return of random moves) / (bar - mean return of random moves).

`--chips` runs the frozen agent for 30 episodes on `event`, Loihi and SpiNNaker, and prints microjoules per decision.
"""

from __future__ import annotations

import argparse
import json
import time
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np

import neuro
from neuro.apps import assignments
from neuro_agent import ActorCritic, LinearTwin

warnings.filterwarnings("ignore", category=DeprecationWarning)
warnings.filterwarnings("ignore", category=neuro.ApproximationWarning)  # else chips warn about each agent


@dataclass(frozen=True)
class Task:
    """A task and the limits of its training and tests.

    Attributes:
        bar: mean return at which the task counts as solved.
        steps: largest number of control steps of a training.
        most: largest number of control steps of an episode, if the environment has no limit.
        window: number of last episodes whose mean return is compared with the bar; more if returns vary more.
        tests: number of test episodes of the frozen agent.
        frozen: bar for the test episodes, if it differs from `bar`.
        controls: number of control steps of a control, see `controls`.
    """

    bar: float
    steps: int
    most: int | None = None
    window: int = 100
    tests: int = 100
    frozen: float | None = None
    controls: int = 60_000

    def make(self, name: str) -> gymnasium.Env[Any, Any]:
        """Return the environment of the task."""
        return gymnasium.make(name) if self.most is None else gymnasium.make(name, max_episode_steps=self.most)


TASKS = {
    "CartPole-v1": Task(475.0, 150_000),
    "Acrobot-v1": Task(-100.0, 100_000, controls=30_000),
    "MountainCar-v0": Task(-110.0, 150_000),
    "CliffWalking-v1": Task(-20.0, 100_000, most=500, controls=30_000),
    "FrozenLake-v1": Task(0.7, 300_000, window=500, tests=1000, frozen=0.68, controls=150_000),
    "Taxi-v4": Task(7.0, 1_000_000),
    "MountainCarContinuous-v0": Task(90.0, 300_000),
    "Pendulum-v1": Task(-150.0, 150_000, frozen=-200.0),
}


def run(name: str, seed: int, kind: type[ActorCritic], settings: dict[str, Any]) -> dict[str, Any]:
    """Train and test an agent with one seed of a task, and return its figures."""
    task, env = TASKS[name], TASKS[name].make(name)
    agent = kind(env.observation_space, env.action_space, seed=seed, **settings)
    begun = time.process_time()
    log = agent.train(env, until=task.bar, steps=task.steps, window=task.window)
    taken = time.process_time() - begun
    test = agent.test(env, task.tests, seed=seed)
    steps = int(log.steps[-1])
    return {
        "seed": seed,
        "solved": log.solved,
        "episodes": len(log),
        "steps": steps,
        "steps_per_s": round(steps / taken),
        "frozen": round(test.mean, 3),
        "passes": test.mean >= (task.bar if task.frozen is None else task.frozen),
    }


def controls(name: str, seed: int, settings: dict[str, Any]) -> dict[str, float]:
    """Return, for each control, how far its mean return lies between random moves (0) and the bar (1)."""
    task, env = TASKS[name], TASKS[name].make(name)
    agent = ActorCritic(env.observation_space, env.action_space, seed=seed, **settings)
    env.action_space.seed(seed)
    chance = float(np.mean([_at_random(env, episode) for episode in range(100)]))
    found = agent.controls(env, steps=task.controls, episodes=100)
    return {control: round((test.mean - chance) / (task.bar - chance), 3) for control, test in found.items()}


def chips(name: str, seed: int, settings: dict[str, Any]) -> dict[str, Any]:
    """Return mean returns of the frozen agent by backend, and microjoules per decision: low, nominal, high."""
    task, env = TASKS[name], TASKS[name].make(name)
    agent = ActorCritic(env.observation_space, env.action_space, seed=seed, **settings)
    agent.train(env, until=task.bar, steps=task.steps, window=task.window)
    found: dict[str, Any] = {
        backend: round(agent.test(env, 30, seed=seed, backend=backend).mean, 2)
        for backend in ("event", "loihi", "spinnaker")
    }
    for target in ("loihi", "spinnaker"):
        bill = agent.energy(target).per(200, "decision")
        found[f"{target}_uJ"] = [round(1e6 * joules, 3) for joules in (bill.low_j, bill.total_j, bill.high_j)]
    return found


def _at_random(env: gymnasium.Env[Any, Any], seed: int) -> float:
    env.reset(seed=seed)
    total, over = 0.0, False
    while not over:
        _, reward, ended, cut, _ = env.step(env.action_space.sample())
        total, over = total + float(reward), ended or cut
    return total


def main() -> None:
    """Run the tasks. Print a line for each seed, then a line for each task."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tasks", nargs="*", default=list(TASKS)[:5], choices=[*TASKS], metavar="TASK")
    parser.add_argument("--seeds", default="101-110")
    parser.add_argument("--twin", action="store_true", help="the linear twin instead")
    parser.add_argument("--controls", action="store_true", help="agents that are kept from learning instead")
    parser.add_argument("--chips", action="store_true", help="the frozen agent on emulated chips instead")
    parser.add_argument("--set", nargs="*", default=[], metavar="NAME=VALUE")
    parser.add_argument("--json", type=Path)
    given = parser.parse_args()
    first, _, last = given.seeds.partition("-")
    settings = assignments(given.set)
    kind = LinearTwin if given.twin else ActorCritic
    found: dict[str, Any] = {}
    for name in given.tasks:
        rows = []
        for seed in range(int(first), int(last or first) + 1):
            if given.controls or given.chips:
                print(name, seed, (controls if given.controls else chips)(name, seed, settings), flush=True)
                continue
            rows.append(run(name, seed, kind, settings))
            print(name, rows[-1], flush=True)
        if not rows:
            continue
        found[name] = {
            "solved": sum(row["solved"] for row in rows),
            "of": len(rows),
            "episodes": float(np.median([row["episodes"] for row in rows])),
            "frozen_passes": sum(row["passes"] for row in rows),
            "frozen_worst": min(row["frozen"] for row in rows),
            "steps_per_s": float(np.median([row["steps_per_s"] for row in rows])),
            "rows": rows,
        }
        print(name, {key: value for key, value in found[name].items() if key != "rows"}, flush=True)
    if given.json:
        given.json.write_text(json.dumps({"settings": settings, "twin": given.twin, "tasks": found}, indent=1))


if __name__ == "__main__":
    main()
