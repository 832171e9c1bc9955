"""Deep reinforcement learning: the common base of DQN, DDPG and PPO, then DQN and DDPG.

Networks, losses, optimizers and buffers are those of stable-baselines3. The closed loop of the other controllers runs
the control steps, so training, checkpoints, files and tests are the same.
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
"""Events in a field at which the input saturates at 1."""


def observed(counts: npt.NDArray[Any], kind: str) -> Singles:
    """Return the observation of a deep network.

    Args:
        counts: (8, 8) events.
        kind: "binary" (1 for a field with events; thesis, section 7.2.1), "counts" (divided by 15, at most 1), or a
            coding of `shares`.

    Returns:
        (64,) in [0, 1].
    """
    flat = counts.ravel()
    if kind == "binary":
        return (flat > 0).astype(np.float32)
    if kind == "counts":
        levels: Singles = np.minimum(flat.astype(np.float32) / MOST, np.float32(1.0))
        return levels
    return shares(counts, kind).astype(np.float32)


ACTIVATIONS: dict[str, Callable[[Singles], Singles]] = {
    "relu": lambda x: np.maximum(x, np.float32(0.0)),
    "tanh": np.tanh,
}
"""Activations of hidden layers by name."""


class Dense:
    """Dense layers in NumPy.

    Args:
        arrays: weights (out, in) and biases (out,), by layer name + ".weight" or ".bias".
        layers: names of the layers, first to last.
        activation: activation of the hidden layers, a name of `ACTIVATIONS`.

    Attributes:
        layers: weights and bias of each layer. The arrays are not copied, so they follow a network that learns.
    """

    def __init__(self, arrays: Arrays, layers: Sequence[str], activation: str = "relu") -> None:
        self.layers = [(arrays[f"{name}.weight"], arrays[f"{name}.bias"]) for name in layers]
        self._activation = ACTIVATIONS[activation]

    def __call__(self, values: Singles) -> Singles:
        """Return the output of the last layer for an observation."""
        *hidden_layers, (weight, bias) = self.layers
        for w, b in hidden_layers:
            values = self._activation(w @ values + b)
        out: Singles = weight @ values + bias
        return out


class Flier(Fixed):
    """A trained agent, which neither learns nor explores.

    Args:
        dense: the policy network.
        command: function from the network's output to the drone's action, (2,).
        observation: kind of the observation, see `observed`.

    Attributes:
        dense: the policy network.
    """

    def __init__(self, dense: Dense, command: Callable[[Singles], Floats], observation: str) -> None:
        self.dense, self._command, self._kind = dense, command, observation

    def act(self, counts: npt.NDArray[Any], info: Mapping[str, Any]) -> Floats:
        """Return the action of the network."""
        return self._command(self.dense(observed(counts, self._kind)))


_POLICY, _BUFFER = "policy.", "kept."
"""Prefixes of the array names of a checkpoint: the networks, and the replay or rollout buffer."""


@dataclass(frozen=True)
class DeepSettings(ControllerSettings):
    """Settings of all agents.

    Attributes:
        observation: binary (1 for a field with events; thesis, section 7.2.1) or counts.
        hidden: units of each of the two hidden layers.
        rate: learning rate of Adam.
        gamma: discount factor per step.
        batch: transitions per update.
    """

    observation: str = setting("binary", words=("binary", "counts"))
    hidden: int = setting(64, at_least=1)
    rate: float = setting(1e-3, above=0)
    gamma: float = setting(0.9, at_least=0, at_most=1)
    batch: int = setting(64, at_least=1)


class Spaces(gymnasium.Env[Any, Any]):
    """An environment without steps, which gives stable-baselines3 the spaces of observations and actions."""

    def __init__(self, actions: gymnasium.Space[Any]) -> None:
        self.observation_space = gymnasium.spaces.Box(0.0, 1.0, (64,), np.float32)
        self.action_space = actions


class Deep(Fixed, ABC):
    """An agent that learns from `info["reward"]` and `info["lost"]`, never from the supervised error.

    Args:
        scenario: ignored.
        seed: seed of the initial weights, of exploration and of the package's random numbers.
        settings: see `DeepSettings`.

    Attributes:
        name: name of the agent.
        acts: names of the layers of the network that chooses the actions.
        activation: activation of the hidden layers.
        buffer_arrays: names of the arrays of the package's buffer, for checkpoints.
    """

    name: ClassVar[str]
    acts: ClassVar[tuple[str, ...]]
    activation: ClassVar[str] = "relu"
    buffer_arrays: ClassVar[tuple[str, ...]]

    def __init__(self, scenario: Scenario, seed: int, settings: Any) -> None:
        self._seed, self._settings = seed, settings
        self._rng = np.random.default_rng((seed, 3))
        self._learnt: dict[str, npt.NDArray[Any]] = {}
        self._steps = 0
        self._last_input: Singles = np.zeros(64, np.float32)
        self._chosen: Any = None

    @abstractmethod
    def build(self, package: Any, common: dict[str, Any]) -> Any:
        """Return the algorithm of stable-baselines3.

        Args:
            package: the module stable_baselines3.
            common: keyword arguments that all agents have in common.
        """

    @property
    @abstractmethod
    def buffer(self) -> Any:
        """The algorithm's buffer of transitions."""

    @abstractmethod
    def explore(self, out: Singles, steps: int) -> Any:
        """Return the agent's action with exploration, from the network's output and the number of steps so far."""

    @staticmethod
    @abstractmethod
    def best(out: Singles) -> Any:
        """Return the agent's action without exploration, from the network's output."""

    @staticmethod
    @abstractmethod
    def command(chosen: Any) -> Floats:
        """Return the drone's action, (2,), for the agent's action."""

    @abstractmethod
    def optimizers(self) -> list[Any]:
        """Return the optimizers of the algorithm."""

    @abstractmethod
    def keep(self, after: Singles, reward: float, lost: bool) -> None:
        """Add the transition of the last action to the buffer.

        Args:
            after: (64,), the observation after the action.
            reward: the reward of the action.
            lost: True if the action lost the target.
        """

    @abstractmethod
    def update(self, after: Singles, lost: bool) -> None:
        """Update the networks if an update is due after `_steps` steps.

        Args:
            after: (64,), the observation after the last action.
            lost: True if the last action lost the target.
        """

    @cached_property
    def algorithm(self) -> Any:
        """The algorithm of stable-baselines3, with the restored networks.

        Raises:
            ModelError: the package is not installed.
        """
        package, torch = needed(self.name)
        s = self._settings
        options = {
            "learning_rate": s.rate,
            "gamma": s.gamma,
            "batch_size": s.batch,
            "policy_kwargs": {"net_arch": [s.hidden, s.hidden], "optimizer_kwargs": {"fused": True}},
            "device": "cpu",
        }
        with alone(self._seed):
            algorithm = self.build(package, options)
        algorithm.set_logger(package.common.logger.Logger(None, []))
        if self._learnt:
            algorithm.policy.load_state_dict({name: torch.tensor(array) for name, array in self._learnt.items()})
        return algorithm

    @cached_property
    def dense(self) -> Dense:
        """The policy network; shares its arrays with the algorithm."""
        return Dense(self.arrays(), self.acts, self.activation)

    def arrays(self) -> dict[str, npt.NDArray[Any]]:
        """Return all learnt arrays, shared with the algorithm."""
        return {name: tensor.numpy() for name, tensor in self.algorithm.policy.state_dict().items()}

    def act(self, counts: npt.NDArray[Any], info: Mapping[str, Any]) -> Floats:
        """Return the network's action with exploration."""
        self._last_input = observed(counts, self._settings.observation)
        self._chosen = self.explore(self.dense(self._last_input), self._steps)
        return self.command(self._chosen)

    def learn(self, info: Mapping[str, Any]) -> None:
        """Add the transition to the buffer, and update the networks if an update is due."""
        observation = observed(info["counts"], self._settings.observation)
        self.keep(observation, info["reward"], info["lost"])
        self._steps += 1
        self.update(observation, info["lost"])

    def learnt(self) -> dict[str, npt.NDArray[Any]]:
        """Return weights and biases of all networks, by their names in stable-baselines3."""
        return {name: array.copy() for name, array in self.arrays().items()}

    def state(self) -> dict[str, npt.NDArray[Any]]:
        """Return networks, optimizers, the buffer, and the state of the random generator."""
        _, torch = needed(self.name)
        buffer, file = self.buffer, BytesIO()
        torch.save([o.state_dict() for o in self.optimizers()], file)
        numbers = {"steps": self._steps, "pos": buffer.pos, "full": buffer.full, "rng": self._rng.bit_generator.state}
        texts = {"words": json.dumps(numbers).encode(), "optimizers": file.getvalue()}
        return (
            {name: np.frombuffer(text, np.uint8) for name, text in texts.items()}
            | {_POLICY + name: array for name, array in self.learnt().items()}
            | {_BUFFER + name: getattr(buffer, name)[: buffer.size()].copy() for name in self.buffer_arrays}
        )

    def restore(self, state: Mapping[str, npt.NDArray[Any]]) -> None:
        """Restore networks or a whole state."""
        for cached in ("dense", "algorithm"):
            self.__dict__.pop(cached, None)
        if "words" not in state:
            self._learnt = dict(state)
            return
        self._learnt = {name.removeprefix(_POLICY): a for name, a in state.items() if name.startswith(_POLICY)}
        _, torch = needed(self.name)
        optimizers = torch.load(BytesIO(state["optimizers"].tobytes()), weights_only=True)
        for optimizer, optimizer_state in zip(self.optimizers(), optimizers, strict=True):
            optimizer.load_state_dict(optimizer_state)
        buffer, numbers = self.buffer, json.loads(state["words"].tobytes())
        for name in self.buffer_arrays:
            array = state[_BUFFER + name]
            getattr(buffer, name)[: len(array)] = array
        buffer.pos, buffer.full, self._steps = numbers["pos"], numbers["full"], numbers["steps"]
        self._rng.bit_generator.state = numbers["rng"]

    def frozen(self) -> Flier:
        """Return a copy in NumPy without learning and exploration."""
        arrays = self._learnt if self._learnt and "algorithm" not in self.__dict__ else self.learnt()
        dense = Dense(arrays, self.acts, self.activation)
        return Flier(dense, lambda out: self.command(self.best(out)), self._settings.observation)


