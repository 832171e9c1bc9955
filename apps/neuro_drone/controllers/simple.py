"""Controllers without a network: one that does nothing, one that sees the truth, one that averages."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from math import atan, pi, sqrt
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro_drone.controllers.fields import DOWN, RIGHT, UNIT
from neuro_drone.controllers.settings import each_axis, numbers
from neuro_drone.parts import Ball, Line
from neuro_drone.scenario import Scenario

__all__ = ["Centroid", "Fixed", "Gain", "Nothing", "NothingSettings", "Oracle", "centroid", "finder"]

Floats = npt.NDArray[np.float64]
_X, _Y = RIGHT.ravel(), DOWN.ravel()
FIELD = 16.0 / UNIT
"""Side of a field; events anywhere in it spread by a twelfth of its square on each axis."""


class Fixed:
    """A controller that keeps nothing between two steps."""

    def begin(self) -> None:
        """Nothing to do."""

    def learn(self, info: Mapping[str, Any]) -> None:
        """It does not learn."""


@dataclass(frozen=True, slots=True)
class NothingSettings:
    """It has none."""


class Nothing(Fixed):
    """Never moves; what it scores, a world gives for free."""

    def __init__(self, scenario: Scenario, seed: int, settings: NothingSettings) -> None:
        self._action = np.zeros(scenario.axes)

    def act(self, counts: npt.NDArray[Any], info: Mapping[str, Any]) -> Floats:
        """No action."""
        return self._action


@dataclass(frozen=True, slots=True)
class Gain:
    """What a proportional controller is told.

    Attributes:
        gain: action by error, where an error of 1 is half of the picture (64 px), of a line's lean 90 degrees, of a
            ball's size as much as it shall have.
    """

    gain: float | tuple[float, ...] = numbers(8.0, above=0)


class Oracle(Fixed):
    """In proportion to the true error, which no camera tells; it bounds what the others can reach."""

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


def finder(scenario: Scenario) -> Callable[[npt.NDArray[Any]], Floats]:
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
