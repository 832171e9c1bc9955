"""An agent as a description, and what it has learnt."""

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
    """What an agent is and has learnt: places, a critic, circuits that choose, and one error for all.

    Args:
        observations: the space of an environment's observations.
        actions: that of its actions.
        seed: of the network's draws, and of the random moves before learning.
        settings: by name, see `Settings`.

    Attributes:
        kind: in what way it learns; what one kind has learnt says nothing to another.
        settings: what was chosen.
        places: the neurons that stand for observations.
        states: which of their numbers have states.
        actions: what the neurons of the circuits stand for.
        rewards: the scale of rewards.
        begun: episodes and blocks of training that have begun; each has a seed of its own.
        explored: whether bounds and scales are known, from random moves or since none are needed.
        log: of the last training.

    Raises:
        ModelError: a space is of another kind or needs too many neurons, a setting is unknown, or a setting or the seed
            is out of bounds.
    """

    kind: ClassVar[str] = "spiking"

    def __init__(
        self, observations: gymnasium.Space[Any], actions: gymnasium.Space[Any], *, seed: int = 0, **settings: Any
    ) -> None:
        self.settings = s = Settings().changed(settings)
        self.observations, self.seed = observations, check(SEED, seed, "seed")
        if not dimensions_of(observations):
            raise ModelError("observation space: it is empty: expected at least one dimension")
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
        about = f"{self.places.size} places, {self.settings.critics} critics, {sizes} actors, seed={self.seed}"
        return f"{type(self).__name__}({about})"

    @property
    def projections(self) -> tuple[str, ...]:
        """The projections that learn: that onto the critic, then those onto the circuits."""
        return ("value", *(f"policy{k}" for k in range(len(self.actions.sizes))))

    @property
    def weights(self) -> dict[str, Floats]:
        """What has been learnt, by projection, mV, (places, neurons)."""
        return {name: each.copy() for name, each in self._memory["learnt"].items()}

    @property
    def seen(self) -> Floats:
        """Observations of the last control steps, (n, dimensions)."""
        return self._memory["seen"]["vectors"]

    def learn_from(self, weights: Weights) -> None:
        """Have learnt these weights, and go on from them."""
        self.put({**self.arrays(), "learnt": weights})

    def network(self, environment: Any = None, *, learns: bool = True) -> neuro.Network:
        """Return the network as a description with its world, which `neuro.closed_loop` and the commands run.

        The same seed learns there what it learns here. A description has no bounds of dimensions that have none: random
        moves tell them.

        Args:
            environment: that the world names; without one `closed_loop` is given it.
            learns: whether it learns, from nothing; else it has what was learnt in static synapses.
        """
        words: dict[str, Any] = {"id": "environment"}
        if environment is not None:
            worlds = Environments(environment)
            words = {"id": worlds.name} | ({"options": worlds.options} if worlds.options else {})
        return network(self.settings, self.places, self.actions, words, None if learns else self.weights)

    def pilot(self, worlds: Environments, seed: int) -> Any:
        """Return what learns in environments, as the pilot of a closed loop that has learnt nothing yet."""
        return NetworkPilot(self.network(), worlds, backend=self.settings.backend, seed=seed)

    def arrays(self) -> dict[str, Any]:
        """Return all that it has learnt, as pilots do."""
        weights = {name: each.ravel() for name, each in self._memory["learnt"].items()}
        parts = {"encoder.places": self._encoder.arrays(), "teacher.error": self._error.arrays()}
        return {**self._memory, "learnt": weights, **parts}

    def put(self, arrays: Mapping[str, Any]) -> None:
        """Have learnt what `arrays` gave."""
        weights = self._memory["learnt"]
        weights = {name: np.array(arrays["learnt"][name]).reshape(each.shape) for name, each in weights.items()}
        self._memory = {"learnt": weights, "seen": arrays["seen"]}
        self._encoder.put(arrays["encoder.places"])
        self._error.put(arrays["teacher.error"])