@contextmanager
def alone(seed: int) -> Iterator[None]:
    """Run stable-baselines3 with seeded global random generators and one thread, and restore both afterwards.

    Args:
        seed: seed of the global random generators of NumPy and torch.

    The networks are so small that several threads would mostly wait for each other.
    """
    import torch

    threads = torch.get_num_threads()
    numpy_state, torch_state = np.random.get_state(), torch.random.get_rng_state()  # noqa: NPY002
    torch.set_num_threads(1)
    np.random.seed(seed)  # noqa: NPY002
    torch.random.manual_seed(seed)
    try:
        yield
    finally:
        np.random.set_state(numpy_state)  # noqa: NPY002
        torch.random.set_rng_state(torch_state)
        torch.set_num_threads(threads)


def needed(name: str) -> tuple[Any, Any]:
    """Import and return the packages stable_baselines3 and torch.

    Args:
        name: name of the controller that needs them, for the message.

    Raises:
        ModelError: a package is not installed.
    """
    try:
        import stable_baselines3
        import torch
    except ImportError:
        raise ModelError(f"controller '{name}': stable-baselines3 is not installed", hint=install("rl")) from None
    return stable_baselines3, torch


@dataclass(frozen=True)
class ReplayingSettings(DeepSettings):
    """Settings of agents that learn from replay, beside those of `DeepSettings`.

    Attributes:
        buffer: transitions in the replay buffer.
        warm: steps before the first update.
        every: steps between two updates.
    """

    buffer: int = setting(50_000, at_least=1)
    warm: int = setting(1000, at_least=1)
    every: int = setting(1, at_least=1)


