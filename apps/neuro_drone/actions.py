"""What an agent may say, and the two commands in [-1, 1] that it means."""

from __future__ import annotations

from collections.abc import Callable
from math import isfinite
from operator import index
from typing import Any

import gymnasium
import numpy as np

from neuro import ModelError

__all__ = ["ACTIONS", "continuous", "discrete", "model"]

ACTIONS = (
    (-1.0, 0.0), (1.0, 0.0), (0.0, -1.0), (0.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (1.0, 1.0), (-1.0, 1.0), (0.0, 0.0),
)  # fmt: skip
"""Left, right, forward, backwards, northeast, northwest, southeast, southwest, nothing; forward is up the picture.

For the line "forward" (north) is turn left and "backwards" (south) turn right. Source: thesis, section 7.3.5.
"""

Commands = tuple[float, float]


def continuous(action: Any) -> Commands:
    """Two numbers; what is beyond [-1, 1] is taken for the nearest of its ends, as a motor does.

    Raises:
        ModelError: not two finite numbers.
    """
    try:
        a, b = action.tolist() if isinstance(action, np.ndarray) else action
        a, b = float(a), float(b)
    except (TypeError, ValueError):
        raise ModelError(f"action {_shown(action)}: expected two numbers in [-1, 1]") from None
    if not (isfinite(a) and isfinite(b)):
        raise ModelError(f"action [{a:g}, {b:g}]: expected two numbers in [-1, 1]")
    return max(-1.0, min(1.0, a)), max(-1.0, min(1.0, b))


def discrete(action: Any) -> Commands:
    """One of the nine.

    Raises:
        ModelError: not a whole number from 0 to 8.
    """
    try:
        number = index(action)
    except TypeError:
        number = -1
    if not 0 <= number < len(ACTIONS):
        raise ModelError(f"action {_shown(action)}: expected a whole number from 0 to {len(ACTIONS) - 1}")
    return ACTIONS[number]


def model(kind: str) -> tuple[gymnasium.Space[Any], Callable[[Any], Commands]]:
    """The space of actions of a kind, continuous or discrete, and what turns one into commands."""
    if kind == "continuous":
        return gymnasium.spaces.Box(-1.0, 1.0, (2,), np.float32), continuous
    return gymnasium.spaces.Discrete(len(ACTIONS)), discrete


def _shown(action: Any) -> str:
    shape = getattr(action, "shape", ())
    return f"of shape {list(shape)}" if shape else repr(action)
