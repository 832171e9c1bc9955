"""Controllers without a network: one that does nothing, one that sees the truth, one that averages, two that learn.

`LMS` learns a linear read-out of the counts by least mean squares, `RandomSearch` a linear policy from the reward alone
by random search, without a gradient.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import Field, dataclass, field
from functools import partial
from math import atan, pi, sqrt
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro import ModelError
from neuro.apps import Quantity, Settings, check, setting
from neuro_drone.geometry import AIM
from neuro_drone.parts import Ball, Line
from neuro_drone.scenario import Scenario


@dataclass(frozen=True)
class ControllerSettings(Settings):
    """Base of the settings of controllers; a `gain` may be one number for all axes, or a list of one for each.

    Attributes:
        name: of the controller, for messages.
    """

    name: str = field(default="", kw_only=True, metadata={"fixed": True})

    def place(self) -> str:
        """Return the controller with its name."""
        return f"controller '{self.name}'"

    def checked(self, one: Field[Any], q: Quantity, value: Any, what: str) -> Any:
        """Return a value, or of a `gain` one for each axis; see `Settings.checked`."""
        if one.name != "gain":
            return super().checked(one, q, value, what)
        if isinstance(value, (list, tuple)) and len(value) in (2, 3):
            return tuple(check(q, each, f"{what}[{k}]") for k, each in enumerate(value))
        try:
            return super().checked(one, q, value, what)
        except ModelError as error:
            raise ModelError(f"{error.message} or a list of two or three, one an axis", hint=error.hint) from None


def each_axis(name: str, value: float | tuple[float, ...], axes: int) -> npt.NDArray[np.float64]:
    """Return the value of a setting for each axis, (axes,).

    Args:
        name: of the setting, for messages.
        value: of it.
        axes: of the scenario.

    Raises:
        ModelError: it is a list, and not of one for each.
    """
    if isinstance(value, tuple) and len(value) != axes:
        raise ModelError(f"{name} = {list(value)}: expected a number or a list of {axes}, one an axis")
    return np.broadcast_to(np.asarray(value, float), axes)


UNIT = 64.0
"""Pixels that an error of 1 stands for: half of the picture."""

_MIDDLES = (16.0 * np.arange(8) + 7.5 - AIM) / UNIT
RIGHT: npt.NDArray[np.float64] = np.tile(_MIDDLES, (8, 1))
"""(8, 8), how far the middle of each field lies to the right of the aim, in units of 64 px."""
DOWN: npt.NDArray[np.float64] = np.ascontiguousarray(RIGHT.T)
"""(8, 8), how far it lies below it."""

AWAY: npt.NDArray[np.float64] = np.hypot(RIGHT, DOWN)
"""(8, 8), how far it lies from the aim."""


def shares(counts: npt.NDArray[Any], coding: str) -> npt.NDArray[np.float64]:
    """How the events are spread over the fields, whatever their number.

    Args:
        counts: (8, 8) events in each field.
        coding: shares (of all events) or rows (of the events of the field's row, over 8). A line crosses all rows:
            its mean place in each tells where it is and how it leans, however many events the row has. Or peaks (of
            the events beyond twice the mean of all fields): textured ground makes events everywhere, a target in few.

    Returns:
        (64,), 1 in all; rows without events are 0, and all where no field has a peak.
    """
    if coding == "peaks":
        counts = np.maximum(counts - 2.0 * counts.mean(), 0.0)
    spread: npt.NDArray[np.float64]
    if coding == "rows":
        n = counts.sum(axis=1, keepdims=True) * len(counts)
        spread = counts / np.where(n > 0, n, 1)
    else:
        spread = counts / (counts.sum() or 1)
    return spread.ravel()


def pattern(scenario: Scenario, shape: str) -> npt.NDArray[np.float64]:
    """How strongly each field speaks for the positive direction of each axis, as a person would set it.

    Args:
        scenario: of a ball, whose axes are right and down, and the third its size: what is farther from the aim than
            the outline of a ball as tall as wanted speaks for up; or of a line, whose second axis is its lean: what
            is right above the aim or left below it leans to the right.
        shape: sign (by the side only) or linear (in the distance).

    Returns:
        (64, axes), in [-1, 1].

    Source: thesis, section 7.3.8 ("static weights set with human knowledge"), which prints no values.
    """
    second = -RIGHT * DOWN if isinstance(scenario.task, Line) else DOWN
    axes = [RIGHT, second]
    if scenario.axes == 3 and isinstance(scenario.task, Ball):
        axes.append(AWAY - 0.5 * scenario.task.tall / UNIT)
    wished = np.stack([one.ravel() for one in axes], axis=1)
    return np.sign(wished) if shape == "sign" else wished / np.abs(wished).max(axis=0)


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
        around = float(n @ (_X**2 + _Y**2) / total) - x * x - y * y  # of the circle with its events in these fields
        return np.array((x, y, 2.0 * sqrt(max(0.0, around - 2.0 * FIELD**2 / 12.0)) / tall - 1.0))
    if not line:
        return np.array((x, y))
    spread = n @ (_Y - y) ** 2
    slope = n @ ((_X - x) * (_Y - y)) / spread if spread > 0.0 else 0.0
    return np.array((x - slope * y, -atan(slope) / (0.5 * pi)))


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

    def frozen(self) -> LMS:
        """The same without learning."""
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

    def frozen(self) -> LinearPolicy:
        """The policy as it is now."""
        return LinearPolicy(self._weights.copy(), self._find)


def linear(weights: Floats, counts: npt.NDArray[Any], find: Find) -> Floats:
    """The action of a linear policy, see `LinearPolicy`."""
    if not counts.any():
        return np.zeros(len(weights))
    return np.clip(weights @ (*find(counts), 1.0), -1.0, 1.0)
