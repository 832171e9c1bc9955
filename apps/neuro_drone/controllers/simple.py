"""Controllers without a spiking network: `Nothing`, `Oracle`, `Centroid`, and the learners `LMS` and `RandomSearch`.

`LMS` learns a linear readout of the counts by least mean squares. `RandomSearch` learns a linear policy from the reward
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
    """Base class of controllers' settings. A `gain` is a number for all axes or a list with a number per axis.

    Attributes:
        name: name of the controller, for messages.
    """

    name: str = field(default="", kw_only=True, metadata={"fixed": True})

    def place(self) -> str:
        """Return "controller 'NAME'", for messages."""
        return f"controller '{self.name}'"

    def checked(self, one: Field[Any], q: Quantity, value: Any, what: str) -> Any:
        """Return the checked value of a setting, or the tuple of a `gain`; see `Settings.checked`."""
        if one.name != "gain":
            return super().checked(one, q, value, what)
        if isinstance(value, (list, tuple)) and len(value) in (2, 3):
            return tuple(check(q, number, f"{what}[{k}]") for k, number in enumerate(value))
        try:
            return super().checked(one, q, value, what)
        except ModelError as error:
            raise ModelError(f"{error.message} or a list of two or three, one per axis", hint=error.hint) from None


def each_axis(name: str, value: float | tuple[float, ...], axes: int) -> npt.NDArray[np.float64]:
    """Return the value of a setting for each axis, (axes,).

    Args:
        name: name of the setting, for messages.
        value: value of the setting.
        axes: number of axes of the scenario.

    Raises:
        ModelError: the length of a list differs from the number of axes.
    """
    if isinstance(value, tuple) and len(value) != axes:
        raise ModelError(f"{name} = {list(value)}: expected a number or a list of {axes}, one per axis")
    return np.broadcast_to(np.asarray(value, float), axes)


UNIT = 64.0
"""Pixels of an error of 1: half of the picture."""

_MIDDLES = (16.0 * np.arange(8) + 7.5 - AIM) / UNIT
RIGHT: npt.NDArray[np.float64] = np.tile(_MIDDLES, (8, 1))
"""(8, 8), distance of each field's centre to the right of the aim, in units of 64 px."""
DOWN: npt.NDArray[np.float64] = np.ascontiguousarray(RIGHT.T)
"""(8, 8), distance of each field's centre below the aim, in units of 64 px."""

AWAY: npt.NDArray[np.float64] = np.hypot(RIGHT, DOWN)
"""(8, 8), distance of each field's centre from the aim, in units of 64 px."""


def shares(counts: npt.NDArray[Any], coding: str) -> npt.NDArray[np.float64]:
    """Normalise the events of the fields.

    Args:
        counts: (8, 8) events in each field.
        coding: the total that a field's events are divided by.

            - "shares": all events.
            - "rows": the events of the field's row, times 8. A line crosses all rows, and its position and lean follow
              from its mean position in each row, whatever the row's number of events.
            - "peaks": as shares, after twice the mean of all fields is subtracted from each field. Textured ground
              makes events in all fields, a target makes them in few fields.

    Returns:
        (64,), with sum 1. Rows without events are 0. All fields are 0 if there are no events or no peaks.
    """
    if coding == "peaks":
        counts = np.maximum(counts - 2.0 * counts.mean(), 0.0)
    normalised: npt.NDArray[np.float64]
    if coding == "rows":
        n = counts.sum(axis=1, keepdims=True) * len(counts)
        normalised = counts / np.where(n > 0, n, 1)
    else:
        normalised = counts / (counts.sum() or 1)
    return normalised.ravel()


def pattern(scenario: Scenario, shape: str) -> npt.NDArray[np.float64]:
    """Return hand-set preferences of the fields for the positive direction of each axis.

    Args:
        scenario: the scenario. The axes of a ball are right, down and, if the drone climbs, up. On the axis up, a field
            outside the outline of a ball of target height is positive. The axes of a line are right and lean. On the
            axis lean, a field right above or left below the aim is positive.
        shape: "sign" (only the side of the field counts) or "linear" (proportional to the distance).

    Returns:
        (64, axes), in [-1, 1].

    Source: thesis, section 7.3.8 ("static weights set with human knowledge"), which prints no values.
    """
    second = -RIGHT * DOWN if isinstance(scenario.task, Line) else DOWN
    axes = [RIGHT, second]
    if scenario.axes == 3 and isinstance(scenario.task, Ball):
        axes.append(AWAY - 0.5 * scenario.task.tall / UNIT)
    distance = np.stack([axis.ravel() for axis in axes], axis=1)
    return np.sign(distance) if shape == "sign" else distance / np.abs(distance).max(axis=0)


