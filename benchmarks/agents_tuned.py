"""The spiking agent beside its linear twin, PPO and DQN, each with the same number of tries to choose settings.

    python benchmarks/agents_tuned.py [TASK ...] [--tries 12] [--seeds 101-103] [--only NAME ...] [--json FILE]

On CartPole and MountainCar each contestant is tried with its defaults and with `tries` drawn settings. SPACES has the
ranges of the settings that users tune (for PPO and DQN, the settings that are published for these tasks). All tries are
trained with seed 1 for the control steps of the task. The settings with the best frozen mean return of 100 episodes are
trained again with `--seeds`. Random search draws linear policies, which have no settings. On other tasks only the
spiking agent has tries, to compare its defaults with settings for a task; the others have their defaults. The figures
are those of `--seeds` alone: frozen mean returns in 100 new episodes, which are the same for all. Results are stored in
FILE, and no training is repeated. The benchmark uses one process and one core, and requires stable-baselines3.
"""

from __future__ import annotations

import argparse
import json
import time
import warnings
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from agents import TASKS

from neuro_agent import ActorCritic, LinearTwin
from neuro_agent.compare import NAMES
from neuro_agent.training import TESTS, episode_seed

warnings.filterwarnings("ignore")

STEPS = {
    "CartPole-v1": 60_000,
    "MountainCar-v0": 100_000,
    "Acrobot-v1": 40_000,
    "FrozenLake-v1": 100_000,
    "CliffWalking-v1": 100_000,
}
"""Control steps of each training. The slowest seeds of the spiking agent need about as many."""
TUNED = ("CartPole-v1", "MountainCar-v0")
OURS = {
    "actor_rate": (0.6, 1.2, 2.4, 4.8, 9.6),
    "critic_rate": (0.015, 0.03, 0.06, 0.12),
    "fields": (4, 6, 8, 10),
    "active": (12, 24, 48),
    "decay": (0.8, 0.9, 0.95, 0.98),
    "discount": (0.98, 0.99, 0.995),
}
SPACES: Mapping[str, Mapping[str, tuple[Any, ...]]] = {
    "agent": OURS,
    "twin": OURS,
    "ppo": {
        "learning_rate": (1e-4, 3e-4, 1e-3, 3e-3),
        "n_steps": (16, 32, 128, 512),
        "batch_size": (64, 256),
        "n_epochs": (4, 10, 20),
        "gamma": (0.98, 0.99, 0.995),
        "gae_lambda": (0.8, 0.9, 0.95, 0.98),
        "ent_coef": (0.0, 0.001, 0.01),
        "envs": (1, 8, 16),
        "normalize": (False, True),
    },
    "dqn": {
        "learning_rate": (1e-4, 5e-4, 1e-3, 2.3e-3, 4e-3),
        "batch_size": (32, 64, 128),
        "buffer_size": (10_000, 50_000, 100_000),
        "learning_starts": (100, 1_000),
        "gamma": (0.98, 0.99, 0.995),
        "target_update_interval": (10, 100, 600, 2_000),
        "train": ((4, 1), (16, 8), (256, 128)),
        "exploration_fraction": (0.1, 0.16, 0.2, 0.3),
        "exploration_final_eps": (0.02, 0.04, 0.07, 0.1),
        "net": (64, 256),
    },
}
Act = Callable[[Any], Any]
LABELS = {**NAMES, "search": "random search, linear policies"}


def drawn(name: str, number: int) -> dict[str, Any]:
    """Return the settings of a try. Try 0 has the defaults."""
    rng = np.random.default_rng([number, 12])
    space = SPACES.get(name, {}) if number else {}
    return {key: values[int(rng.integers(len(values)))] for key, values in space.items()}


def ours(name: str, task: str, seed: int, settings: Mapping[str, Any]) -> list[float]:
    """Return the frozen returns of the spiking agent or its twin, by episode."""
    env, kind = TASKS[task].make(task), ActorCritic if name == "agent" else LinearTwin
    agent = kind(env.observation_space, env.action_space, seed=seed, **settings)
    agent.train(env, steps=STEPS[task])
    found: list[float] = agent.test(env, episodes=100).returns.tolist()
    return found


def theirs(name: str, task: str, seed: int, settings: Mapping[str, Any]) -> list[float]:
    """Return the frozen returns of PPO or DQN, by episode. Both choose the action that they prefer."""
    import stable_baselines3
    import torch
    from stable_baselines3.common.vec_env import DummyVecEnv, VecNormalize

    torch.set_num_threads(1)
    options = dict(settings)
    envs: Any = DummyVecEnv([lambda: TASKS[task].make(task)] * options.pop("envs", 1))
    if options.pop("normalize", False):
        envs = VecNormalize(envs, gamma=options["gamma"])
    if "train" in options:  # a number of gradient steps after the same number of control steps
        options["train_freq"], options["gradient_steps"] = options.pop("train")
    if "net" in options:
        options["policy_kwargs"] = {"net_arch": [options.pop("net")] * 2}
    model = getattr(stable_baselines3, name.upper())("MlpPolicy", envs, seed=seed, device="cpu", **options)
    model.learn(STEPS[task])
    normal = model.get_vec_normalize_env()

    def act(seen: Any) -> Any:
        return model.predict(seen if normal is None else normal.normalize_obs(seen), deterministic=True)[0]

    return episodes(TASKS[task].make(task), act)


