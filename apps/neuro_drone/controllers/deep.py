"""Deep reinforcement learning beside the spiking network: what DQN, DDPG and PPO have in common.

Networks, losses, optimisers and buffers are those of stable-baselines3. The steps of control are taken by the same loop
as for every other controller, so that training, checkpoints, files and tests are the same, too.
"""

from __future__ import annotations

import json
from abc import ABC, abstractmethod
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from io import BytesIO
from typing import Any, ClassVar

import gymnasium
import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro.apps import install
from neuro_drone.controllers.dense import Dense, Flier, Floats, Singles, observed
from neuro_drone.controllers.settings import choice, number, share, whole
from neuro_drone.controllers.simple import Fixed
from neuro_drone.scenario import Scenario

__all__ = ["Deep", "DeepSettings", "Spaces", "alone", "needed"]

_POLICY, _KEPT = "policy.", "kept."


@dataclass(frozen=True, slots=True)
class DeepSettings:
    """What all of them are told.

    Attributes:
        observation: binary (whether a field had events; thesis, section 7.2.1) or counts.
        hidden: units of each of the two hidden layers.
        rate: of learning, for Adam.
        gamma: discount of a step.
        batch: transitions of an update.
    """

    observation: str = choice("binary", "binary", "counts")
    hidden: int = whole(64)
    rate: float = number(1e-3, above=0)
    gamma: float = share(0.9)
    batch: int = whole(64)


class Spaces(gymnasium.Env[Any, Any]):
    """Tells stable-baselines3 what an agent sees and does, and no more."""

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

    def frozen(self, backend: str = "event") -> Flier:
        """The same without learning and exploration, in NumPy; `backend` makes no difference."""
        arrays = self._learnt if self._learnt and "algorithm" not in self.__dict__ else self.learnt()
        dense = Dense(arrays, self.acts, self.activation)
        return Flier(dense, lambda out: self.command(self.best(out)), self._settings.observation)


@contextmanager
def alone(seed: int) -> Iterator[None]:
    """Lend the global generators to the package, and one thread: of small networks more only wait for each other."""
    _, torch = needed("")
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