Floats = npt.NDArray[np.float64]
Find = Callable[[npt.NDArray[Any]], Floats]
_X, _Y = RIGHT.ravel(), DOWN.ravel()
FIELD = 16.0 / UNIT
"""Width of a field in units of 64 px. Events at random positions in a field have a variance of FIELD^2 / 12 on each
axis."""


class Fixed:
    """Base class of controllers without state and without learning."""

    def begin(self) -> None:
        """Do nothing."""

    def learn(self, info: Mapping[str, Any]) -> None:
        """Learn nothing."""


@dataclass(frozen=True)
class NothingSettings(ControllerSettings):
    """The controller that does nothing has no settings."""


class Nothing(Fixed):
    """A controller that never moves: the baseline of a scenario."""

    def __init__(self, scenario: Scenario, seed: int, settings: NothingSettings) -> None:
        self._action = np.zeros(scenario.axes)

    def act(self, counts: npt.NDArray[Any], info: Mapping[str, Any]) -> Floats:
        """Return the zero action."""
        return self._action


@dataclass(frozen=True)
class Gain(ControllerSettings):
    """Settings of a proportional controller.

    Attributes:
        gain: action per error. An error of 1 is half of the picture (64 px), 90 degrees of a line's lean, or the target
            height of a ball's picture.
    """

    gain: float | tuple[float, ...] = setting(8.0, above=0)


class Oracle(Fixed):
    """A proportional controller of the true error, which no camera sees: the upper bound for other controllers."""

    def __init__(self, scenario: Scenario, seed: int, settings: Gain) -> None:
        self._gain = each_axis("gain", settings.gain, scenario.axes)

    def act(self, counts: npt.NDArray[Any], info: Mapping[str, Any]) -> Floats:
        """Return the gain times the error, clipped to [-1, 1]."""
        error: Floats = info["supervised_error"]
        return np.clip(self._gain * error, -1.0, 1.0)


class Centroid(Fixed):
    """A proportional controller of the error that `centroid` estimates.

    For a ball, the error is the mean position of the events. For a line, a straight line is fitted to the events.

    With three axes, the spread of the events around their mean estimates the size of the ball's outline.
    """

    def __init__(self, scenario: Scenario, seed: int, settings: Gain) -> None:
        self._gain = each_axis("gain", settings.gain, scenario.axes)
        self._find = finder(scenario)

    def act(self, counts: npt.NDArray[Any], info: Mapping[str, Any]) -> Floats:
        """Return the gain times the estimated error, clipped to [-1, 1]; 0 without events."""
        return np.clip(self._gain * self._find(counts), -1.0, 1.0)


def finder(scenario: Scenario) -> Find:
    """Return `centroid` with the arguments for a scenario: a function from counts to the error on each axis."""
    task = scenario.task
    tall = task.tall / UNIT if isinstance(task, Ball) and task.axes == 3 else None
    return partial(centroid, line=isinstance(task, Line), tall=tall)


def centroid(counts: npt.NDArray[Any], line: bool = False, tall: float | None = None) -> Floats:
    """Estimate the error on each axis from the mean position of the events.

    Args:
        counts: (8, 8) events in each field.
        line: True fits a straight line.
        tall: target height of a ball's picture, in units of 64 px, if the drone climbs.

    Returns:
        (2,) for a ball: distance of the mean to the right of the aim and below it, in units of 64 px. (2,) for a line:
        distance to the right of the aim at which the fitted line crosses the aim's row, in units of 64 px, and its lean
        to the right in units of 90 degrees. (3,) if the drone climbs: as for a ball, then the excess height of the
        ball's picture as a share of the target height, for events on the ball's outline. All are 0 without events.
    """
    n = counts.ravel()
    total = n.sum()
    if total == 0:
        return np.zeros(2 if tall is None else 3)
    x, y = n @ _X / total, n @ _Y / total
    if tall is not None:
        variance = float(n @ (_X**2 + _Y**2) / total) - x * x - y * y  # sum over both axes
        return np.array((x, y, 2.0 * sqrt(max(0.0, variance - 2.0 * FIELD**2 / 12.0)) / tall - 1.0))
    if not line:
        return np.array((x, y))
    squares = n @ (_Y - y) ** 2
    slope = n @ ((_X - x) * (_Y - y)) / squares if squares > 0.0 else 0.0
    return np.array((x - slope * y, -atan(slope) / (0.5 * pi)))