class Replaying(Deep):
    """An agent that learns from random transitions of its replay buffer."""

    buffer_arrays = ("observations", "next_observations", "actions", "rewards", "dones")

    @property
    def buffer(self) -> Any:
        """See `Deep`."""
        return self.algorithm.replay_buffer

    def keep(self, after: Singles, reward: float, lost: bool) -> None:
        """See `Deep`."""
        self.buffer.add(self._last_input, after, np.asarray(self._chosen), reward, lost, [{}])

    def update(self, after: Singles, lost: bool) -> None:
        """Learn from a batch if an update is due, see `ReplayingSettings`."""
        s = self._settings
        if self._steps > s.warm and self._steps % s.every == 0:
            with alone(int(self._rng.integers(2**32))):
                self.algorithm.train(1, s.batch)


@dataclass(frozen=True)
class DQNSettings(ReplayingSettings):
    """Settings of DQN, beside those of `ReplayingSettings`.

    Attributes:
        rate: learning rate. The choice of an action changes the return by less than 0.01; with a larger rate, the noise
            of the estimated values hides this difference.
        every: steps between two updates.
        copy: steps between two copies of the network to its target network.
        explore: steps in which the share of random actions falls from 1 to `random`.
        random: share of random actions after these steps.
    """

    rate: float = setting(3e-4, above=0)
    every: int = setting(4, at_least=1)
    copy: int = setting(1000, at_least=1)
    explore: int = setting(5000, at_least=1)
    random: float = setting(0.05, at_least=0, at_most=1)


