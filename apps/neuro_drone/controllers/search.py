"""A linear policy learnt from the reward alone by random search, without a gradient and without a network."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro_drone.controllers.settings import number, whole
from neuro_drone.controllers.simple import Fixed, Floats, finder
from neuro_drone.scenario import Scenario

__all__ = ["LinearPolicy", "RandomSearch", "RandomSearchSettings"]

Find = Callable[[npt.NDArray[Any]], Floats]


@dataclass(frozen=True, slots=True)
class RandomSearchSettings:
    """What the search is told.

    Attributes:
        directions: tried from one update to the next, each there and back: twice as many episodes.
        best: of them, that an update follows; those whose better episode was best.
        noise: how far from the weights they are tried.
        rate: of an update's step.
    """

    directions: int = whole(8)
    best: int = whole(4)
    noise: float = number(1.0, above=0)
    rate: float = number(1.0, above=0)


class LinearPolicy(Fixed):
    """An action that is linear in the centroid of the events and a constant; none without events.

    Args:
        weights: (axes, axes + 1), of each action by what `find` gives, and by the constant.
        find: see `neuro_drone.controllers.simple.finder`.
    """

    def __init__(self, weights: Floats, find: Find) -> None:
        self._weights, self._find = weights, find

    def act(self, counts: npt.NDArray[Any], info: Mapping[str, Any]) -> Floats:
        """The action."""
        return linear(self._weights, counts, self._find)


class RandomSearch:
    """Augmented random search, version V1-t, of a linear policy.

    An episode is flown with weights a random direction away from the present ones, the next one as far on the other
    side. Once all directions are tried, the weights move along the best of them, each in proportion to how much more
    reward one side brought than the other, in units of the standard deviation of these rewards.

    It sees what the controller `centroid` sees and hears the sum of an episode's rewards: `info["reward"]`, never the
    supervised error.

    Args:
        scenario: of a ball or a line, which decides what is averaged.
        seed: of the directions.
        settings: see `RandomSearchSettings`.

    Source: H. Mania, A. Guy and B. Recht, "Simple random search of static linear policies is competitive for
        reinforcement learning", NeurIPS 2018, algorithms 1 and 2 (V1-t).

    Raises:
        ModelError: more directions shall be followed than are tried.
    """

    def __init__(self, scenario: Scenario, seed: int, settings: RandomSearchSettings) -> None:
        if settings.best > settings.directions:
            raise ModelError(
                f"controller 'random-search': best = {settings.best}: "
                f"expected at most directions = {settings.directions}"
            )
        self._settings, self._find = settings, finder(scenario)
        self._rng = np.random.default_rng((seed, 4))
        self._weights = np.zeros((scenario.axes, scenario.axes + 1))
        self._tried = self._weights
        self._renew()

    def _renew(self) -> None:
        """Draw directions."""
        n = self._settings.directions
        self._directions = self._rng.standard_normal((n, *self._weights.shape))
        self._returns = np.zeros((n, 2))
        self._episode, self._flown = -1, True

    def begin(self) -> None:
        """An episode begins; if the one before was flown, its reward is known now."""
        if self._flown:
            self._episode, self._flown = self._episode + 1, False
        if self._episode == self._returns.size:
            self._update()
            self._renew()
            self._episode, self._flown = 0, False
        direction, back = divmod(self._episode, 2)
        self._returns[direction, back] = 0.0
        self._tried = self._weights + (1 - 2 * back) * self._settings.noise * self._directions[direction]

    def act(self, counts: npt.NDArray[Any], info: Mapping[str, Any]) -> Floats:
        """The action of the weights that are tried."""
        return linear(self._tried, counts, self._find)

    def learn(self, info: Mapping[str, Any]) -> None:
        """Sum up the reward."""
        self._returns[divmod(self._episode, 2)] += info["reward"]
        self._flown = True

    def _update(self) -> None:
        """Move along the best directions."""
        best = np.argsort(-self._returns.max(axis=1), kind="stable")[: self._settings.best]
        returns = self._returns[best]
        deviation = returns.std()
        if deviation > 0.0:
            steps = np.tensordot(returns[:, 0] - returns[:, 1], self._directions[best], 1)
            self._weights = self._weights + self._settings.rate / (len(best) * deviation) * steps

    def learnt(self) -> dict[str, npt.NDArray[Any]]:
        """The weights, (axes, axes + 1), see `LinearPolicy`."""
        return {"weights": self._weights.copy()}

    def state(self) -> dict[str, npt.NDArray[Any]]:
        """Weights, directions, what they brought, and where the generator is."""
        words = {"episode": self._episode, "flown": self._flown, "rng": self._rng.bit_generator.state}
        return self.learnt() | {
            "directions": self._directions,
            "returns": self._returns.copy(),
            "words": np.frombuffer(json.dumps(words).encode(), np.uint8),
        }

    def restore(self, state: Mapping[str, npt.NDArray[Any]]) -> None:
        """Take up weights, or a whole state."""
        self._weights = np.array(state["weights"])
        if "words" in state:
            words = json.loads(state["words"].tobytes())
            self._directions, self._returns = np.array(state["directions"]), np.array(state["returns"])
            self._episode, self._flown = words["episode"], words["flown"]
            self._rng.bit_generator.state = words["rng"]

    def frozen(self, backend: str = "event") -> LinearPolicy:
        """The policy as it is now; `backend` makes no difference."""
        return LinearPolicy(self._weights.copy(), self._find)


def linear(weights: Floats, counts: npt.NDArray[Any], find: Find) -> Floats:
    """The action of a linear policy, see `LinearPolicy`."""
    if not counts.any():
        return np.zeros(len(weights))
    return np.clip(weights @ (*find(counts), 1.0), -1.0, 1.0)
