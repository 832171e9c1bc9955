"""The 8 x 8 fields of the picture: where they look, and which of them speak for which direction."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from neuro_drone.geometry import AIM
from neuro_drone.parts import Ball, Line
from neuro_drone.scenario import Scenario

__all__ = ["AWAY", "DOWN", "RIGHT", "UNIT", "pattern", "shares"]

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
