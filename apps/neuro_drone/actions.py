"""What an agent may say, and the commands in [-1, 1], one an axis, that it means."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from math import isfinite
from operator import index
from typing import Any

import gymnasium
import numpy as np

from neuro import ModelError

__all__ = ["ACTIONS", "SPACE", "continuous", "discrete", "model"]

ACTIONS = (
    (-1.0, 0.0), (1.0, 0.0), (0.0, -1.0), (0.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (1.0, 1.0), (-1.0, 1.0), (0.0, 0.0),
)  # fmt: skip
"""Left, right, forward, backwards, northeast, northwest, southeast, southwest, nothing; forward is up the picture.

For the line "forward" (north) is turn left and "backwards" (south) turn right. Source: thesis, section 7.3.5.
"""

SPACE = (*((a, b, 0.0) for a, b in ACTIONS), (0.0, 0.0, 1.0), (0.0, 0.0, -1.0))
"""The same of three axes, and then up and down."""

COUNTS = {2: "two", 3: "three"}
Commands = tuple[float, ...]


def continuous(action: Any, axes: int = 2) -> Commands:
    """A number an axis; what is beyond [-1, 1] is taken for the nearest of its ends, as a motor does.

    Raises:
        ModelError: not so many finite numbers.
    """
    try:
        said = [float(one) for one in (action.tolist() if isinstance(action, np.ndarray) else action)]
    except (TypeError, ValueError):
        said = []
    if len(said) != axes or not all(map(isfinite, said)):
        shown = f"[{', '.join(f'{one:g}' for one in said)}]" if len(said) == axes else _shown(action)
        raise ModelError(f"action {shown}: expected {COUNTS[axes]} numbers in [-1, 1]")
    return tuple([max(-1.0, min(1.0, one)) for one in said])


def discrete(action: Any, axes: int = 2) -> Commands:
    """One of the nine, of three axes of eleven.

    Raises:
        ModelError: not a whole number from 0 to 8, or 10.
    """
    known: Sequence[Commands] = ACTIONS if axes == 2 else SPACE
    try:
        number = index(action)
    except TypeError:
        number = -1
    if not 0 <= number < len(known):
        raise ModelError(f"action {_shown(action)}: expected a whole number from 0 to {len(known) - 1}")
    return known[number]


def model(kind: str, axes: int = 2) -> tuple[gymnasium.Space[Any], Callable[[Any], Commands]]:
    """The space of actions of a kind, continuous or discrete, and what turns one into commands.

    Args:
        kind: continuous or discrete.
        axes: 2, or 3 of a drone that also climbs.
    """
    if kind == "continuous":
        return gymnasium.spaces.Box(-1.0, 1.0, (axes,), np.float32), partial(continuous, axes=axes)
    return gymnasium.spaces.Discrete(len(ACTIONS if axes == 2 else SPACE)), partial(discrete, axes=axes)


def _shown(action: Any) -> str:
    shape = getattr(action, "shape", ())
    return f"of shape {list(shape)}" if shape else repr(action)
