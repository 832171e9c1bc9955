"""The two deep agents: DQN on nine actions, DDPG on continuous ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np

from neuro_drone.controllers.deep import Deep, DeepSettings, Spaces
from neuro_drone.controllers.dense import Floats, Singles
from neuro_drone.controllers.settings import number, share, whole
from neuro_drone.env import ACTIONS

__all__ = ["DDPG", "DQN", "DDPGSettings", "DQNSettings"]


@dataclass(frozen=True, slots=True)
class DQNSettings(DeepSettings):
    """What DQN is told; the rest is in `DeepSettings`.

    Attributes:
        rate: of learning. An action changes the value by less than a hundredth, so that a larger one stays noisy.
        every: steps from one update to the next.
        copy: steps from one copy of the network to its target to the next.
        explore: steps in which the share of random actions falls from 1 to `random`.
        random: share of random actions from then on.
    """

    rate: float = number(3e-4, above=0)
    every: int = whole(4)
    copy: int = whole(1000)
    explore: int = whole(5000)
    random: float = share(0.05)


class DQN(Deep):
    """Values of the nine actions of `env.ACTIONS`, learnt from a copy of the network that lags behind.

    Source: V. Mnih et al., "Human-level control through deep reinforcement learning", Nature 518, 2015; thesis,
        section 4.6.5.
    """

    name, acts = "dqn", "q_net.q_net."

    def build(self, package: Any, common: dict[str, Any]) -> Any:
        """See `Deep`."""
        return package.DQN("MlpPolicy", Spaces(gymnasium.spaces.Discrete(len(ACTIONS))), **common)

    def explore(self, out: Singles, steps: int) -> Any:
        """A random action now and then, see `DQNSettings`."""
        s = self._settings
        if self._rng.random() < max(s.random, 1.0 - steps / s.explore * (1.0 - s.random)):
            return int(self._rng.integers(len(ACTIONS)))
        return self.best(out)

    @staticmethod
    def best(out: Singles) -> Any:
        """The action of the largest value."""
        return int(np.argmax(out))

    @staticmethod
    def command(chosen: Any) -> Floats:
        """The direction that an action stands for."""
        return np.array(ACTIONS[chosen])

    def optimizers(self) -> list[Any]:
        """That of the values."""
        return [self.algorithm.policy.optimizer]

    def updated(self, steps: int) -> None:
        """Copy the network to its target when it is time."""
        if steps % self._settings.copy == 0:
            self.algorithm.q_net_target.load_state_dict(self.algorithm.q_net.state_dict())


@dataclass(frozen=True, slots=True)
class DDPGSettings(DeepSettings):
    """What DDPG is told; the rest is in `DeepSettings`.

    Attributes:
        noise: standard deviation of what is added to an action while learning; the first `warm` ones are drawn.
        tau: share of the networks that their targets take over in an update.
    """

    noise: float = number(0.2, at_least=0)
    tau: float = share(0.005)


class DDPG(Deep):
    """An actor whose output is the action, and a critic that tells it where better ones lie.

    Source: T. P. Lillicrap et al., "Continuous control with deep reinforcement learning", ICLR 2016; thesis, section
        4.7.3. Noise is independent from step to step.
    """

    name, acts = "ddpg", "actor.mu."

    def build(self, package: Any, common: dict[str, Any]) -> Any:
        """See `Deep`."""
        return package.DDPG(
            "MlpPolicy", Spaces(gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32)), tau=self._settings.tau, **common
        )

    def explore(self, out: Singles, steps: int) -> Any:
        """Noise on the action."""
        if steps < self._settings.warm:
            return self._rng.uniform(-1.0, 1.0, 2)
        return np.clip(self.best(out) + self._rng.normal(0.0, self._settings.noise, 2), -1.0, 1.0)

    @staticmethod
    def best(out: Singles) -> Any:
        """The actor's action."""
        return np.tanh(out)

    @staticmethod
    def command(chosen: Any) -> Floats:
        """The action itself."""
        return np.asarray(chosen, np.float64)

    def optimizers(self) -> list[Any]:
        """Those of actor and critic."""
        return [self.algorithm.actor.optimizer, self.algorithm.critic.optimizer]

    def updated(self, steps: int) -> None:
        """The targets follow in the update itself."""
