"""Controllers without a network: one that does nothing, one that sees the truth, one that averages."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import atan, pi
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro_drone.controllers.fields import DOWN, RIGHT
from neuro_drone.controllers.settings import numbers
from neuro_drone.parts import Line
from neuro_drone.scenario import Scenario

__all__ = ["Centroid", "Fixed", "Gain", "Nothing", "NothingSettings", "Oracle", "centroid"]

Floats = npt.NDArray[np.float64]
_X, _Y = RIGHT.ravel(), DOWN.ravel()


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
        self._action = np.zeros(2)

    def act(self, counts: npt.NDArray[Any], info: Mapping[str, Any]) -> Floats:
        """No action."""
        return self._action


@dataclass(frozen=True, slots=True)
class Gain:
    """What a proportional controller is told.

    Attributes:
        gain: action by error, where an error of 1 is half of the picture (64 px), of a line's lean 90 degrees.
    """

    gain: float | tuple[float, float] = numbers(8.0, above=0)


class Oracle(Fixed):
    """In proportion to the true error, which no camera tells; it bounds what the others can reach."""

    def __init__(self, scenario: Scenario, seed: int, settings: Gain) -> None:
        self._gain = np.broadcast_to(np.asarray(settings.gain), 2)

    def act(self, counts: npt.NDArray[Any], info: Mapping[str, Any]) -> Floats:
        """The action of a proportional controller."""
        error: Floats = info["supervised_error"]
        return np.clip(self._gain * error, -1.0, 1.0)


class Centroid(Fixed):
    """In proportion to the mean place of the events, of a line to the straight line that fits them best."""

    def __init__(self, scenario: Scenario, seed: int, settings: Gain) -> None:
        self._gain = np.broadcast_to(np.asarray(settings.gain), 2)
        self._line = isinstance(scenario.task, Line)

    def act(self, counts: npt.NDArray[Any], info: Mapping[str, Any]) -> Floats:
        """The action of a proportional controller on what the counts tell; none where there are no events."""
        return np.clip(self._gain * centroid(counts, self._line), -1.0, 1.0)


def centroid(counts: npt.NDArray[Any], line: bool = False) -> Floats:
    """Where the events are on average.

    Args:
        counts: (8, 8) events in each field.
        line: they are those of a line.

    Returns:
        (2,), to the right of the aim and below it, in units of 64 px; of a line where the one that fits best crosses
        the aim's row, and its lean to the right over 90 degrees. 0 where there are no events.
    """
    n = counts.ravel()
    total = n.sum()
    if total == 0:
        return np.zeros(2)
    x, y = n @ _X / total, n @ _Y / total
    if not line:
        return np.array((x, y))
    spread = n @ (_Y - y) ** 2
    slope = n @ ((_X - x) * (_Y - y)) / spread if spread > 0.0 else 0.0
    return np.array((x - slope * y, -atan(slope) / (0.5 * pi)))
