"""Deep reinforcement learning beside the spiking network: what DQN, DDPG and PPO have in common, then DQN and DDPG.

Networks, losses, optimisers and buffers are those of stable-baselines3. The steps of control are taken by the same loop
as for every other controller, so that training, checkpoints, files and tests are the same, too.
"""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from io import BytesIO
from typing import Any, ClassVar

import gymnasium
import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro.apps import install, setting
from neuro_drone.controllers.simple import ControllerSettings, Fixed, shares
from neuro_drone.env import ACTIONS
from neuro_drone.scenario import Scenario

Arrays = Mapping[str, npt.NDArray[Any]]
Floats = npt.NDArray[np.float64]
Singles = npt.NDArray[np.float32]
MOST = np.float32(15.0)
"""Events in a field that are taken for 1; at as many the spiking network's cells have reached their largest rate."""


def observed(counts: npt.NDArray[Any], kind: str) -> Singles:
    """What a deep network sees of the fields.

    Args:
        counts: (8, 8) events.
        kind: binary (whether a field had events; thesis, section 7.2.1), counts (15 and more are 1), or a coding of
            `shares`.

    Returns:
        (64,) in [0, 1].
    """
    flat = counts.ravel()
    if kind == "binary":
        return (flat > 0).astype(np.float32)
    if kind == "counts":
        seen: Singles = np.minimum(flat.astype(np.float32) / MOST, np.float32(1.0))
        return seen
    return shares(counts, kind).astype(np.float32)


ACTIVATIONS: dict[str, Callable[[Singles], Singles]] = {
    "relu": lambda x: np.maximum(x, np.float32(0.0)),
    "tanh": np.tanh,
}
"""Activations of hidden layers by name."""


class Dense:
    """Layers of weights with an activation between two.

    Args:
        arrays: weights (out, in) and biases (out,) by name.
        layers: names of the layers, from the first to the last; ".weight" and ".bias" follow.
        activation: of the hidden layers, one of `ACTIVATIONS`.

    Attributes:
        layers: weights and bias of each; not copied, so that a network that learns is seen as it is at any time.
    """

    def __init__(self, arrays: Arrays, layers: Sequence[str], activation: str = "relu") -> None:
        self.layers = [(arrays[f"{name}.weight"], arrays[f"{name}.bias"]) for name in layers]
        self._activation = ACTIVATIONS[activation]

    def __call__(self, seen: Singles) -> Singles:
        """What the last layer gives for an observation."""
        *hidden, (weight, bias) = self.layers
        for w, b in hidden:
            seen = self._activation(w @ seen + b)
        out: Singles = weight @ seen + bias
        return out


class Flier(Fixed):
    """A trained agent, which neither learns nor explores.

    Args:
        dense: the network that acts.
        command: the drone's action, (2,), of what the network gives.
        observation: see `observed`.

    Attributes:
        dense: as given.
    """

    def __init__(self, dense: Dense, command: Callable[[Singles], Floats], observation: str) -> None:
        self.dense, self._command, self._kind = dense, command, observation

    def act(self, counts: npt.NDArray[Any], info: Mapping[str, Any]) -> Floats:
        """The action that the network thinks best."""
        return self._command(self.dense(observed(counts, self._kind)))


_POLICY, _KEPT = "policy.", "kept."


@dataclass(frozen=True)
class DeepSettings(ControllerSettings):
    """Settings of all of them.

    Attributes:
        observation: binary (whether a field had events; thesis, section 7.2.1) or counts.
        hidden: units of each of the two hidden layers.
        rate: of learning, for Adam.
        gamma: discount of a step.
        batch: transitions of an update.
    """

    observation: str = setting("binary", words=("binary", "counts"))
    hidden: int = setting(64, at_least=1)
    rate: float = setting(1e-3, above=0)
    gamma: float = setting(0.9, at_least=0, at_most=1)
    batch: int = setting(64, at_least=1)


class Spaces(gymnasium.Env[Any, Any]):
    """The spaces of an agent's observations and actions, for stable-baselines3; it has no steps."""

    def __init__(self, actions: gymnasium.Space[Any]) -> None:
        self.observation_space = gymnasium.spaces.Box(0.0, 1.0, (64,), np.float32)
        self.action_space = actions


