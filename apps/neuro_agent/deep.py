"""Deep agents of stable-baselines3: their training, and the count of their multiply-accumulates."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium import spaces

from neuro import ModelError
from neuro.apps import Log, why

NAMES = {"ppo": "PPO of stable-baselines3, defaults", "dqn": "DQN of stable-baselines3, defaults"}
ROLLOUT, BATCH = 2048, 64
"""Numbers of control steps of a rollout and of a batch, the defaults of PPO in stable-baselines3."""
WINDOW = 100
"""Number of episodes of the mean return that ends a training."""
OPTIMISER = 5
"""Multiply-accumulates of Adam per parameter: the gradient's norm, two moments, their quotient, the step."""
NOTES = (
    "counted in the training: each weight once for each input forward, twice backward; biases and activations are not",
    f"Adam counts {OPTIMISER} for each parameter and update; the environment and the stored steps are not priced",
)


class BaselineError(ModelError):
    """stable-baselines3 cannot train in the environment."""


def from_zero(env: gymnasium.Env[Any, Any]) -> gymnasium.Env[Any, Any]:
    """Return the environment with actions numbered from 0, as stable-baselines3 requires."""
    space: Any = env.action_space
    if not starts(space).any():
        return env
    zeros = spaces.Discrete(space.n) if isinstance(space, spaces.Discrete) else spaces.MultiDiscrete(space.nvec)
    return gymnasium.wrappers.TransformAction(env, lambda action: action + space.start, zeros)


def starts(space: gymnasium.Space[Any]) -> npt.NDArray[np.int64]:
    """Return the smallest value of each number of a Discrete or MultiDiscrete space; 0 for other spaces."""
    return np.ravel(getattr(space, "start", 0))


def trained(
    name: str, env: gymnasium.Env[Any, Any], *, steps: int, seed: int, until: float | None = None, **settings: Any
) -> tuple[Any, Log, Counter[str]]:
    """Train PPO or DQN on one core.

    Args:
        name: one of `NAMES`.
        env: the environment, with actions from 0.
        steps: maximum number of control steps; PPO rounds up to whole rollouts.
        seed: seed of all random draws.
        until: mean return of `WINDOW` episodes at which training stops at once.
        settings: settings of stable-baselines3, in place of its defaults.

    Returns:
        the model, its episodes, and its multiply-accumulates by purpose.

    Raises:
        BaselineError: stable-baselines3 refuses the environment, or the environment raises an error.
    """
    import stable_baselines3
    import torch
    from stable_baselines3.common.callbacks import BaseCallback

    log = Log()

    class Until(BaseCallback):
        """A callback that records the episodes and stops the training at its goal."""

        def _on_step(self) -> bool:
            for info in self.locals["infos"]:
                if "episode" in info:
                    log.add(info["episode"]["r"], info["episode"]["l"], self.num_timesteps)
                    if until is not None and not log.solved:
                        log.solved = len(log) >= WINDOW and log.mean(WINDOW) >= until
            return not log.solved

    torch.set_num_threads(1)
    policy = "MultiInputPolicy" if isinstance(env.observation_space, spaces.Dict) else "MlpPolicy"
    if name == "ppo" and steps < ROLLOUT:  # PPO trains for whole rollouts, each of whole batches
        steps = steps // BATCH * BATCH or steps
        settings = {"n_steps": steps, "batch_size": min(BATCH, steps), **settings}
    try:
        model = getattr(stable_baselines3, name.upper())(policy, env, seed=seed, device="cpu", **settings)
        with counting_macs(model.policy) as macs:
            model.learn(steps, callback=Until())
    except Exception as error:
        raise BaselineError(f"{NAMES[name]}: {why(error)}") from error
    return model, log, macs


@contextmanager
def counting_macs(policy: Any) -> Iterator[Counter[str]]:
    """Count the multiply-accumulates of a policy's layers and of its optimiser.

    A layer multiplies each weight once per input forward, and twice backward: for the gradients of its weights and of
    its input.
    """
    import torch

    macs: Counter[str] = Counter()
    parameters = sum(array.numel() for group in policy.optimizer.param_groups for array in group["params"])

    def multiplied(layer: Any, inputs: Any, output: Any) -> None:
        positions = output.numel() * layer.weight[0].numel()
        macs["layers, forward"] += positions
        if torch.is_grad_enabled():
            macs["layers, backward"] += 2 * positions

    def updated(*_: Any) -> None:
        macs["optimiser"] += OPTIMISER * parameters

    kinds = (torch.nn.Linear, torch.nn.Conv2d)
    hooks = [layer.register_forward_hook(multiplied) for layer in policy.modules() if isinstance(layer, kinds)]
    hooks.append(policy.optimizer.register_step_post_hook(updated))
    try:
        yield macs
    finally:
        for hook in hooks:
            hook.remove()
