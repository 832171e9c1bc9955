"""Controllers without a network: one that does nothing, one that sees the truth, one that averages, two that learn.

`LMS` learns a linear read-out of the counts by least mean squares, `RandomSearch` a linear policy from the reward alone
by random search, without a gradient.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from math import atan, pi, sqrt
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro.apps import setting
from neuro_drone.controllers.fields import DOWN, RIGHT, UNIT, shares
from neuro_drone.controllers.settings import ControllerSettings, each_axis
from neuro_drone.parts import Ball, Line
from neuro_drone.scenario import Scenario

__all__ = [
    "LMS",
    "Centroid",
    "Fixed",
    "Gain",
    "LMSSettings",
    "LinearPolicy",
    "Nothing",
    "NothingSettings",
    "Oracle",
    "RandomSearch",
    "RandomSearchSettings",
    "centroid",
    "finder",
]

Floats = npt.NDArray[np.float64]
Find = Callable[[npt.NDArray[Any]], Floats]
_X, _Y = RIGHT.ravel(), DOWN.ravel()
FIELD = 16.0 / UNIT
"""Side of a field; events anywhere in it spread by a twelfth of its square on each axis."""


class Fixed:
    """A controller that keeps nothing between two steps."""

    def begin(self) -> None:
        """Nothing to do."""

    def learn(self, info: Mapping[str, Any]) -> None:
        """It does not learn."""


@dataclass(frozen=True)
class NothingSettings(ControllerSettings):
    """It has none."""


class Nothing(Fixed):
    """Never moves; what it scores, a world gives for free."""

    def __init__(self, scenario: Scenario, seed: int, settings: NothingSettings) -> None:
        self._action = np.zeros(scenario.axes)

    def act(self, counts: npt.NDArray[Any], info: Mapping[str, Any]) -> Floats:
        """No action."""
        return self._action


@dataclass(frozen=True)
class Gain(ControllerSettings):
    """Settings of a proportional controller.

    Attributes:
        gain: action by error, where an error of 1 is half of the picture (64 px), of a line's lean 90 degrees, of a
            ball's size as much as it shall have.
    """

    gain: float | tuple[float, ...] = setting(8.0, above=0)


class Oracle(Fixed):
    """In proportion to the true error, which no camera sees; it bounds what the others can reach."""

    def __init__(self, scenario: Scenario, seed: int, settings: Gain) -> None:
        self._gain = each_axis("gain", settings.gain, scenario.axes)

    def act(self, counts: npt.NDArray[Any], info: Mapping[str, Any]) -> Floats:
        """The action of a proportional controller."""
        error: Floats = info["supervised_error"]
        return np.clip(self._gain * error, -1.0, 1.0)


class Centroid(Fixed):
    """In proportion to the mean place of the events, of a line to the straight line that fits them best.

    Of a ball on three axes it takes the events' distances from their mean place for those of the ball's outline.
    """

    def __init__(self, scenario: Scenario, seed: int, settings: Gain) -> None:
        self._gain = each_axis("gain", settings.gain, scenario.axes)
        self._find = finder(scenario)

    def act(self, counts: npt.NDArray[Any], info: Mapping[str, Any]) -> Floats:
        """The action of a proportional controller on what the counts tell; none where there are no events."""
        return np.clip(self._gain * self._find(counts), -1.0, 1.0)


def finder(scenario: Scenario) -> Find:
    """What `centroid` gives of counts in this scenario, a number an axis."""
    task = scenario.task
    tall = task.tall / UNIT if isinstance(task, Ball) and task.axes == 3 else None
    return partial(centroid, line=isinstance(task, Line), tall=tall)


def centroid(counts: npt.NDArray[Any], line: bool = False, tall: float | None = None) -> Floats:
    """Where the events are on average.

    Args:
        counts: (8, 8) events in each field.
        line: they are those of a line.
        tall: how tall a ball shall be seen, in units of 64 px, where the drone climbs.

    Returns:
        (2,), to the right of the aim and below it, in units of 64 px; of a line where the one that fits best crosses
        the aim's row, and its lean to the right over 90 degrees. Where the drone climbs (3,): how much too tall the
        ball is, as a share, if the events are on its outline. 0 where there are no events.
    """
    n = counts.ravel()
    total = n.sum()
    if total == 0:
        return np.zeros(2 if tall is None else 3)
    x, y = n @ _X / total, n @ _Y / total
    if tall is not None:
        return np.array((x, y, _tall(n / total, x, y) / tall - 1.0))
    if not line:
        return np.array((x, y))
    spread = n @ (_Y - y) ** 2
    slope = n @ ((_X - x) * (_Y - y)) / spread if spread > 0.0 else 0.0
    return np.array((x - slope * y, -atan(slope) / (0.5 * pi)))


def _tall(shares: npt.NDArray[Any], x: float, y: float) -> float:
    """How tall the circle around a place is whose outline has its events in these fields, in units of 64 px."""
    around = float(shares @ (_X**2 + _Y**2)) - x * x - y * y
    return 2.0 * sqrt(max(0.0, around - 2.0 * FIELD**2 / 12.0))


@dataclass(frozen=True)
class LMSSettings(ControllerSettings):
    """Settings of the read-out.

    Attributes:
        gain: action by estimated error.
        mu: share of the estimate's error that a step takes away.
        coding: shares, rows or peaks, see `fields.shares`.
    """

    gain: float | tuple[float, ...] = setting(8.0, above=0)
    mu: float = setting(0.02, at_least=0)
    coding: str = setting("shares", words=("shares", "rows", "peaks"))


class LMS(Fixed):
    """Estimates the error of each axis as a weighted sum of the fields' shares of the events, and acts in proportion.

    It has the network's inputs and the network's supervised error, and no spikes: what is left between the two is
    the price of spikes and of a local rule. Source of the rule: B. Widrow and M. E. Hoff, "Adaptive switching
    circuits", IRE WESCON, 1960, in its normalised form.
    """

    def __init__(self, scenario: Scenario, seed: int, settings: LMSSettings, learns: bool = True) -> None:
        self._settings, self._learns = settings, learns
        self._new = (scenario, seed)
        self._gain = each_axis("gain", settings.gain, scenario.axes)
        self._weights = np.zeros((scenario.axes, 64))
        self._shares = np.zeros(64)

    def begin(self) -> None:
        """Forget what was seen."""
        self._shares = np.zeros(64)

    def act(self, counts: npt.NDArray[Any], info: Mapping[str, Any]) -> Floats:
        """In proportion to the estimated error; none where there are no events."""
        self._shares = shares(counts, self._settings.coding)
        return np.clip(self._gain * (self._weights @ self._shares), -1.0, 1.0)

    def learn(self, info: Mapping[str, Any]) -> None:
        """Take away a share of the difference between the supervised error and the estimate."""
        x = self._shares
        power = x @ x
        if self._learns and power > 0.0:
            missing = info["supervised_error"] - self._weights @ x
            self._weights += np.outer(self._settings.mu / power * missing, x)

    def learnt(self) -> dict[str, npt.NDArray[Any]]:
        """The weights, (axes, 64)."""
        return {"weights": self._weights.copy()}

    def state(self) -> dict[str, npt.NDArray[Any]]:
        """The weights: an episode begins with nothing else."""
        return self.learnt()

    def restore(self, state: Mapping[str, npt.NDArray[Any]]) -> None:
        """Take up weights."""
        self._weights = np.array(state["weights"])

    def frozen(self, backend: str = "event") -> LMS:
        """The same without learning; `backend` makes no difference."""
        other = LMS(*self._new, self._settings, learns=False)
        other.restore(self.learnt())
        return other


@dataclass(frozen=True)
class RandomSearchSettings(ControllerSettings):
    """Settings of the search.

    Attributes:
        directions: tried from one update to the next, each there and back: twice as many episodes.
        best: of them, that an update follows; those whose better episode was best.
        noise: how far from the weights they are tried.
        rate: of an update's step.
    """

    directions: int = setting(8, at_least=1)
    best: int = setting(4, at_least=1)
    noise: float = setting(1.0, above=0)
    rate: float = setting(1.0, above=0)


class LinearPolicy(Fixed):
    """An action that is linear in the centroid of the events and a constant; none without events.

    Args:
        weights: (axes, axes + 1), of each action by what `find` gives, and by the constant.
        find: see `finder`.
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