@dataclass(frozen=True)
class LMSSettings(ControllerSettings):
    """Settings of the readout.

    Attributes:
        gain: action per estimated error.
        mu: share of the estimate's error that a step removes.
        coding: shares, rows or peaks, see `shares`.
    """

    gain: float | tuple[float, ...] = setting(8.0, above=0)
    mu: float = setting(0.02, at_least=0)
    coding: str = setting("shares", words=("shares", "rows", "peaks"))


class LMS(Fixed):
    """A proportional controller of the error that a linear readout of the fields estimates.

    The inputs and the supervised error are those of the spiking network. The difference in performance is the cost of
    spikes and of a local learning rule.

    Source: B. Widrow and M. E. Hoff, "Adaptive switching circuits", IRE WESCON, 1960, in its normalised form.
    """

    def __init__(self, scenario: Scenario, seed: int, settings: LMSSettings, learns: bool = True) -> None:
        self._settings, self._learns = settings, learns
        self._arguments = (scenario, seed)
        self._gain = each_axis("gain", settings.gain, scenario.axes)
        self._weights = np.zeros((scenario.axes, 64))
        self._shares = np.zeros(64)

    def begin(self) -> None:
        """Clear the last input."""
        self._shares = np.zeros(64)

    def act(self, counts: npt.NDArray[Any], info: Mapping[str, Any]) -> Floats:
        """Return the gain times the estimated error, clipped to [-1, 1]; 0 without events."""
        self._shares = shares(counts, self._settings.coding)
        return np.clip(self._gain * (self._weights @ self._shares), -1.0, 1.0)

    def learn(self, info: Mapping[str, Any]) -> None:
        """Reduce the difference between the supervised error and the estimate by the share `mu`."""
        x = self._shares
        power = x @ x
        if self._learns and power > 0.0:
            difference = info["supervised_error"] - self._weights @ x
            self._weights += np.outer(self._settings.mu / power * difference, x)

    def learnt(self) -> dict[str, npt.NDArray[Any]]:
        """Return the weights, (axes, 64)."""
        return {"weights": self._weights.copy()}

    def state(self) -> dict[str, npt.NDArray[Any]]:
        """Return the weights, which are the whole state at the beginning of an episode."""
        return self.learnt()

    def restore(self, state: Mapping[str, npt.NDArray[Any]]) -> None:
        """Restore the weights."""
        self._weights = np.array(state["weights"])

    def frozen(self) -> LMS:
        """Return a copy that does not learn."""
        copy = LMS(*self._arguments, self._settings, learns=False)
        copy.restore(self.learnt())
        return copy


@dataclass(frozen=True)
class RandomSearchSettings(ControllerSettings):
    """Settings of the search.

    Attributes:
        directions: random directions per update; each takes two episodes, one with each sign.
        best: number of directions that an update uses, those with the best episodes.
        noise: factor on a direction before it is added to the weights.
        rate: step size of an update.
    """

    directions: int = setting(8, at_least=1)
    best: int = setting(4, at_least=1)
    noise: float = setting(1.0, above=0)
    rate: float = setting(1.0, above=0)


class LinearPolicy(Fixed):
    """A policy that is linear in the centroid of the events, with a constant; the action is 0 without events.

    Args:
        weights: (axes, axes + 1), weights of the estimated errors, and the constant.
        find: function from counts to estimated errors, see `finder`.
    """

    def __init__(self, weights: Floats, find: Find) -> None:
        self._weights, self._find = weights, find

    def act(self, counts: npt.NDArray[Any], info: Mapping[str, Any]) -> Floats:
        """Return the action for the counts, (axes,), in [-1, 1]."""
        return linear(self._weights, counts, self._find)


