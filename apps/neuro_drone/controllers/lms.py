"""A linear read-out of the counts, learnt by least mean squares."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from neuro_drone.controllers.fields import shares
from neuro_drone.controllers.settings import choice, each_axis, number, numbers
from neuro_drone.controllers.simple import Fixed
from neuro_drone.scenario import Scenario

__all__ = ["LMS", "LMSSettings"]

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class LMSSettings:
    """What the read-out is told.

    Attributes:
        gain: action by estimated error.
        mu: share of the estimate's error that a step takes away.
        coding: shares, rows or peaks, see `fields.shares`.
    """

    gain: float | tuple[float, ...] = numbers(8.0, above=0)
    mu: float = number(0.02, at_least=0)
    coding: str = choice("shares", "shares", "rows", "peaks")


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
