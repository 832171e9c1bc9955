"""The deep agents that learn from replay: DQN on nine actions, DDPG on continuous ones."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import gymnasium
import numpy as np

from neuro_drone.controllers.deep import Deep, DeepSettings, Spaces, alone
from neuro_drone.controllers.dense import Floats, Singles
from neuro_drone.controllers.settings import number, share, whole
from neuro_drone.env import ACTIONS

__all__ = ["DDPG", "DQN", "DDPGSettings", "DQNSettings", "Replaying", "ReplayingSettings"]


@dataclass(frozen=True, slots=True)
class ReplayingSettings(DeepSettings):
    """What agents that learn from replay are told; the rest is in `DeepSettings`.

    Attributes:
        buffer: transitions kept for replay.
        warm: steps before the first update.
        every: steps from one update to the next.
    """

    buffer: int = whole(50_000)
    warm: int = whole(1000)
    every: int = whole(1)


class Replaying(Deep):
    """An agent that learns from transitions drawn from all that it keeps."""

    kept = ("observations", "next_observations", "actions", "rewards", "dones")

    @property
    def buffer(self) -> Any:
        """See `Deep`."""
        return self.algorithm.replay_buffer

    def keep(self, after: Singles, reward: float, lost: bool) -> None:
        """See `Deep`."""
        self.buffer.add(self._seen, after, np.asarray(self._chosen), reward, lost, [{}])

    def update(self, after: Singles, lost: bool) -> None:
        """Learn from a batch when it is time, see `ReplayingSettings`."""
        s = self._settings
        if self._steps > s.warm and self._steps % s.every == 0:
            with alone(int(self._rng.integers(2**32))):
                self.algorithm.train(1, s.batch)


@dataclass(frozen=True, slots=True)
class DQNSettings(ReplayingSettings):
    """What DQN is told; the rest is in `ReplayingSettings`.

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


class DQN(Replaying):
    """Values of the nine actions of `env.ACTIONS`, learnt from a copy of the network that lags behind.

    Source: V. Mnih et al., "Human-level control through deep reinforcement learning", Nature 518, 2015; thesis,
        section 4.6.5.
    """

    name = "dqn"
    acts = ("q_net.q_net.0", "q_net.q_net.2", "q_net.q_net.4")

    def build(self, package: Any, common: dict[str, Any]) -> Any:
        """See `Deep`."""
        spaces = Spaces(gymnasium.spaces.Discrete(len(ACTIONS)))
        return package.DQN("MlpPolicy", spaces, buffer_size=self._settings.buffer, **common)

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

    def update(self, after: Singles, lost: bool) -> None:
        """Learn, and copy the network to its target when it is time."""
        super().update(after, lost)
        if self._steps % self._settings.copy == 0:
            self.algorithm.q_net_target.load_state_dict(self.algorithm.q_net.state_dict())


@dataclass(frozen=True, slots=True)
class DDPGSettings(ReplayingSettings):
    """What DDPG is told; the rest is in `ReplayingSettings`.

    Attributes:
        noise: standard deviation of what is added to an action while learning; the first `warm` ones are drawn.
        tau: share of the networks that their targets take over in an update.
    """

    noise: float = number(0.2, at_least=0)
    tau: float = share(0.005)


class DDPG(Replaying):
    """An actor whose output is the action, and a critic that tells it where better ones lie.

    Source: T. P. Lillicrap et al., "Continuous control with deep reinforcement learning", ICLR 2016; thesis, section
        4.7.3. Noise is independent from step to step.
    """

    name = "ddpg"
    acts = ("actor.mu.0", "actor.mu.2", "actor.mu.4")

    def build(self, package: Any, common: dict[str, Any]) -> Any:
        """See `Deep`."""
        s, spaces = self._settings, Spaces(gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32))
        return package.DDPG("MlpPolicy", spaces, buffer_size=s.buffer, tau=s.tau, **common)

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