class Deep(Fixed, ABC):
    """An agent that learns from the reward alone: `info["reward"]` and `info["lost"]`, never the supervised error.

    Args:
        scenario: makes no difference.
        seed: of the first weights, of exploration and of what the package draws.
        settings: see `DeepSettings`.

    Attributes:
        name: of the agent.
        acts: names of the layers of the network that acts.
        activation: between them.
        kept: names of the arrays of the package's buffer.
    """

    name: ClassVar[str]
    acts: ClassVar[tuple[str, ...]]
    activation: ClassVar[str] = "relu"
    kept: ClassVar[tuple[str, ...]]

    def __init__(self, scenario: Scenario, seed: int, settings: Any) -> None:
        self._seed, self._settings = seed, settings
        self._rng = np.random.default_rng((seed, 3))
        self._learnt: dict[str, npt.NDArray[Any]] = {}
        self._steps = 0
        self._seen: Singles = np.zeros(64, np.float32)
        self._chosen: Any = None

    @abstractmethod
    def build(self, package: Any, common: dict[str, Any]) -> Any:
        """The algorithm, made by the package with these words and the agent's own."""

    @property
    @abstractmethod
    def buffer(self) -> Any:
        """The algorithm's, of transitions."""

    @abstractmethod
    def explore(self, out: Singles, steps: int) -> Any:
        """The agent's action of what its network gives, with exploration after so many steps."""

    @staticmethod
    @abstractmethod
    def best(out: Singles) -> Any:
        """The agent's action of what its network gives."""

    @staticmethod
    @abstractmethod
    def command(chosen: Any) -> Floats:
        """The drone's action, (2,), of the agent's."""

    @abstractmethod
    def optimizers(self) -> list[Any]:
        """Those of the algorithm."""

    @abstractmethod
    def keep(self, after: Singles, reward: float, lost: bool) -> None:
        """Keep the transition from what was seen to what is seen after the chosen action."""

    @abstractmethod
    def update(self, after: Singles, lost: bool) -> None:
        """Update the networks if it is time; `_steps` are done."""

    @cached_property
    def algorithm(self) -> Any:
        """The algorithm of stable-baselines3, with what was learnt before.

        Raises:
            ModelError: the package is not installed.
        """
        package, torch = needed(self.name)
        s = self._settings
        words = {
            "learning_rate": s.rate,
            "gamma": s.gamma,
            "batch_size": s.batch,
            "policy_kwargs": {"net_arch": [s.hidden, s.hidden], "optimizer_kwargs": {"fused": True}},
            "device": "cpu",
        }
        with alone(self._seed):
            made = self.build(package, words)
        made.set_logger(package.common.logger.Logger(None, []))
        if self._learnt:
            made.policy.load_state_dict({name: torch.tensor(array) for name, array in self._learnt.items()})
        return made

    @cached_property
    def dense(self) -> Dense:
        """The network that acts, as it is at any time."""
        return Dense(self.arrays(), self.acts, self.activation)

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """All that is learnt, as it is at any time."""
        return {name: tensor.numpy() for name, tensor in self.algorithm.policy.state_dict().items()}

    def act(self, counts: npt.NDArray[Any], info: Mapping[str, Any]) -> Floats:
        """Act by the network, with exploration."""
        self._seen = observed(counts, self._settings.observation)
        self._chosen = self.explore(self.dense(self._seen), self._steps)
        return self.command(self._chosen)

    def learn(self, info: Mapping[str, Any]) -> None:
        """Keep the transition, and update the networks when it is time."""
        after = observed(info["counts"], self._settings.observation)
        self.keep(after, info["reward"], info["lost"])
        self._steps += 1
        self.update(after, info["lost"])

    def learnt(self) -> dict[str, npt.NDArray[Any]]:
        """Weights and biases of all networks, by the names that stable-baselines3 gives them."""
        return {name: array.copy() for name, array in self.arrays().items()}

    def state(self) -> dict[str, npt.NDArray[Any]]:
        """Networks, optimisers, the buffer, and where the generator is."""
        _, torch = needed(self.name)
        buffer, file = self.buffer, BytesIO()
        torch.save([one.state_dict() for one in self.optimizers()], file)
        words = {"steps": self._steps, "pos": buffer.pos, "full": buffer.full, "rng": self._rng.bit_generator.state}
        texts = {"words": json.dumps(words).encode(), "optimizers": file.getvalue()}
        return (
            {name: np.frombuffer(text, np.uint8) for name, text in texts.items()}
            | {_POLICY + name: array for name, array in self.learnt().items()}
            | {_KEPT + name: getattr(buffer, name)[: buffer.size()].copy() for name in self.kept}
        )

    def restore(self, state: Mapping[str, npt.NDArray[Any]]) -> None:
        """Take up networks, or a whole state."""
        for cached in ("dense", "algorithm"):
            self.__dict__.pop(cached, None)
        if "words" not in state:
            self._learnt = dict(state)
            return
        self._learnt = {name.removeprefix(_POLICY): a for name, a in state.items() if name.startswith(_POLICY)}
        _, torch = needed(self.name)
        optimizers = torch.load(BytesIO(state["optimizers"].tobytes()), weights_only=True)
        for optimizer, one in zip(self.optimizers(), optimizers, strict=True):
            optimizer.load_state_dict(one)
        buffer, words = self.buffer, json.loads(state["words"].tobytes())
        for name in self.kept:
            array = state[_KEPT + name]
            getattr(buffer, name)[: len(array)] = array
        buffer.pos, buffer.full, self._steps = words["pos"], words["full"], words["steps"]
        self._rng.bit_generator.state = words["rng"]

    def frozen(self) -> Flier:
        """The same without learning and exploration, in NumPy."""
        arrays = self._learnt if self._learnt and "algorithm" not in self.__dict__ else self.learnt()
        dense = Dense(arrays, self.acts, self.activation)
        return Flier(dense, lambda out: self.command(self.best(out)), self._settings.observation)


