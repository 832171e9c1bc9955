"""The description of an agent and what it has learnt."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

import gymnasium
import numpy as np

import neuro
from neuro import ModelError
from neuro.apps import Environments, Log, NetworkPilot, States, actions_of, check, dimensions_of
from neuro_agent.network import SEED, Floats, Settings, Weights, encoder_of, network


class Learner:
    """The parts of an agent: places, a critic, circuits that choose actions, and one error that teaches all.

    Args:
        observations: space of the environment's observations.
        actions: space of the environment's actions.
        seed: seed of the network's draws, and of the random moves before learning.
        settings: settings by name, see `Settings`.

    Attributes:
        kind: kind of learning; an agent file of one kind cannot be read as another.
        settings: the settings.
        places: neurons that encode observations.
        states: dimensions of the observations with discrete states.
        actions: conversion of the neurons that spiked in the circuits to an action of the environment.
        rewards: scale from the rewards of the environment to those of the network.
        begun: numbers of episodes and of blocks of training so far; every episode and block has its own seed.
        explored: whether bounds and scales are known; random moves measure them, if any are needed.
        log: log of the last training.

    Raises:
        ModelError: a space is not supported or needs too many neurons, a setting is unknown, or a setting or the seed
            is out of bounds.
    """

    kind: ClassVar[str] = "spiking"

    def __init__(
        self, observations: gymnasium.Space[Any], actions: gymnasium.Space[Any], *, seed: int = 0, **settings: Any
    ) -> None:
        self.settings = s = Settings().changed(settings)
        self.observations, self.seed = observations, check(SEED, seed, "seed")
        if not dimensions_of(observations):
            raise ModelError("observation space: found an empty space: expected at least one dimension")
        self._encoder = encoder_of(s).made(observations, ())
        self.places, self.states = self._encoder.fields, States(observations)
        self.actions = actions_of(actions, s.levels, s.circuits)
        self.explored, self.begun, self.log = False, (0, 0), Log()
        world = self.network().world_section
        assert world is not None
        self._error = world.reward["error"].made()
        self._error.join({"places": self._encoder})
        self.rewards = self._error.scale
        sizes = (s.critics, *self.actions.sizes)
        weights = {p: np.zeros((self.places.size, n)) for p, n in zip(self.projections, sizes, strict=True)}
        self._memory = {"learnt": weights, "seen": {"vectors": np.zeros((0, len(self.places.dimensions)))}}

    def __repr__(self) -> str:
        sizes = " + ".join(map(str, self.actions.sizes))
        text = f"{self.places.size} places, {self.settings.critics} critics, {sizes} actors, seed={self.seed}"
        return f"{type(self).__name__}({text})"

    @property
    def projections(self) -> tuple[str, ...]:
        """Projections that learn: onto the critic first, then onto the circuits."""
        return ("value", *(f"policy{k}" for k in range(len(self.actions.sizes))))

    @property
    def weights(self) -> dict[str, Floats]:
        """Learnt weights by projection, mV, (places, neurons)."""
        return {name: weights.copy() for name, weights in self._memory["learnt"].items()}

    @property
    def last_vectors(self) -> Floats:
        """Observations of the last control steps, (n, dimensions)."""
        return self._memory["seen"]["vectors"]

    def learn_from(self, weights: Weights) -> None:
        """Replace the learnt weights."""
        self.put({**self.arrays(), "learnt": weights})

    def network(self, environment: Any = None, *, learns: bool = True) -> neuro.Network:
        """Return the network with its world, for `neuro.closed_loop` and the commands.

        Training this network with the agent's seed gives the agent's results. The network does not hold the bounds of
        unbounded dimensions; random moves measure them.

        Args:
            environment: environment that the world names; without one, pass it to `closed_loop`.
            learns: whether the network learns, from initial weights; else it has the learnt weights as static synapses.
        """
        description: dict[str, Any] = {"id": "environment"}
        if environment is not None:
            worlds = Environments(environment)
            description = {"id": worlds.name} | ({"options": worlds.options} if worlds.options else {})
        return network(self.settings, self.places, self.actions, description, None if learns else self.weights)

    def pilot(self, worlds: Environments, seed: int) -> Any:
        """Return an untrained pilot that learns in environments within a closed loop."""
        return NetworkPilot(self.network(), worlds, backend=self.settings.backend, seed=seed)

    def arrays(self) -> dict[str, Any]:
        """Return everything that the agent has learnt, in the format of `NetworkPilot.arrays`."""
        weights = {name: values.ravel() for name, values in self._memory["learnt"].items()}
        parts = {"encoder.places": self._encoder.arrays(), "teacher.error": self._error.arrays()}
        return {**self._memory, "learnt": weights, **parts}

    def put(self, arrays: Mapping[str, Any]) -> None:
        """Restore what the agent has learnt from arrays that `arrays()` returned."""
        weights = self._memory["learnt"]
        weights = {name: np.array(arrays["learnt"][name]).reshape(array.shape) for name, array in weights.items()}
        self._memory = {"learnt": weights, "seen": arrays["seen"]}
        self._encoder.put(arrays["encoder.places"])
        self._error.put(arrays["teacher.error"])