class RandomSearch:
    """Augmented random search, version V1-t, of a linear policy.

    Two episodes test each random direction: the first adds the direction to the weights, the second subtracts it. After
    all directions, the weights move along the best directions. The movement along a direction is proportional to the
    difference between the returns of its two episodes, in units of the standard deviation of the best directions'
    returns.

    The inputs are those of the controller `centroid`. Learning uses `info["reward"]`, never the supervised error.

    Args:
        scenario: scenario of the flights.
        seed: seed of the directions.
        settings: see `RandomSearchSettings`.

    Source: H. Mania, A. Guy and B. Recht, "Simple random search of static linear policies is competitive for
        reinforcement learning", NeurIPS 2018, algorithms 1 and 2 (V1-t).

    Raises:
        ModelError: `best` is more than `directions`.
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
        self._trial_weights = self._weights
        self._draw_directions()

    def _draw_directions(self) -> None:
        """Draw the directions of the next update."""
        n = self._settings.directions
        self._directions = self._rng.standard_normal((n, *self._weights.shape))
        self._returns = np.zeros((n, 2))
        self._episode, self._has_steps = -1, True

    def begin(self) -> None:
        """Begin an episode with the weights of the next trial; update the weights after the last trial.

        If the previous episode had no step, its trial is repeated.
        """
        if self._has_steps:
            self._episode, self._has_steps = self._episode + 1, False
        if self._episode == self._returns.size:
            self._update()
            self._draw_directions()
            self._episode, self._has_steps = 0, False
        direction, is_second = divmod(self._episode, 2)
        self._returns[direction, is_second] = 0.0
        self._trial_weights = self._weights + (1 - 2 * is_second) * self._settings.noise * self._directions[direction]

    def act(self, counts: npt.NDArray[Any], info: Mapping[str, Any]) -> Floats:
        """Return the action of the trial's weights."""
        return linear(self._trial_weights, counts, self._find)

    def learn(self, info: Mapping[str, Any]) -> None:
        """Add the reward to the episode's return."""
        self._returns[divmod(self._episode, 2)] += info["reward"]
        self._has_steps = True

    def _update(self) -> None:
        """Move the weights along the best directions."""
        best = np.argsort(-self._returns.max(axis=1), kind="stable")[: self._settings.best]
        returns = self._returns[best]
        deviation = returns.std()
        if deviation > 0.0:
            steps = np.tensordot(returns[:, 0] - returns[:, 1], self._directions[best], 1)
            self._weights = self._weights + self._settings.rate / (len(best) * deviation) * steps

    def learnt(self) -> dict[str, npt.NDArray[Any]]:
        """Return the weights, (axes, axes + 1), see `LinearPolicy`."""
        return {"weights": self._weights.copy()}

    def state(self) -> dict[str, npt.NDArray[Any]]:
        """Return the weights, the directions with their returns, and the state of the random generator."""
        counters = {"episode": self._episode, "flown": self._has_steps, "rng": self._rng.bit_generator.state}
        return self.learnt() | {
            "directions": self._directions,
            "returns": self._returns.copy(),
            "words": np.frombuffer(json.dumps(counters).encode(), np.uint8),
        }

    def restore(self, state: Mapping[str, npt.NDArray[Any]]) -> None:
        """Restore weights or a whole state."""
        self._weights = np.array(state["weights"])
        if "words" in state:
            counters = json.loads(state["words"].tobytes())
            self._directions, self._returns = np.array(state["directions"]), np.array(state["returns"])
            self._episode, self._has_steps = counters["episode"], counters["flown"]
            self._rng.bit_generator.state = counters["rng"]

    def frozen(self) -> LinearPolicy:
        """Return the policy of the current weights."""
        return LinearPolicy(self._weights.copy(), self._find)


def linear(weights: Floats, counts: npt.NDArray[Any], find: Find) -> Floats:
    """Return the action of a linear policy, see `LinearPolicy`."""
    if not counts.any():
        return np.zeros(len(weights))
    return np.clip(weights @ (*find(counts), 1.0), -1.0, 1.0)