@contextmanager
def alone(seed: int) -> Iterator[None]:
    """Lend the global generators to the package, and one thread: of small networks more only wait for each other."""
    import torch

    threads, kept, drawn = torch.get_num_threads(), np.random.get_state(), torch.random.get_rng_state()  # noqa: NPY002
    torch.set_num_threads(1)
    np.random.seed(seed)  # noqa: NPY002
    torch.random.manual_seed(seed)
    try:
        yield
    finally:
        np.random.set_state(kept)  # noqa: NPY002
        torch.random.set_rng_state(drawn)
        torch.set_num_threads(threads)


def needed(name: str) -> tuple[Any, Any]:
    """The packages stable_baselines3 and torch.

    Args:
        name: of the controller that needs them.

    Raises:
        ModelError: one is not installed.
    """
    try:
        import stable_baselines3
        import torch
    except ImportError:
        raise ModelError(f"controller '{name}': stable-baselines3 is not installed", hint=install("rl")) from None
    return stable_baselines3, torch


@dataclass(frozen=True)
class ReplayingSettings(DeepSettings):
    """Settings of agents that learn from replay; the rest are in `DeepSettings`.

    Attributes:
        buffer: transitions kept for replay.
        warm: steps before the first update.
        every: steps from one update to the next.
    """

    buffer: int = setting(50_000, at_least=1)
    warm: int = setting(1000, at_least=1)
    every: int = setting(1, at_least=1)


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


@dataclass(frozen=True)
class DQNSettings(ReplayingSettings):
    """Settings of DQN; the rest are in `ReplayingSettings`.

    Attributes:
        rate: of learning. An action changes the value by less than a hundredth, so that a larger one stays noisy.
        every: steps from one update to the next.
        copy: steps from one copy of the network to its target to the next.
        explore: steps in which the share of random actions falls from 1 to `random`.
        random: share of random actions from then on.
    """

    rate: float = setting(3e-4, above=0)
    every: int = setting(4, at_least=1)
    copy: int = setting(1000, at_least=1)
    explore: int = setting(5000, at_least=1)
    random: float = setting(0.05, at_least=0, at_most=1)


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


@dataclass(frozen=True)
class DDPGSettings(ReplayingSettings):
    """Settings of DDPG; the rest are in `ReplayingSettings`.

    Attributes:
        noise: standard deviation of what is added to an action while learning; the first `warm` ones are drawn.
        tau: share of the networks that their targets take over in an update.
    """

    noise: float = setting(0.2, at_least=0)
    tau: float = setting(0.005, at_least=0, at_most=1)


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
