"""PPO: an actor and a critic that learn from their latest steps only."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from math import log, pi
from typing import Any

import gymnasium
import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro.apps import setting
from neuro_drone.controllers.deep import Deep, DeepSettings, Dense, Floats, Singles, Spaces, alone, needed
from neuro_drone.scenario import Scenario

ADAM = {"fused": True, "eps": 1e-5}
"""Options of the optimizer Adam. Source: stable-baselines3, `ActorCriticPolicy`."""


@dataclass(frozen=True)
class PPOSettings(DeepSettings):
    """Settings of PPO, beside those of `DeepSettings`.

    Attributes:
        rate: learning rate of Adam.
        rollout: steps between two updates, and transitions of an update; a multiple of `batch`.
        epochs: passes over the transitions in an update.
        trace: lambda of generalised advantage estimation.
        clip: largest change of an action's probability in an update, as a share.
        spread: initial standard deviation of the actions, which is learnt, too.
    """

    rate: float = setting(3e-4, above=0)
    rollout: int = setting(256, at_least=1)
    epochs: int = setting(10, at_least=1)
    trace: float = setting(0.95, at_least=0, at_most=1)
    clip: float = setting(0.2, above=0)
    spread: float = setting(1.0, above=0)


class PPO(Deep):
    """Proximal policy optimization of a Gaussian policy, with a critic.

    If training truncates an episode, the critic's value of the last state is added to the last reward.

    Attributes:
        judges: names of the layers of the critic.

    Source: J. Schulman et al., "Proximal policy optimization algorithms", arXiv:1707.06347, 2017.

    Raises:
        ModelError: `rollout` is no multiple of `batch`, or a batch has one transition.
    """

    name = "ppo"
    acts = ("mlp_extractor.policy_net.0", "mlp_extractor.policy_net.2", "action_net")
    judges = ("mlp_extractor.value_net.0", "mlp_extractor.value_net.2", "value_net")
    activation = "tanh"
    buffer_arrays = ("observations", "actions", "rewards", "episode_starts", "values", "log_probs")

    def __init__(self, scenario: Scenario, seed: int, settings: PPOSettings) -> None:
        super().__init__(scenario, seed, settings)
        if settings.batch < 2 or settings.rollout % settings.batch:
            raise ModelError(
                f"controller 'ppo': rollout = {settings.rollout} with batch = {settings.batch}: "
                "expected a multiple of the batch, which is at least 2"
            )
        # whether the next step is the episode's first; whether the episode still runs; the last observation
        self._first, self._cut, self._after = True, False, self._last_input
        self._log_prob = 0.0

    def build(self, package: Any, common: dict[str, Any]) -> Any:
        """See `Deep`."""
        s, spaces = self._settings, Spaces(gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32))
        policy = {**common.pop("policy_kwargs"), "optimizer_kwargs": ADAM, "log_std_init": log(s.spread)}
        options = {"n_steps": s.rollout, "n_epochs": s.epochs, "gae_lambda": s.trace, "clip_range": s.clip}
        return package.PPO("MlpPolicy", spaces, policy_kwargs=policy, **options, **common)

    @property
    def buffer(self) -> Any:
        """See `Deep`."""
        return self.algorithm.rollout_buffer

    @cached_property
    def critic(self) -> Dense:
        """The network that predicts the return; shares its arrays with the algorithm."""
        return Dense(self.arrays(), self.judges, self.activation)

    @cached_property
    def log_std(self) -> Singles:
        """Logarithm of the actions' standard deviations; shares its array with the algorithm."""
        return self.arrays()["log_std"]

    def begin(self) -> None:
        """Begin an episode; add the critic's value to the last reward if the previous episode was truncated."""
        if self._cut and self.buffer.pos > 0:
            self.buffer.rewards[self.buffer.pos - 1] += self._settings.gamma * self.critic(self._after)
        self._first, self._cut = True, False

    def explore(self, out: Singles, steps: int) -> Any:
        """Draw an action around the actor's mean, and store its log probability."""
        noise = self._rng.standard_normal(2, np.float32)
        self._log_prob = float(np.sum(-0.5 * noise**2 - self.log_std - 0.5 * log(2.0 * pi)))
        return out + np.exp(self.log_std) * noise

    @staticmethod
    def best(out: Singles) -> Any:
        """Return the actor's action."""
        return out

    @staticmethod
    def command(chosen: Any) -> Floats:
        """Return the action, clipped to [-1, 1]."""
        return np.clip(np.asarray(chosen, np.float64), -1.0, 1.0)

    def optimizers(self) -> list[Any]:
        """Return the optimizer, which both networks share."""
        return [self.algorithm.policy.optimizer]

    def keep(self, after: Singles, reward: float, lost: bool) -> None:
        """See `Deep`."""
        _, torch = needed(self.name)
        value, log_prob = torch.from_numpy(self.critic(self._last_input)), torch.tensor([self._log_prob])
        self.buffer.add(self._last_input, self._chosen, reward, self._first, value, log_prob)
        self._first, self._cut, self._after = False, not lost, after

    def update(self, after: Singles, lost: bool) -> None:
        """Learn from a full buffer, and empty the buffer."""
        if not self.buffer.full:
            return
        _, torch = needed(self.name)
        self.buffer.compute_returns_and_advantage(torch.from_numpy(self.critic(after)), np.array([lost]))
        with alone(int(self._rng.integers(2**32))):
            self.algorithm.train()
        self.buffer.reset()

    def state(self) -> dict[str, npt.NDArray[Any]]:
        """Return the state of `Deep`, the last observation, and whether the episode is still running."""
        return super().state() | {"after": self._after, "cut": np.array(self._cut)}

    def restore(self, state: Mapping[str, npt.NDArray[Any]]) -> None:
        """See `Deep`."""
        for cached in ("critic", "log_std"):
            self.__dict__.pop(cached, None)
        super().restore(state)
        if "cut" in state:
            self._after, self._cut = state["after"], bool(state["cut"])