def searched(task: str, seed: int) -> list[float]:
    """Return the frozen returns of the best of random linear policies. Each policy is tried in three episodes."""
    env, rng = TASKS[task].make(task), np.random.default_rng([seed, 13])
    discrete = isinstance(env.observation_space, gymnasium.spaces.Discrete)
    size = int(env.observation_space.n) if discrete else int(np.prod(env.observation_space.shape))
    spread, best, found, steps = np.ones(size), -np.inf, np.zeros((0, 0)), 0
    if not discrete:
        env.action_space.seed(seed)
        seen = [env.reset(seed=seed)[0]]
        while len(seen) < 400:
            now, _, ended, cut, _ = env.step(env.action_space.sample())
            seen.append(env.reset()[0] if ended or cut else now)
        spread, steps = np.std(seen, axis=0) + 1e-9, len(seen)

    def act(weights: Any, now: Any) -> int:
        return int(np.argmax(weights[:, now] if discrete else weights[:, :-1] @ (now / spread) + weights[:, -1]))

    while steps < STEPS[task]:
        weights, total = rng.normal(size=(int(env.action_space.n), size + (not discrete))), 0.0
        for _ in range(3):
            now, _ = env.reset(seed=int(rng.integers(2**31)))
            over = False
            while not over:
                now, reward, ended, cut, _ = env.step(act(weights, now))
                total, steps, over = total + float(reward), steps + 1, ended or cut
        if total > best:
            best, found = total, weights
    return episodes(TASKS[task].make(task), lambda now: act(found, now))


def episodes(env: gymnasium.Env[Any, Any], act: Act) -> list[float]:
    """Return the returns of a policy in the same episodes as `ActorCritic.test`."""
    returns = []
    for k in range(100):
        seen, _ = env.reset(seed=episode_seed(0, TESTS + k))
        over, total = False, 0.0
        while not over:
            action = act(seen)
            seen, reward, ended, cut, _ = env.step(int(action))
            total, over = total + float(reward), bool(ended or cut)
        returns.append(total)
    return returns


class Kept:
    """Figures of trainings in a file, so that no training is repeated.

    Args:
        path: path of the file, or None for no file.
    """

    def __init__(self, path: Path | None) -> None:
        self._path = path
        self._each: dict[str, Any] = json.loads(path.read_text()) if path is not None and path.exists() else {}

    def mean(self, name: str, task: str, seed: int, number: int) -> float:
        """Return the frozen mean return of a training with the settings of a try."""
        key = f"{task} {name} seed {seed} try {number}"
        if key not in self._each:
            begun, settings = time.process_time(), drawn(name, number)
            run = ours if name in ("agent", "twin") else theirs
            try:
                returns = searched(task, seed) if name == "search" else run(name, task, seed, settings)
            except (ValueError, AssertionError) as error:  # settings that exclude each other
                returns = [float("-inf")]
                print(f"{key}: {error}", flush=True)
            self._each[key] = {
                "settings": settings,
                "mean": float(np.mean(returns)),
                "worst": min(returns),
                "seconds": round(time.process_time() - begun, 1),
            }
            print(f"{key}: {self._each[key]}", flush=True)
            if self._path is not None:
                part = self._path.with_name(self._path.name + ".part")
                part.write_text(json.dumps(self._each, indent=1))
                part.replace(self._path)
        return float(self._each[key]["mean"])


def main() -> None:
    """Train all contestants and print the figures."""
    parser = argparse.ArgumentParser()
    parser.add_argument("tasks", nargs="*", default=list(STEPS))
    parser.add_argument("--tries", type=int, default=12)
    parser.add_argument("--seeds", default="101-103")
    parser.add_argument("--only", action="append", default=[])
    parser.add_argument("--json", type=Path)
    chosen = parser.parse_args()
    low, high = map(int, chosen.seeds.split("-"))
    kept, names = Kept(chosen.json), chosen.only or [*SPACES, "search"]
    for task in chosen.tasks:
        rows = []
        for name in names:
            tried = name == "agent" or (task in TUNED and name in SPACES)
            numbers = range(chosen.tries + 1) if tried else [0]
            best = max(numbers, key=lambda number: kept.mean(name, task, 1, number)) if len(numbers) > 1 else 0
            for number in sorted({0, best}):
                means = [kept.mean(name, task, seed, number) for seed in range(low, high + 1)]
                rows.append((float(np.mean(means)), name, number, means))
        rows.sort(reverse=True)
        print(f"\n{task}, {STEPS[task]} control steps, bar {TASKS[task].bar:g}: {LABELS[rows[0][1]]} first")
        for mean, name, number, means in rows:
            settings = f"try {number} {drawn(name, number)}" if number else "defaults"
            print(f"  {mean:8.1f}  {LABELS[name].partition(',')[0]:32} {[round(m, 1) for m in means]}  {settings}")


if __name__ == "__main__":
    main()