class DQN(Replaying):
    """Q-learning of the nine actions of `env.ACTIONS`, with a target network.

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
        """Return the best action or, with the probability of `DQNSettings`, a random one."""
        s = self._settings
        if self._rng.random() < max(s.random, 1.0 - steps / s.explore * (1.0 - s.random)):
            return int(self._rng.integers(len(ACTIONS)))
        return self.best(out)

    @staticmethod
    def best(out: Singles) -> Any:
        """Return the action of the largest value."""
        return int(np.argmax(out))

    @staticmethod
    def command(chosen: Any) -> Floats:
        """Return the direction of an action."""
        return np.array(ACTIONS[chosen])

    def optimizers(self) -> list[Any]:
        """Return the optimizer of the values."""
        return [self.algorithm.policy.optimizer]

    def update(self, after: Singles, lost: bool) -> None:
        """Learn, and copy the network to its target if a copy is due."""
        super().update(after, lost)
        if self._steps % self._settings.copy == 0:
            self.algorithm.q_net_target.load_state_dict(self.algorithm.q_net.state_dict())


@dataclass(frozen=True)
class DDPGSettings(ReplayingSettings):
    """Settings of DDPG, beside those of `ReplayingSettings`.

    Attributes:
        noise: standard deviation of the noise on an action. The first `warm` actions are random instead.
        tau: share by which the target networks approach the networks in an update.
    """

    noise: float = setting(0.2, at_least=0)
    tau: float = setting(0.005, at_least=0, at_most=1)


class DDPG(Replaying):
    """Deep deterministic policy gradient: an actor with continuous actions, trained by the gradient of a critic.

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
        """Return the action with noise, or a random one in the first `warm` steps."""
        if steps < self._settings.warm:
            return self._rng.uniform(-1.0, 1.0, 2)
        return np.clip(self.best(out) + self._rng.normal(0.0, self._settings.noise, 2), -1.0, 1.0)

    @staticmethod
    def best(out: Singles) -> Any:
        """Return the actor's action."""
        return np.tanh(out)

    @staticmethod
    def command(chosen: Any) -> Floats:
        """Return the action."""
        return np.asarray(chosen, np.float64)

    def optimizers(self) -> list[Any]:
        """Return the optimizers of actor and critic."""
        return [self.algorithm.actor.optimizer, self.algorithm.critic.optimizer]
